"""The search for causes: from a converged fit without, score all, refit the best, keep the best of these, go on.

Forward with all parameters fitted anew at each stage; a stage's candidates are chosen by the linear evidence of all
variants of all effects and judged by the evidence of their own converged fits.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.signal import find_peaks

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.first_part import best_first
from msl_fem.diagnosis.fit import FitPlan, fit, with_the_rest
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.gathered import gathered_here, in_gatherings
from msl_fem.diagnosis.likelihood import Fit, white
from msl_fem.diagnosis.null import NullDistribution
from msl_fem.diagnosis.refinement import AT_ONCE, HELD_UP, MADE_UP, Refinement
from msl_fem.diagnosis.refits import BENT, LAST_STEPS, Refit, extended, objectives, strained
from msl_fem.diagnosis.scores import AmountColumns, Score, ScoredVariants, scored
from msl_fem.diagnosis.unknowns import EffectUnknown
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant.effects import CATALOGUE

MOST_TRIED = 7
FEWEST_TRIED = 3
LIKELY = 10
"""Effects that are best by columns of a stage before, and so are scored exactly: more than are refitted."""
SHARE = 0.03  # of the best score: effects below are not refitted
VARIANTS = 2  # of an effect that are refitted
FORM = 0.25
"""Share of the best score of an effect, above which another form of it is refitted too."""
STANDS_OUT = 5.0
"""Nats of its neighbours on the grid of a shape, by which a score is a peak of its own."""
FINITE = (0.03, 0.1, 0.3, 1.0)  # of z: sizes in which an amount that may act beyond a threshold is tried
AS_IT_IS = 0.25
"""Share of the best score that an amount of some size has to bring, with all else as it is, to be tried."""
FAR_ABOVE = 40.0
HOPELESS = 1 / 3  # of the nats that an effect needs, below which linear scores beside noise are taken at their word
NEAR_END = 10.0  # nats that a fit without effects is from its end, where its columns are those of the end
COMPENSATED = ("gap_offset", "early_saturation", "fringing", "armature_tilt", *HELD_UP, *MADE_UP)
"""Effects that gap, scale, table, mass and gains make up for nearly: at a strained fit a linear score misses them."""


@dataclass(frozen=True, eq=False)
class SearchStage:
    """A fit, and what one effect more would bring: all scores, and the refits, best first; the columns of the scores as
    long as they are of use."""

    base: Fit
    scores: tuple[Score, ...]
    refits: tuple[Refit, ...]
    null: NullDistribution = field(default_factory=NullDistribution)
    columns: AmountColumns | None = None

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
    memory: FitMemory | None = None,
    needed: Callable[[Variant], float] = lambda variant: 0.0,
    hopeless: Callable[[Refit], bool] = lambda refit: False,
    near: AmountColumns | None = None,
) -> SearchStage:
    """What one of these variants more would bring to a fit, which is converged as far as that asks for; refits begin
    where `memory` says that they ended. Where the fit leaves noise alone, and all scores are far below the nats that
    their effects need, a first effect's best one alone is refitted, and none behind a first effect: there the columns
    of a stage before, `near`, tell which effects are, and these go no further, unless parameters are bent. Where more
    than noise is left they tell which are scored exactly. Refits that will not count are not led to their ends."""
    tell("all effects")
    quiet = white(start.excess)
    base = converged_base(start) if quiet else start

    def worth(score: Score) -> bool:
        return score.gain >= HOPELESS * needed(score.variant)

    beside = quiet and near is not None and not strained(base, BENT)
    if beside:
        roughly = replace(scored(base, tried, near=near), columns=None)
        seen = {score.variant.effect for score in filter(worth, roughly.scores)}
        if not seen:
            return SearchStage(base, roughly.scores, (), roughly.null)
        tried = _of_effects({*seen, *COMPENSATED}, tried)
    elif quiet and near is not None:  # what is faint beside noise, columns from far away do not tell
        near.lets_go()
    telling = None if quiet else near
    at_base = scored_where_likely(base, tried, telling)
    if at_base.dropped:
        tell(f"all effects but those with which the runs cannot be simulated here: {', '.join(at_base.dropped)}")
    every = at_base.scores
    if not base.converged and not quiet and not (every and every[0].gain > FAR_ABOVE + 10 * base.predicted):
        base = converged_base(start)
        if base is not start:
            at_base = scored_where_likely(base, tried, telling)
            every = at_base.scores
    columns = near if beside else at_base.columns
    at_base = replace(at_base, columns=None)
    candidates = ranked(every)
    candidates += peaks(every, candidates)
    if not quiet and base.sane is None:
        candidates += beyond_thresholds(base, every, candidates)
    if quiet and not any(map(worth, candidates)):
        candidates = candidates[: 0 if base.unknowns.effects else 1]
    elif quiet and base.unknowns.effects:
        candidates = [one for one in candidates if worth(one) or one.variant.effect in COMPENSATED]
    if strained(base, BENT):
        made_up_for = COMPENSATED if strained(base) else MADE_UP
        missing = set(made_up_for) - {score.variant.effect for score in candidates}
        candidates += [score for score in _best_of(every) if score.variant.effect in missing]
    kept = memory or FitMemory()
    kept.ended(fit_name(base.unknowns), base.z)
    refits = best_first(base, candidates, partial(Refinement, tell=tell, hopeless=hopeless, variants=tried), kept)
    return SearchStage(base, every, tuple(refits), at_base.null, columns)


def scored_where_likely(base: Fit, tried: Sequence[Variant], near: AmountColumns | None) -> ScoredVariants:
    """The variants at a fit that leaves more than noise. Columns of a stage before, where they are of its stretches,
    tell which effects are not among the best: of these they are taken, the others are simulated."""
    if near is None or not tried or base.sane is not None or not near.suit(base):
        return scored(base.sane or base, tried)
    roughly = scored(base, tried, near=near)
    assert roughly.columns is not None
    simulated = roughly.columns.without(near)
    roughly = replace(roughly, columns=None)
    best = dict.fromkeys(score.variant.effect for score in roughly.scores)
    likely = {*list(best)[:LIKELY], *COMPENSATED}
    exact = scored(base, _of_effects(likely, tried), null=False, near=simulated)
    others = [score for score in roughly.scores if score.variant.effect not in likely]
    scores = sorted([*exact.scores, *others], key=lambda score: -score.gain)
    dropped = dict.fromkeys((*exact.dropped, *roughly.dropped))
    return ScoredVariants(tuple(scores), roughly.null, tuple(dropped), near)


def _of_effects(effects: Collection[str], tried: Sequence[Variant]) -> list[Variant]:
    return [variant for variant in tried if variant.effect in effects]


def beyond_thresholds(base: Fit, every: Sequence[Score], chosen: Sequence[Score]) -> list[Score]:
    """Of effects that are chosen the variants with an amount that the chosen ones lack, which as it is, in one of some
    sizes, brings a good part of what the best linear score promises (`AS_IT_IS`): the slope at nothing says little of
    what acts beyond a threshold, as a slew limit does. Such amounts are one-sided. Those that are measured in sampling
    periods, lags and delays, are tried whatever is chosen, where their slope promises nothing: what follows within a
    sample shows nothing of a lag that is well below a period. Of these counts what they bring when all else has moved
    a step to suit them, where as it is they bring anything. Others that cannot be negative begin beside such an amount
    in the least of the sizes: at nothing they may have no slope either."""
    effects = {score.variant.effect for score in chosen}
    had = {amount.place for score in chosen for amount in score.variant.amounts}
    lacking: list[Score] = []
    late: list[Score] = []
    for score in every:
        [amount, *more] = score.variant.amounts
        if more or amount.place in had or not amount.one_sided:
            continue
        hidden = _in_periods(amount) and score.gain <= 0.0
        if score.variant.effect not in effects and not hidden:
            continue
        had.add(amount.place)
        lacking.append(score)
        late += [score] if hidden else []

    def points_of(score: Score, sizes: Sequence[float]) -> Array:
        shapes = np.zeros(len(score.variant.shapes))
        return np.array([np.concatenate([base.z, [size], shapes]) for size in sizes])

    def costs_of(score: Score) -> Array:
        likelihood = base.likelihood.gathering(gathered_here())
        return objectives(likelihood, extended(base.unknowns, score.variant), points_of(score, FINITE))

    found: list[Score] = []
    every_cost = in_gatherings(costs_of, lacking, at_once=AT_ONCE, threads=base.likelihood.threads)
    for score, costs in zip(lacking, every_cost, strict=True):
        [amount] = score.variant.amounts
        gain, size = float(base.objective - costs.min()), FINITE[int(np.argmin(costs))]
        if score in late and 0.0 < gain <= AS_IT_IS * every[0].gain:
            [point] = points_of(score, [size])
            gain = base.objective - with_the_rest(base, extended(base.unknowns, score.variant), point)
        if gain > AS_IT_IS * every[0].gain:
            for one in (*_forms_of(every, score), *_fullest(every, score)):
                begins = {own.place: FINITE[0] if own.one_sided else 0.0 for own in one.variant.amounts}
                guess = np.array(list((begins | {amount.place: size}).values()))
                found.append(replace(one, gain=gain, guess=guess, shift=np.zeros_like(one.shift)))
    return found


def _in_periods(amount: EffectUnknown) -> bool:
    """Whether an amount is measured in sampling periods."""
    return ("period", 1) in CATALOGUE[amount.effect].parameter(amount.name).of


def _forms_of(every: Sequence[Score], single: Score) -> list[Score]:
    """The variants with the one amount of a single one, alike or with other shapes."""
    return [
        one
        for one in every
        if one.variant.effect == single.variant.effect and one.variant.amounts == single.variant.amounts
    ]


def _fullest(every: Sequence[Score], single: Score) -> list[Score]:
    """The variant of an effect with most amounts beside a single one; none where it has none beside it."""
    [amount] = single.variant.amounts
    more = [
        one
        for one in every
        if one.variant.effect == single.variant.effect
        and amount.place in [own.place for own in one.variant.amounts]
        and len(one.variant.amounts) > 1
    ]
    return sorted(more, key=lambda one: -len(one.variant.amounts))[:1]


def converged_base(start: Fit) -> Fit:
    """A fit from where it is to its end; its Jacobian stays with the end alone, computed anew there unless that is so
    near that it is the same."""
    if start.converged or start.finished:
        return start
    columns = start.jacobian[:, : start.unknowns.n_nuisance]
    plan = FitPlan(most_steps=LAST_STEPS) if start.unknowns.effects else FitPlan(fresh_end=start.predicted > NEAR_END)
    found = fit(start.likelihood, start.unknowns, start.z, plan=plan, nuisance_columns=columns)
    start.lets_go()
    return found


def _best_of(every: Sequence[Score]) -> list[Score]:
    """Of scores in their order, whose guess is not nothing, the best of each effect; of one that much makes up for
    (`MADE_UP`) with all its amounts: one side's alone is as far from two of either sign as nothing is."""
    guessed = [one for one in every if np.any(one.guess != 0)]
    most: dict[str, int] = {}
    for one in guessed:
        most[one.variant.effect] = max(most.get(one.variant.effect, 0), len(one.variant.amounts))
    found: dict[str, Score] = {}
    for one in guessed:
        effect = one.variant.effect
        if effect not in MADE_UP or len(one.variant.amounts) == most[effect]:
            found.setdefault(effect, one)
    return list(found.values())


