"""The most probable unknowns of a record, its noise's colour estimated with them, and the log evidence.

Minimised is S(z) = sum over bands (n + p)/2 log((Q(z) + p)/(n + p)) - log prior(z): the residuals' likelihood with the
densities of the noise integrated out (`noise_bands`), and the prior of the unknowns. A Gauss-Newton step takes the
densities as they are at the point; since log is concave, a step that decreases the quadratic decreases S. Damping is
in the prior's metric (`computing.gauss_newton`). The log evidence is Laplace's, -S - log det(J'J + P)/2, P the prior's
curvature.

Where what is left is far above the densest noise that there can be, the data's part outweighs the prior so much that a
step of a model which is only linear nearby goes hundreds of tolerances along what the record hardly tells, and the way
back is long. The data's part is then divided by a heat: at first what brings it to the size of noise, and less from
round to round, one at the end (the iteratively regularised Gauss-Newton method: Bakushinskii, Comput. Math. Math. Phys.
32, 1992, 1353-1359).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.gauss_newton import (
    Damping,
    DescentSettings,
    add_outer,
    bounded_step,
    descend,
    linear_change,
    log_evidence,
    normal_equations,
)
from msl_fem.diagnosis.likelihood import (
    CONVERGED,
    Columns,
    Fit,
    Likelihood,
    numbers_and_starts,
    put_columns,
)
from msl_fem.diagnosis.noise import NoiseWeights
from msl_fem.diagnosis.problem import Points, Starts
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import ComputationError

STALE = 0.6
"""Share of the predicted decrease that a step has to bring for the nuisances' columns to be kept."""
MISLED = 0.1
"""The same where columns need not be those of the fit's end."""
STEPS_A_ROUND = 8
FIRST_LOOK = 2
"""Steps that tell whether more are worth it: of a candidate, and of a fit that is to come to some log evidence."""
MOST_IDLE_ROUNDS = 2
"""Rounds in a row that bring nothing: beside a model that cannot follow, moved starts raise what steps lower."""
HOT = 100.0
"""Mean square of residuals over their noise at its loudest, above which a fit over stretches begins with a heat."""
STILL_HOT = 10.0
"""The same beyond `SANE` where the heat has gone, above which a cause is missing for good."""
WARM = 2.0
"""Heat below which a fit that began with one goes on without."""
COOLING = 10.0
"""Times, at least, by which the heat of a round is less than that of the one before."""
CARRIED = 1e-2, 1e2
"""Damping, least and most, with which a round goes on after another one in a fit that began with a heat; in others it
is one at most, since a kink that has raised it may be behind the new starts."""
STUCK = 3
"""Trials at least, none of which leads down, behind which a fit is stuck: in a narrow valley the first few do not, and
with more damping it goes on."""
SANE = 20.0
"""Tolerances beyond which no number of a model without effects is what it says: a cause is missing."""
SHORT_WAY = 2
"""Rounds in which a fit that does not go on with a heat comes to an end, or back to numbers that a plant can have."""
WORTH = 0.05
"""Share of its nats that a round has to bring a model without effects beyond `SANE`, to be worth a further one."""
RESTARTED = 0.2
"""Nats by which moving the starts of stretches may change a fit that has converged."""
AS_GOOD = 3e-3
"""Of the prior's sigma: a start that lies no farther from where a linear model leaves least is as good; ten times
farther, a stretch over which errors grow tells the difference."""
WORN = 50.0
"""Nats that a round brings, behind which the nuisances' columns are of a place too far away."""
NEARLY_AS_GOOD, TELLS = 0.03, 10.0
"""The same of a point that is so many nats above that of the step before, and will not come below it."""
MOST_LED = 3  # times that starts are moved at a point
LED = 0.01  # of what a step has brought, that moving them has to bring to be worth another time
TINY = 1e-300  # square of a move that is none


