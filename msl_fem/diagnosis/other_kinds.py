"""Which records free runs do not serve, and their diagnoses: static maps alone, carriages, unstable plants."""

from collections.abc import Sequence

from msl_fem.diagnosis.decidable import unstable_run, why_not
from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.loops import of_loops
from msl_fem.diagnosis.mechanical_rig import carriage, is_carriage
from msl_fem.diagnosis.other_records import Tell, diagnosis_of
from msl_fem.diagnosis.rests import of_rests, rests
from msl_fem.diagnosis.result import Diagnosis
from msl_fem.diagnosis.static_maps import of_map, why_no_map
from msl_fem.plant import plant_parameters
from msl_fem.prediction import ModelHypothesis, RunData
from msl_fem.record import Record


def other_diagnosis(
    record: Record, belief: ModelHypothesis, data: Sequence[RunData], *, rule: Rule, tell: Tell
) -> Diagnosis | None:
    """The diagnosis of a record that free runs do not serve; None where they do.

    Raises
    ------
    InputError : the record lacks what the model needs
    ComputationError : the model cannot follow the data at all
    """
    if not data:
        assert record.static is not None
        reason = why_no_map(record.static)
        if reason:
            return Diagnosis("undecidable", reason)
        likelihood, unknowns, kind = of_map(record, belief)
        return diagnosis_of(likelihood, unknowns, kind, rule=rule, tell=tell)
    mechanical = is_carriage(plant_parameters(record.actuator))
    if not mechanical and not unstable_run(belief, data):
        return None  # the recorded commands make a free run, whatever made them
    reason = why_not(record, data)
    if reason:
        return Diagnosis("undecidable", reason)
    if record.static is not None and plant_parameters(record.actuator).sides == 1:
        stood = rests(record)
        if {"fit", "held-out"} <= set(stood.role):
            static, unknowns, kind = of_rests(record, belief, stood)
            return diagnosis_of(static, unknowns, kind, rule=rule, tell=tell)
    likelihood_, unknowns, kind = (carriage if mechanical else of_loops)(record, belief, data)
    return diagnosis_of(likelihood_, unknowns, kind, rule=rule, tell=tell)
