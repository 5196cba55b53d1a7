"""Damped Gauss-Newton descent, and the maximum a posteriori fit of a simulation to data with it.

`descend` is the one loop: a quadratic model around a point, a damped step of it, the objective there; a step that
raises the objective is tried again with more damping (Levenberg 1944, Marquardt 1963). What the unknowns are, in which
metric they are damped and how a point is evaluated is the business of an `Objective`.

`fit_map` minimises S = |r(z)|^2/2 + |z|^2/2 with residuals r in units of their noise and parameters z in units of their
prior's sigma, counted from the believed values, damped in the same metric: (J'J + (1 + mu) I) d = -(J'r + z).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.optimize import lsq_linear

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import add_times
from msl_fem.computing.threads import in_threads
from msl_fem.errors import ComputationError


class DescentPoint(Protocol):
    """Where a descent is."""

    @property
    def objective(self) -> float:
        """What is minimised; inf or nan where it cannot be computed."""
        ...


class QuadraticModel(Protocol):
    """The objective near a point.

    `promised` is the decrease by the step without damping; a model is `stale` where parts of it were taken over from a
    neighbouring point.
    """

    @property
    def promised(self) -> float: ...
    @property
    def stale(self) -> bool: ...
    def step(self, damping: float) -> tuple[Array, float]:
        """(move, the decrease that it promises)"""
        ...


P = TypeVar("P", bound=DescentPoint)
M = TypeVar("M", bound=QuadraticModel)


class Objective(Protocol[P, M]):
    """What is minimised."""

    def model(self, point: P, neighbour: M | None) -> M:
        """The quadratic model at a point; what is costly may be taken over from that of a neighbouring point."""
        ...

    def moved(self, point: P, move: Array) -> P:
        """The point that a move leads to, within its bounds."""
        ...


@dataclass(frozen=True)
class Damping:
    """How the damping mu follows success: divided or multiplied by `factor`.

    Attributes
    ----------
    first : mu of the first step
    least : up to here success leads to no damping at all
    rise : mu, at least, after the failure of a step
    most : a failure above it ends the search
    """

    first: float = 1e3
    least: float = 1e-6
    rise: float = 1e-3
    most: float = 1e12
    factor: float = 10.0

    def after_success(self, mu: float, *, raised: bool) -> float:
        """Less of it, but where it has just been raised, since with less the step before it failed."""
        if mu <= self.least:
            return 0.0
        return mu if raised else mu / self.factor

    def after_failure(self, mu: float) -> float:
        return max(self.factor * mu, self.rise)


HALVING = Damping(first=0.0, least=np.inf, rise=1.0, most=3.0, factor=2.0)
"""For steps shortened by `halved`: the whole step first at every point, then its half, quarter and eighth."""


ROUNDING = 1e-12  # of a diagonal: what acts alike
ROWS_AT_ONCE = 4096
"""Of a Jacobian, that are weighted and multiplied at a time."""
PARTS = 4
"""Of all rows, each summed by itself: what threads share."""
VAIN = 0.1
"""Share of its promise below which the step of a new model was in vain."""
MOST_VAIN = 2
"""Such steps in a row, after which models are renewed no more."""
DAMPED_FIRST = 1
"""Trials with more damping of a stale model that failed, before it is computed anew: of both a trial is the cheaper by
far, and as often as not the step was too long and no column too old."""
PATTERN = 3
"""Steps behind which a descent that goes on slowly tries the same way again."""
MOST_PATTERNS = 2  # times that it does so, twice as far each
SLOWLY = 0.25
"""Share of the first of these steps' gains that the last one brings, from which a descent is slow: near an end that a
model is right about each step leaves much less than the one before."""
MOST_FAILED = 3
"""Trials in a row that raise the objective, with which a descent ends where little is promised: a model that is right
about the slope keeps at least the promise of a damped step."""
MOST_IDLE = 2
"""Trials in a row after that, or that are damped so much that they promise no more, which bring less than is enough to
go on, with which a descent ends."""


def halved(move: Array, mu: float) -> Array:
    """A move shortened for mu = 0, 1, 2, 4, ... to the whole, 1/2, 1/4, 1/8, ... of it."""
    return move / (2.0 * mu) if mu else move


@dataclass(frozen=True)
class DescentSettings:
    """When a descent ends, and how it is damped.

    Attributes
    ----------
    enough, enough_share : a promised decrease of the objective, and a share of what is above the `least` that can be
        left, below which it has converged
    most_trials : steps, accepted or not
    most_steps : accepted steps; None: as many as trials
    renewal : the next model is computed wholly anew where a step brings less than this share of its promise, and where
        a stale one fails or promises too little; None: never. Where steps of new models bring next to nothing of what
        they promise (`VAIN`), as at a kink, no new one helps, and what is taken over has to do, until it brings nothing
        either; nor is anything to come where only damped steps are left that promise too little (`MOST_IDLE`)
    fresh_end : whether a stale model that promises too little is computed anew before the descent ends
    little : a promised decrease below which `MOST_FAILED` failures in a row end it
    """

    damping: Damping = Damping()
    enough: float = 1e-2
    enough_share: float = 0.0
    most_trials: int = 60
    most_steps: int | None = None
    renewal: float | None = None
    fresh_end: bool = True
    least: float = 0.0
    little: float = 0.0


@dataclass(frozen=True, eq=False)
class Descent(Generic[P, M]):
    """Where a descent ended: the model there, and why: no step leads down, promises are not kept, or no more steps are
    allowed. `damping` is the mu that a further trial would take."""

    point: P
    model: M
    ending: Literal["converged", "no descent", "in vain", "no more steps"]
    steps: int
    damping: float = 0.0


def descend(
    objective: Objective[P, M],
    start: P,
    settings: DescentSettings,
    *,
    first: M | None = None,
    further: Callable[[P, P], P] | None = None,
    reached: Callable[[P, M], bool] | None = None,
) -> Descent[P, M]:
    """The descent from a start with a finite objective; `first` is the model there where it is known.

    `further` makes of two points the one as far again beyond the second. Along a bent valley, or where what is left is
    large and bends as it is lowered, models take each step for nearly the last one; the way of some of them is then
    tried again, twice as far each time as it leads down (the pattern move of Hooke and Jeeves, J. ACM 8, 1961,
    212-229). `reached` says whether a point and the model there are all that is asked for.
    """
    how, point, steps = settings, start, 0
    since, gains = start, list[float]()
    model = first or objective.model(start, None)
    mu = settings.damping.first
    renewal, vain, idle, failed = how.renewal, 0, 0, 0
    for _ in range(how.most_trials):
        if model.promised < max(how.enough, how.enough_share * (point.objective - how.least)):
            if how.renewal is None or not model.stale or not how.fresh_end:
                return Descent(point, model, "converged", steps, mu)
            model = objective.model(point, None)
            continue
        if (how.most_steps is not None and steps >= how.most_steps) or (reached is not None and reached(point, model)):
            break
        move, promised = model.step(mu)
        trial = objective.moved(point, move)
        gain = point.objective - trial.objective
        small = vain >= MOST_VAIN or promised < how.enough
        idle = idle + 1 if how.renewal is not None and small and not gain >= how.enough else 0
        if idle >= MOST_IDLE:
            return Descent(point, model, "in vain", steps, mu)
        if gain > 0.0:  # not of nan
            if not model.stale:
                vain = 0 if gain >= VAIN * promised else vain + 1
                renewal = None if vain >= MOST_VAIN else renewal
            fruitful = renewal is None or gain >= renewal * promised
            gains.append(gain)
            if further is not None and len(gains) == PATTERN:
                if gain >= SLOWLY * gains[0]:
                    trial, fruitful = _as_far_again(further, since, trial), renewal is None
                since, gains = trial, []
            model = objective.model(trial, model if fruitful else None)
            point = trial
            mu = how.damping.after_success(mu, raised=failed > 0)
            steps, failed = steps + 1, 0
        elif renewal is not None and model.stale and failed >= DAMPED_FIRST:
            model = objective.model(point, None)
        elif failed + 1 >= MOST_FAILED and model.promised < how.little:
            return Descent(point, model, "in vain", steps, mu)
        elif mu > how.damping.most:
            return Descent(point, model, "no descent", steps, mu)
        else:
            mu, failed = how.damping.after_failure(mu), failed + 1
    return Descent(point, model, "no more steps", steps, mu)


def _as_far_again(further: Callable[[P, P], P], since: P, point: P) -> P:
    """The last point on the way from one to another, and on, that is lower than the one before."""
    for _ in range(MOST_PATTERNS):
        beyond = further(since, point)
        if not beyond.objective < point.objective:
            break
        point = beyond
    return point


def summed_over_rows(made: Callable[[slice], tuple[Array, ...]], n_row: int, *, threads: int = 1) -> tuple[Array, ...]:
    """The sums of what is made of some rows of a large matrix at a time, so that nothing as large is made beside it;
    the same to the last bit by any number of threads."""

    def of_part(rows: NDArray[np.intp]) -> list[Array]:
        every = (made(slice(begin, begin + ROWS_AT_ONCE)) for begin in rows)
        return [sum(one[1:], one[0]) for one in zip(*every, strict=True)]

    begins = np.arange(0, max(n_row, 1), ROWS_AT_ONCE)
    parts = in_threads(of_part, np.array_split(begins, min(PARTS, begins.size)), threads)
    return tuple(sum(one[1:], one[0]) for one in zip(*parts, strict=True))


def normal_equations(
    jacobian: Array | Slopes, root: Array, residual: Array | None = None, *, threads: int = 1
) -> tuple[Array, Array]:
    """(J'J (n, n), J'r (n,)) of a Jacobian (n_number, n) and a residual (n_number,) times `root` (n_number,). Without a
    residual J'r is zero."""

    def made(rows: slice) -> tuple[Array, Array]:
        weighted = jacobian[rows] * root[rows, None]
        right = np.zeros(len(weighted)) if residual is None else residual[rows] * root[rows]
        return weighted.T @ weighted, weighted.T @ right

    gram, slope = summed_over_rows(made, len(jacobian), threads=threads)
    return gram, slope