@dataclass(frozen=True)
class FitPlan:
    """How a fit goes.

    Attributes
    ----------
    most_steps : accepted or not
    damping : the first mu
    enough : nats that a further step would gain, at which it ends
    share : of what is above white noise as loud as the instruments show it, that is enough where it is more
    until : log evidence that ends it
    little : nats that a further step promises, below which some that fail in a row end a round
    renew : whether the nuisances' columns may be computed anew; they are where a step brings less than it promised
    heats : whether it goes on where it has to begin with a heat, and where `SHORT_WAY` rounds lead beyond `SANE`
    fresh_begin, fresh_end : whether they, and all others, are those of the point where the fit goes on, and ends
    tell : is told at every model of the objective what a further step promises
    """

    most_steps: int = 60
    damping: float = 1.0
    enough: float = CONVERGED
    share: float = 0.0
    until: float = np.inf
    little: float = 0.0
    renew: bool = True
    heats: bool = True
    fresh_begin: bool = False
    fresh_end: bool = True
    tell: Callable[[str], None] | None = None


def fit(
    likelihood: Likelihood,
    unknowns: Unknowns,
    start: Array,
    *,
    plan: FitPlan | None = None,
    nuisance_columns: Slopes | None = None,
    goes_on: Fit | None = None,
    takes_columns: bool = False,
) -> Fit:
    """The most probable unknowns next to a start.

    Parameters
    ----------
    nuisance_columns : (n_number, n_nuisance) known from a neighbouring fit; None: they are computed
    goes_on : a fit of this likelihood and these unknowns that has ended at the start, with its columns; None: there is
        none, and what it knows is computed
    takes_columns : whether that fit's columns become those of this one, and are its own no more: they are large

    Raises
    ------
    ComputationError : the simulation fails at the start
    """
    rounds = _Rounds(likelihood, unknowns, plan or FitPlan(), unknowns.allowed(start))
    rounds.known, rounds.begun, rounds.free = nuisance_columns, goes_on, goes_on if takes_columns else None
    for n in range(1, len(rounds.trials) + 1):
        come_to = rounds.descended(n)
        if not rounds.goes_on(n, come_to):
            break
    return replace(come_to.found, sane=rounds.sane)


def fit_there(likelihood: Likelihood, unknowns: Unknowns, z: Array, jacobian: Slopes) -> Fit:
    """A fit that has not gone anywhere yet: at numbers where the columns of all unknowns are known."""
    posterior = _FitPosterior(likelihood, unknowns, FitPlan())
    point = posterior.at(z)
    return _fit_at(posterior, point, posterior.linearised(point, jacobian), posterior.simulations, FitPlan.damping)


def with_the_rest(found: Fit, unknowns: Unknowns, z: Array) -> float:
    """The least S of a linear model, its columns those of a fit, when amounts are what they are at z, of unknowns with
    theirs behind the fit's, and all that the fit knows of moves to suit them; inf where that cannot be simulated."""
    likelihood = found.likelihood
    residual = likelihood.spectra(Points.of(unknowns, z[None]))[0].copy()
    if not np.isfinite(residual).all():
        return np.inf
    weights = likelihood.weights(residual, unknowns)
    point = _FitPoint(found.z, residual, weights, weights.nats + unknowns.prior(z)[0])
    return point.objective - _FitModel(found.unknowns, point, found.jacobian, stale=True).promised


def _reached(posterior: "_FitPosterior", point: "_FitPoint", model: "_FitModel") -> bool:
    """Whether a fit has come to the log evidence that it is to."""
    until = posterior.plan.until
    return until < np.inf and posterior.heat == 1.0 and log_evidence(point.objective, model.precision) > until


def beyond_sanity(unknowns: Unknowns, z: Array) -> bool:
    """Whether a model without effects makes up for a cause that it lacks by numbers that nothing can have."""
    n = len(unknowns.believed) + unknowns.n_table
    return not unknowns.effects and bool(np.any(np.abs(z[:n]) > SANE))


def _point_of(found: Fit) -> "_FitPoint":
    """Where a fit has ended."""
    return _FitPoint(found.z, found.residual, found.weights, found.objective, nearer=found.nearer)


