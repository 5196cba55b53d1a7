"""The search for causes: from a converged fit without, score all, refit the best, keep the best of these, go on.

Forward with all parameters fitted anew at each stage; a stage's candidates are chosen by the linear evidence of all
variants of all effects and judged by the evidence of their own converged fits.

The linear evidence is exact for the linear model around a fit. At a most probable point without an effect, with the
weighted residual r, the columns J of what is unknown there and C of the effect's amounts, the likelihood over the
amounts a is that of a linear model with

    G = C'C - C'J (J'J + I)^-1 J'C,   b = -C'r + C'J (J'J + I)^-1 (J'r + z),

and with Cauchy's prior the log evidence grows by b'a - a'Ga/2 - sum log(1 + a^2) - log det(G + 2)/2 at the best a. G
tells how far apart an effect and all that is unknown are: the noncentrality of an effect of given size is a'Ga (a case
of Kay, Statistical Signal Processing II, 1998, ch. 6).
"""

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.likelihood import CONVERGED, Fit
from msl_fem.diagnosis.null import AmountPlaces, NullDistribution, null_distribution
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.unknowns import CAUCHY, STEP_OF_AMOUNTS, EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError

Shapes = tuple[EffectUnknown, ...]
_AT_ONCE = 64
MOST_TRIED = 7
FEWEST_TRIED = 3
SHARE = 0.03  # of the best score: effects below are not refitted
VARIANTS = 2  # of an effect that are refitted
ELIMINATED = 0.25  # of the gain that the best refit has made: a refit below it after screening goes no further
SCREENING_STEPS = 6
SHARES = (1.0, 0.5, 0.2, 0.05)  # of the way to the linear model's best at which a refit may begin
REFINEMENT_STEPS = 25
LAST_STEPS = 20
NEAR = 15.0  # nats behind the best within which refits are converged
FRACTION = 0.005  # of its gain that a refit may still gain, where it is not the best
ROUNDING = 1e-12  # of a diagonal: amounts that act alike
ROUGH = 5.0  # nats that a fit may still gain when it is scored, where the best score is far above
FAR_ABOVE = 40.0
STRAINED = 4.0  # tolerances by which a believed parameter of a fit has moved, where something else bends it
COMPENSATED = ("gap_offset", "early_saturation", "fringing", "armature_tilt")
"""Effects that gap, scale and table make up for nearly, so that at a strained fit a linear score misses them."""


@dataclass(frozen=True, eq=False)
class Score:
    """A variant at a converged fit.

    Attributes
    ----------
    gain : nats of log evidence, of the linear model
    guess : (n_amount,) z at which it is highest; `shift` how far all that was unknown before moves then
    own : (n_amount, n_amount) what the record tells of the amounts alone, when all else is unknown
    signature : (n_number, n_amount) weighted columns
    """

    variant: Variant
    gain: float
    guess: Array
    shift: Array
    own: Array
    signature: Array


class Background:
    """What is unknown at a fit, and the columns of many amounts, multiplied with one another once."""

    def __init__(self, found: Fit, raw: Array) -> None:
        """`raw` are columns (n_number, n_amount) of the residual, not weighted."""
        root = found.weights.root
        j, self.c = found.jacobian * root[:, None], raw * root[:, None]
        residual = found.residual * root
        inverse = np.linalg.inv(j.T @ j + np.diag(found.unknowns.prior(found.z)[2]))
        mixed = self.c.T @ j
        gradient = j.T @ residual + found.unknowns.prior(found.z)[1]
        self.own = self.c.T @ self.c - mixed @ inverse @ mixed.T
        self.slope = -self.c.T @ residual + mixed @ inverse @ gradient
        self.still, self.moved = -inverse @ gradient, -inverse @ mixed.T

    def score(self, variant: Variant, places: Sequence[int]) -> Score:
        """The score of a variant whose amounts stand at these places."""
        at = np.array(places)
        own, b = self.own[np.ix_(at, at)], self.slope[at]
        one_sided = np.array([one.one_sided for one in variant.amounts])
        guess, best = np.zeros(at.size), 0.0
        for weak in (2.0, 0.02):  # near nothing, and far out, where the prior is all but flat
            a = _held(own + weak * np.eye(at.size), b, one_sided)
            made = float(b @ a - a @ own @ a / 2 - np.log1p(a**2).sum())
            guess, best = (a, made) if made > best else (guess, best)
        gain = best + CAUCHY * at.size - float(np.linalg.slogdet(own + 2 * np.eye(at.size))[1]) / 2
        return Score(variant, gain, guess, self.still + self.moved[:, at] @ guess, own, self.c[:, at])