def linear_change(jacobian: Array | Slopes, move: Array) -> Array:
    """(n_number,) a Jacobian (n_number, n) times a move (n,), in double precision."""
    made = np.zeros(len(jacobian))
    _add_product(made, jacobian.T, move)
    return made


def add_outer(jacobian: Array | Slopes, column: Array, row: Array) -> None:
    """Adds column (n_number,) times row (n,) to a Jacobian (n_number, n) in place."""
    _add_to_each(jacobian.T, column, row)


@compiled
def _add_product(made: Array, columns: Array | Slopes, move: Array) -> None:
    """Adds columns (n, n_number) times a move (n,) to numbers (n_number,), some at a time, which stay in the cache."""
    for begin in range(0, made.size, ROWS_AT_ONCE):
        part = made[begin : begin + ROWS_AT_ONCE]
        for k in range(move.size):
            add_times(part, columns[k, begin : begin + ROWS_AT_ONCE], move[k])


@compiled
def _add_to_each(columns: Array | Slopes, one: Array, times: Array) -> None:
    """Adds one column (n_number,) to each of several (n, n_number), so many times (n,)."""
    for begin in range(0, one.size, ROWS_AT_ONCE):
        part = one[begin : begin + ROWS_AT_ONCE]
        for k in range(times.size):
            add_times(columns[k, begin : begin + ROWS_AT_ONCE], part, times[k])