def _fit_at(
    posterior: "_FitPosterior", point: "_FitPoint", model: "_FitModel", simulations: int, damping: float
) -> Fit:
    """What a fit is at a point, from which it would go on with that damping."""
    likelihood = posterior.likelihood
    return Fit(
        model.unknowns,
        point.z,
        point.residual,
        Columns(model.jacobian, model.gram),
        point.weights,
        point.objective,
        log_evidence(point.objective, model.precision),
        model.promised,
        simulations,
        likelihood if point.starts is None else likelihood.starting(point.starts),
        damping=damping,
        next_step=model.step(damping)[1],
        nearer=point.nearer,
        start_slopes=posterior.start_slopes,
        stale=model.stale,
    )


def _trials(likelihood: Likelihood, how: FitPlan) -> list[int]:
    """Steps of each round of a fit; between rounds the starts of stretches are moved to where the fit is."""
    look = [min(FIRST_LOOK, how.most_steps)] if how.until < np.inf else []
    rest = how.most_steps - sum(look)
    if not likelihood.is_cut:
        return [*look, rest] if rest else look
    each = STEPS_A_ROUND // 2 if look else STEPS_A_ROUND
    whole, over = divmod(rest, each)
    return look + [each] * whole + ([over] if over else [])


@dataclass(frozen=True, eq=False)
class _FitPoint:
    """Unknowns with their residual, the noise's densities that suit it, and S; where stretches begin, None: where those
    of the likelihood do; and where they leave least to a linear model from there."""

    z: Array
    residual: Array
    weights: NoiseWeights
    objective: float
    starts: Starts | None = None
    nearer: Starts | None = None


def _loudness(point: "_FitPoint | Fit") -> float:
    """Mean square of the residuals over their noise at its loudest."""
    return float(np.mean((point.residual * point.weights.root) ** 2))


@dataclass(frozen=True, eq=False)
class _Round:
    """What a round has come to; `begin`, S where it began, `noise`, nats of noise there."""

    found: Fit
    ending: str
    steps: int
    damping: float
    heat: float
    begin: float
    noise: float