def _held(g: Array, b: Array, one_sided: NDArray[np.bool_]) -> Array:
    """The best point with one-sided numbers at least 0, by leaving out those below."""
    kept = np.ones(b.size, dtype=bool)
    guess = np.zeros(b.size)
    for _ in range(b.size):
        guess = np.zeros(b.size)
        if not kept.any():
            return guess
        own = g[np.ix_(kept, kept)]
        guess[kept] = np.linalg.solve(own + ROUNDING * np.diag(np.diag(own)), b[kept])
        bad = one_sided & (guess < 0)
        if not bad.any():
            break
        kept &= ~bad
    return guess


@dataclass(frozen=True, eq=False)
class ScoredVariants:
    """All variants that can be seen at a fit, best first, and what any of them brings by chance there."""

    scores: tuple[Score, ...] = ()
    null: NullDistribution = field(default_factory=NullDistribution)


def scores(found: Fit, tried: Sequence[Variant]) -> list[Score]:
    """All variants at a fit that can be seen there, best first."""
    return list(scored(found, tried, null=False).scores)


def scored(found: Fit, tried: Sequence[Variant], *, null: bool = True) -> ScoredVariants:
    """The variants at a fit; without `null` what they bring by chance is left out."""
    if not tried:
        return ScoredVariants()
    amounts = list(dict.fromkeys((amount, variant.shapes) for variant in tried for amount in variant.amounts))
    starts = range(0, len(amounts), _AT_ONCE)
    raw = np.concatenate([_signatures(found, amounts[at : at + _AT_ONCE]) for at in starts], axis=1)
    seen = np.isfinite(raw).all(axis=0) & (np.abs(np.nan_to_num(raw)).max(axis=0) > 0)
    background = Background(found, np.where(seen, raw, 0.0))
    place = {amount: n for n, amount in enumerate(amounts)}
    made, amount_places = [], []
    for variant in tried:
        places = [place[one, variant.shapes] for one in variant.amounts]
        if seen[places].all():
            made.append(background.score(variant, places))
            one_sided = tuple(one.one_sided for one in variant.amounts)
            amount_places.append(AmountPlaces(tuple(places), one_sided))
    by_chance = null_distribution(background.own, amount_places) if null else NullDistribution()
    return ScoredVariants(tuple(sorted(made, key=lambda s: -s.gain)), by_chance)


def _signatures(found: Fit, amounts: Sequence[tuple[EffectUnknown, Shapes]]) -> Array:
    """(n_number, n_amount) slopes of the residual over each amount at nothing, around its shapes; nan where there is
    none. With all amounts at nothing shapes change nothing."""
    effects = np.tile(found.unknowns.effect_vector(found.z), (len(amounts), 1))
    for row, (one, shapes) in zip(effects, amounts, strict=True):
        for shape in shapes:
            row[shape.place] = shape.centre
        row[one.place] = one.value(np.array(STEP_OF_AMOUNTS))
    rows = np.tile(found.z, (len(amounts), 1))
    moved = found.likelihood.spectra(Points(found.unknowns, rows, effects))
    return np.asarray(((moved - found.residual) / STEP_OF_AMOUNTS).T)


@dataclass(frozen=True, eq=False)
class Refit:
    """A variant with everything fitted anew, and its gain of log evidence over the fit without it."""

    variant: Variant
    fit: Fit
    gain: float


