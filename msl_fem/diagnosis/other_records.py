"""The search and the verdict for records whose likelihood is not that of free runs: static maps, carriages, loops.

Stages, scores, refits and thresholds are those of free runs (`search`, `decision`). What differs by the kind of a
record stands in `Kind`: which variants there are, how a fit is followed along the data, and what it extends to.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.diagnosis.decision import (
    FINISHED,
    TIE,
    WORSE,
    Rule,
    accepted,
    allowed,
    quiet,
    share_left,
    too_much_left,
)
from msl_fem.diagnosis.extension import believed_estimates, effect_estimates
from msl_fem.diagnosis.fit import Fit, FitPlan, Likelihood, fit
from msl_fem.diagnosis.held_out import Followed, held_out_gains
from msl_fem.diagnosis.result import Accuracy, Cause, Diagnosis, Unexplained
from msl_fem.diagnosis.search import ROUGH, Stage, stage, statistics_of
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant
from msl_fem.prediction import ModelHypothesis

Tell = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Kind:
    """What is particular to a kind of record.

    Attributes
    ----------
    prediction : its word in the accuracy's entries
    belief : as in the record
    candidates : of the likelihood and a fit, the variants to be tried
    follow : of a fit, or of None for the believed model, how well it follows all data
    extend : of a fit, the model that other commands take
    finished : share of the excess power that a further effect may leave, where the fit before was not quiet
    experiments : effect to what would separate it from its rivals
    notes : what the reader must know beside the verdict
    next_experiment : what would show more of what is left unexplained
    faithful : how many times their error on the fit data the effects may err on held-out data, to be named
    """

    prediction: str
    belief: ModelHypothesis
    candidates: Callable[[Likelihood, Fit], list[Variant]]
    follow: Callable[[Fit | None], list[Followed]]
    extend: Callable[[Fit], ModelHypothesis]
    finished: float = FINISHED
    experiments: Mapping[str, str] | None = None
    notes: tuple[str, ...] = ()
    next_experiment: str = ""
    faithful: float = float("inf")


@dataclass(frozen=True, eq=False)
class Trail:
    """The fits without and with each further effect, the stages between them, the excesses of each fit."""

    fits: tuple[Fit, ...]
    stages: tuple[Stage, ...]
    excesses: tuple[dict[str, float], ...]


def diagnosis_of(likelihood: Likelihood, unknowns: Unknowns, kind: Kind, *, rule: Rule, tell: Tell) -> Diagnosis:
    """The diagnosis of a record of this kind."""
    own = replace(rule, finished=kind.finished, share=0.0)
    trail = searched(likelihood, unknowns, kind, rule=own, tell=tell)
    tell("held-out data")
    return verdict(trail, kind, rule=own)


def searched(likelihood: Likelihood, unknowns: Unknowns, kind: Kind, *, rule: Rule, tell: Tell) -> Trail:
    """Effects added one after the other as long as each brings more than the rule asks."""
    tell("the model within its tolerances")
    fits = [fit(likelihood, unknowns, np.zeros(unknowns.size), plan=FitPlan(enough=ROUGH))]
    stages: list[Stage] = []
    for n in range(rule.most):
        found = stage(likelihood, fits[-1], kind.candidates(likelihood, fits[-1]), tell=tell)
        fits[-1] = found.base
        stages.append(allowed(likelihood.problem, found))
        best = stages[-1].best
        if best is None or not rule.enough(stages, n):
            break
        fits.append(best.fit)
        if not rule.goes_on(stages, n, likelihood.excess(fits[-2]), likelihood.excess(fits[-1])):
            break
    return Trail(tuple(fits), tuple(stages), tuple(likelihood.excess(found) for found in fits))


def verdict(trail: Trail, kind: Kind, *, rule: Rule) -> Diagnosis:
    """What a search has found, with what held-out data say."""
    nominal, follows = kind.follow(None), [kind.follow(found) for found in trail.fits]
    gains = held_out_gains(follows)
    taken, notes = accepted(trail.stages, trail.excesses, rule), list(kind.notes)
    names = [one.unknowns.effects[-1].effect for one in trail.fits[1 : taken + 1]]
    if too_much := too_much_left(names, trail.excesses):
        notes.append(too_much)
        taken = 0
    while taken and gains[taken - 1] < -WORSE:
        taken -= 1
        name = trail.fits[taken + 1].unknowns.effects[-1].effect
        notes.append(f"{name} makes held-out data worse and is not named")
    mimics = _unfaithful(follows[taken], kind) if taken else ""
    if mimics:
        tried = ", ".join(one.unknowns.effects[-1].effect for one in trail.fits[1 : taken + 1])
        reason = (
            f"{tried} would account for the fit data, and {mimics}: something else acts alike where they were taken"
        )
        reason += f"; what would decide: {kind.next_experiment}" if kind.next_experiment else ""
        rows = tuple(Accuracy(*row, kind.prediction) for row in zip(nominal, follows[0], follows[taken], strict=True))
        left = Unexplained(share_left(trail.excesses, taken), next_experiment=kind.next_experiment)
        return Diagnosis(
            "undecidable", reason, unexplained=left, accuracy=rows, refitted=kind.extend(trail.fits[0]),
            threshold=rule.threshold, statistics=statistics_of(trail.stages), notes=tuple(notes),
        )  # fmt: skip
    final, calm = trail.fits[taken], quiet(trail.excesses[taken])
    share = share_left(trail.excesses, taken)
    left = Unexplained(0.0) if calm else Unexplained(share, next_experiment=kind.next_experiment)
    words = ("nothing-found", "unexplained", "named", "named-and-unexplained")
    return Diagnosis(
        words[2 * bool(taken) + (not calm)],  # type: ignore[arg-type]
        _reason(trail, taken),
        tuple(_cause(trail, n, gains[n], (kind, final)) for n in range(taken)),
        left,
        tuple(Accuracy(*row, kind.prediction) for row in zip(nominal, follows[0], follows[taken], strict=True)),
        believed_estimates(kind.belief, final) if final.unknowns.believed else {},
        kind.extend(trail.fits[0]),
        kind.extend(final),
        rule.threshold,
        statistics=statistics_of(trail.stages),
        notes=tuple(notes),
    )


def _unfaithful(found: Sequence[Followed], kind: Kind) -> str:
    """On which channel held-out data are followed much worse than fit data, in words; empty where on none."""
    for one in (f for f in found if f.role == "held-out"):
        own = [f.rms for f in found if f.role == "fit" and f.channel == one.channel]
        if own and one.rms > kind.faithful * max(*own, one.floor):
            return f"errs by {one.rms:.3g} on held-out {one.channel}, {one.rms / max(own):.3g} times as much as there"
    return ""


def _cause(trail: Trail, n: int, gain: float, where: tuple[Kind, Fit]) -> Cause:
    (kind, final), best = where, trail.stages[n].best
    assert best is not None
    rivals = tuple(r.variant.effect for r in trail.stages[n].rivals(TIE))
    effect = best.variant.effect
    experiment = (kind.experiments or {}).get(effect, "") if rivals else ""
    return Cause(effect, effect_estimates(final)[effect], best.gain, None, gain, rivals, experiment)


def _reason(trail: Trail, taken: int) -> str:
    excess = trail.excesses[taken]
    worst = max(excess, key=lambda name: excess[name])
    told = f"residuals are at most {excess[worst]:.3g} of the noise ({worst})"
    best = trail.stages[taken].best if taken < len(trail.stages) else None
    further = "no further effect" if best is None else f"{best.variant.effect} would bring {best.gain:.3g} nats more"
    return f"{told}; {further}"
