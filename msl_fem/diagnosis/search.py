"""The search for causes: from a converged fit without, score all, refit the best, keep the best of these, go on.

Forward with all parameters fitted anew at each stage; a stage's candidates are chosen by the linear evidence of all
variants of all effects (`scoring`) and judged by the evidence of their own converged fits.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import ENOUGH, Fit, FitPlan, Likelihood, fit
from msl_fem.diagnosis.scoring import Score, scores
from msl_fem.diagnosis.simulator import Points
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError

Array = NDArray[np.float64]
Progress = Callable[[str], None]
MOST_TRIED, FEWEST_TRIED = 7, 3
SHARE = 0.03  # of the best score: effects below are not refitted
VARIANTS = 2  # of an effect that are refitted
LOST = 0.25  # of the gain that the best refit has made: a refit below it after its first steps is out of the race
FIRST_STEPS = 6
SHARES = (1.0, 0.5, 0.2, 0.05)  # of the way to the linear model's best at which a refit may begin
RACE_STEPS, LAST_STEPS = 25, 20
NEAR = 15.0  # nats behind the best within which refits are converged
FRACTION = 0.005  # of its gain that a refit may still gain, where it is not the best
ROUGH = 5.0  # nats that a fit may still gain when it is scored, where the best score is far above
FAR_ABOVE = 40.0
STRAINED = 4.0  # tolerances by which a believed parameter of a fit has moved, where something else bends it
COMPENSATED = ("gap_offset", "early_saturation", "fringing", "armature_tilt")
"""Effects that gap, scale and table make up for nearly, so that at a strained fit a linear score misses them."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A variant with everything fitted anew, and its gain of log evidence over the fit without it."""

    variant: Variant
    fit: Fit
    gain: float


@dataclass(frozen=True, eq=False)
class Stage:
    """A fit, and what one effect more would bring: all scores, and the refits, best first."""

    base: Fit
    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]

    @property
    def best(self) -> Refit | None:
        return self.refits[0] if self.refits else None

    def rivals(self, within: float) -> list[Refit]:
        """The best refit of each other effect that is within some nats of the best."""
        found: dict[str, Refit] = {}
        for one in self.refits[1:]:
            near = self.refits[0].gain - one.gain <= within
            if near and one.variant.effect != self.refits[0].variant.effect:
                found.setdefault(one.variant.effect, one)
        return list(found.values())


def stage(likelihood: Likelihood, start: Fit, tried: Sequence[Variant], *, tell: Progress, threads: int = 1) -> Stage:
    """What one of these variants more would bring to a fit, which is converged as far as that asks for."""
    tell("all effects")
    base, every = start, scores(likelihood, start, tried)
    if not base.converged and not (every and every[0].gain > FAR_ABOVE + 10 * base.predicted):
        base = fit(likelihood, base.unknowns, base.z, nuisance_columns=base.jacobian[:, : base.unknowns.n_nuisance])
        every = scores(likelihood, base, tried)
    candidates = ranked(every)
    if strained(base):
        tried_too = {score.variant.effect for score in candidates}
        candidates += [s for s in _best_of(every).values() if s.variant.effect in set(COMPENSATED) - tried_too]
    return Stage(base, tuple(every), tuple(_refits(likelihood, base, candidates, tell=tell, threads=threads)))


def strained(found: Fit) -> bool:
    """Whether a believed parameter is so far off that something else must be wrong."""
    return bool(np.any(np.abs(found.z[: len(found.unknowns.believed)]) > STRAINED))


def _best_of(every: Sequence[Score]) -> dict[str, Score]:
    """The best score of each effect, of scores in their order, with a guess that is not nothing."""
    found: dict[str, Score] = {}
    for one in every:
        if np.any(one.guess != 0):
            found.setdefault(one.variant.effect, one)
    return found


def statistics_of(stages: Sequence[Stage]) -> tuple[tuple[tuple[str, float], ...], ...]:
    """Of each stage the best effects with their gains."""
    return tuple(tuple((r.variant.effect, r.gain) for r in one.refits[:3]) for one in stages)