def bounded_step(matrix: Array, slope: Array, bounds: Array) -> Array:
    """(n,) the least of slope . d + d . matrix . d/2 over moves d within bounds (2, n): where the least of all lies
    beyond some of them, the others make up for what these may not do (Stark and Parker, Computational Statistics 10,
    1995, 129-141). A move that is merely cut off there may lead uphill.

    A matrix (n, n) that is positive definite but for rounding will do.
    """
    move = np.linalg.solve(matrix, -slope)
    if np.all((bounds[0] <= move) & (move <= bounds[1])):
        return np.asarray(move)
    root = np.linalg.cholesky(matrix + ROUNDING * np.diag(np.diag(matrix)))
    target = solve_triangular(root, -slope, lower=True)
    return np.clip(lsq_linear(root.T, target, bounds, method="bvls").x, *bounds)


def log_evidence(objective: float, precision: Array) -> float:
    """Laplace's approximation, -S - log det(precision)/2, up to a constant that all models of the same data share.

    It contains the Occam factor (MacKay, Information Theory, Inference, and Learning Algorithms, 2003, ch. 27).
    """
    return -objective - float(np.linalg.slogdet(precision)[1]) / 2


Simulator = Callable[[Array], Array]
"""Parameters (n_lane, n_parameter) in units of their prior to residuals (n_lane, n_residual), nan of a failed run."""


@dataclass(frozen=True)
class FitSettings:
    """How a fit goes.

    Attributes
    ----------
    step : of the differences, in units of the prior's sigma
    damping : the first mu
    enough : a predicted decrease of S, in nats, at which the fit has converged
    most_steps : accepted or not
    """

    step: float = 1e-3
    damping: float = 1e3
    enough: float = 1e-2
    most_steps: int = 60


