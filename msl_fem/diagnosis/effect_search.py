"""The search for a set of effects: forward one after the other, back, and forward again.

What is taken first decides what is found: one effect may stand for two others. Where a search leaves more than noise,
it is begun once more with what came near (a beam search: Lowerre, The HARPY speech recognition system, 1976, ch. 3),
and the most probable set counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.conclusion import EffectSearch
from msl_fem.diagnosis.decision import (
    Rule,
    beyond_tolerances,
    disagrees,
    does_alone,
    in_sight,
    n_accepted,
    of_its_own,
    stays_within,
)
from msl_fem.diagnosis.exchange import Exchange
from msl_fem.diagnosis.fit import STEPS_A_ROUND, FitPlan, fit
from msl_fem.diagnosis.fit_memory import fit_name
from msl_fem.diagnosis.kind import Kind, about_belief
from msl_fem.diagnosis.likelihood import QUIET, Fit, white
from msl_fem.diagnosis.refinement import NEARLY, Refinement
from msl_fem.diagnosis.refits import ROUGH, Refit
from msl_fem.diagnosis.search import SearchStage, search_stage
from msl_fem.diagnosis.settings import DiagnosisSettings

WORSE_THAN = 1.02
"""How many times the belief's largest residual a fit within the tolerances may leave."""
EXCHANGED = 2
"""How often a set of effects is put right and then added to."""
BEGINNINGS = 2
"""How often a search that leaves more than noise is begun once more, with another effect that is `NEARLY` as good."""
ROUGHLY = 1e-3
"""Share of the nats by which a model without effects is worse than the noise, that it may still gain: beside what a
missing cause costs it is little."""
CLOSER = 1.0
"""Nats by which a set has to be more probable with another effect in one's place: more than fits are off their ends."""


@dataclass(frozen=True)
class _Doubt:
    """The first stage whose most probable effect another surpasses by far in what it takes, and that other. Where all
    effects together leave noise, or that other is one of them, it says nothing."""

    stage: int
    effect: str


@dataclass(frozen=True, eq=False)
class Chain:
    """Fits without effects, with the first, and so on; the stages at each of them; the first doubt."""

    fits: tuple[Fit, ...]
    stages: tuple[SearchStage, ...] = ()
    doubt: _Doubt | None = None

    @property
    def quiet(self) -> bool:
        return white(self.fits[-1].excess)

    @property
    def nats(self) -> float:
        """Log evidence of the set."""
        return self.fits[-1].log_evidence

    @property
    def ended(self) -> bool:
        """Whether the last stage brought nothing that counts."""
        return len(self.stages) == len(self.fits)

    def told(self, rule: Rule) -> EffectSearch:
        """As many effects as the rule takes; with a doubt that remains those before it."""
        fits, stages, unclear = self.fits, self.stages, ""
        together = {stage.best.variant.effect for stage in stages[: len(fits) - 1] if stage.best is not None}
        if self.doubt is not None and not self.quiet and self.doubt.effect not in together:
            n, unclear = self.doubt.stage, self.doubt.effect
            fits, stages = fits[: n + 1], stages[: n + 1]
        excesses = tuple(found.excess for found in fits)
        judged = stages[:-1] if unclear else stages
        return EffectSearch(fits, stages, excesses, n_accepted(judged, excesses, rule), unclear)


def first_effect(kind: Kind, how: DiagnosisSettings) -> Chain:
    """The beginning of a search: the fit without effects, and what comes first beside it."""
    return _forward(kind, replace(how, rule=replace(how.rule, most=1)), Chain((without_effects(kind, how),)))


def search_effects(kind: Kind, how: DiagnosisSettings, begun: Chain | None = None) -> EffectSearch:
    """Effects added one after the other, behind what a search has begun with, as long as each brings more than the rule
    asks; of several beginnings, where the first leaves more than noise, those of the most probable set."""
    forward = _forward(kind, how, begun or first_effect(kind, how))
    best = _put_right(kind, how, forward)
    for stage, other in _beginnings(forward):
        if best.quiet:
            break
        how.progress(f"once more with {other.variant.effect}, since more than noise is left")
        begun = _begun_with(other, forward, stage, how)
        found = _put_right(kind, how, _forward(kind, how, begun))
        if found.nats > best.nats + CLOSER:
            best = found
    return best.told(kind.rule(how.rule))


def _beginnings(chain: Chain) -> list[tuple[int, Refit]]:
    """Stages of a search and the effects with which it may be begun once more: what takes most of what is left where
    another is most probable, and what brings nearly as much as the first effect, but none that came behind it."""
    found: dict[str, tuple[int, Refit]] = {}
    if len(chain.fits) < 2 or chain.fits[0].sane:
        return []
    if chain.doubt is not None:
        tried = chain.stages[chain.doubt.stage].refits
        found[chain.doubt.effect] = chain.doubt.stage, next(r for r in tried if r.variant.effect == chain.doubt.effect)
    first, *others = chain.stages[0].refits
    taken = {one.effect for one in chain.fits[-1].unknowns.effects}
    for other in (one for one in others if one.gain >= NEARLY * first.gain and one.variant.effect not in taken):
        found.setdefault(other.variant.effect, (0, other))
    return list(found.values())[:BEGINNINGS]


