"""A run of a record as the coupled model takes it: what drives it, and what it should read."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant import plant_parameters
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE
from msl_fem.prediction.scheduling import Schedule, schedules_of, standing_factors
from msl_fem.record import Mover, Record, Role, Run
from msl_fem.record.clipping import clipped_samples
from msl_fem.record.columns import Channel, side_columns
from msl_fem.record.linear_law import READINGS
from msl_fem.record.validity import bridged

POSITION_COLUMN, VELOCITY_COLUMN = "position_m", "velocity_m_per_s"
Hold = Literal["zero-order", "linear"]
HIGHEST_BAND = 0.8  # of half the sampling rate: from here on, a channel is taken to hold noise alone
LOWEST = 1e-9  # of a channel's span: noise below is none
STOPPED = 3  # samples of the largest command, which say that it was a limit
READ_OFF = 0.05  # how much larger than it was a command may be read
_NONE = np.zeros(0, dtype=np.intp)


@dataclass(frozen=True)
class NoiseFloor:
    """One sigma of a channel and where it comes from."""

    sigma: float
    source: Literal["stated in [noise]", "estimated above 80 % of half the sampling rate"]

    @property
    def stated(self) -> bool:
        return self.source == "stated in [noise]"


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
    commands : (n_sample, 2) A, V or N by the drive's kind
    hold : whether commands are held over their samples, or run straight from one to the next
    measured : channel (its column's name) to (n_sample,): what the model reads; currents of the sides, position,
        in current drive the voltages that its amplifier gives
    noise : of these channels
    ideal_current : the commands are measured currents
    law : what drove the run in closed loop, where it is linear and known
    read : (n_sample, 3) position and currents as recorded, for the law; columns that it does not read are 0
    spikes : channel to the samples of readings that stand alone, which do not count
    invalid : channel to the samples of readings that the record or a clipped sensor says do not count; there the
        channel holds a straight line
    mover : "free", "locked" or "imposed", as `Run` has it
    schedules : parameters that go with a second input
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
    hold: Hold = "zero-order"
    spikes: Mapping[str, NDArray[np.intp]] = field(default_factory=dict)
    invalid: Mapping[str, NDArray[np.intp]] = field(default_factory=dict)
    mover: Mover = "free"
    schedules: tuple[Schedule, ...] = ()

    @property
    def left_out(self) -> dict[str, NDArray[np.intp]]:
        """Channel to the samples of its readings that do not count, those that have some."""
        both = {name: self.spikes.get(name, _NONE) for name in (*self.spikes, *self.invalid)}
        return {name: np.union1d(at, self.invalid.get(name, _NONE)) for name, at in both.items()}

    def inputs(self, columns: int) -> Inputs:
        """The commands of so many sides, or of one voltage or force; made and looked through once."""
        if columns not in self._inputs:
            self._inputs[columns] = Inputs(self.commands[:, :columns], self.rate, hold=self.hold)
        return self._inputs[columns]

    @cached_property
    def _inputs(self) -> dict[int, Inputs]:
        return {}

    def are_limited(self, limit: float) -> bool:
        """Whether the commands were recorded behind a limit (A, V): none is larger, or by no more than a reading may be
        off, and several stop at the largest."""
        largest, times = self._largest_command
        return largest <= ((1.0 + READ_OFF) * limit if times >= STOPPED else limit)

    @cached_property
    def _largest_command(self) -> tuple[float, int]:
        """The largest size of a command, and how often it is met."""
        sizes = np.abs(self.commands)
        largest = float(sizes.max(initial=0.0))
        return largest, int(np.count_nonzero(sizes == largest))

    @property
    def held(self) -> Array:
        """(n_sample, 2) commands as means over their samples, for what takes them one by one; of an imposed motion the
        force is a reading, which is as it was at its instant."""
        if self.hold == "zero-order" or self.mover == "imposed":
            return self.commands
        held = self.commands.copy()
        held[:-1] = (self.commands[:-1] + self.commands[1:]) / 2
        return held

    @property
    def still(self) -> bool:
        """Whether the position is that of a locked mover and reads the same throughout: a setting and no reading."""
        return self.mover == "locked" and float(np.ptp(self.measured[POSITION_COLUMN])) == 0

    @property
    def channels(self) -> dict[str, Channel]:
        """What is measured, by the column's name."""
        return {name: Channel.of(name) for name in self.measured}

    @property
    def time(self) -> Array:
        return np.arange(len(self.commands)) / self.rate

    def standing(self, factors: Mapping[str, float]) -> dict[str, float]:
        """Parameters over those of `factors` by what a second input makes of them in this run, one value throughout;
        InputError where it changes."""
        return standing_factors(self.schedules, factors, run=self.name)

    def first(self, n: int) -> "RunData":
        """Its first n samples."""
        measured = {k: v[:n] for k, v in self.measured.items()}
        read = None if self.read is None else self.read[:n]
        spikes, invalid = ({k: at[at < n] for k, at in some.items()} for some in (self.spikes, self.invalid))
        head = replace(self, commands=self.commands[:n], measured=measured, read=read)
        schedules = tuple(one.first(n) for one in self.schedules)
        return replace(head, spikes=spikes, invalid=invalid, schedules=schedules)