def extended(base: Unknowns, variant: Variant) -> Unknowns:
    """The unknowns with those of a variant behind them."""
    return replace(base, effects=(*base.effects, *variant.unknowns))


def started(likelihood: Likelihood, base: Fit, score: Score) -> Array:
    """Where the refit of a scored variant begins: of some points on the way to the linear model's best, the one of the
    highest density. All else moves along, since it makes up for what is alike."""
    shapes = np.zeros(len(score.variant.shapes))
    rows = [np.concatenate([base.z + part * score.shift, part * score.guess, shapes]) for part in SHARES]
    rows += [np.concatenate([base.z, part * score.guess, shapes]) for part in SHARES]
    unknowns = extended(base.unknowns, score.variant)
    points = np.array([unknowns.allowed(row) for row in rows])
    residuals = likelihood.spectra(Points.of(unknowns, points))
    costs = [
        likelihood.weights(r).nats + unknowns.prior(z)[0] if np.isfinite(r).all() else np.inf
        for r, z in zip(residuals, points, strict=True)
    ]
    return np.asarray(points[int(np.argmin(costs))])


def ranked(every: Sequence[Score]) -> list[Score]:
    """The variants worth a refit, at most `VARIANTS` of an effect, best first."""
    found: list[Score] = []
    best = every[0].gain if every else 0.0
    for one in every:
        same = sum(s.variant.effect == one.variant.effect for s in found)
        effects = {s.variant.effect for s in found}
        if same >= VARIANTS or (one.variant.effect not in effects and len(effects) >= MOST_TRIED):
            continue
        if one.gain < SHARE * best and len(effects) >= FEWEST_TRIED:
            continue
        if same and one.gain < 0.5 * next(s.gain for s in found if s.variant.effect == one.variant.effect):
            continue
        found.append(one)
    return found


def _refits(
    likelihood: Likelihood, base: Fit, candidates: Sequence[Score], *, tell: Progress, threads: int
) -> list[Refit]:
    """The candidates refitted in a race, best first: heats for all, those that lag far behind are given up, and those
    in front go on until nothing more is to be gained. The outcome does not depend on the number of threads."""

    n = base.unknowns.n_nuisance

    def refitted(variant: Variant, z: Array, plan: FitPlan, columns: Array | None = None) -> Refit:
        unknowns = extended(base.unknowns, variant)
        found = fit(likelihood, unknowns, z, plan=plan, nuisance_columns=columns)
        return Refit(variant, found, found.log_evidence - base.log_evidence)

    def heat(score: Score) -> Refit | None:
        tell(score.variant.name)
        plan = FitPlan(most_steps=FIRST_STEPS, renew=False)
        try:
            return refitted(score.variant, started(likelihood, base, score), plan, base.jacobian[:, :n])
        except ComputationError:
            return None

    def race(one: Refit) -> Refit:
        plan = FitPlan(most_steps=RACE_STEPS, enough=max(ROUGH, FRACTION * max(one.gain, 0.0)))
        return refitted(one.variant, one.fit.z, plan)

    def end(one: Refit, enough: float) -> Refit:
        if one.fit.predicted <= enough:
            return one
        plan = FitPlan(most_steps=LAST_STEPS, enough=enough)
        return refitted(one.variant, one.fit.z, plan, one.fit.jacobian[:, :n])

    with ThreadPoolExecutor(threads) as pool:
        heats = [one for one in pool.map(heat, candidates) if one is not None]
        best = max((one.gain for one in heats), default=0.0)
        lost = [one for one in heats if best > 0 and one.gain < LOST * best]
        found = sorted(pool.map(race, [one for one in heats if one not in lost]), key=lambda one: -one.gain)
        level = [one.gain > 0 and one.gain + one.fit.predicted > found[0].gain - NEAR for one in found]
        enough = [max(ENOUGH, FRACTION * one.gain if place else 0.0) for place, one in enumerate(found)]
        ends = [limit if near else np.inf for near, limit in zip(level, enough, strict=True)]
        found = list(pool.map(end, found, ends))
    return sorted([*found, *lost], key=lambda one: -one.gain)
