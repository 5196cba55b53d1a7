"""A set of effects put right: each is dropped, or another tried in its place, beside all the others.

A search forward takes first what alone makes up for most, and of several causes that may be none: once the others are
there it is superfluous, or another explains the same better, or one of them does in another form. Steps back until
nothing changes mend that (Pudil, Novovicova and Kittler, Pattern Recognition Letters 15, 1994, 1119-1125).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.fit import FitPlan, fit
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.refits import LAST_STEPS, SCREENING_STEPS, SHARES, Refit, extended, let_go, objectives
from msl_fem.diagnosis.search import SearchStage
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError
from msl_fem.plant.effects import CATALOGUE

WORTH = 0.25
"""Of the best gain at a stage of the search, from which an effect is tried in another's place."""
MOST = 3
"""Effects that are tried in the place of one, and other forms of its own."""
ROUNDS = 3
FULLER = 0.1
"""Of the nats that a set loses without an effect, that the rest of another's form makes up for at once, to be tried."""
SIZES = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Of an amount, in units of its prior, with which such a rest begins: beside the form that is there it may be far from
linear."""
FAR = 50.0
"""Nats behind the set, after some steps and what a further one promises, at which a trial ends."""


@dataclass(frozen=True, eq=False)
class EffectSet:
    """Effects beside each other, fitted together: their variants in the order of the fit's unknowns."""

    variants: tuple[Variant, ...]
    fit: Fit

    @property
    def effects(self) -> set[str]:
        return {variant.effect for variant in self.variants}

    def part(self, places: Sequence[int]) -> tuple[tuple[Variant, ...], Unknowns, Array]:
        """(variants, unknowns, numbers) of some of the effects, in this order."""
        n = self.fit.unknowns.n_nuisance
        ends = np.cumsum([len(variant.unknowns) for variant in self.variants])[:-1]
        own = np.split(self.fit.z[n:], ends)
        variants = tuple(self.variants[at] for at in places)
        effects = tuple(one for variant in variants for one in variant.unknowns)
        z = np.concatenate([self.fit.z[:n], *(own[at] for at in places)])
        return variants, replace(self.fit.unknowns, effects=effects), z

    def fuller(self, n: int, rest: Variant, z: Array) -> tuple[tuple[Variant, ...], Unknowns, Array]:
        """(variants, unknowns, numbers) with the rest of its form beside what effect n has; z: with that at the end."""
        have = self.variants[n]
        whole = Variant(have.effect, (*have.amounts, *rest.amounts), (*have.shapes, *rest.shapes))
        variants = (*self.variants[:n], whole, *self.variants[n + 1 :])
        effects = tuple(one for variant in variants for one in variant.unknowns)
        values = dict(zip((*self.fit.unknowns.effects, *rest.unknowns), z[self.fit.unknowns.n_nuisance :], strict=True))
        own = [values[one] for one in effects]
        z = np.concatenate([z[: self.fit.unknowns.n_nuisance], own])
        return variants, replace(self.fit.unknowns, effects=effects), z

    def without(self, n: int) -> tuple[tuple[Variant, ...], Unknowns, Array]:
        """(variants, unknowns, numbers) without effect n."""
        return self.part([at for at in range(len(self.variants)) if at != n])


@dataclass(frozen=True, eq=False)
class _Place:
    """An effect of a set: the nats that are lost without it, and what was tried in its place."""

    loss: float
    others: tuple[Refit, ...]