def _begun_with(other: Refit, chain: Chain, n: int, how: DiagnosisSettings) -> Chain:
    """A search up to stage n, its effect another one, which is led to its end."""
    stage = chain.stages[n]
    refinement = Refinement(stage.base, how.progress, how.memory)
    led = refinement.converged(refinement.over_all(other), leads=True)
    begun = replace(stage, refits=(led, *(one for one in stage.refits if one is not other)))
    return Chain((*chain.fits[: n + 1], led.fit), (*chain.stages[:n], begun))


def without_effects(kind: Kind, how: DiagnosisSettings) -> Fit:
    """The most probable model without effects."""
    begin = np.zeros(kind.unknowns.size) if kind.begin is None else kind.begin
    known = how.memory.end_of(fit_name(kind.unknowns), kind.unknowns)
    begin = begin if known is None else known
    steps = STEPS_A_ROUND if kind.sane else FitPlan.most_steps
    plan = FitPlan(most_steps=steps, enough=ROUGH, share=ROUGHLY, tell=partial(about_tolerances, how))
    first = not_worse(kind, begin, fit(kind.likelihood, kind.unknowns, begin, plan=plan), plan)
    return replace(first, finished=kind.sane is not None, sane=kind.sane)


def _put_right(kind: Kind, how: DiagnosisSettings, chain: Chain) -> Chain:
    """A chain put right and continued forward, until nothing changes; not where the first effect would do alone."""
    rule = kind.rule(how.rule)
    exchange = Exchange(rule.further, CLOSER, how.progress, how.memory)
    for _ in range(EXCHANGED):
        excesses = [found.excess for found in chain.fits]
        if len(chain.fits) <= 2 or chain.fits[0].sane or does_alone(chain.stages, excesses):
            break
        fits, stages = exchange.chain(chain.fits, chain.stages)
        if fits[-1] is chain.fits[-1]:
            return replace(chain, stages=tuple(stages))
        chain = _forward(kind, how, Chain(tuple(fits), tuple(stages)))
    return chain


def _forward(kind: Kind, how: DiagnosisSettings, chain: Chain) -> Chain:
    """Effects added to the last fit, one after the other, as long as the rule asks for more."""
    rule, doubt, fits, stages = kind.rule(how.rule), chain.doubt, list(chain.fits), list(chain.stages)
    if chain.ended:
        return chain
    for n in range(len(stages), rule.most):
        stage = search_stage(
            fits[n],
            about_belief(kind, fits[n]),
            tell=how.progress,
            memory=how.memory,
            needed=partial(rule.needed, tuple(stages), left=fits[n].excess),
            hopeless=partial(_hopeless, rule, tuple(stages), tuple(fits)),
            near=stages[-1].columns if stages else None,
        )
        stages = [replace(before, columns=None) for before in stages]
        stage = of_its_own(stage, stages)
        stage = in_sight(kind.likelihood.problem, beyond_tolerances(kind.likelihood.problem, stage))
        fits[n] = stage.base
        stages.append(stage)
        if stage.best is None:
            break
        excesses = [found.excess for found in (*fits, stage.best.fit)]
        if not rule.enough(stages, n, excesses) or rule.leads_nowhere(stages[:-1], stage.best, excesses[:-1]):
            break
        surpassed_by = disagrees(stage, stage.base.excess)
        if surpassed_by and doubt is None:
            doubt = _Doubt(n, surpassed_by)
        fits.append(stage.best.fit)
        if not rule.searches_on(stages, n, excesses):
            break
    return Chain(tuple(fits), tuple(stages), doubt)


def _hopeless(rule: Rule, stages: Sequence[SearchStage], fits: Sequence[Fit], refit: Refit) -> bool:
    """Whether a refit behind these stages, beside the last of their fits, is not worth its end."""
    base = fits[-1]
    if rule.out_of_reach(stages, refit, base.excess) or stays_within(base.likelihood.problem, refit):
        return True
    return rule.leads_nowhere(stages, refit, [fit.excess for fit in fits])


def about_tolerances(how: DiagnosisSettings, text: str) -> None:
    """Tells how the model without effects comes on."""
    how.progress(f"the model within its tolerances: {text}")


def not_worse(kind: Kind, begin: Array, found: Fit, plan: FitPlan) -> Fit:
    """A fit without effects that is no worse than the belief: where its largest residual is, because the error of a
    channel was taken for noise, one whose noise has a ceiling in every octave, or the better of both."""
    believed = kind.likelihood.excess(replace(found, z=np.zeros(found.z.size)))
    if not max(found.excess.values()) > max(WORSE_THAN * max(believed.values()), QUIET):
        return found
    again = fit(replace(kind.likelihood, strict=True), kind.unknowns, begin, plan=plan)
    return again if max(again.excess.values()) < max(found.excess.values()) else found
