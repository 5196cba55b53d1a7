"""Candidates beside a fit, each fitted anew with everything else: screened by a few steps, those that lag far behind
eliminated, those in front followed until nothing more is to be gained.

Steps are dealt out in rounds, as in a race (Maron and Moore, Artificial Intelligence Review 11, 1997, 193-225): who has
no prospect of leading any more is stopped. All that run ask for their simulations at the same time.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.malloc import give_back
from msl_fem.diagnosis.fit import FIRST_LOOK, FitPlan, fit
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.gathered import Item, Stepped, gathered_here, in_gatherings
from msl_fem.diagnosis.likelihood import CONVERGED, Fit, Likelihood, first_columns, white
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.refits import (
    BENT,
    CATCHING_UP,
    FRACTION,
    LAST_STEPS,
    RACED_STEPS,
    ROUGH,
    SCREENING_STEPS,
    SMALL,
    Refit,
    as_believed,
    by_gain,
    effects_among,
    extended,
    leaves_noise,
    let_go,
    objectives,
    started,
    strained,
)
from msl_fem.diagnosis.scores import Score, scored
from msl_fem.diagnosis.screening import Screening
from msl_fem.diagnosis.variants import Variant
from msl_fem.errors import ComputationError
from msl_fem.plant.effects import find_parameter

ELIMINATED = 0.25  # of the gain that the best refit has made: a refit below it after screening goes no further
FIRST_STEPS = 20  # of a candidate that begins with `SMALL` amounts
WAYS, FEW_WAYS = 4, 2  # combinations of its amounts' signs with which it begins at most, and beside others
SIZES = np.geomspace(1 / 16, 512, 15)
"""Of the amounts of the leader that is begun at the belief, over those beside a model that has made up for it."""
LEAST = 1 / 64  # of these amounts, with which starts of stretches are found before
SHAPE_LEGS = 3  # of `FIRST_STEPS`, for a leader begun at other shapes
SHAPES_BESIDE = 2  # of these
FAR_BEHIND = 0.1
"""Of the gain that the best has made after a first look, to which a candidate has to come with what it promises."""
FRONT = 0.25  # of the best linear score: candidates that are looked at before the others
NEARLY_ALL = 0.15
"""Of the nats above white noise as loud as the instruments show it, that a candidate leaves where the others have next
to nothing to come to."""
LOST_NEAR = 0.15
"""Share of its gain, within which others are near what leads beside a model that is lost: few fits come to their ends
there."""
REFINEMENT_STEPS = 25
MORE_LEGS = 6  # of `LAST_STEPS`, for the leader and what begins far off alone, as long as they bring what counts
NEARLY = 0.5
"""Share of the best gain, to which another refit has to come to be of interest beside it."""
MADE_UP = ("remanent_flux",)
"""Effects that gains make up for as far as that: where more than noise is left their refits begin once more with all
else as believed."""
HIDDEN = 30.0
"""Nats that such an effect has to bring, by the linear model, beside a leader whose residuals are no larger than noise,
where that stands in for it all the same."""
HELD_UP = ("force_offset",)
"""Effects that a mass makes up for where the magnets carry it."""
NEAR = 15.0  # nats behind the best within which refits are converged
LED = 1e-4  # of its gain that the one that leads may still gain, `ROUGH` at most
ROUGHLY_CONVERGED = 0.5  # nats that a candidate may still gain which does not lead, or of which much more is asked
AT_ONCE = 3
"""Candidates that go on at the same time where each has starts of stretches of its own, which take memory, and after
some steps no simulation in common with another."""


class Refinement:
    """The refits of candidates beside a fit: all are screened by a few steps, those that lag far behind are eliminated,
    and those in front go on until nothing more is to be gained. Their simulations are run together.
    """

    def __init__(
        self,
        base: Fit,
        tell: Callable[[str], None],
        memory: FitMemory,
        hopeless: Callable[[Refit], bool] = lambda refit: False,
        variants: Sequence[Variant] = (),
        ends: Mapping[Variant, Array] | None = None,
        of_part: bool = False,
    ) -> None:
        """`ends` are numbers to which candidates have come over a part of the record; `of_part`: this is such a
        part."""
        self.base, self.tell, self.memory, self.hopeless = base, tell, memory, hopeless
        self.variants, self.ends, self.of_part = variants, ends or {}, of_part
        self.near, self.lost = base.sane or base, base.sane is not None
        self.nuisance_columns = self.near.jacobian[:, : base.unknowns.n_nuisance]

    def best_first(self, candidates: Sequence[Score], led: Sequence[Refit] = ()) -> list[Refit]:
        """All refits by their gain, those that were `led` to their ends before among them."""
        if self.lost:  # where no gain over the base means anything
            most = max((score.gain for score in candidates), default=0.0)
            candidates = [score for score in candidates if score.gain >= ELIMINATED * most]
        further, ended = self._screened(candidates, led)
        kept, eliminated = _in_front(self._held_up([*further, *ended]), led)
        let_go(eliminated)
        if self.lost:
            still = _still(eliminated, candidates, max((refit.gain for refit in [*kept, *led]), default=0.0))
            kept, behind = self._lost_from_small_amounts([*still, *sorted(kept, key=by_gain)])
            eliminated = [*(refit for refit in eliminated if refit not in still), *behind]
        raced = self.raced(kept)
        let_go(sorted(raced, key=by_gain)[1:])
        eliminated += [refit for refit in raced if refit.gain > 0 and self.hopeless(refit)]
        refined = sorted((refit for refit in raced if refit not in eliminated), key=by_gain)
        leader = None
        if refined and refined[0].gain > 0:
            leader = self._of_other_shapes(self.converged(refined[0], leads=True))
            leader = self._fuller(leader, [*refined[1:], *eliminated])
        others = refined if leader is None else refined[1:]
        ends = sorted([*([] if leader is None else [leader]), *led], key=by_gain)
        if not ends:
            return sorted([*refined, *eliminated], key=by_gain)
        leader, *known = ends
        anew = self._made_up_for([leader, *others, *eliminated])
        again = {refit.variant for refit in anew}
        near: list[Refit] = []
        margin = 0.0 if self.hopeless(leader) else NEAR  # beside one that does not count only what may overtake it
        far = [refit for refit in eliminated if refit.variant not in again]
        others = [refit for refit in others if refit.variant not in again]
        forms = self._other_forms(leader, others)
        settled = {leader.variant.effect} if self._settles(leader) else set()
        for refit in [*anew, *(one for one in others if one not in forms)]:
            may_gain = refit.gain > 0 and refit.variant.effect not in settled
            is_near = may_gain and _at_its_end(refit) > leader.gain - margin
            (near if is_near else far).append(refit)
        converged = self._together(lambda one: self.converged(one, behind=leader.gain - one.gain), near)
        return self._led([leader, *(self.converged(form, leads=True) for form in forms), *converged], [*known, *far])

    def _lost_from_small_amounts(self, kept: Sequence[Refit]) -> tuple[list[Refit], list[Refit]]:
        """Candidates beside a model that is lost, the likeliest first, begun once more, and those too far behind the
        best. The others go on if they promise to come as far as the one in front: the right cause does. Where what
        comes of those near it takes all, those farther behind do not begin again, nor does any that did so over a part
        of the record already; over such a part, which does not decide, nearly all will do."""
        if not kept:
            return [], []
        first, *others = kept
        if self.ends and self.takes_all(first):
            return _in_front(kept)
        self.tell(f"once more with small amounts and all else as believed: {', '.join(effects_among(kept))}")
        first = self.from_small_amounts(first, by_itself=True)
        near = [one for one in others if self.is_near(one, first)]
        farther = [one for one in others if one not in near]
        least = first.gain - NEAR
        begun = [first, *self._together(lambda one: self.from_small_amounts(one, least), near)]
        best = min(begun, key=by_gain)
        if not (self.takes_all(best) or (self.of_part and self.takes_nearly_all(best))):
            farther = self._together(lambda one: self.from_small_amounts(one, least), farther)
        return _in_front([*begun, *farther])

    def _held_up(self, refits: Sequence[Refit]) -> list[Refit]:
        """All, those of forces that a weight makes up for begun once more at the belief, beside other effects that
        leave noise and a parameter that is far off: what that costs is all they bring, and the way back is long."""
        behind = self.base.unknowns.effects and not self.lost and strained(self.base)
        if not behind or not white(self.base.excess):
            return list(refits)
        return [self.from_small_amounts(one) if one.variant.effect in HELD_UP else one for one in refits]

    def _made_up_for(self, refits: Sequence[Refit]) -> list[Refit]:
        """Of all, the leader first, those of effects that gains make up for which come further from small amounts. They
        are begun there where the leader may stand in for them."""
        bent = [refit for refit in refits if refit.variant.effect in MADE_UP]
        if not bent or not self._stands_in(refits[0]):
            return []
        self.tell(f"once more with small amounts and all else as believed: {', '.join(effects_among(bent))}")
        far = ELIMINATED * refits[0].gain
        begun = [self.from_small_amounts(refit, far, by_itself=True) for refit in bent]
        return [after for before, after in zip(bent, begun, strict=True) if after is not before]

    def _stands_in(self, leader: Refit) -> bool:
        """Whether a leader beside bent parameters leaves more than noise: by its residuals' size, or by what effects
        that gains make up for bring beside it."""
        if self.lost or not strained(self.base, BENT):
            return False
        if not leaves_noise(leader):
            return True
        if leader.variant.effect in MADE_UP:
            return False
        bent = [variant for variant in self.variants if variant.effect in MADE_UP]
        return any(score.gain >= HIDDEN for score in scored(leader.fit, bent, null=False).scores)

    def over_all(self, refit: Refit) -> Refit:
        """One that was fitted over a part of the record alone, over all of it if that can be simulated."""
        if refit.fit.residual.size == self.base.residual.size:
            return refit
        return self._tried(self.base, refit.variant, refit.fit.z, FitPlan(FIRST_STEPS, enough=ROUGH)) or refit

    def _settles(self, leader: Refit) -> bool:
        """Whether a leader leaves noise alone where there was more: other forms of its effect have next to nothing to
        come to then, and would bring no other name."""
        return leaves_noise(leader) and (self.lost or not white(self.base.excess))

    def _other_forms(self, leader: Refit, refits: Sequence[Refit]) -> list[Refit]:
        """Of the leader's effect, beside a model that is lost: which of them leads on the way there is chance."""
        if not self.lost or self._settles(leader):
            return []
        return [one for one in refits if one.gain > 0 and one.variant.effect == leader.variant.effect]

    def _led(self, converged: list[Refit], far: list[Refit]) -> list[Refit]:
        """All refits, best first; one that overtook the first is led to its end as well."""
        best = min(converged, key=by_gain)
        if best is not converged[0] and not best.fit.finished:
            converged[converged.index(best)] = self.converged(best, leads=True)
        every = sorted([*converged, *far], key=by_gain)
        let_go(every[1:])
        return every

    def _together(self, step: Callable[[Item], Stepped], items: Sequence[Item]) -> list[Stepped]:
        """A step of each, all at the same time, over stretches `AT_ONCE`; it comes to that of one after the other."""
        give_back()
        at_once = AT_ONCE if self.base.likelihood.is_cut else len(items)
        return in_gatherings(step, items, at_once=at_once, threads=self.base.likelihood.threads)

    def screened(self, score: Score) -> Refit | None:
        """A candidate after a first look; None where it cannot be simulated."""
        plan = FitPlan(most_steps=FIRST_LOOK, enough=ROUGHLY_CONVERGED, renew=False)
        unknowns = extended(self.base.unknowns, score.variant)
        begin = self.memory.end_of(fit_name(self.base.unknowns, score.variant.name), unknowns)
        if begin is not None:  # where it ended over stretches of its own, which are not those it begins with here
            again = self._tried(self.near, score.variant, begin, plan, self.nuisance_columns)
            if again is not None:
                return again
        try:
            near, known = self._known_of_part(score.variant)
            if known is None:  # at the same time, all their runs would be in the memory together
                known = started(near, score, near.likelihood.gathering(gathered_here()))
            return self._refit(near, score.variant, known, plan, self.nuisance_columns)
        except ComputationError:
            return None

    def _known_of_part(self, variant: Variant) -> tuple[Fit, Array | None]:
        """Where a candidate begins that was fitted over a part of the record, and what it begins beside: where it ended
        there, with stretches that begin where they do beside the fit without it, or else where they suit it. None where
        neither is better than that fit."""
        z, unknowns = self.ends.get(variant), extended(self.base.unknowns, variant)
        if z is None:
            return self.near, None
        likelihood = self.near.likelihood.gathering(gathered_here())
        if likelihood.objective(unknowns, z) < self.near.objective:
            return self.near, z
        likelihood = likelihood.followed(unknowns, z)
        if likelihood.objective(unknowns, z) < self.near.objective:
            return replace(self.near, likelihood=likelihood.gathering(None)), z
        return self.near, None

    def _screened(self, candidates: Sequence[Score], led: Sequence[Refit] = ()) -> tuple[list[Refit], list[Refit]]:
        """Candidates that were screened, and those that ended after a first look, beside what was `led` before. Where
        one of those in `FRONT` by their linear scores leaves nearly noise alone, and bends no believed parameter, the
        others have nothing to come to but those of effects that gains make up for, for which it may stand in."""
        most = max((score.gain for score in candidates), default=0.0)
        every = self.lost or white(self.base.excess)
        front = [score for score in candidates if every or score.gain >= FRONT * most]
        behind = [score for score in candidates if score not in front]
        further, ended = self._screened_beside(led, front)
        if further and self.takes_all(best := min(further, key=by_gain)):
            behind = [score for score in behind if score.variant.effect in MADE_UP]
            behind = behind if behind and self._stands_in(best) else []
        more, also = self._screened_beside([*led, *further], behind)
        return [*further, *more], [*ended, *also]

    def _screened_beside(self, others: Sequence[Refit], candidates: Sequence[Score]) -> tuple[list[Refit], list[Refit]]:
        """The candidates that are screened, and those that end after a first look: what is hopeless, or so far behind
        the best of these and others that it is so even if it comes to what it promises."""
        told = Screening(self.tell, len(candidates), "a first look", _far_behind)
        looked_at = self._together(lambda score: told.ends(score.variant, self.screened(score)), candidates)
        first = [refit for refit in looked_at if refit is not None]
        best = max((refit.gain for refit in [*others, *first]), default=0.0)
        going = [one for one in first if not _far_behind(one, best) and (self.lost or not self.hopeless(one))]
        ended = [refit for refit in first if refit not in going]
        let_go(ended)
        told = Screening(self.tell, len(going), "screening", _is_behind)
        return self._together(lambda refit: told.ends(refit.variant, self.screened_on(refit)), going), ended

    def takes_all(self, refit: Refit) -> bool:
        """Whether a candidate leaves nearly noise alone, all but noise beside a model that is lost, and bends no
        believed parameter."""
        if strained(refit.fit):
            return False
        if self.lost or leaves_noise(refit) or not self.base.likelihood.is_cut:
            return leaves_noise(refit)
        return self.takes_nearly_all(refit)

    def is_near(self, refit: Refit, leader: Refit) -> bool:
        """Whether a candidate is so near the one that leads that it may overtake it over the whole record, or at its
        end."""
        return refit.gain > leader.gain - (LOST_NEAR * abs(leader.gain) if self.lost else NEAR)

    def lags(self, refit: Refit, leader: Refit) -> bool:
        """Whether a candidate is so far behind one that leads over a part of the record that it would be eliminated
        over the whole as well. Where the leader may stand in for it that is not so."""
        return not self.lost and _is_behind(refit, leader.gain) and refit.variant.effect not in MADE_UP

    def takes_nearly_all(self, refit: Refit) -> bool:
        """Whether a candidate leaves little of the nats above white noise."""
        noise = refit.fit.nats_of_noise
        return refit.fit.objective - noise <= NEARLY_ALL * (self.base.objective - noise)

    def screened_on(self, refit: Refit) -> Refit:
        """A candidate after all steps by which it is screened, where they promise anything."""
        if refit.promising or self.lost:
            plan = FitPlan(SCREENING_STEPS - FIRST_LOOK, refit.fit.damping, enough=ROUGHLY_CONVERGED, renew=False)
            refit = self._leg(refit, plan)
        if not refit.promising and self.hopeless(refit):
            refit.fit.lets_go()
        return refit

    def raced(self, kept: Sequence[Refit]) -> list[Refit]:
        """Candidates after rounds of a few steps, where each that may come near the best goes on as long as it gains,
        may still lead, and would count if it did."""
        if not self.base.unknowns.effects and strained(self.base) and len(effects_among(kept)) == 1:
            return list(kept)  # what leads begins once more
        first = min(kept, key=by_gain, default=None)
        most = NEARLY * max(first.gain, 0.0) if first else 0.0
        running = [one for one in kept if one.promising and one.promised >= most and not self.hopeless(one)]
        if first and self.takes_all(first):  # whose model is that of those that began at other shapes
            own = [unknown.place for unknown in first.variant.unknowns]
            other = [one for one in running if [unknown.place for unknown in one.variant.unknowns] != own]
            running = [one for one in other if one.promised > first.gain - NEAR]
        ended = [refit for refit in kept if refit not in running]
        for _ in range(REFINEMENT_STEPS // RACED_STEPS if kept else 0):
            best = min([*running, *ended], key=by_gain)
            let_go([one for one in ended if one is not best])
            if running:
                self.tell(f"{len(running)} of them go on, {', '.join(effects_among(running))}")
            moved = self._together(self.refined, running)
            leader = max((refit.gain for refit in [*moved, *ended]), default=0.0)
            pairs = list(zip(running, moved, strict=True))
            running = [new for old, new in pairs if new.promising and _may_lead(old, new, leader)]
            running = [new for new in running if not self.hopeless(new)]
            ended += [new for new in moved if new not in running]
            if len(running) == 1 and running[0].gain >= leader:
                break  # it is led to its end
        return [*running, *ended]

    def refined(self, refit: Refit) -> Refit:
        """A candidate a few steps on; the nuisances' columns are those of a point nearby."""
        plan = FitPlan(RACED_STEPS, refit.fit.damping, enough=refit.enough, fresh_end=False)
        return self._leg(refit, plan)

    def converged(self, refit: Refit, *, leads: bool = False, behind: float = np.inf) -> Refit:
        """A candidate in front, its columns in the end those of that point, of which a further step would gain next to
        nothing: of one that leads, or lies so few nats `behind` that what it has left undone may decide."""
        enough = max(ROUGHLY_CONVERGED if self.base.unknowns.effects else CONVERGED, FRACTION * refit.gain)
        ended = max(ROUGHLY_CONVERGED, min(LED * refit.gain, ROUGH))
        decides = behind < CATCHING_UP * enough
        enough = min(enough, ended) if leads or decides else max(enough, ROUGHLY_CONVERGED)
        little = FRACTION * refit.gain if leads else 0.0
        plan = FitPlan(LAST_STEPS, refit.fit.damping, enough=enough, little=little, fresh_begin=leads)
        led = None
        if leads and not self.base.unknowns.effects and strained(refit.fit):
            self.tell(f"{refit.variant.name}, which leads, once more with all else as believed")
            led = self._as_believed(refit, refit.variant, plan)
        if led is None or led.gain < refit.gain:
            led = self._on_from(refit, plan)
        for _ in range(MORE_LEGS if leads else 0):  # what it has left undone, whatever is beside it would collect
            if led.gain - refit.gain < led.enough or not led.promising:
                break
            self.tell(f"{led.variant.name}, which leads, goes on; {led.gain:.3g} nats")
            refit, led = led, self._leg(led, plan)
        return replace(led, fit=replace(led.fit, finished=leads))

    def _of_other_shapes(self, leader: Refit) -> Refit:
        """A leader that leaves more than noise beside parameters that are bent is led to its very end; where that does
        not help, what comes from the belief begun at the shapes next to its own: fits have ends of their own along a
        shape, and a model that has made up for the effect leads to the nearest."""
        if self.base.unknowns.effects or self.lost or not strained(self.base) or leaves_noise(leader):
            return leader
        shapes = [variant for variant in self.variants if _other_shape(variant, leader.variant)]
        if shapes:
            leader = self._to_the_end(leader)
        if not shapes or leaves_noise(leader):
            return leader
        shapes = sorted(shapes, key=lambda variant: _apart(variant, leader))[:SHAPES_BESIDE]
        self.tell(f"{leader.variant.effect}, which leads, begun at other shapes with all else as believed")
        plan = FitPlan(FIRST_STEPS, enough=ROUGH, fresh_end=False)
        begun = self._together(lambda variant: self._as_believed(leader, variant, plan), shapes)
        going = [one for one in begun if one is not None]
        ended: list[Refit] = [leader]
        for _ in range(SHAPE_LEGS):
            if not going or any(leaves_noise(one) for one in going):
                break
            moved = self._together(self._on, going)
            pairs = list(zip(going, moved, strict=True))
            going = [new for old, new in pairs if new.promising and new.gain - old.gain >= new.enough]
            ended += [new for _, new in pairs if new not in going]
        best = min([*ended, *going], key=by_gain)
        let_go([one for one in (*ended, *going) if one is not best])
        return leader if best is leader else self.converged(best, leads=True)

    def _fuller(self, leader: Refit, others: Sequence[Refit]) -> Refit:
        """A leader, or where that leaves more than noise the better of it and another form of its effect with further
        amounts or shapes begun where it is. Such a one is, at its best, no more than a few nats behind: where it is
        further, it has lost its way."""
        first = self.base.unknowns.size
        led = dict(zip(leader.variant.unknowns, leader.fit.z[first:], strict=True))
        own = set(leader.variant.amounts)
        more = [one for one in others if own < set(one.variant.amounts) or led.keys() < set(one.variant.unknowns)]
        best = max(more, key=lambda one: one.gain, default=leader)
        if self.lost or leaves_noise(leader) or best is leader or best.gain > leader.gain - NEAR:
            return leader
        variant = best.variant
        self.tell(f"{leader.variant.effect}, which leads, with further numbers: {variant.name}")
        begin = [led.get(one, 0.0) for one in variant.unknowns]
        z = np.concatenate([leader.fit.z[:first], begin])
        on = self._tried(leader.fit, variant, z, FitPlan(LAST_STEPS, enough=ROUGH))
        if on is None or on.gain <= leader.gain:
            return leader
        leader.fit.lets_go()
        return self.converged(on, leads=True)

    def _leg(self, led: Refit, plan: FitPlan) -> Refit:
        """A candidate some steps on, whose columns are of no further use."""
        on = self._on_from(led, plan)
        led.fit.lets_go()
        return on

    def _on_from(self, refit: Refit, plan: FitPlan) -> Refit:
        """A candidate some steps on, from where it is with the columns that it has."""
        return self._refit(refit.fit, refit.variant, refit.fit.z, plan, None)

    def _to_the_end(self, leader: Refit) -> Refit:
        """A leader as long as further legs bring anything, however little of its gain that is."""
        for _ in range(MORE_LEGS):
            if leader.fit.to_come(RACED_STEPS) < ROUGH or leaves_noise(leader):
                break
            self.tell(f"{leader.variant.name}, which leads, goes on to its end; {leader.gain:.3g} nats")
            plan = FitPlan(LAST_STEPS, leader.fit.damping, enough=ROUGHLY_CONVERGED)
            on = self._leg(leader, plan)
            before, leader = leader, replace(on, fit=replace(on.fit, finished=True))
            if leader.gain - before.gain < ROUGH:
                break
        return leader

    def _as_believed(self, refit: Refit, variant: Variant, plan: FitPlan) -> Refit | None:
        """A variant that differs from a refit's in its shapes alone, begun with all else as believed, its amounts in
        the likeliest of several sizes: beside what had made up for them they may be hundreds of times too small."""
        unknowns, n = extended(self.base.unknowns, variant), self.base.unknowns.n_nuisance
        amounts, z = slice(n, n + len(variant.amounts)), as_believed(refit.fit)
        z[amounts.stop :] = 0.0
        nearly = z.copy()
        nearly[amounts] *= LEAST
        whole = refit.fit.likelihood.gathering(gathered_here())
        begins_in_part = whole.is_cut and whole.is_long
        likelihood = whole.first_part()[0] if begins_in_part else whole
        likelihood = likelihood.followed(unknowns, nearly) if likelihood.is_cut else likelihood
        rows = np.tile(z, (len(SIZES) + 1, 1))
        rows[1:, amounts] *= SIZES[:, None]
        rows[0] = as_believed(refit.fit) if variant == refit.variant else z
        rows = np.array([unknowns.allowed(row) for row in rows])
        best = rows[int(np.argmin(objectives(likelihood, unknowns, rows)))]
        if begins_in_part:
            try:
                best = fit(likelihood, unknowns, best, plan=replace(plan, fresh_end=False)).z
            except ComputationError:
                return None
            likelihood = whole.followed(unknowns, best)
        return self._tried(replace(refit.fit, likelihood=likelihood.gathering(None)), variant, best, plan)

    def _begun_anew(self, refit: Refit, z: Array, plan: FitPlan, columns: Slopes | None = None) -> Refit | None:
        """A candidate begun once more elsewhere, as where all but its effects is as believed: what the model without it
        had moved, to make up for it, may be a long way back. None where that cannot be simulated."""
        likelihood = refit.fit.likelihood
        if likelihood.is_cut:
            likelihood = likelihood.followed(refit.fit.unknowns, z)
        return self._tried(replace(refit.fit, likelihood=likelihood), refit.variant, z, plan, columns)

    def _tried(
        self, near: Fit, variant: Variant, z: Array, plan: FitPlan, columns: Slopes | None = None
    ) -> Refit | None:
        """A refit; None where it cannot be simulated."""
        try:
            return self._refit(near, variant, z, plan, columns)
        except ComputationError:
            return None

    def from_small_amounts(self, refit: Refit, least: float = -np.inf, *, by_itself: bool = False) -> Refit:
        """The better of a candidate and of one begun at the belief: beside numbers that nothing can have, the amounts
        that suit them are none that lead back. The likeliest `WAYS` of the signs that its amounts may have are tried,
        in the likeliest of several sizes, for a candidate `by_itself` all at the same time. What may still lead after a
        few steps, and come to the least nats that count, goes on, the most promising as long as it may still: where two
        amounts nearly balance each other, the likeliest beginning is the one whose unbalance suits, and the way is
        long. Beside others fewer are tried, and what a way has come to of its promise, those of other ways are worth.
        """
        likelihood, begin = refit.fit.likelihood.gathering(gathered_here()), as_believed(refit.fit)
        if likelihood.is_cut:
            likelihood = likelihood.followed(refit.fit.unknowns, begin)
        near = replace(refit, fit=replace(refit.fit, likelihood=likelihood))
        plan = FitPlan(most_steps=SCREENING_STEPS, enough=ROUGH, fresh_end=False)
        columns = self._columns_without(likelihood, begin)

        def each(step: Callable[[Item], Stepped], items: Sequence[Item]) -> list[Stepped]:
            return self._together(step, items) if by_itself else list(map(step, items))

        signs = [(1.0,) if amount.one_sided else (1.0, -1.0) for amount in refit.variant.amounts]
        ways = each(lambda way: self._along(near, begin, way), list(product(*signs)))
        likeliest = sorted(ways, key=lambda way: way[0])[: WAYS if by_itself else FEW_WAYS]
        found = each(lambda way: self._begun_anew(near, way[1], plan, columns), likeliest)
        begun = sorted((one for one in found if one is not None), key=by_gain)
        let_go(begun)
        ended = self._farthest_on(refit, self._gone_on(refit, begun, least, by_itself=by_itself), least)
        return max([refit, *begun, *ended], key=lambda one: one.gain)

    def _along(self, near: Refit, begin: Array, way: Sequence[float]) -> tuple[float, Array]:
        """S, and where a candidate begins: at amounts of these signs, in the likeliest of several sizes."""
        unknowns, n = near.fit.unknowns, self.base.unknowns.n_nuisance
        rows = np.tile(begin, (len(SMALL), 1))
        rows[:, n : n + len(way)] = np.outer(SMALL, way)
        rows = np.array([unknowns.allowed(row) for row in rows])
        costs = objectives(near.fit.likelihood.gathering(gathered_here()), unknowns, rows)
        return float(costs.min()), rows[int(np.argmin(costs))]

    def _gone_on(self, refit: Refit, begun: Sequence[Refit], least: float, *, by_itself: bool) -> list[Refit]:
        """Of what has begun at small amounts, the best first, what may still lead and come to what counts, some steps
        on."""
        ended: list[Refit] = []
        kept = 1.0  # share of its promise that a way has come to
        for one in begun:
            if any(leaves_noise(other) for other in ended):
                break  # where one leaves noise alone the others have nothing to come to
            promise = one.reach - one.gain
            within = one.reach >= begun[0].gain and one.gain + kept * promise >= least
            if within and (one.gain > refit.gain or not one.fit.stuck):
                ended.append(self._on(one))
                if not by_itself and promise > 0:
                    kept = min(kept, max(ended[-1].reach - one.gain, 0.0) / promise)
        return ended

    def _farthest_on(self, refit: Refit, ended: list[Refit], least: float) -> list[Refit]:
        """The same, the most promising in legs as long as it may still lead and these bring what counts."""
        for _ in range(MORE_LEGS if ended else 0):
            far = max(ended, key=lambda one: one.reach)
            if not far.promising or far.reach <= max(refit.gain, least, *(one.gain for one in ended)):
                break
            on = self._on(far)
            ended = [*(one for one in ended if one is not far), on]
            if on.gain - far.gain < far.enough:
                break
        return ended

    def _columns_without(self, likelihood: Likelihood, z: Array) -> Slopes | None:
        """The nuisances' columns where a candidate is nothing, for all that begin near by; None where none can be had,
        or stretches have starts of their own."""
        if likelihood.is_cut:
            return None
        unknowns, z = self.base.unknowns, z[: self.base.unknowns.size]
        residual = likelihood.spectra(Points.of(unknowns, z[None]))[0].copy()
        if not np.isfinite(residual).all():
            return None
        return first_columns(likelihood, unknowns, z, unknowns.n_nuisance, residual)

    def _on(self, begun: Refit) -> Refit:
        """What began at small amounts, some steps on."""
        plan = FitPlan(FIRST_STEPS, begun.fit.damping, enough=ROUGH, fresh_end=False)
        on = self._on_from(begun, plan)
        on.fit.lets_go()
        return on

    def _refit(self, near: Fit, variant: Variant, z: Array, plan: FitPlan, columns: Slopes | None) -> Refit:
        """A variant fitted from z; where a fit of it has ended there and has its columns, that goes on."""
        unknowns = extended(self.base.unknowns, variant)
        likelihood = near.likelihood.gathering(gathered_here())
        goes_on = near if z is near.z and near.columns.values is not None else None
        found = fit(likelihood, unknowns, z, plan=plan, nuisance_columns=columns, goes_on=goes_on, takes_columns=True)
        own = near.likelihood if found.likelihood is likelihood else found.likelihood.gathering(None)
        found = replace(found, likelihood=own)
        self.memory.ended(fit_name(self.base.unknowns, variant.name), found.z)
        return Refit(variant, found, found.log_evidence - self.base.log_evidence)


def _in_front(refits: Sequence[Refit], led: Sequence[Refit] = ()) -> tuple[list[Refit], list[Refit]]:
    """Those that go on, and those too far behind the best, or what was led to its end before."""
    best = max((refit.gain for refit in refits), default=0.0)
    end = max((refit.gain - NEAR for refit in led), default=-np.inf)
    behind = [refit for refit in refits if _is_behind(refit, best) or refit.promised <= end]
    return [refit for refit in refits if refit not in behind], behind


def _still(refits: Sequence[Refit], scores: Sequence[Score], best: float) -> list[Refit]:
    """Candidates no step of which led down though the linear model says more of them than the best has gained, the
    likeliest first: where the way there cannot be simulated, what they have come to tells nothing of them."""
    said = {score.variant: score.gain for score in scores}
    found = [refit for refit in refits if refit.fit.stuck and said[refit.variant] > best]
    return sorted(found, key=lambda refit: -said[refit.variant])


def _is_behind(refit: Refit, best: float) -> bool:
    """Whether a candidate that was screened is too far behind the best gain."""
    return best > 0 and refit.gain < ELIMINATED * best


def _far_behind(refit: Refit, best: float) -> bool:
    """Whether one after a first look is, even if it comes to what it promises."""
    return best > 0 and refit.promised < FAR_BEHIND * best


def _other_shape(variant: Variant, leader: Variant) -> bool:
    """Whether two variants of an effect differ in where a shape begins alone, with which an amount goes."""
    names, own = ([one.name for one in each.unknowns] for each in (variant, leader))
    goes = any(find_parameter(one.effect, one.name).root_of in names for one in leader.amounts)
    return variant.effect == leader.effect and names == own and variant != leader and goes


def _apart(variant: Variant, leader: Refit) -> float:
    """How far the first shape of a variant begins from where that of a leader is, as a logarithm."""
    at = leader.fit.unknowns.effect_vector(leader.fit.z)[variant.shapes[0].place]
    return float(abs(np.log(variant.shapes[0].centre / at)))


def _at_its_end(refit: Refit) -> float:
    """Nats that a candidate may come to. Of one that goes no further since it promises little of its gain, that little
    counts several times, as in `Refit.promised`: many steps bring more than a linear model says at the first."""
    left = refit.fit.to_come(LAST_STEPS)
    return refit.gain + left if refit.promising else max(refit.gain + left, refit.reach)


def _may_lead(before: Refit, after: Refit, leader: float) -> bool:
    """Whether a candidate that went on gains, and may still come near the one that leads: by what it has gained, or by
    what its next step promises."""
    gained = after.gain - before.gain
    to_come = max(CATCHING_UP * gained, after.fit.to_come(RACED_STEPS))
    return gained >= after.enough and after.gain + to_come > leader - NEAR