def statistics_of(stages: Sequence[SearchStage]) -> tuple[tuple[tuple[str, float], ...], ...]:
    """Of each stage the best effects with their gains."""
    return tuple(tuple((r.variant.effect, r.gain) for r in one.refits[:3]) for one in stages)


def ranked(every: Sequence[Score]) -> list[Score]:
    """The variants worth a refit, best first: at most `VARIANTS` of an effect, and one more with a shape that these
    lack, of which a linear score may tell little, since it bends far out."""
    found: list[Score] = []
    chosen: dict[str, list[Score]] = {}
    best = every[0].gain if every else 0.0
    for score in every:
        of_effect = chosen.get(score.variant.effect, [])
        bent = len(of_effect) <= VARIANTS and _bent(score, of_effect)
        if (len(of_effect) >= VARIANTS and not bent) or (not of_effect and len(chosen) >= MOST_TRIED):
            continue
        if score.gain < SHARE * best and len(chosen) >= FEWEST_TRIED:
            continue
        if of_effect and score.gain < FORM * of_effect[0].gain and not bent:
            continue
        chosen.setdefault(score.variant.effect, []).append(score)
        found.append(score)
    return found


def _bent(score: Score, chosen: Sequence[Score]) -> bool:
    """Whether a variant has the amounts of one that is chosen, more shapes than any such, and a guess."""
    shapes = {shape.name for shape in score.variant.shapes}
    alike = [one.variant for one in chosen if one.variant.amounts == score.variant.amounts]
    more = all({shape.name for shape in one.shapes} < shapes for one in alike)
    return bool(alike) and more and bool(np.any(score.guess != 0))


def peaks(every: Sequence[Score], chosen: Sequence[Score]) -> list[Score]:
    """Of each effect that is chosen the further peak over the grid of a shape that stands out most: next to a resonance
    between two points of a grid the springs far below and above it score more, and lead nowhere."""
    least = {score.variant.effect: FORM * score.gain for score in reversed(chosen)}
    families: dict[tuple[object, ...], list[Score]] = {}
    for score in every:
        if score.variant.effect in least and score.variant.shapes:
            names = (score.variant.effect, *(amount.name for amount in score.variant.amounts))
            families.setdefault((*names, *score.variant.shapes[1:]), []).append(score)
    found: dict[str, tuple[float, Score]] = {}
    for (effect, *_), family in families.items():
        along = sorted(family, key=lambda score: score.variant.shapes[0].centre)
        places, told = find_peaks([score.gain for score in along], prominence=STANDS_OUT)
        for place, height in zip(places, told["prominences"], strict=True):
            score = along[place]
            if score not in chosen and score.gain >= least[str(effect)] and height > found.get(str(effect), (0.0,))[0]:
                found[str(effect)] = float(height), score
    return [score for _, score in found.values()]