@dataclass(frozen=True, eq=False)
class SearchStage:
    """A fit, and what one effect more would bring: all scores, and the refits, best first."""

    base: Fit
    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    null: NullDistribution = field(default_factory=NullDistribution)

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


def search_stage(
    start: Fit,
    tried: Sequence[Variant],
    *,
    tell: Callable[[str], None],
    threads: int = 1,
    memory: FitMemory | None = None,
) -> SearchStage:
    """What one of these variants more would bring to a fit, which is converged as far as that asks for; refits begin
    where `memory` says that they ended."""
    tell("all effects")
    base, at_base = start, scored(start, tried)
    every = at_base.scores
    if not base.converged and not (every and every[0].gain > FAR_ABOVE + 10 * base.predicted):
        columns = base.jacobian[:, : base.unknowns.n_nuisance]
        base = fit(base.likelihood, base.unknowns, base.z, nuisance_columns=columns)
        at_base = scored(base, tried)
        every = at_base.scores
    candidates = ranked(every)
    if strained(base):
        missing = set(COMPENSATED) - {score.variant.effect for score in candidates}
        candidates += [score for score in _best_of(every).values() if score.variant.effect in missing]
    kept = memory or FitMemory()
    kept.ended(fit_name(base.unknowns), base.z)
    refits = _Refinement(base, tell, kept).best_first(candidates, threads=threads)
    return SearchStage(base, every, tuple(refits), at_base.null)


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


def statistics_of(stages: Sequence[SearchStage]) -> tuple[tuple[tuple[str, float], ...], ...]:
    """Of each stage the best effects with their gains."""
    return tuple(tuple((r.variant.effect, r.gain) for r in one.refits[:3]) for one in stages)


def extended(base: Unknowns, variant: Variant) -> Unknowns:
    """The unknowns with those of a variant behind them."""
    return replace(base, effects=(*base.effects, *variant.unknowns))


def started(base: Fit, score: Score) -> Array:
    """Where the refit of a scored variant begins: of some points on the way to the linear model's best, the one of the
    highest density. All else moves along, since it makes up for what is alike."""
    shapes = np.zeros(len(score.variant.shapes))
    rows = [np.concatenate([base.z + part * score.shift, part * score.guess, shapes]) for part in SHARES]
    rows += [np.concatenate([base.z, part * score.guess, shapes]) for part in SHARES]
    unknowns = extended(base.unknowns, score.variant)
    points = np.array([unknowns.allowed(row) for row in rows])
    residuals = base.likelihood.spectra(Points.of(unknowns, points))
    costs = np.full(len(points), np.inf)
    for n, residual in enumerate(residuals):
        if np.isfinite(residual).all():
            costs[n] = base.likelihood.weights(residual).nats + unknowns.prior(points[n])[0]
    return np.asarray(points[int(np.argmin(costs))])


def ranked(every: Sequence[Score]) -> list[Score]:
    """The variants worth a refit, at most `VARIANTS` of an effect, best first."""
    found: list[Score] = []
    chosen: dict[str, list[Score]] = {}
    best = every[0].gain if every else 0.0
    for score in every:
        of_effect = chosen.get(score.variant.effect, [])
        if len(of_effect) >= VARIANTS or (not of_effect and len(chosen) >= MOST_TRIED):
            continue
        if score.gain < SHARE * best and len(chosen) >= FEWEST_TRIED:
            continue
        if of_effect and score.gain < 0.5 * of_effect[0].gain:
            continue
        chosen.setdefault(score.variant.effect, []).append(score)
        found.append(score)
    return found


