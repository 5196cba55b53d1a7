"""A record diagnosed: what the model gets wrong, by which causes, and how much better it becomes with them.

One driver for all kinds of records; what differs between them stands in their `Kind`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.diagnosis.carriages import carriage, is_carriage
from msl_fem.diagnosis.conclusion import EffectSearch, conclude
from msl_fem.diagnosis.decision import (
    Rule,
    beyond_tolerances,
    disagrees,
    in_sight,
    n_accepted,
    stays_within,
    too_few_because,
    undecidable_because,
)
from msl_fem.diagnosis.equilibria import told_by_equilibria
from msl_fem.diagnosis.fit import STEPS_A_ROUND, FitPlan, fit
from msl_fem.diagnosis.fit_memory import FitMemory, fit_name
from msl_fem.diagnosis.formula import formula_of
from msl_fem.diagnosis.imposed_maps import with_imposed_maps
from msl_fem.diagnosis.in_turn import agreed, turns_of
from msl_fem.diagnosis.kind import (
    Kind,
    about_belief,
)
from msl_fem.diagnosis.likelihood import QUIET, Fit
from msl_fem.diagnosis.refits import ROUGH
from msl_fem.diagnosis.result import (
    Diagnosis,
    with_formula,
)
from msl_fem.diagnosis.runs import dynamic_runs
from msl_fem.diagnosis.search import SearchStage, search_stage
from msl_fem.diagnosis.statements import restated
from msl_fem.diagnosis.static_maps import map_alone, why_no_map
from msl_fem.diagnosis.without_mover import without_absent
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.plant.believed import PLAIN_BELIEF, Belief
from msl_fem.plant.effects import declare
from msl_fem.prediction import ModelHypothesis, RunData, run_data
from msl_fem.record import Record
from msl_fem.table.magnetic_table import MagneticTable

WORSE_THAN = 1.02
"""How many times the belief's largest residual a fit within the tolerances may leave."""


def _untold(text: str) -> None:
    """No progress is told."""


@dataclass(frozen=True, eq=False)
class DiagnosisSettings:
    """What a diagnosis takes beside the record: the table of its magnets, the rule, threads, a progress report, and
    where fits of an interrupted one ended; `belief` is what the plain model is believed to have beside."""

    table: MagneticTable | None = None
    rule: Rule = field(default_factory=Rule)
    threads: int = 1
    progress: Callable[[str], None] = _untold
    memory: FitMemory = field(default_factory=FitMemory)
    belief: Belief = PLAIN_BELIEF


