"""A run of a record as the coupled model takes it: what drives it, and what it should read."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE
from msl_fem.prediction.noise import NoiseFloor, noise_floor
from msl_fem.record import Record, Role, Run
from msl_fem.record.rig_file import READINGS

Array = NDArray[np.float64]
POSITION_COLUMN = "position_m"


class LoopLaw(NamedTuple):
    """A linear law from readings to commands, as `closed_loop` runs it: see `record.linear_law`."""

    a: Array
    b: Array
    c: Array
    d: Array
    reads: NDArray[np.intp]  # which of position, current 1, current 2
    makes: NDArray[np.intp]  # columns of the commands
    every: int  # samples of the run between two steps of the law
    delay: int  # samples of the run until a command acts


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
    law : what drove the run in closed loop, where it is linear and known
    read : (n_sample, 3) position and currents as recorded, for the law; columns that it does not read are 0
    """

    name: str
    role: Role
    rate: float
    commands: Array
    measured: Mapping[str, Array]
    noise: Mapping[str, NoiseFloor]
    ideal_current: bool = False
    law: LoopLaw | None = None
    read: Array | None = None

    @property
    def time(self) -> Array:
        return np.arange(len(self.commands)) / self.rate

    def first(self, n: int) -> "RunData":
        """Its first n samples."""
        measured = {k: v[:n] for k, v in self.measured.items()}
        read = None if self.read is None else self.read[:n]
        return replace(self, commands=self.commands[:n], measured=measured, read=read)


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
    missing = [name for name in (*inputs, POSITION_COLUMN) if name not in run]
    if missing:
        raise InputError(
            f"run {run.name} has no column {missing[0]}, which the coupled model of {record.actuator.name} needs for "
            f"its drive; it has {', '.join(run.columns)}"
        )
    outputs = [*currents, POSITION_COLUMN]
    if p.drive == CURRENT_DRIVE:
        outputs += [f"voltage_{j}_V" for j in sides if f"voltage_{j}_V" in run]
    outputs = [name for name in outputs if name == POSITION_COLUMN or np.ptp(run[name]) > 0]
    commands = np.zeros((run.time.size, 2))
    for j, name in enumerate(inputs):
        commands[:, j] = run[name]
    if record.sampling is not None and record.sampling.hold == "linear":
        commands[:-1] = (commands[:-1] + commands[1:]) / 2
    law, read = _law(record, run, inputs)
    return RunData(
        run.name, run.role, 1.0 / run.sampling_period, commands, {name: run[name] for name in outputs},
        {name: noise_floor(record, name) for name in outputs}, ideal, law, read,
    )  # fmt: skip


def _law(record: Record, run: Run, inputs: list[str]) -> tuple[LoopLaw | None, Array | None]:
    """The law of a run with what it read; None twice where none is stated."""
    stated = record.law_of(run.name)
    if stated is None:
        return None, None
    foreign = [name for name in stated.outputs if name not in inputs]
    if foreign:
        raise InputError(
            f"controller.linear: the law of run {run.name} makes {foreign[0]}, the drive of {record.actuator.name} "
            f"takes {', '.join(inputs)}; state the law from the readings to these"
        )
    every, delay = _clock(record, run)
    read = np.zeros((run.time.size, len(READINGS)))
    for name in stated.inputs:
        read[:, READINGS.index(name)] = run[name]
    reads = np.array([READINGS.index(name) for name in stated.inputs])
    makes = np.array([inputs.index(name) for name in stated.outputs])
    return LoopLaw(*stated.matrices(every * run.sampling_period), reads, makes, every, delay), read


def _clock(record: Record, run: Run) -> tuple[int, int]:
    """Samples of a run between two steps of its controller, and until a command acts."""
    controller = record.actuator.controller
    if controller is None:
        return 1, 0
    every = 1.0 / (controller.rate * run.sampling_period)
    whole = round(every)
    if whole < 1 or abs(every - whole) > 1e-3 * whole:
        raise InputError(
            f"controller.rate: {controller.rate:g} Hz; the samples of run {run.name}, {1 / run.sampling_period:g} a "
            "second, must be a whole multiple of it"
        )
    return whole, whole * controller.delay_samples
