"""The terms of a formula, chosen one after the other by their evidence, each simulated beside all that is unknown.

Every term of a library (`formula_terms`) is a law in its equation. The linear evidence of all terms at a fit and what
the whole library brings by chance (`null`) are those of effects (`scores`); the best terms are fitted anew with
everything else, and the one of the highest evidence is kept. Further terms of the same equation are looked for beside
it as long as each leaves little of what was left: forward selection by evidence, where Brunton, Proctor and Kutz (PNAS
113, 2016, 3932-3937) cut small coefficients of a regression on derivatives.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from msl_fem.computing.laws import LawExpression
from msl_fem.diagnosis.decision import BY_CHANCE, completes, excess_power
from msl_fem.diagnosis.first_part import in_first_part
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.formula_terms import law_sizes, library
from msl_fem.diagnosis.likelihood import Fit, white
from msl_fem.diagnosis.linear_model import Background
from msl_fem.diagnosis.null import AmountPlaces, NullDistribution, null_distribution
from msl_fem.diagnosis.refinement import Refinement
from msl_fem.diagnosis.refits import Refit, let_go
from msl_fem.diagnosis.scores import Score, score_of, seen_columns, signatures
from msl_fem.diagnosis.search import converged_base, ranked
from msl_fem.diagnosis.variants import record_features, variants
from msl_fem.plant.effects import declared
from msl_fem.plant.effects.expressions import DECLARED, MOST_PARAMETERS

LEAST = 12.0  # nats that a term brings at least
OUT_OF_SIGHT = 0.1  # of the nats that a term has to bring, below which no score has a prospect of them
EXPLAINED = 0.3  # share of the excess power that a formula takes at least
MOST_TERMS = 3


@dataclass(frozen=True, eq=False)
class ChosenTerms:
    """Terms that were taken beside a start, the fit with them, and what was tried first."""

    start: Fit
    fit: Fit
    laws: tuple[LawExpression, ...]
    gain: float
    p_value: float
    first: tuple[tuple[LawExpression, Refit], ...]


def chosen_terms(
    start: Fit, *, tell: Callable[[str], None], most: int = MOST_TERMS, least: float = LEAST
) -> ChosenTerms | None:
    """Terms taken one after the other beside a fit; None where the first is not worth it: it has to bring `least` nats.
    Terms that will not be worth it are not led to their ends."""
    problem = start.likelihood.problem
    laws = library(problem.plant.parameters, law_sizes(problem.plant.parameters, problem.runs))
    base = converged_base(start)
    found: ChosenTerms | None = None
    for _ in range(most):
        taken = () if found is None else found.laws
        before = base if found is None else found.fit
        with declared(*taken):
            tried = [law for law in laws if _goes_with(law, taken)]
            further = _best_term(before, tried, taken, tell, LEAST if taken else least)
        if further is None or not _worth(before, further, taken):
            break
        found = _with_term(base, found, further)
        if white(found.fit.excess):
            break
    return found


@dataclass(frozen=True, eq=False)
class _Step:
    """The best term beside a fit, and all that were fitted anew with what they leave."""

    refits: tuple[tuple[LawExpression, Refit], ...]
    null: NullDistribution


def _goes_with(law: LawExpression, taken: Sequence[LawExpression]) -> bool:
    return all(law.equation == one.equation and law.name != one.name for one in taken)


def _best_term(
    base: Fit,
    laws: Sequence[LawExpression],
    taken: Sequence[LawExpression],
    tell: Callable[[str], None],
    least: float,
) -> _Step | None:
    """Every term scored, the best ones beside those that were taken fitted anew with everything else: of a long record
    first over its first part, where that tells them apart, and over all of it what has a prospect there."""
    tell(f"{len(laws)} terms of a formula")
    scores, null = _scored(base, laws)
    if not scores or scores[0].gain < max(LEAST, OUT_OF_SIGHT * least):
        return None
    best = _first_of_each(ranked(scores))
    by_name = {law.effect: law for law in laws}
    tried = {law.effect: law for law in _within_room([by_name[name] for name in best])}
    with declared(*tried.values()):
        refits = _refits(base, [best[name] for name in best if name in tried], taken, tell, least)
        pairs = tuple((tried[refit.variant.effect], refit) for refit in refits)
        for _, refit in pairs:
            assert refit.fit.excess  # simulated while the terms are declared
    return _Step(pairs, null) if pairs else None


def _refits(
    base: Fit, scores: Sequence[Score], taken: Sequence[LawExpression], tell: Callable[[str], None], least: float
) -> list[Refit]:
    """Terms fitted anew beside a fit, best first. One that has to bring a share of the nats above noise has to bring it
    of the first part of a long record as well: what has no prospect of it there is not looked at over all of it."""

    def beside(found: Fit, least: float, **told: Any) -> Refinement:
        return Refinement(
            found, lambda text: tell(f"a formula: {text}"), FitMemory(), partial(_hopeless, found, taken, least), **told
        )

    first = None if base.sane is not None else in_first_part(base)
    if first is None:
        return beside(base, least).best_first(scores)
    there = beside(first, least * first.nats_above_noise / base.nats_above_noise, of_part=True)
    refits = there.best_first(scores)
    ends = {one.variant: one.fit.z for one in refits if not there.hopeless(one)}
    let_go(refits)
    return beside(base, least, ends=ends).best_first([score for score in scores if score.variant in ends])


def _scored(base: Fit, laws: Sequence[LawExpression]) -> tuple[list[Score], NullDistribution]:
    """All terms at a fit, best first, and what any of them brings by chance, of a long record as its first part tells.
    The kernel has room for some at a time."""
    scores, columns = [], []
    features = record_features(base.likelihood, base)
    there = in_first_part(base) or base
    times = base.residual.size / there.residual.size
    plant = base.likelihood.problem.plant.parameters
    for batch in _batches(laws):
        with declared(*batch):
            tried = [variant for law in batch for variant in variants(law.effect, features, plant)]
            raw = signatures(there, [(variant.amounts[0], variant.shapes) for variant in tried])
            seen = np.flatnonzero(seen_columns(raw))
            background = Background(there, raw[:, seen])
            own = (score_of(background, tried[k], (place,)) for place, k in enumerate(seen))
            scores += [replace(score, gain=times * score.gain) for score in own]
            columns.append(raw[:, seen])
    if not scores:
        return [], NullDistribution()
    of_all = Background(there, np.concatenate(columns, axis=1)).own
    null = null_distribution(of_all, [AmountPlaces((n,), (False,)) for n in range(len(of_all))])
    return sorted(scores, key=lambda score: -score.gain), null


def _batches(laws: Sequence[LawExpression]) -> Iterator[list[LawExpression]]:
    """Laws that the kernel has room for at the same time."""
    left = list(laws)
    while left:
        batch = list(_within_room(left))
        if not batch:
            return
        yield batch
        left = left[len(batch) :]


def _within_room(laws: Iterable[LawExpression]) -> Iterator[LawExpression]:
    """The first laws that have room beside those that are declared."""
    room = MOST_PARAMETERS - sum(len(one.parameters) for one in DECLARED.values())
    for law in laws:
        room -= len(law.parameters)
        if room < 0:
            return
        yield law


def _first_of_each(scores: Sequence[Score]) -> dict[str, Score]:
    """The best score of each law, by its name as an effect."""
    found: dict[str, Score] = {}
    for score in scores:
        found.setdefault(score.variant.effect, score)
    return found


def _worth(before: Fit, step: _Step, taken: Sequence[LawExpression]) -> bool:
    """Whether the best term brings enough, and takes enough of what is in excess of the noise."""
    best = step.refits[0][1]
    if best.gain < max(LEAST, step.null.quantile(BY_CHANCE)):
        return False
    return _takes_enough(before.excess, best.fit.excess, taken)


def _takes_enough(before: Mapping[str, float], after: Mapping[str, float], taken: Sequence[LawExpression]) -> bool:
    """Whether a term takes enough of what is in excess of the noise: a first one a share, a further one most of it."""
    if taken:
        return completes(before, after)
    return excess_power(after) <= (1 - EXPLAINED) * excess_power(before)


def _hopeless(before: Fit, taken: Sequence[LawExpression], least: float, refit: Refit) -> bool:
    """Whether a term is not worth its end: it comes to fewer nats than it has to bring, or takes too little of what is
    in excess of the noise, also where that grows as its nats may."""
    return refit.reach < least or not _takes_enough(before.excess, refit.may_leave(before.excess), taken)


def _with_term(base: Fit, found: ChosenTerms | None, step: _Step) -> ChosenTerms:
    law, best = step.refits[0]
    if found is None:
        return ChosenTerms(base, best.fit, (law,), best.gain, step.null.p_value(best.gain), step.refits)
    return replace(found, fit=best.fit, laws=(*found.laws, law), gain=found.gain + best.gain)