@dataclass(frozen=True, eq=False)
class MapFit:
    """Where a fit ended.

    Attributes
    ----------
    parameters : (n_parameter,) in units of the prior's sigma, from the believed values
    covariance : (n_parameter, n_parameter) of them, (J'J + I)^-1
    residual : (n_residual,) at the end
    jacobian : (n_residual, n_parameter) there
    objective : S
    log_evidence : up to a constant of the data
    converged : the predicted decrease fell below what is enough
    simulations : single runs of the simulator
    reason : how it ended, in words
    """

    parameters: Array
    covariance: Array
    residual: Array
    jacobian: Array
    objective: float
    log_evidence: float
    converged: bool
    simulations: int
    reason: str


def fit_map(simulate: Simulator, start: Array, *, settings: FitSettings | None = None) -> MapFit:
    """The parameters of highest posterior density next to a start, (n_parameter,) in units of the prior.

    Raises
    ------
    ComputationError : the simulation fails at the start, or at a difference of it to both sides
    """
    how = settings or FitSettings()
    posterior = _Posterior(simulate, how.step)
    first = posterior.at(np.array(start, dtype=float))
    if not np.isfinite(first.residual).all():
        raise ComputationError("the simulation fails at the start of the fit; begin nearer to what was measured")
    limits = DescentSettings(Damping(how.damping), how.enough, most_trials=how.most_steps)
    end = descend(posterior, first, limits)
    reasons = {
        "converged": f"a further step would gain {end.model.promised:.2g} nats",
        "no descent": "no step makes it better",
        "no more steps": f"no end after {how.most_steps} steps",
    }
    precision = end.model.gram + np.eye(first.z.size)
    return MapFit(
        parameters=end.point.z,
        covariance=np.asarray(np.linalg.inv(precision), dtype=np.float64),
        residual=end.point.residual,
        jacobian=end.model.jacobian,
        objective=end.point.objective,
        log_evidence=log_evidence(end.point.objective, precision),
        converged=end.ending == "converged",
        simulations=posterior.simulations,
        reason=reasons[end.ending],
    )


@dataclass(frozen=True, eq=False)
class _Simulated:
    """Parameters with their residuals."""

    z: Array
    residual: Array
    objective: float


class _Linearised:
    """|r + J d|^2/2 + |z + d|^2/2."""

    stale = False

    def __init__(self, jacobian: Array, at: _Simulated) -> None:
        self.jacobian = jacobian
        self.gram = jacobian.T @ jacobian
        self._slope = jacobian.T @ at.residual + at.z
        self.promised = self.step(-1.0)[1]

    def step(self, damping: float) -> tuple[Array, float]:
        """(move, its promise); -1 for the step without any damping"""
        metric = 1.0 if damping < 0.0 else 1.0 + damping
        move = np.linalg.solve(self.gram + metric * np.eye(self._slope.size), -self._slope)
        return np.asarray(move, dtype=np.float64), float(-self._slope @ move / 2)


class _Posterior:
    """Minus the log posterior of a simulation's parameters; counts its runs."""

    def __init__(self, simulate: Simulator, step: float) -> None:
        self._simulate = simulate
        self._step = step
        self.simulations = 0

    def at(self, z: Array) -> _Simulated:
        residual = self._simulate(z[None])[0]
        self.simulations += 1
        return _Simulated(z, residual, float(residual @ residual + z @ z) / 2)

    def moved(self, point: _Simulated, move: Array) -> _Simulated:
        return self.at(point.z + move)

    def model(self, point: _Simulated, neighbour: _Linearised | None) -> _Linearised:
        self.simulations += point.z.size
        return _Linearised(differences(self._simulate, point.z, point.residual, self._step), point)


def differences(simulate: Simulator, z: Array, residual: Array, step: float) -> Array:
    """The Jacobian (n_residual, n_parameter) by one-sided differences; backwards where a run ahead fails.

    Raises
    ------
    ComputationError : the runs to both sides of a parameter fail
    """
    size = np.full(z.size, step)
    moved = simulate(z + np.diag(size))
    failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        size[failed] = -step
        moved[failed] = simulate(z + np.diag(size)[failed])
        failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        raise ComputationError(
            f"the simulation fails to both sides of parameter number {int(np.argmax(failed))}; take a shorter run or a "
            "smaller amplitude"
        )
    return np.asarray(((moved - residual) / size[:, None]).T)
