"""A candidate beside a fit, fitted anew with everything else: where it begins, what it has come to and still may."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.fit import TINY
from msl_fem.diagnosis.likelihood import Fit, Likelihood, white
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.scores import Score
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant

SMALL = (0.03, 0.1, 0.3)  # of z: the largest amount with which a candidate may begin
SHARES = (1.0, 0.4, 0.1)  # of the way to the linear model's best at which a refit may begin
AS_PROMISED = 0.5  # of its nats, that the linear model's best brings where a refit begins there
SCREENING_STEPS = 6
LAST_STEPS = 20
RACED_STEPS = 5  # of a candidate that is kept, until it is looked at again
CATCHING_UP = 3.0
"""Times what the last of these rounds brought, by which a candidate that goes on may still grow."""
FRACTION = 0.005  # of its gain that a refit may still gain, where it is not the best
ROUGH = 5.0  # nats that a fit may still gain when it is scored, where the best score is far above
LEAST_GAIN = 1e-9  # nats: one that brings less takes nothing, or in proportion everything
STRAINED = 4.0  # tolerances by which a believed parameter of a fit has moved, where something else bends it
BENT = 2.5  # tolerances, from which what gains make up for nearly may be what bends it


@dataclass(frozen=True, eq=False)
class Refit:
    """A variant with everything fitted anew, and its gain of log evidence over the fit without it."""

    variant: Variant
    fit: Fit
    gain: float

    @property
    def enough(self) -> float:
        """Nats below which further steps are left to the end."""
        return max(ROUGH, FRACTION * max(self.gain, 0.0))

    @property
    def promising(self) -> bool:
        return self.fit.to_come(RACED_STEPS) >= self.enough

    def may_leave(self, before: Mapping[str, float]) -> dict[str, float]:
        """Channel to residual over the noise, where it takes of what was left `before` in proportion to all the nats
        that it may come to."""
        now, share = self.fit.excess, self.reach / max(self.gain, LEAST_GAIN)
        powers = {name: value**2 - share * (value**2 - now[name] ** 2) for name, value in before.items()}
        return {name: float(np.sqrt(max(power, 0.0))) for name, power in powers.items()}

    @property
    def reach(self) -> float:
        """Nats that it may come to: what it has where none of its last steps led down, whatever they promised."""
        return self.gain if self.fit.stuck else self.promised

    @property
    def promised(self) -> float:
        """Nats with `CATCHING_UP` times what some steps promise more, as damped as they have to be."""
        return self.gain + CATCHING_UP * self.fit.to_come(RACED_STEPS)


def extended(base: Unknowns, variant: Variant) -> Unknowns:
    """The unknowns with those of a variant behind them."""
    return replace(base, effects=(*base.effects, *variant.unknowns))


def started(base: Fit, score: Score, likelihood: Likelihood) -> Array:
    """Where the refit of a scored variant begins: the linear model's best, where that brings most of what it promises;
    else of some points on the way there the one of the highest density by `likelihood`. All else moves along, since it
    makes up for what is alike. Small amounts are among them, for beside a model that is far off the linear model's best
    may be none that can be simulated."""
    shapes = np.zeros(len(score.variant.shapes))
    unknowns = extended(base.unknowns, score.variant)
    whole = unknowns.allowed(np.concatenate([base.z + score.shift, score.guess, shapes]))
    there = objectives(likelihood, unknowns, whole[None])[0]
    if there <= base.objective - AS_PROMISED * max(score.gain, 0.0):
        return whole
    rows = [np.concatenate([base.z + part * score.shift, part * score.guess, shapes]) for part in SHARES[1:]]
    rows += [np.concatenate([base.z, part * score.guess, shapes]) for part in SHARES]
    largest = max(float(np.abs(score.guess).max()), TINY)
    rows += [np.concatenate([base.z, size / largest * score.guess, shapes]) for size in SMALL if size < largest]
    points = np.array([unknowns.allowed(row) for row in rows])
    costs = objectives(likelihood, unknowns, points)
    return whole if there <= costs.min() else np.asarray(points[int(np.argmin(costs))])


def objectives(likelihood: Likelihood, unknowns: Unknowns, points: Array) -> Array:
    """(n_point,) S at points (n_point, unknowns.size); inf where a run fails."""
    costs = np.full(len(points), np.inf)
    for n, residual in enumerate(likelihood.spectra(Points.of(unknowns, points))):
        if np.isfinite(residual).all():
            costs[n] = likelihood.weights(residual, unknowns).nats + unknowns.prior(points[n])[0]
    return costs


def as_believed(found: Fit) -> Array:
    """Where a fit is, with believed parameters and the table as believed."""
    z = found.z.copy()
    z[: len(found.unknowns.believed) + found.unknowns.n_table] = 0.0
    return z


def let_go(refits: Sequence[Refit]) -> None:
    """The Jacobians of refits that go no further, or do so with one of their own."""
    for refit in refits:
        refit.fit.lets_go()


def strained(found: Fit, tolerances: float = STRAINED) -> bool:
    """Whether a believed parameter is so far off that something else must be wrong."""
    return bool(np.any(np.abs(found.z[: len(found.unknowns.believed)]) > tolerances))


def leaves_noise(refit: Refit) -> bool:
    return white(refit.fit.excess)


def effects_among(refits: Sequence[Refit]) -> list[str]:
    """Their effects, each once, the best first."""
    return list(dict.fromkeys(refit.variant.effect for refit in sorted(refits, key=by_gain)))


def by_gain(refit: Refit) -> float:
    return -refit.gain