class _Rounds:
    """The rounds of a fit, and what each hands on to the next: where it has come to, columns that are known there, how
    it is damped and heated. Between them the starts of stretches are moved to where the fit is."""

    def __init__(self, likelihood: Likelihood, unknowns: Unknowns, how: FitPlan, z: Array) -> None:
        self.likelihood, self.unknowns, self.how, self.z = likelihood, unknowns, how, z
        self.trials = _trials(likelihood, how)
        self.damping = Damping(first=how.damping, least=1e-4, rise=1e-2, most=1e8)
        self.known: Slopes | None = None  # columns of the nuisances
        self.stale = True
        self.begun: Fit | None = None  # which has ended here, all columns known
        self.free: Fit | None = None  # whose columns nothing else looks at
        self.sane: Fit | None = None
        self.start_slopes: Starts = ()
        self.simulations, self.idle = 0, 0
        self.least, self.most_heat = np.inf, np.inf

    def descended(self, n: int) -> _Round:
        """The n-th round."""
        how, unknowns, trials = self.how, self.unknowns, self.trials[n - 1]
        posterior = _FitPosterior(
            self.likelihood, unknowns, how, self.start_slopes if self.begun is None else self.begun.start_slopes
        )
        first, model = self._first(posterior, n)
        noise = self.likelihood.nats_of_noise(unknowns, self.z) if how.share else 0.0
        if self.sane is None and posterior.heat > 1.0:
            cold = _fit_at(posterior, *posterior.cooled(first, model), self.simulations, self.damping.first)
            self.sane = cold
            if not how.heats:
                return _Round(cold, "too hot", 0, self.damping.first, posterior.heat, first.objective, noise)
            self.sane = replace(cold, columns=Columns(cold.jacobian.copy("F"), cold.columns.gram))  # the model goes on
        renewal = (STALE if how.fresh_end else MISLED) if how.renew else None
        settings = DescentSettings(
            self.damping, how.enough, how.share, trials, None, renewal, how.fresh_end, noise, how.little
        )
        end = descend(
            posterior, first, settings, first=model, further=posterior.further, reached=partial(_reached, posterior)
        )
        self.simulations, self.start_slopes = self.simulations + posterior.simulations, posterior.start_slopes
        found = _fit_at(posterior, *posterior.cooled(end.point, end.model), self.simulations, end.damping)
        found = replace(found, stuck=not end.steps and end.ending == "no more steps" and trials >= STUCK)
        if self.sane is not None and not beyond_sanity(unknowns, found.z):
            self.sane = found
        self.free = None if self.sane is found else found
        return _Round(found, end.ending, end.steps, end.damping, posterior.heat, first.objective, noise)

    def _first(self, posterior: "_FitPosterior", n: int) -> tuple["_FitPoint", "_FitModel"]:
        """The point and the model with which the n-th round begins."""
        begun = self.begun
        first = posterior.at(self.z) if begun is None else _point_of(begun)
        if not np.isfinite(first.residual).all():
            raise ComputationError("the simulation fails at the start of the fit")
        first = posterior.heated(first, self.most_heat, COOLING ** (len(self.trials) - n))
        if begun is not None:
            self.known, self.stale = None if self.how.fresh_begin and begun.stale else begun.jacobian, begun.stale
        if self.free is not None:
            posterior.takes(self.free.columns)
        return first, posterior.linearised(first, self.known, stale=self.stale)

    def goes_on(self, n: int, last: _Round) -> bool:
        """Whether a further round is worth it behind the n-th; it is made ready."""
        found = last.found
        if last.ending == "too hot" or found.log_evidence > self.how.until:
            return False
        if n == SHORT_WAY and not self.how.heats and beyond_sanity(self.unknowns, found.z):
            return False
        if not self.likelihood.is_cut:
            self.begun, self.damping = found, replace(self.damping, first=last.damping)
            return n < len(self.trials) and last.ending == "no more steps"
        self.begun, self.stale = None, found.stale
        far = self.how.renew and found.stale and last.begin - found.objective > WORN
        kept = last.heat == 1.0 and not far
        self.known = found.jacobian[:, : self.unknowns.n_nuisance] if kept else None
        if last.ending == "no more steps" and not last.steps:  # next to a table's end only shorter ones lead anywhere
            self.damping = replace(self.damping, first=self.damping.first * self.damping.factor ** self.trials[n - 1])
            return True
        if n == len(self.trials) or (n > 1 and last.ending == "converged" and not last.steps):
            return False  # starts suit this very point
        nearer = found.likelihood.followed(self.unknowns, found.z)
        again = nearer.objective(self.unknowns, found.z)
        self.most_heat = last.heat / COOLING
        if (last.heat == 1.0 and not self._worth(last, again)) or not np.isfinite(again):
            return False
        self.likelihood, self.z = nearer, found.z
        most = CARRIED[1] if self.sane else 1.0
        self.damping = replace(self.damping, first=float(np.clip(last.damping, CARRIED[0], most)))
        return True

    def _worth(self, last: _Round, again: float) -> bool:
        """Whether more may come of a fit without heat, its starts moved: S is `again` with them."""
        how, objective = self.how, last.found.objective
        alike = max(RESTARTED, how.enough, how.share * (objective - last.noise))
        if last.ending in {"converged", "in vain"} and abs(again - objective) < alike:
            return False
        worth, lost = how.enough, self.sane is not None and beyond_sanity(self.unknowns, last.found.z)
        if lost and _loudness(last.found) > STILL_HOT:
            return False
        if lost and self.least < np.inf:
            worth = max(worth, WORTH * self.least)
        self.idle = 0 if objective < self.least - worth else self.idle + 1
        self.least = min(self.least, objective)
        return self.idle < MOST_IDLE_ROUNDS


