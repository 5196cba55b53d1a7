"""How a record was excited: the run that an experiment after its diagnosis is held against."""

from typing import Any

import numpy as np

from msl_fem.diagnosis.next_experiment import noise_like
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import run_data
from msl_fem.record import Record, Run


def as_excited(record: Record) -> Excitation | None:
    """Noise of the bias, size and band of the record's first fit run in motion; None without one, or without a drive.

    A run that is added later, two tones or a locked mover, is no usual one.
    """
    drive, free = record.actuator.drive, _first_in_motion(record)
    if drive is None or free is None:
        return None
    run = run_data(record, free)
    if not np.ptp(run.commands) > 0:
        return None
    return noise_like(run, sides=max(plant_parameters(record.actuator).sides, 1), drive=drive.kind)


def excited_json(record: Record) -> dict[str, Any]:
    """What diagnosis.json says of how a record was excited; nothing of one that `as_excited` takes for none."""
    usual, free = as_excited(record), _first_in_motion(record)
    if usual is None or free is None:
        return {}
    return {"usual_run": {"excitation": usual.spec, "rate": 1.0 / free.sampling_period}}


def _first_in_motion(record: Record) -> Run | None:
    return next((run for run in record.runs_of("fit") if run.mover == "free"), None)