class Exchange:
    """Steps back from the end of a search forward.

    Parameters
    ----------
    least : nats that an effect has to bring beside the others
    better : nats by which another has to be more probable in its place
    """

    def __init__(self, least: float, better: float, tell: Callable[[str], None], memory: FitMemory) -> None:
        self.least, self.better, self.tell, self.memory = least, better, tell, memory

    def chain(self, fits: Sequence[Fit], stages: Sequence[SearchStage]) -> tuple[list[Fit], list[SearchStage]]:
        """Fits and stages of the set that the steps lead to, what it needs most first. Where that is the one to which
        the search came, the fits are the same, and at a stage others stand as they are beside the whole set.

        Parameters
        ----------
        fits : without effects, with the first, and so on, (n_effect + 1,)
        stages : at each of them, (n_effect,) or one more
        """
        variants = tuple(stage.best.variant for stage in stages[: len(fits) - 1] if stage.best is not None)
        began = found = EffectSet(variants, fits[-1])
        known = [_tried(stage) for stage in stages]
        forms = [score.variant for score in stages[0].scores]
        places: list[_Place] = []
        for _ in range(ROUNDS):
            found, places, settled = self._round(found, known, forms)
            if settled:
                break
        if found is not began or _led_by_another(variants, stages[0]):
            return self._rebuilt(found, places, fits[0], stages[0])
        beside = [_beside_the_others(stage, place, found) for stage, place in zip(stages, places, strict=False)]
        return list(fits), [*beside, *stages[len(beside) :]]

    def _round(
        self, found: EffectSet, known: Sequence[Sequence[Refit]], forms: Sequence[Variant]
    ) -> tuple[EffectSet, list[_Place], bool]:
        """Every effect once, the first first; the set after a change, and whether there was none."""
        places = []
        for n, variant in enumerate(found.variants):
            self.tell(f"{variant.effect} dropped or exchanged beside the others")
            try:
                without = self._without(found, n)
            except ComputationError:  # the others alone cannot even be followed there
                places.append(_Place(np.inf, ()))
                continue
            loss = found.fit.log_evidence - without.fit.log_evidence
            if loss < self.least:
                return without, [], False
            _, _, z = found.without(n)  # fitted without it, the others would be bent
            rests = dict.fromkeys((m, rest) for m, have in enumerate(without.variants) for rest in _rests(have, forms))
            for fuller in self._fuller(found, without, z, list(rests), loss):
                if fuller.fit.log_evidence > found.fit.log_evidence - self.least:
                    return fuller, [], False
            others = tuple(self._in_place(found, n, without, _worth(found, variant, known), forms))
            best = max(others, key=lambda one: one.fit.log_evidence, default=None)
            if best is not None and best.fit.log_evidence > found.fit.log_evidence + self.better:
                return EffectSet((*without.variants, best.variant), best.fit), [], False
            let_go(others)
            places.append(_Place(loss, others))
        return found, places, True

    def _without(self, found: EffectSet, n: int) -> EffectSet:
        """The others, fitted anew."""
        variants, unknowns, z = found.without(n)
        name = fit_name(unknowns, f"without {found.variants[n].name}")
        again = self._fitted(found, unknowns, name, z, LAST_STEPS)
        self.memory.ended(name, again.z)
        return EffectSet(variants, again)

    def _fuller(
        self, found: EffectSet, others: EffectSet, z: Array, rests: Sequence[tuple[int, Variant]], missing: float
    ) -> Iterator[EffectSet]:
        """Others in the place of a set found, at z, one of them in a fuller form, the most promising first, where what
        its form lacks makes up for a good part of the nats that are missing: a drive's lag and slew limit are one
        cause, and the limit beside a delay are two."""
        promised = []
        now = float(objectives(found.fit.likelihood, others.fit.unknowns, z[None])[0]) if rests else 0.0
        for m, rest in rests:
            unknowns = extended(others.fit.unknowns, rest)
            begins = np.array([np.concatenate([z, row]) for row in _sizes(rest)])
            costs = objectives(found.fit.likelihood, unknowns, begins)
            best = int(np.argmin(costs))
            promised.append((now - float(costs[best]), m, rest, begins[best]))
        likely = [one for one in promised if one[0] > FULLER * missing]
        for _, m, rest, begin in sorted(likely, key=lambda one: -one[0])[:MOST]:
            variants, unknowns, begin = others.fuller(m, rest, begin)
            name = fit_name(unknowns, f"{rest.name} more of it")
            try:
                tried = self._followed(found, unknowns, name, begin)
            except ComputationError:
                continue
            yield EffectSet(variants, tried)

    def _in_place(
        self, found: EffectSet, n: int, without: EffectSet, worth: Sequence[Refit], forms: Sequence[Variant]
    ) -> Iterator[Refit]:
        """Others in the place of effect n, each followed as long as it may come near the set, and where it does not
        come up to it in fuller forms as well."""
        _, _, z = found.without(n)
        nats = without.fit.log_evidence
        for other in worth:
            unknowns = extended(without.fit.unknowns, other.variant)
            begin = np.concatenate([z, other.fit.z[-len(other.variant.unknowns) :]])
            name = fit_name(without.fit.unknowns, f"{other.variant.name} in place of {found.variants[n].effect}")
            try:
                tried = self._followed(found, unknowns, name, begin)
            except ComputationError:
                continue
            yield Refit(other.variant, tried, tried.log_evidence - nats)
            missing = found.fit.log_evidence - tried.log_evidence
            if missing > 0 and other.variant.effect != found.variants[n].effect:
                whole = EffectSet((*without.variants, other.variant), tried)
                rests = [(len(without.variants), rest) for rest in dict.fromkeys(_rests(other.variant, forms))]
                for fuller in self._fuller(found, whole, tried.z, rests, missing):
                    yield Refit(fuller.variants[-1], fuller.fit, fuller.fit.log_evidence - nats)

    def _followed(self, found: EffectSet, unknowns: Unknowns, name: str, begin: Array) -> Fit:
        """A trial, as long as it may come near the set."""
        tried = self._fitted(found, unknowns, name, begin, SCREENING_STEPS)
        if tried.log_evidence + tried.predicted > found.fit.log_evidence - FAR:
            tried = fit(tried.likelihood, unknowns, tried.z, plan=FitPlan(most_steps=LAST_STEPS))
        self.memory.ended(name, tried.z)
        return tried

    def _fitted(self, found: EffectSet, unknowns: Unknowns, name: str, begin: Array, steps: int) -> Fit:
        """A fit of the set's record, from where it ended if it is known by this name."""
        likelihood, known = found.fit.likelihood, self.memory.end_of(name, unknowns)
        columns = None if likelihood.is_cut else found.fit.jacobian[:, : unknowns.n_nuisance]
        begin = begin if known is None else known
        return fit(likelihood, unknowns, begin, plan=FitPlan(most_steps=steps), nuisance_columns=columns)

    def _rebuilt(
        self, found: EffectSet, places: Sequence[_Place], first: Fit, stage: SearchStage
    ) -> tuple[list[Fit], list[SearchStage]]:
        """Fits and stages as a search forward would have them that took the effects in the order of their losses."""
        losses = [place.loss for place in places] or [0.0] * len(found.variants)
        order = sorted(range(len(losses)), key=lambda n: -losses[n])
        fits, stages = [first], []
        for count in range(1, len(order) + 1):
            chosen, unknowns, z = found.part(order[:count])
            last = count == len(order)
            plan = FitPlan(most_steps=1 if last else LAST_STEPS)
            try:
                fits.append(fit(found.fit.likelihood, unknowns, z, plan=plan))
            except ComputationError:  # the numbers of the whole set cannot be followed without the others
                z = _behind(fits[-1], unknowns, z[fits[-1].z.size :])
                fits.append(fit(fits[-1].likelihood, unknowns, z, plan=plan))
            base, whole = fits[-2], fits[-1]
            gain = whole.log_evidence - base.log_evidence
            best = Refit(chosen[-1], whole, gain)
            own = SearchStage(base, stage.scores, (best,), stage.null) if count == 1 else SearchStage(base, (), (best,))
            stages.append(_beside_the_others(own, places[order[count - 1]], found) if places else own)
        return fits, stages


