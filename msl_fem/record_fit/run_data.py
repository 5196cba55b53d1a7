"""A run of a record as the coupled model takes it: what drives it, and what it should read."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.coupled_model import plant_parameters
from msl_fem.coupled_model.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE
from msl_fem.errors import InputError
from msl_fem.record import Record, Role, Run
from msl_fem.record_fit.noise import NoiseFloor, noise_floor

Array = NDArray[np.float64]
POSITION = "position_m"


@dataclass(frozen=True, eq=False)
class RunData:
    """A run: commands in, readings out.

    Attributes
    ----------
    commands : (n_sample, 2) A, V or N by the drive's kind, each held over its sample
    measured : channel (its column's name) to (n_sample,): what the model reads; currents of the sides, position,
        in current drive the voltages that its amplifier gives
    noise : of these channels
    ideal_current : the commands are measured currents
    """

    name: str
    role: Role
    rate: float
    commands: Array
    measured: Mapping[str, Array]
    noise: Mapping[str, NoiseFloor]
    ideal_current: bool = False

    @property
    def time(self) -> Array:
        return np.arange(len(self.commands)) / self.rate

    def first(self, n: int) -> "RunData":
        """Its first n samples."""
        return replace(self, commands=self.commands[:n], measured={k: v[:n] for k, v in self.measured.items()})


def run_data(record: Record, run: Run) -> RunData:
    """A run's inputs and outputs by the actuator's drive.

    Inputs held linearly between samples are taken as their mean over each sample.

    Raises
    ------
    InputError : a column that the drive needs is missing
    """
    p = plant_parameters(record.actuator)
    sides = range(1, p.sides + 1)
    currents = [f"current_{j}_A" for j in sides if f"current_{j}_A" in run]
    ideal = False
    if p.drive == FORCE_DRIVE:
        inputs = ["force_N"]
    elif p.drive == VOLTAGE_DRIVE:
        inputs = [f"voltage_{j}_V" for j in sides]
    else:
        inputs = [f"command_{j}_A" for j in sides]
        ideal = not all(name in run for name in inputs)
        if ideal:
            inputs, currents = [f"current_{j}_A" for j in sides], []
    missing = [name for name in (*inputs, POSITION) if name not in run]
    if missing:
        raise InputError(
            f"run {run.name} has no column {missing[0]}, which the coupled model of {record.actuator.name} needs for "
            f"its drive; it has {', '.join(run.columns)}"
        )
    outputs = [*currents, POSITION]
    if p.drive == CURRENT_DRIVE:
        outputs += [f"voltage_{j}_V" for j in sides if f"voltage_{j}_V" in run]
    outputs = [name for name in outputs if name == POSITION or np.ptp(run[name]) > 0]
    commands = np.zeros((run.time.size, 2))
    for j, name in enumerate(inputs):
        commands[:, j] = run[name]
    if record.sampling is not None and record.sampling.hold == "linear":
        commands[:-1] = (commands[:-1] + commands[1:]) / 2
    return RunData(
        run.name, run.role, 1.0 / run.sampling_period, commands, {name: run[name] for name in outputs},
        {name: noise_floor(record, name) for name in outputs}, ideal,
    )  # fmt: skip