@one_blas_thread
def diagnose(record: Record, settings: DiagnosisSettings | None = None) -> Diagnosis:
    """The diagnosis of a record, as its kind asks.

    Raises
    ------
    InputError : the record lacks what the coupled model needs, or its magnets' table is missing
    ComputationError : the model cannot follow the data at all
    """
    how = settings or DiagnosisSettings()
    declare(*record.causes)
    record, of_coil = without_absent(record)
    record, of_motion = with_imposed_maps(record, how.table)
    if record.actuator.magnet is not None and how.table is None:
        raise InputError(f"{record.actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    turns = [_of_turn(one, how) for one in turns_of(record)]
    if turns:
        return replace(agreed(turns), belief=how.belief)
    kind = kind_of(record, how)
    found = Diagnosis("undecidable", kind) if isinstance(kind, str) else diagnosis_of(kind, how)
    return replace(found, belief=how.belief, notes=(*of_coil, *of_motion, *found.notes))


def _of_turn(record: Record, how: DiagnosisSettings) -> Diagnosis:
    """The diagnosis of a short map with some of its rows held out."""
    belief = ModelHypothesis.of(record.actuator, how.table, how.belief)
    return diagnosis_of(map_alone(record, belief), replace(how, memory=FitMemory()))


def kind_of(record: Record, how: DiagnosisSettings) -> Kind | str:
    """The record made ready for its diagnosis; why it cannot decide, where it cannot."""
    belief = ModelHypothesis.of(record.actuator, how.table, how.belief)
    runs = [run_data(record, run, velocity=True) for run in record.runs]
    if not runs:
        assert record.static is not None
        return why_no_map(record.static) or map_alone(record, belief)
    mechanical = is_carriage(plant_parameters(record.actuator), runs)
    reason = undecidable_because(record, runs)
    if reason:
        return reason
    how.progress("the runs are read, and how far the model follows them")
    if mechanical:
        return carriage(record, belief, runs)
    return told_by_equilibria(record, belief) or _followed(record, belief, runs, threads=how.threads)


def _followed(record: Record, belief: ModelHypothesis, runs: Sequence[RunData], *, threads: int) -> Kind | str:
    """Runs in motion, or why too little of them can be followed."""
    kind = dynamic_runs(record, belief, runs, threads=threads)
    too_few = too_few_because(kind.likelihood.problem)
    return "; ".join((too_few, *(one.text for one in kind.left_out))) if too_few else kind


def diagnosis_of(kind: Kind, how: DiagnosisSettings) -> Diagnosis:
    """The diagnosis of a record that was made ready."""
    tell = partial(_about_tolerances, how)
    tell("to be fitted")
    kind = kind.settled(tell)
    result = search_effects(kind, how)
    other = restated(kind, result.fits)
    if other is not None:
        how.progress("a statement of rig.toml turned round")
        kind, result = other, search_effects(other, replace(how, memory=FitMemory()))
    how.progress("held-out runs")
    found = conclude(kind, result, threshold=how.rule.threshold, threads=how.threads, tell=how.progress)
    if "unexplained" not in found.verdict or not kind.takes_laws:
        return found
    starts = (result.fits[0], result.final) if found.causes else (result.fits[0],)
    return with_formula(found, formula_of(kind, starts, how.rule, tell=how.progress))


def search_effects(kind: Kind, how: DiagnosisSettings) -> EffectSearch:
    """Effects added one after the other as long as each brings more than the rule asks."""
    rule = kind.rule(how.rule)
    begin = np.zeros(kind.unknowns.size) if kind.begin is None else kind.begin
    known = how.memory.end_of(fit_name(kind.unknowns), kind.unknowns)
    begin = begin if known is None else known
    steps = STEPS_A_ROUND if kind.sane else FitPlan.most_steps
    plan = FitPlan(most_steps=steps, enough=ROUGH, tell=partial(_about_tolerances, how))
    first = not_worse(kind, begin, fit(kind.likelihood, kind.unknowns, begin, plan=plan), plan)
    fits = [replace(first, finished=kind.sane is not None, sane=kind.sane)]
    stages: list[SearchStage] = []
    excesses = []
    unclear = ""
    for n in range(rule.most):
        stage = search_stage(
            fits[n],
            about_belief(kind, fits[n]),
            tell=how.progress,
            memory=how.memory,
            least=rule.least(stages),
            hopeless=partial(stays_within, kind.likelihood.problem),
        )
        stage = in_sight(kind.likelihood.problem, beyond_tolerances(kind.likelihood.problem, stage))
        fits[n] = stage.base
        stages.append(stage)
        excesses.append(stage.base.excess)
        if stage.best is None or not rule.enough(stages, n):
            break
        unclear = disagrees(stage, excesses[n])
        if unclear:
            break
        fits.append(stage.best.fit)
        if not rule.searches_on(stages, n, excesses[n], stage.best.fit.excess):
            break
    if len(fits) > len(excesses):
        excesses.append(fits[-1].excess)
    judged = stages[:-1] if unclear else stages
    return EffectSearch(tuple(fits), tuple(stages), tuple(excesses), n_accepted(judged, excesses, rule), unclear)


def _about_tolerances(how: DiagnosisSettings, text: str) -> None:
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