def _behind(before: Fit, unknowns: Unknowns, own: Array) -> Array:
    """Where a fit of one effect more may begin: where the fit without it ended, with its stretches, and of its own
    numbers as much as suits best there, nothing at the least."""
    amounts = np.array([unknown.width == 0.0 for unknown in unknowns.effects[-own.size :]])
    rows = [np.concatenate([before.z, np.where(amounts, share * own, own)]) for share in (*SHARES, 0.0)]
    return rows[int(np.argmin(objectives(before.likelihood, unknowns, np.array(rows))))]


def _beside_the_others(stage: SearchStage, place: _Place, found: EffectSet) -> SearchStage:
    """A stage with what was tried in the place of its effect: as far behind it as the whole set is with it."""
    best, *refits = stage.refits
    ahead = best.gain - found.fit.log_evidence
    tried = {one.variant.effect: replace(one, gain=ahead + one.fit.log_evidence) for one in place.others}
    kept = [one for one in refits if one.variant.effect not in tried]
    return replace(stage, refits=(best, *sorted([*tried.values(), *kept], key=lambda one: -one.gain)))


def _led_by_another(variants: Sequence[Variant], first: SearchStage) -> bool:
    """Whether a set was begun with an effect that alone brings less than another one of it."""
    others = {variant.effect for variant in variants[1:]}
    return any(one.gain > first.refits[0].gain for one in first.refits if one.variant.effect in others)