class _Screening:
    """What is told while candidates are screened: how many are left, which leads, how long it may take."""

    def __init__(self, tell: Callable[[str], None], count: int) -> None:
        self._tell, self._count = tell, count
        self._begun, self._done = 0, 0
        self._leader: Refit | None = None
        self._since, self._lock = time.monotonic(), threading.Lock()

    def begins(self, score: Score) -> None:
        """Tells that a candidate is looked at."""
        with self._lock:
            self._begun += 1
            told = f"{score.variant.name}, {self._begun} of {self._count}"
            if self._leader is not None:
                told += f"; best so far {self._leader.variant.effect}, {self._leader.gain:.3g} nats"
            if self._done:
                each = (time.monotonic() - self._since) / self._done
                told += f"; about {each * (self._count - self._done):.0f} s left for screening"
        self._tell(told)

    def ends(self, refit: Refit | None) -> Refit | None:
        """Keeps what a candidate came to."""
        with self._lock:
            self._done += 1
            if refit is not None and (self._leader is None or refit.gain > self._leader.gain):
                self._leader = refit
        return refit


class _Refinement:
    """The refits of candidates beside a fit: all are screened by a few steps, those that lag far behind are eliminated,
    and those in front go on until nothing more is to be gained. The outcome does not depend on the number of threads.
    """

    def __init__(self, base: Fit, tell: Callable[[str], None], memory: FitMemory) -> None:
        self.base, self.tell, self.memory = base, tell, memory
        self.nuisance_columns = base.jacobian[:, : base.unknowns.n_nuisance]

    def best_first(self, candidates: Sequence[Score], *, threads: int) -> list[Refit]:
        """All refits by their gain."""
        told = _Screening(self.tell, len(candidates))
        with ThreadPoolExecutor(threads) as pool:
            first = pool.map(lambda score: told.ends(self.screened(score, told)), candidates)
            screened = [refit for refit in first if refit is not None]
            best = max((refit.gain for refit in screened), default=0.0)
            eliminated = [refit for refit in screened if best > 0 and refit.gain < ELIMINATED * best]
            kept = [refit for refit in screened if refit not in eliminated]
            refined = sorted(pool.map(self.refined, kept), key=_by_gain)
            ends = []
            for place, refit in enumerate(refined):
                near = refit.gain > 0 and refit.gain + refit.fit.predicted > refined[0].gain - NEAR
                enough = max(CONVERGED, FRACTION * refit.gain if place else 0.0)
                ends.append(enough if near else np.inf)
            converged = list(pool.map(self.converged, refined, ends))
        return sorted([*converged, *eliminated], key=_by_gain)

    def screened(self, score: Score, told: _Screening) -> Refit | None:
        """A candidate after its first steps; None where it cannot be simulated."""
        told.begins(score)
        plan = FitPlan(most_steps=SCREENING_STEPS, renew=False)
        unknowns = extended(self.base.unknowns, score.variant)
        begin = self.memory.end_of(fit_name(self.base.unknowns, score.variant.name), unknowns)
        try:
            begin = started(self.base, score) if begin is None else begin
            return self._refit(self.base, score.variant, begin, plan, self.nuisance_columns)
        except ComputationError:
            return None

    def refined(self, refit: Refit) -> Refit:
        """A candidate that was kept, where its steps lead to; the nuisances' columns are those of a point nearby."""
        enough = max(ROUGH, FRACTION * max(refit.gain, 0.0))
        plan = FitPlan(most_steps=REFINEMENT_STEPS, enough=enough, fresh_end=False)
        columns = refit.fit.jacobian[:, : self.base.unknowns.n_nuisance]
        return self._refit(refit.fit, refit.variant, refit.fit.z, plan, columns)

    def converged(self, refit: Refit, enough: float) -> Refit:
        """A candidate in front, with all columns of its own, of which a further step would gain no more than enough."""
        if enough == np.inf:
            return refit
        return self._refit(refit.fit, refit.variant, refit.fit.z, FitPlan(most_steps=LAST_STEPS, enough=enough), None)

    def _refit(self, near: Fit, variant: Variant, z: Array, plan: FitPlan, columns: Array | None) -> Refit:
        unknowns = extended(self.base.unknowns, variant)
        found = fit(near.likelihood, unknowns, z, plan=plan, nuisance_columns=columns)
        self.memory.ended(fit_name(self.base.unknowns, variant.name), found.z)
        return Refit(variant, found, found.log_evidence - self.base.log_evidence)


def _by_gain(refit: Refit) -> float:
    return -refit.gain