class _FitModel:
    """S near a point: the densities of the noise as they are there, the residual linear."""

    def __init__(
        self, unknowns: Unknowns, point: _FitPoint, jacobian: Slopes, *, stale: bool, threads: int = 1
    ) -> None:
        self.unknowns, self.point = unknowns, point
        self.jacobian, self.stale = jacobian, stale
        _, prior_slope, self.curvature = unknowns.prior(point.z)
        self.gram, slope = normal_equations(jacobian, point.weights.root, point.residual, threads=threads)
        self.slope = slope + prior_slope
        self.bounds = _bounds(unknowns) - point.z
        self.promised = self.step(-1.0)[1]

    def step(self, damping: float) -> tuple[Array, float]:
        """(the step within the bounds, nats that it promises); -1 for the step without any damping."""
        matrix = self.precision
        damped = matrix + (1 + damping) * np.diag(self.curvature)
        move = bounded_step(matrix if damping < 0 else damped, self.slope, self.bounds)
        return move, float(-self.slope @ move - move @ matrix @ move / 2)

    @property
    def precision(self) -> Array:
        """J'J and the prior's curvature."""
        return self.gram + np.diag(self.curvature)

    def move_to(self, point: _FitPoint) -> None:
        """Makes the nuisances' columns those at a point nearby, by the secant from here (Broyden, Math. Comp. 19, 1965,
        577-593), in place."""
        move = point.z - self.point.z
        missed = point.residual - self.point.residual - linear_change(self.jacobian, move)
        n = self.unknowns.n_nuisance
        add_outer(self.jacobian[:, :n], missed, move[:n] / max(float(move @ move), TINY))