def _tried(stage: SearchStage) -> list[Refit]:
    """What came to a good part of what the best did, the best first."""
    return [one for one in stage.refits if one.gain > 0 and one.gain >= WORTH * stage.refits[0].gain]


def _form(variant: Variant) -> tuple[str, ...]:
    """The names of what is unknown of an effect."""
    return tuple(one.name for one in variant.unknowns)


def _rests(have: Variant, forms: Sequence[Variant]) -> Iterator[Variant]:
    """What fuller forms of an effect have beyond one of its forms."""
    names = {one.name for one in have.unknowns}
    for form in forms:
        if form.effect == have.effect and names < {one.name for one in form.unknowns}:
            amounts, shapes = (tuple(one for one in of if one.name not in names) for of in (form.amounts, form.shapes))
            yield Variant(have.effect, amounts, shapes)


def _sizes(rest: Variant) -> list[Array]:
    """(n_unknown,) nothing of what an effect may have besides, and each amount at several sizes."""
    rows = [np.zeros(len(rest.unknowns))]
    for n, amount in enumerate(rest.amounts):
        for size in SIZES if amount.one_sided else (*SIZES, *(-size for size in SIZES)):
            rows.append(np.zeros(len(rest.unknowns)))
            rows[-1][n] = size
    return rows


def _worth(found: EffectSet, variant: Variant, known: Sequence[Sequence[Refit]]) -> list[Refit]:
    """What is tried in the place of an effect: rivals of the stage that chose it, then others, none of the set nor what
    one of it deviates by from its form; and the effect in other forms."""
    stages = sorted(known, key=lambda tried: [one.variant.effect for one in tried[:1]] != [variant.effect])
    by_effect: dict[str, Refit] = {}
    forms: dict[tuple[str, ...], Refit] = {}
    for one in (one for tried in stages for one in tried):
        by_effect.setdefault(one.variant.effect, one)
        if one.variant.effect == variant.effect:
            forms.setdefault(_form(one.variant), one)
    forms.pop(_form(variant), None)
    stay = found.effects - {variant.effect}
    outside = [one for one in by_effect.values() if one.variant.effect not in found.effects]
    others = [one for one in outside if stay.isdisjoint(CATALOGUE[one.variant.effect].deviation_of)]
    return [*others[:MOST], *list(forms.values())[:MOST]]
