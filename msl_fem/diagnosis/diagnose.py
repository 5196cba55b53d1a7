"""A record diagnosed: what the model gets wrong, by which causes, and how much better it becomes with them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.diagnosis.calibration import Calibration, calibration_of
from msl_fem.diagnosis.decidable import why_not
from msl_fem.diagnosis.decision import (
    OWN_OF_A_RUN,
    TIE,
    WORSE,
    Rule,
    accepted,
    allowed,
    quiet,
    share_left,
    too_much_left,
)
from msl_fem.diagnosis.evidence import Models, gathered
from msl_fem.diagnosis.extension import believed_estimates, effect_estimates, extended_belief
from msl_fem.diagnosis.fit import Fit, FitPlan, Likelihood, fit
from msl_fem.diagnosis.held_out import followed, held_out_gains
from msl_fem.diagnosis.joint import NOTE, JointLikelihood, joined
from msl_fem.diagnosis.next_experiment import Question, separating
from msl_fem.diagnosis.other_kinds import other_diagnosis
from msl_fem.diagnosis.outside import ENOUGH, Dependence, dependences, named
from msl_fem.diagnosis.prepare import prepared
from msl_fem.diagnosis.result import Cause, Diagnosis, Unexplained, Verdict, accuracy
from msl_fem.diagnosis.scene import scene
from msl_fem.diagnosis.search import ROUGH, Stage, stage, statistics_of
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import Variant, possible, variants
from msl_fem.diagnosis.widening import wider
from msl_fem.errors import InputError
from msl_fem.prediction import ModelHypothesis, RunData, run_data
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class DiagnosisSettings:
    """What a diagnosis takes beside the record: the table of its magnets, the rule, threads, a progress report."""

    table: MagneticTable | None = None
    rule: Rule = field(default_factory=Rule)
    threads: int = 1
    progress: Progress = lambda said: None


@dataclass(frozen=True, eq=False)
class Searched:
    """What a search went through: the fit without effects, its stages, the residuals over the noise after each.

    `taken` of the stages' effects are named; `fits` are without, with the first, and so on.
    """

    likelihood: Likelihood
    fits: tuple[Fit, ...]
    stages: tuple[Stage, ...]
    excesses: tuple[dict[str, float], ...]
    taken: int

    @property
    def final(self) -> Fit:
        return self.fits[self.taken]


@one_blas_thread
def diagnose(record: Record, settings: DiagnosisSettings | None = None) -> Diagnosis:
    """The diagnosis of a record: by free runs, or as its kind asks (`other_kinds`).

    Raises
    ------
    InputError : the record lacks what the coupled model needs, or its magnets' table is missing
    ComputationError : the model cannot follow the runs at all
    """
    how = settings or DiagnosisSettings()
    if record.actuator.magnet is not None and how.table is None:
        raise InputError(f"{record.actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    data = tuple(run_data(record, run) for run in record.runs)
    belief = ModelHypothesis(record.actuator, how.table)
    other = other_diagnosis(record, belief, data, rule=how.rule, tell=how.progress)
    if other is not None:
        return other
    reason = why_not(record, data)
    if reason:
        return Diagnosis("undecidable", reason)
    fit_runs = [run for run in data if run.role == "fit"]
    how.progress("the model within its tolerances")
    likelihood, unknowns = prepared(belief, fit_runs, record.tolerance, threads=how.threads)
    likelihood, unknowns = joined(record, belief, likelihood, unknowns)
    searched = search(likelihood, unknowns, how)
    how.progress("held-out runs")
    return concluded(record, belief, data, searched, how)


def search(likelihood: Likelihood, unknowns: Unknowns, how: DiagnosisSettings) -> Searched:
    """Effects added one after the other as long as each brings more than the rule asks."""
    base = fit(likelihood, unknowns, np.zeros(unknowns.size), plan=FitPlan(enough=ROUGH))
    fits, stages = [base], []
    excesses = [likelihood.excess(base)]
    plant = likelihood.problem.plant.parameters
    for n in range(how.rule.most):
        looked = scene(likelihood, fits[-1])
        have = {one.effect for one in fits[-1].unknowns.effects}
        tried = [v for effect in possible(plant) if effect not in have for v in variants(effect, looked, plant)]
        found = stage(likelihood, fits[-1], tried, tell=how.progress, threads=how.threads)
        if n == 0:
            fits[0] = found.base
        found = allowed(likelihood.problem, found)
        stages.append(found)
        if found.best is None or not how.rule.enough(stages, n):
            break
        fits.append(found.best.fit)
        excesses.append(likelihood.excess(found.best.fit))
        if not how.rule.goes_on(stages, n, excesses[-2], excesses[-1]):
            break
    taken = accepted(stages, excesses, how.rule)
    return Searched(likelihood, tuple(fits), tuple(stages), tuple(excesses), taken)


def concluded(
    record: Record, belief: ModelHypothesis, data: Sequence[RunData], searched: Searched, how: DiagnosisSettings
) -> Diagnosis:
    """The verdict of a search, with what held-out runs say."""
    problem = searched.likelihood.problem
    models = [extended_belief(belief, problem, found) for found in searched.fits[: searched.taken + 1]]
    follows = [followed(model, data) for model in models]
    gains = held_out_gains(follows)
    patched = searched.taken > 1 and _patched(searched, models[searched.taken], threads=how.threads)
    if patched:
        searched = replace(searched, taken=1)
    names, notes = _kept(searched, gains)
    if patched:
        notes.append("several effects together leave what a function of one variable explains; only the first is kept")
    if isinstance(searched.likelihood, JointLikelihood):
        notes.append(NOTE)
    searched = replace(searched, taken=names)
    calm = quiet(searched.excesses[names]) and not patched
    studied, outside = calibration_of(record, problem.plant.parameters, problem.runs, how.rule)
    causes = tuple(_cause(searched, n, gains[n], studied) for n in range(names))
    asked = Question(belief, problem, searched.final.unknowns.believed)
    causes = tuple(
        replace(cause, next_experiment=separating(asked, at, cause.rivals))
        for cause, at in zip(causes, searched.stages, strict=False)
    )
    left = Unexplained(0.0)
    ranked: list[Dependence] = []
    if not calm:
        how.progress("what is left over every variable")
        ranked = dependences(*searched.likelihood.runs_part(searched.final), models[names], threads=how.threads)
        equation, variables = named(ranked)
        left = Unexplained(share_left(searched.excesses, names), variables, equation, wider(asked, variables))
    return Diagnosis(
        _verdict(names, calm),
        _reason(searched, names, calm),
        causes,
        left,
        accuracy(followed(belief, data), follows[0], follows[names]),
        believed_estimates(belief, searched.final),
        models[0],
        models[names],
        how.rule.threshold,
        (studied.named, studied.records) if studied is not None else None,
        statistics=statistics_of(searched.stages),
        notes=(*notes, *([outside] if outside else [])),
        evidence=gathered(
            data,
            Models(belief, models[0], models[names]),
            searched.stages,
            causes=[c.effect for c in causes],
            left=ranked,
        ),
    )


def _patched(searched: Searched, model: ModelHypothesis, *, threads: int) -> bool:
    """Whether several effects only patch up what none of them is: what they leave, small as it may be, is a function of
    one variable that brings more than the last of them did."""
    ranked = dependences(*searched.likelihood.runs_part(searched.final), model, few=True, threads=threads)
    last = searched.stages[searched.taken - 1].best
    return bool(ranked and last is not None and ranked[0].gain > max(ENOUGH, last.gain))


def _kept(searched: Searched, gains: Sequence[float]) -> tuple[int, list[str]]:
    """How many of the search's effects are named, and why not more."""
    names, notes = searched.taken, []
    tried = [r.variant.effect for s in searched.stages[:names] if (r := s.best)]
    if too_much := too_much_left(tried, searched.excesses):
        notes.append(too_much)
        names = 0
    while names and gains[names - 1] < -WORSE:
        best = searched.stages[names - 1].best
        effect = best.variant.effect if best else ""
        if effect in OWN_OF_A_RUN:
            notes.append(f"{effect} is of each run's own: that of the fit run says nothing of held-out runs")
            break
        names -= 1
        notes.append(f"{effect} makes held-out runs worse and is not named")
    return names, notes


def _verdict(names: int, calm: bool) -> Verdict:
    if names:
        return "named" if calm else "named-and-unexplained"
    return "nothing-found" if calm else "unexplained"


def _cause(searched: Searched, n: int, gain: float, studied: Calibration | None) -> Cause:
    best, final = searched.stages[n].best, searched.final
    assert best is not None
    rivals = tuple(r.variant.effect for r in searched.stages[n].rivals(TIE))
    p_value = studied.p_value(best.gain) if studied is not None else None
    return Cause(best.variant.effect, effect_estimates(final)[best.variant.effect], best.gain, p_value, gain, rivals)


def _reason(searched: Searched, names: int, calm: bool) -> str:
    excess = searched.excesses[names]
    worst = max(excess, key=lambda name: excess[name])
    told = f"the largest residual is {excess[worst]:.3g} times the noise ({worst})"
    best = searched.stages[names].best if names < len(searched.stages) else None
    if names == 0:
        return f"{told}; " + (
            "no effect" if best is None else f"{best.variant.effect} would bring {best.gain:.3g} nats"
        )
    return told if calm else f"{told}, which the named effects do not account for"


__all__ = ["DiagnosisSettings", "Searched", "Variant", "concluded", "diagnose", "search"]
