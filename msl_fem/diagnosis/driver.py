"""A record diagnosed: what the model gets wrong, by which causes, and how much better it becomes with them.

One driver for all kinds of records; what differs between them stands in their `Kind`.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.malloc import few_arenas
from msl_fem.diagnosis.carriages import carriage, is_carriage
from msl_fem.diagnosis.conclusion import EffectSearch, conclude
from msl_fem.diagnosis.decision import TIE, too_few_because, undecidable_because
from msl_fem.diagnosis.effect_search import about_tolerances, first_effect, search_effects
from msl_fem.diagnosis.equilibria import told_by_equilibria
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.formula import formula_of
from msl_fem.diagnosis.imposed_maps import with_imposed_maps
from msl_fem.diagnosis.in_turn import agreed, turns_of
from msl_fem.diagnosis.kind import Kind
from msl_fem.diagnosis.result import Diagnosis, with_formula
from msl_fem.diagnosis.runs import dynamic_runs
from msl_fem.diagnosis.settings import DiagnosisSettings
from msl_fem.diagnosis.statements import in_doubt, restated
from msl_fem.diagnosis.static_maps import map_alone, why_no_map
from msl_fem.diagnosis.usual_run import usual_run
from msl_fem.diagnosis.without_mover import without_absent
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.plant.effects import declare
from msl_fem.prediction import ModelHypothesis, RunData, run_data
from msl_fem.record import Record


@one_blas_thread
def diagnose(record: Record, settings: DiagnosisSettings | None = None) -> Diagnosis:
    """The diagnosis of a record, as its kind asks.

    Raises
    ------
    InputError : the record lacks what the coupled model needs, or its magnets' table is missing
    ComputationError : the model cannot follow the data at all
    """
    few_arenas()
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
    notes = (*of_coil, *of_motion, *found.notes)
    return replace(found, belief=how.belief, notes=notes, usual_run=usual_run(record))


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
    tell = partial(about_tolerances, how)
    tell("to be fitted")
    kind = kind.settled(tell)
    kind, result = _searched(kind, how)
    how.progress("held-out runs")
    found = conclude(kind, result, threshold=how.rule.threshold, threads=how.threads, tell=how.progress)
    if "unexplained" not in found.verdict or not kind.takes_laws:
        return found
    starts = (result.fits[0], result.final) if found.causes else (result.fits[0],)
    return with_formula(found, formula_of(kind, starts, tell=how.progress))


def _searched(kind: Kind, how: DiagnosisSettings) -> tuple[Kind, EffectSearch]:
    """What a search finds, and the record as stated or with a statement turned round, whichever explains more: with one
    effect where the statement is in doubt with it, with all of them where an effect has hidden that it is wrong. Over
    stretches the search begins once more there, since with a wrong statement shorter ones are chosen."""
    turned_how = replace(how, memory=how.memory.part("a statement turned round"))
    begun = first_effect(kind, how)
    doubted = in_doubt(kind, begun.fits)
    if doubted is not None:
        how.progress("a statement of rig.toml turned round")
        other = first_effect(doubted, turned_how)
        if other.nats > begun.nats + TIE:
            return _over_its_stretches(doubted, how) or (doubted, search_effects(doubted, turned_how, other))
    result = search_effects(kind, how, begun)
    hidden = restated(kind, result.fits)
    if hidden is not None:
        how.progress("a statement of rig.toml turned round")
        turned = search_effects(hidden, turned_how)
        if turned.fits[-1].log_evidence > result.fits[-1].log_evidence + TIE:
            return _over_its_stretches(hidden, how) or (hidden, turned)
    return kind, result


def _over_its_stretches(kind: Kind, how: DiagnosisSettings) -> tuple[Kind, EffectSearch] | None:
    """A record with a statement turned round over stretches that are chosen with it, and what a search finds there;
    None where its runs are followed as a whole."""
    settled = kind.settled(partial(about_tolerances, how))
    if settled is kind:
        return None
    return settled, search_effects(settled, replace(how, memory=how.memory.part("stretches chosen anew")))
