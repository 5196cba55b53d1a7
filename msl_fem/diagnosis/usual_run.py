"""How a record was excited: the run that an experiment after its diagnosis is held against."""

from typing import Any

import numpy as np

from msl_fem.diagnosis.next_experiment import noise_like
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import run_data
from msl_fem.record import Record


def as_excited(record: Record) -> Excitation | None:
    """Noise of the bias, size and band of the record's first fit run in motion; None without one, or without a drive.

    A run that is added later, two tones or a locked mover, is no usual one.
    """
    drive = record.actuator.drive
    free = [run for run in record.runs_of("fit") if run.mover == "free"]
    if drive is None or not free:
        return None
    run = run_data(record, free[0])
    if not np.ptp(run.commands) > 0:
        return None
    return noise_like(run, sides=max(plant_parameters(record.actuator).sides, 1), drive=drive.kind)


def excited_json(record: Record) -> dict[str, Any]:
    """What diagnosis.json says of how a record was excited; nothing of one that `as_excited` takes for none."""
    usual = as_excited(record)
    if usual is None:
        return {}
    rate = 1.0 / record.runs_of("fit")[0].sampling_period
    return {"usual_run": {"excitation": usual.spec, "rate": rate}}