def run_data(record: Record, run: Run, *, velocity: bool = False) -> RunData:
    """A run's inputs and outputs by the actuator's drive; a measured `velocity` among them where it is asked for.

    Raises
    ------
    InputError : a column that the drive needs is missing
    """
    inputs = _inputs(record, run)
    outputs = _outputs(record, run, inputs)
    outputs += [VELOCITY_COLUMN] if velocity and VELOCITY_COLUMN in run and np.ptp(run[VELOCITY_COLUMN]) > 0 else []
    commands = np.zeros((run.time.size, 2))
    for j, name in enumerate(inputs):
        commands[:, j] = run[name]
    law, read = _law(record, run, inputs)
    invalid = {name: at for name in outputs if (at := _invalid(run, name)).size}
    return RunData(
        name=run.name,
        role=run.role,
        rate=1.0 / run.sampling_period,
        commands=commands,
        measured={name: bridged(run[name], invalid.get(name, _NONE)) for name in outputs},
        noise={name: noise_floor(record, name) for name in outputs},
        ideal_current=any(Channel.of(name).quantity == "current" for name in inputs),
        law=law,
        read=read,
        hold=record.sampling.hold if record.sampling is not None else "zero-order",
        invalid=invalid,
        mover=run.mover,
        schedules=schedules_of(record, run),
    )


def _invalid(run: Run, name: str) -> NDArray[np.intp]:
    """The samples of a reading that do not count: as the run says, and of a position at which its sensor is clipped. A
    current that stands still may be at the limit of its drive, so nothing is taken for granted there."""
    stated = np.flatnonzero(~run.valid[name]) if name in run.valid else _NONE
    moving = name == POSITION_COLUMN and run.mover != "locked"
    return np.union1d(stated, clipped_samples(run[name])) if moving else stated


def _inputs(record: Record, run: Run) -> list[str]:
    """The columns that drive the plant; in current drive the measured currents where not all commands are there."""
    p = plant_parameters(record.actuator)
    if p.drive == FORCE_DRIVE:
        inputs = ["force_N"]
    elif p.drive == VOLTAGE_DRIVE:
        inputs = side_columns("voltage", p.sides)
    else:
        inputs = side_columns("command", p.sides)
        if not all(name in run for name in inputs):
            inputs = side_columns("current", p.sides)
    missing = [name for name in (*inputs, POSITION_COLUMN) if name not in run]
    if missing:
        raise InputError(
            f"run {run.name} has no column {missing[0]}, which the coupled model of {record.actuator.name} needs for "
            f"its drive; it has {', '.join(run.columns)}"
        )
    return inputs


def _outputs(record: Record, run: Run, inputs: list[str]) -> list[str]:
    """The columns that the model is to read: those that are there, move and do not drive it."""
    p = plant_parameters(record.actuator)
    candidates = [*side_columns("current", p.sides), POSITION_COLUMN]
    if p.drive == CURRENT_DRIVE:
        candidates += side_columns("voltage", p.sides)
    outputs = [name for name in candidates if name in run and name not in inputs]
    return [name for name in outputs if name == POSITION_COLUMN or np.ptp(run[name]) > 0]


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
    a, b, c, d = stated.matrices(every * run.sampling_period)
    return LoopLaw(a, b, c, d, reads, makes, every, delay), read


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


def noise_floor(record: Record, channel: str) -> NoiseFloor:
    """The noise of a channel by its column's name: what the instruments state, else the least over the runs of what
    their highest frequencies hold."""
    stated = getattr(record.noise, Channel.of(channel).quantity)
    if stated:
        return NoiseFloor(float(stated), "stated in [noise]")
    estimates = [highest_band_sigma(run[channel]) for run in record.runs if channel in run and np.ptp(run[channel]) > 0]
    return NoiseFloor(min(estimates, default=LOWEST), "estimated above 80 % of half the sampling rate")


def highest_band_sigma(signal: Array) -> float:
    """Sigma of the white noise that would have the power of a signal's highest band, with a Hann window."""
    window = np.hanning(signal.size)
    power = np.abs(np.fft.rfft((signal - signal.mean()) * window)) ** 2
    lines = power[int(HIGHEST_BAND * power.size) :]
    return float(max(np.sqrt(lines.mean() / np.sum(window**2)), LOWEST * np.ptp(signal)))
