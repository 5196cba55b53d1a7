"""How a record was excited: the run that an experiment after its diagnosis is held against."""

from dataclasses import dataclass

import numpy as np

from msl_fem.diagnosis.next_experiment import noise_like
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.prediction import run_data
from msl_fem.record import Record


@dataclass(frozen=True)
class UsualRun:
    """How a record was excited.

    Attributes
    ----------
    rate : of its samples, Hz
    """

    excitation: Excitation
    rate: float

    def to_json(self) -> dict[str, float | str]:
        """The entry of diagnosis.json."""
        return {"excitation": self.excitation.spec, "rate": self.rate}


def usual_run(record: Record) -> UsualRun | None:
    """Noise of the bias, size and band of the record's first fit run in motion; None without one, or without a drive.

    A run that is added later, two tones or a locked mover, is no usual one.
    """
    drive = record.actuator.drive
    free = next((run for run in record.runs_of("fit") if run.mover == "free"), None)
    if drive is None or free is None:
        return None
    run = run_data(record, free)
    if not np.ptp(run.commands) > 0:
        return None
    sides = max(plant_parameters(record.actuator).sides, 1)
    return UsualRun(noise_like(run, sides=sides, drive=drive.kind), 1.0 / free.sampling_period)