class _FitPosterior:
    """S of a likelihood, its data's part over a heat; counts its simulations. Its models have one Jacobian, that of the
    last of them: it is by far the largest of what a fit holds."""

    def __init__(self, likelihood: Likelihood, unknowns: Unknowns, plan: FitPlan, start_slopes: Starts = ()) -> None:
        self.likelihood, self.unknowns, self.plan = likelihood, unknowns, plan
        self.simulations, self.heat = 0, 1.0
        # by how much each unknown moves the starts of stretches
        self.start_slopes = tuple(own.copy() for own in start_slopes)
        self._jacobian = np.empty((0, unknowns.size), dtype=np.float32)
        self._left: _FitPoint | None = None  # from which the last move went
        self._failed = 0  # moves from there before it

    def at(self, z: Array, starts: Starts | None = None, most: float = np.inf) -> _FitPoint:
        """A point that holds the bounds; its S is inf where the simulation fails. Stretches begin at `starts`, or where
        a linear model leaves least from there, if that is elsewhere and better. A point that will not come below the
        `most` is left as soon as that shows, for each time less is to be gained; one that does where little is."""
        point, nearer, far = self._from(z, starts)
        for _ in range(MOST_LED):
            lost = point.objective - most > TELLS
            if far <= (NEARLY_AS_GOOD if lost else AS_GOOD) or not np.isfinite(point.objective):
                break
            moved, nearer, far = self._from(z, nearer)
            gained = point.objective - moved.objective
            if not gained > 0.0:
                break
            point = moved
            if point.objective - gained > most or (most < np.inf and gained < LED * (most - point.objective)):
                break
        return point

    def _from(self, z: Array, starts: Starts | None) -> tuple[_FitPoint, Starts, float]:
        """A point with given starts, starts that leave less, and how far they are apart."""
        every, nearer, far = numbers_and_starts(self.likelihood, Points.of(self.unknowns, z[None], starts))
        self.simulations += 1
        alone = every[0].copy()  # others' are beside it where they meet
        return replace(self._weighted(z, alone, starts), nearer=nearer), nearer, far

    def _weighted(self, z: Array, residual: Array, starts: Starts | None) -> _FitPoint:
        weights = self.likelihood.weights(residual, self.unknowns)
        if self.heat != 1.0:
            weights = replace(weights, root=weights.root / np.sqrt(self.heat), nats=weights.nats / self.heat)
        objective = weights.nats + self.unknowns.prior(z)[0] if np.isfinite(residual).all() else np.inf
        return _FitPoint(z, residual, weights, float(objective), starts)

    def heated(self, point: _FitPoint, most: float, cools: float) -> _FitPoint:
        """A point with the heat that suits what is left there, none where runs are followed as a whole; at `most` as
        what the round before leaves, and what cools in those to come."""
        loud = _loudness(point) if self.likelihood.is_cut else 1.0
        heat = min(loud, most, cools)
        if heat <= WARM or (most == np.inf and loud <= HOT):
            return point
        self.heat = heat
        return replace(self._weighted(point.z, point.residual, point.starts), nearer=point.nearer)

    def cooled(self, point: _FitPoint, model: _FitModel) -> tuple[_FitPoint, _FitModel]:
        """The same without heat."""
        if self.heat == 1.0:
            return point, model
        without = _FitPosterior(self.likelihood, self.unknowns, self.plan)
        cold = without._weighted(point.z, point.residual, point.starts)
        return cold, _FitModel(self.unknowns, cold, model.jacobian, stale=True)

    def moved(self, point: _FitPoint, move: Array) -> _FitPoint:
        """The point that a move leads to. Starts go along as it moves them, and to where they suit the point, half as
        far each time that a move from it did not lead down: a linear model knows of a stretch alone, and not of what it
        does to those behind it."""
        z = self.unknowns.allowed(point.z + move)
        if not self.start_slopes or point.nearer is None:
            return self.at(z, most=point.objective)
        self._failed = self._failed + 1 if point is self._left else 0
        self._left, share = point, 0.5**self._failed
        by = [np.tensordot(z - point.z, slopes, axes=1) for slopes in self.start_slopes]
        here = point.starts or self.likelihood.problem.starts(1)
        every = zip(here, point.nearer, by, strict=True)
        return self.at(z, tuple(own + share * (near - own) + b for own, near, b in every), point.objective)

    def further(self, before: _FitPoint, point: _FitPoint) -> _FitPoint:
        """As far again beyond a point as from the one before."""
        return self.moved(point, point.z - before.z)

    def model(self, point: _FitPoint, neighbour: _FitModel | None) -> _FitModel:
        if neighbour is not None:
            neighbour.move_to(point)
        return self._model(point, 0 if neighbour is None else self.unknowns.n_nuisance, stale=neighbour is not None)

    def takes(self, columns: Columns) -> None:
        """Takes what columns of these unknowns hold for its own models', and leaves them empty."""
        if columns.values is not None:
            self._jacobian, columns.values = columns.values, None

    def linearised(self, point: _FitPoint, columns: Slopes | None, *, stale: bool = True) -> _FitModel:
        """The first model, at a point, with columns that are known, those of the nuisances or all, and may be `stale`;
        the others are computed."""
        if self._jacobian.shape != (point.residual.size, point.z.size):
            self._jacobian = np.empty((point.residual.size, point.z.size), dtype=np.float32, order="F")
        known = 0 if columns is None else columns.shape[1]
        if columns is not None and not np.may_share_memory(columns, self._jacobian):
            self._jacobian[:, :known] = columns
        return self._model(point, known, stale=stale and columns is not None)

    def _model(self, point: _FitPoint, known: int, *, stale: bool) -> _FitModel:
        """The model at a point, so many columns as they are."""
        which = np.arange(known, self.unknowns.size)
        if which.size:
            slopes = put_columns(
                self._jacobian[:, known:], self.likelihood, self.unknowns, point.z, which, point.residual,
                point.starts, point.nearer,
            )  # fmt: skip
            if slopes and not self.start_slopes:
                self.start_slopes = tuple(np.zeros((self.unknowns.size, *own.shape[1:])) for own in slopes)
            for every, own in zip(self.start_slopes, slopes, strict=True):
                every[which] = own
        self.simulations += which.size
        model = _FitModel(self.unknowns, point, self._jacobian, stale=stale, threads=self.likelihood.threads_here)
        if self.plan.tell is not None:
            promise = f"{max(model.promised, 0.0):.3g} nats"
            self.plan.tell(f"a further step promises {promise}, below {self.plan.enough:.3g} it is the last")
        return model


def _bounds(unknowns: Unknowns) -> Array:
    """(2, unknowns.size) least and most of each."""
    bounds = np.tile([[-np.inf], [np.inf]], unknowns.size)
    bounds[:, unknowns.n_nuisance :] = np.reshape([one.bounds for one in unknowns.effects], (-1, 2)).T
    return bounds
