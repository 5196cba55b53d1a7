"""What a search says: the verdict, the causes that are named, what held-out data say of them, and what is left."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.correlation import correlation_of
from msl_fem.diagnosis.decision import (
    MOST_OF_IT,
    OWN_OF_A_RUN,
    TIE,
    WEAK,
    WORSE,
    completes,
    does_alone,
    excess_power,
    gauges,
    share_left,
    too_much_left,
)
from msl_fem.diagnosis.estimates import believed_estimates, effect_estimates
from msl_fem.diagnosis.kind import (
    ErrorSignal,
    Kind,
    PredictionError,
    held_out_against,
    held_out_gains,
    on_common_ground,
    worse_than_belief,
)
from msl_fem.diagnosis.likelihood import Fit, white
from msl_fem.diagnosis.outside import EXPLAINED, WORTH_NAMING, Dependence, named_dependence
from msl_fem.diagnosis.refits import Refit, by_gain
from msl_fem.diagnosis.result import (
    Accuracy,
    Cause,
    Diagnosis,
    Evidence,
    MainCause,
    Unexplained,
    Verdict,
    channel_residuals,
    hidden_at_most,
    tried_variants,
)
from msl_fem.diagnosis.scheduled import about_schedules, scheduled_estimates
from msl_fem.diagnosis.search import SearchStage, statistics_of
from msl_fem.prediction import ModelHypothesis

NEARLY_AS_PROBABLE = 2 * TIE
"""Nats behind a name within which another is told with it, where both leave the same of the record."""
APART = 2.0
"""Nats that the record itself would bring one of two on average, below which they leave the same: whoever asks the
record alone takes one for the other once in six times (the normal distribution at sqrt(2 APART)/2)."""
COSTS = 10.0
"""Times the nats that a further effect brings, that held-out runs lose with all numbers as fitted at most, where what
the fit leaves uncertain may be why."""
NO_EXTENDED_MODEL = "held-out runs are followed worse than by the believed model, so there is no extended model"


@dataclass(frozen=True, eq=False)
class EffectSearch:
    """What a search went through.

    Attributes
    ----------
    fits : without effects, with the first, and so on
    stages : what was tried beside each of these fits
    excesses : of each fit, channel to residuals over the noise
    taken : of how many stages the best effect is named
    unclear : the effect that takes most of the excess where another is most probable, so that neither is named
    """

    fits: tuple[Fit, ...]
    stages: tuple[SearchStage, ...]
    excesses: tuple[dict[str, float], ...]
    taken: int
    unclear: str = ""

    @property
    def final(self) -> Fit:
        return self.fits[self.taken]

    @property
    def effects(self) -> list[str]:
        """The names that were taken, in their order."""
        return [stage.best.variant.effect for stage in self.stages[: self.taken] if stage.best is not None]


def conclude(
    kind: Kind, result: EffectSearch, *, threshold: float, threads: int, tell: Callable[[str], None]
) -> Diagnosis:
    """The verdict of a search, with what held-out data say.

    Parameters
    ----------
    threshold : nats that an effect had to bring
    tell : is told what is looked at
    """
    models = [kind.extend(fit) for fit in result.fits[: result.taken + 1]]
    nominal, *signals = _followed(kind, models, result.fits, threads)
    gains, worse = _held_out(signals, result)
    names = _names(kind, result, models, gains, worse, threads=threads)
    result, n, notes = names.result, names.result.taken, [*names.notes, *_about_starts(names.result, gains)]
    believed, by_instruments, at_end = ([one.summary for one in of] for of in (nominal, signals[0], signals[n]))
    extended = None if worse_than_belief(nominal, signals[n]) else models[n]
    if extended is None:
        notes.append(NO_EXTENDED_MODEL)
    unfaithful = _unfaithful(at_end, kind) if n else ""
    if names.faint:
        notes.append(names.faint)
    notes += kind.above_noise(result.final) if names.explained else []
    schedules = kind.likelihood.problem.schedules
    scheduling = scheduled_estimates(kind.belief, result.final, schedules)
    unexplained = Unexplained(0.0)
    ranked: list[Dependence] = []
    if unfaithful:
        unexplained = Unexplained(share_left(result.excesses, n), next_experiment=kind.look_further(()))
    elif not names.explained:
        tell("what is left over every variable")
        unexplained, ranked = _left(kind, result, models[n], threads=threads)
    n_named = 0 if unfaithful else n
    found = Diagnosis(
        _verdict(n, names.explained),
        _reason(result, names.explained),
        tuple(_cause(kind, result, stage, gains[stage]) for stage in range(n_named)),
        unexplained,
        tuple(Accuracy(*three, kind.prediction) for three in zip(believed, by_instruments, at_end, strict=True)),
        believed_estimates(kind.belief, result.final),
        models[0],
        extended,
        threshold,
        result.stages[0].null,
        names.main,
        hidden_at_most(result.stages[0].scores),
        statistics=statistics_of(result.stages),
        notes=(*kind.notes, *notes, *about_schedules(schedules, scheduling)),
        scheduling=scheduling,
        left_out=kind.left_out,
        evidence=Evidence(
            tried_variants(result.stages, n_named),
            channel_residuals(nominal, signals[0], signals[n]),
            kind.variables(),
            tuple(kind.sizes(models[n], result.effects)),
            tuple(ranked),
            result.final.likelihood.noise_spectra(result.final.weights),
        ),
        correlation=correlation_of(result.final),
    )
    return _undecided(found, result, unfaithful, kind) if unfaithful else found


def _followed(
    kind: Kind, models: Sequence[ModelHypothesis], fits: Sequence[Fit], threads: int
) -> list[list[ErrorSignal]]:
    """The errors of the belief, and of each model, whose numbers are those of a fit, over what all of them follow."""
    every = [*zip(models, fits, strict=False), (kind.belief, None)]  # what a fit has come to takes longest
    *of_models, nominal = in_threads(lambda one: kind.errors(*one), every, threads)
    return on_common_ground([nominal, *of_models])


@dataclass(frozen=True, eq=False)
class _Names:
    """What is named of a search: `result`, with so many of its effects taken; `faint`, why these may be none."""

    result: EffectSearch
    main: MainCause | None
    notes: list[str]
    explained: bool
    faint: str


def _names(
    kind: Kind,
    result: EffectSearch,
    models: Sequence[ModelHypothesis],
    gains: Sequence[float],
    worse: Sequence[bool],
    *,
    threads: int,
) -> _Names:
    """What is named of a search, by what its effects bring on held-out data."""
    confirmed = [gain if bad else max(gain, 0.0) for gain, bad in zip(gains, worse, strict=True)]
    main, (named, notes) = main_cause(result, worse), _named(kind, result, confirmed)
    compensating = named.taken > 1 and _compensating(kind, result, models[result.taken], threads=threads)
    if compensating:
        kept = _without_patches(kind, result, models, threads=threads)
        main, (named, notes) = main_cause(kept, worse), _named(kind, kept, confirmed)
        which = "the first is" if kept.taken == 1 else f"the first {kept.taken} are"
        notes.append(f"several effects together leave what a function of one variable explains; only {which} kept")
    if named.unclear and named.stages[-1].best is not None:
        probable = named.stages[-1].best.variant.effect
        notes.append(f"unclear: {probable} is most probable, {named.unclear} takes most of what is in excess of noise")
    faint = _faint(kind, named, models[named.taken], threads=threads)
    explained = white(named.excesses[named.taken]) and not compensating and not faint
    if compensating or faint or _left_elsewhere(named):
        named, main = _without_wander(named, main, notes)
    return _Names(named, main, notes, explained, faint)


def _held_out(models: Sequence[Sequence[ErrorSignal]], result: EffectSearch) -> tuple[list[float], list[bool]]:
    """Of each effect the nats that it brings on held-out data, and whether these speak against its name.

    A channel whose zero wanders does so anew in every run, and any small change may meet its path by chance: it speaks
    of the wander alone, and of no other effect. Over stretches whose starts it tells the other channels err by it too:
    beside a wander that is most of all that was missing, held-out data refuse no other name.
    """
    repeat = [[signal for signal in one if signal.channel != result.final.unknowns.wanders] for one in models]
    gains, of_others = (held_out_gains([[one.summary for one in of] for of in judged]) for judged in (models, repeat))
    against, against_others = held_out_against(models), held_out_against(repeat)
    for n, effect in enumerate(result.effects):
        if effect not in OWN_OF_A_RUN:
            gains[n], against[n] = of_others[n], against_others[n]
            against[n] &= not _starts_wander(result)
    return gains, against


def _starts_wander(result: EffectSearch) -> bool:
    """Whether runs are followed over stretches, and what brings most of all effects is a zero that wanders."""
    found = [stage.best for stage in result.stages if stage.best is not None]
    return result.final.likelihood.is_cut and min(found, key=by_gain).variant.effect in OWN_OF_A_RUN


def _about_starts(result: EffectSearch, gains: Sequence[float]) -> list[str]:
    """Which effects are named though held-out data lose by them, and why, where a wander tells the starts."""
    return [
        f"with {effect} held-out runs lose {-gain:.3g} nats; their stretches begin where the reading says whose zero "
        "wanders, so that they do not speak against it"
        for effect, gain in zip(result.effects, gains, strict=False)
        if gain < -WORSE and effect not in OWN_OF_A_RUN and _starts_wander(result)
    ]


def main_cause(result: EffectSearch, worse: Sequence[bool]) -> MainCause | None:
    """The first effect that was taken, where it accounts for most of the excess and held-out data do not speak against
    it, whatever else is left."""
    if not result.taken or worse[0]:
        return None
    explained = 1 - excess_power(result.excesses[1]) / max(excess_power(result.excesses[0]), 1e-300)
    if white(result.excesses[0]) or explained < MOST_OF_IT:
        return None
    return MainCause(result.effects[0], explained, share_left(result.excesses, result.taken))


def _explained(result: EffectSearch, n: int) -> float | None:
    """Share of the excess power that effect n takes beside those before it; None where there is none."""
    if white(result.excesses[0]):
        return None
    before, after = excess_power(result.excesses[n]), excess_power(result.excesses[n + 1])
    return (before - after) / excess_power(result.excesses[0])


def _compensating(kind: Kind, result: EffectSearch, model: ModelHypothesis, *, threads: int) -> bool:
    """Whether several effects only make up together for what none of them is: what they leave, small as it may be, is
    a function of one variable that brings more than the last of them did. What the first does alone is no such."""
    if result.taken < 2 or does_alone(result.stages, result.excesses[: result.taken + 1]):
        return False
    ranked = kind.dependences(result.final, model, few=True, threads=threads)
    last = result.stages[result.taken - 1].best
    return bool(ranked and last is not None and ranked[0].gain > max(WORTH_NAMING, last.gain))


def _without_patches(
    kind: Kind, result: EffectSearch, models: Sequence[ModelHypothesis], *, threads: int
) -> EffectSearch:
    """The search without the effects that make up together for what none of them is: with the first alone, but where
    the last ones bring next to nothing beside those before, which then leave no such function, with those before."""
    while result.taken > 1:
        gains = [0.0 if stage.best is None else stage.best.gain for stage in result.stages[: result.taken]]
        if gains[-1] >= WEAK * max(gains):
            return replace(result, taken=1)
        result = replace(result, taken=result.taken - 1)
        if not _compensating(kind, result, models[result.taken], threads=threads):
            break
    return result


def _faint(kind: Kind, result: EffectSearch, model: ModelHypothesis, *, threads: int) -> str:
    """What a function of one variable brings though the residuals look like noise and no effect is named, in words;
    empty where it is not worth it."""
    if result.taken or not white(result.excesses[0]):
        return ""
    ranked = kind.dependences(result.final, model, few=True, threads=threads)
    if not ranked or ranked[0].gain < WORTH_NAMING:
        return ""
    best = ranked[0]
    told = f"a {best.equation} that is a function of the {best.variable} brings {best.gain:.3g} nats"
    return f"the residuals are no larger than the noise, but {told}"


def _named(kind: Kind, result: EffectSearch, gains: Sequence[float]) -> tuple[EffectSearch, list[str]]:
    """The search with as many effects as are named, and why not more.

    What the fit runs leave uncertain, held-out runs may show far better: another frequency, a resonance. Where they are
    followed worse with an effect, their predictive density decides, of which that uncertainty is a part. Not so where a
    further effect loses many times what it brings (`COSTS`): the uncertainty is that of those before it.
    """
    taken, effects = result.taken, result.effects
    notes = []
    too_much = too_much_left(effects, result.excesses)
    if too_much:
        notes.append(too_much)
        taken = 0
    while taken and _refused(result, taken - 1, gains[taken - 1]):
        effect = effects[taken - 1]
        if effect in OWN_OF_A_RUN:
            notes.append(f"{effect} is of each run's own: that of the fit run says nothing of held-out runs")
            break
        best = result.stages[taken - 1].best
        asked = taken == 1 or best is None or -gains[taken - 1] <= COSTS * best.gain
        predicted = kind.predictive_gain(*result.fits[taken - 1 : taken + 1]) if asked else -np.inf
        if not _refused(result, taken - 1, predicted):
            notes.append(
                f"with {effect} held-out runs lose {-gains[taken - 1]:.3g} nats with all numbers as fitted, and change "
                f"by {predicted:+.3g} at least with what the fit runs leave uncertain as free as they leave it, which "
                "counts"
            )
            break
        taken -= 1
        why = (
            "makes held-out runs worse"
            if gains[taken] < 0
            else "leaves more than noise, and makes no held-out run better"
        )
        notes.append(f"{effect} {why} and is not named")
    return replace(result, taken=taken), notes


def _before_wander(result: EffectSearch) -> int:
    """How many effects were taken before a zero that wanders: all, where none does."""
    return next((n for n, effect in enumerate(result.effects) if effect in OWN_OF_A_RUN), result.taken)


def _left_elsewhere(result: EffectSearch) -> bool:
    """Whether more than noise is left in readings whose zero does not wander by what is taken, of which the wander has
    not taken most: a fit without it errs there too, where it follows that zero with numbers of the plant."""
    wanders, every = result.final.unknowns.wanders, result.excesses
    fits = every[_before_wander(result)], every[result.taken]
    before, left = ({name: x for name, x in of.items() if name != wanders} for of in fits)
    return not white(left) and excess_power(left) > (1 - MOST_OF_IT) * excess_power(before)


def _without_wander(
    result: EffectSearch, main: MainCause | None, notes: list[str]
) -> tuple[EffectSearch, MainCause | None]:
    """The search with the effects before a zero that wanders, and the main cause if it is another one, where a cause is
    missing: one that moves the mover shows in other readings too, and a density of the noise takes what it leaves in
    the one that wanders. Why is noted."""
    n = _before_wander(result)
    if main is not None and main.effect in OWN_OF_A_RUN:
        main = None
    if n < result.taken:
        main = main and replace(main, rest=share_left(result.excesses, n))
        name = result.effects[n]
        notes.append(f"{name} takes what any missing cause leaves in its reading, and a cause is missing: not named")
    return replace(result, taken=n), main


def _refused(result: EffectSearch, n: int, gain: float) -> bool:
    """Whether a gain on held-out data refuses effect n its name: a loss, or none where the effect does not complete
    those before it."""
    before, after = result.excesses[n : n + 2]
    beside_own = not OWN_OF_A_RUN.isdisjoint(result.effects)
    unconfirmed = n > 0 and gain <= 0 and not beside_own and not completes(before, after)
    return gain < -WORSE or unconfirmed


def _unfaithful(errors: Sequence[PredictionError], kind: Kind) -> str:
    """On which channel held-out data are followed much worse than fit data, in words; empty where on none."""
    for held in (error for error in errors if error.role == "held-out"):
        own = [error.rms for error in errors if error.role == "fit" and error.channel == held.channel]
        if own and held.rms > kind.faithful * max(*own, held.floor):
            ratio = held.rms / max(own)
            return f"errs by {held.rms:.3g} on held-out {held.channel}, {ratio:.3g} times as much as there"
    return ""


def _undecided(found: Diagnosis, result: EffectSearch, unfaithful: str, kind: Kind) -> Diagnosis:
    """The diagnosis where effects hold on the data they were fitted to alone."""
    effects = ", ".join(result.effects)
    reason = (
        f"{effects} would account for the fit data, and {unfaithful}: something else acts alike where they were taken"
    )
    advice = kind.look_further(())
    if advice:
        reason += f"; what would decide: {advice}"
    return replace(found, verdict="undecidable", reason=reason, parameters={}, extended=None)


def _left(
    kind: Kind, result: EffectSearch, model: ModelHypothesis, *, threads: int
) -> tuple[Unexplained, list[Dependence]]:
    """What no effect accounts for, and on which variables it depends."""
    ranked = kind.dependences(result.final, model, threads=threads)
    quiet = white(result.excesses[result.taken])
    equation, variables = named_dependence(ranked, share=0.0 if quiet else EXPLAINED)
    share = share_left(result.excesses, result.taken)
    return Unexplained(share, variables, equation, kind.look_further(variables)), ranked


def _verdict(n_named: int, explained: bool) -> Verdict:
    if n_named:
        return "named" if explained else "named-and-unexplained"
    return "nothing-found" if explained else "unexplained"


def _cause(kind: Kind, result: EffectSearch, n: int, gain: float) -> Cause:
    stage = result.stages[n]
    best = stage.best
    assert best is not None
    effect = best.variant.effect
    rivals = _told_with(result, n)
    p_value = stage.null.p_value(best.gain) if stage.null.gains.size else None
    parameters = effect_estimates(result.final)[effect]
    experiment = kind.separating(stage, rivals)
    partners = tuple(name for name in (*rivals, *gauges(stage.base, best.gain)) if name != effect)
    return Cause(effect, parameters, best.gain, p_value, gain, partners, experiment, _explained(result, n))


def _told_with(result: EffectSearch, n: int) -> tuple[str, ...]:
    """What the record cannot tell from effect n: what is as probable, and what is nearly as probable and leaves the
    same, so that priors alone say which it is."""
    stage = result.stages[n]
    assert stage.best is not None
    as_probable = [refit.variant.effect for refit in stage.rivals(TIE)]
    near = [refit for refit in stage.rivals(NEARLY_AS_PROBABLE) if refit.variant.effect not in as_probable]
    alike = [one.variant.effect for one in near if _leave_the_same(one, stage.best, (stage.best.fit, result.final))]
    return (*as_probable, *alike)


def _leave_the_same(other: Refit, best: Refit, fits: Sequence[Fit]) -> bool:
    """Whether the simulations with one effect in another's place differ by next to nothing over the noise."""
    for fit in fits:
        exchanged = {one.effect for one in fit.unknowns.effects} - {best.variant.effect} | {other.variant.effect}
        if {one.effect for one in other.fit.unknowns.effects} == exchanged:
            return fit.nats_apart(other.fit) < APART
    return False


def _reason(result: EffectSearch, explained: bool) -> str:
    n = result.taken
    excess = result.excesses[n]
    worst = max(excess, key=lambda name: excess[name])
    size = "no larger than the noise as fitted" if excess[worst] < 1.05 else f"{excess[worst]:.3g} times the noise"
    told = f"the largest residual is {size} ({worst})"
    if n and explained:
        return told
    best = result.stages[n].best if n < len(result.stages) else None
    further = "" if best is None else f"{best.variant.effect} would bring {best.gain:.3g} nats"
    if n == 0:
        return f"{told}; {further or 'no effect'}"
    told += ", which the named effects do not account for"
    return f"{told}; {further} more" if further else told
