"""Runs of the coupled model along a record's run, inputs given and readings simulated: free, and in closed loop by the
law that drove the run.

A linear law answers to readings and reference apart, u = R r - L y. With the recorded u and y the simulated loop is

    u_sim = u + L y - L y_sim = u - L (y_sim - y),

whatever the reference and the constants were: they need not be known, and noise of the readings cancels, since the
recorded command already answers to it. Of a law that is not linear, the difference of its answers takes that place; it
needs the reference then. Limits of the drive act on u_sim as the kernel has them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import copy_into, set_combined
from msl_fem.computing.gauss_newton import FitSettings, fit_map
from msl_fem.errors import ComputationError, OutOfTable
from msl_fem.plant import kernel, layout, linearise
from msl_fem.plant.instruments import Channels, currents_before_noise, instruments_of, position_before_noise
from msl_fem.plant.layout import OK, initial_state
from msl_fem.plant.plant import FORCE_DRIVE, drive_lags, plant_parameters
from msl_fem.plant.preparation import start_effects
from msl_fem.plant.sampled_plant import SampledPlant, advance_sample, plant_at_rest, read_instruments
from msl_fem.plant.simulate import STATUS
from msl_fem.prediction.hypothesis import KernelPlant, ModelHypothesis, plant_in_run
from msl_fem.prediction.nuisances import line_of
from msl_fem.prediction.run_data import POSITION_COLUMN, LoopLaw, RunData
from msl_fem.record import Tolerance
from msl_fem.record.columns import Channel, side_columns
from msl_fem.record.validity import bridged

GROWTH = 20.0  # of an error in one stretch of a run, beyond which a free run says nothing
LOOKED_AT = 4000  # samples of a run at which its stiffness is looked at
START_SECONDS, START_SAMPLES = 0.05, 100  # what the start of a run is estimated from, the longer of both
START_FIT = FitSettings(step=1e-3, damping=1.0, most_steps=15)
FIRST_LOOK = 9  # samples of the straight line that gives a first guess of position and velocity
_READINGS, _VOLTAGES, _N_OUT = slice(0, 3), slice(3, 5), 5  # columns of a run in closed loop


@dataclass(frozen=True)
class Start:
    """Where a run begins: A of each side, m, m/s."""

    currents: tuple[float, float]
    position: float
    velocity: float


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Simulated readings by channel, (n_sample,) each, nan from `ended` on, which is None for a whole run."""

    readings: Mapping[str, Array]
    ended: int | None = None
    reason: str = ""


def open_loop_stable(belief: ModelHypothesis, data: RunData) -> bool:
    """Whether the plant returns from a small push at the run's mean position and RMS currents, and nowhere along the
    run grows an error by more than `GROWTH`.

    A rig without a spring does not return: an error of its force stays in its position.
    """
    currents = believed_currents(belief, data)
    position = float(np.mean(data.measured[POSITION_COLUMN]))
    try:
        at = linearise(belief.actuator, belief.table, currents=currents, position=position)
    except OutOfTable:
        return False
    return at.stiffness > 0 and at.is_stable and error_growth(belief, data) <= GROWTH


def error_growth(belief: ModelHypothesis, data: RunData) -> float:
    """The largest factor by which a small error of the position grows in one stretch of a run, by the stiffness K that
    the belief has at the measured positions and currents: exp of the integral of sqrt(-K/m) - c/(2 m) where K < 0."""
    p, table = plant_parameters(belief.actuator), belief.table
    if table is None or not p.sides:
        return 1.0
    every = max(1, len(data.commands) // LOOKED_AT)
    x = data.measured[POSITION_COLUMN][::every]
    stiffness = np.full(x.shape, p.stiffness)
    for j in range(p.sides):
        current = np.abs(_side_current(data, j)[::every]) * p.current_share
        gap = np.clip(p.nominal_gap - (1 - 2 * j) * x, table.gap[0], table.gap[-1])
        magnet = table.evaluate(np.minimum(current, table.current[-1]), gap)
        stiffness = stiffness + p.magnets * magnet["force_gap_slope"]
    rate = np.sqrt(np.maximum(-stiffness, 0.0) / p.mass) - p.damping / (2 * p.mass)
    grown = largest = 0.0
    for step in rate * every / data.rate:
        grown = grown + step if step > 0 else 0.0
        largest = max(largest, grown)
    return float(np.exp(min(largest, 700.0)))


def believed_currents(belief: ModelHypothesis, data: RunData) -> tuple[float, float]:
    """RMS currents of the sides over a run: as measured, else as commanded."""
    actuator = belief.actuator
    sides = actuator.sides.count if actuator.sides and actuator.magnet else 0
    rms = [0.0, 0.0]
    for j in range(sides):
        rms[j] = float(np.sqrt(np.mean(_side_current(data, j) ** 2)))
    return rms[0], rms[1]


def _side_current(data: RunData, j: int) -> Array:
    """(n_sample,) current of a side, counted from 0: as measured, else as commanded."""
    return data.measured.get(Channel("current", j + 1).column, data.commands[:, j])


def free_run(plant: KernelPlant, data: RunData, start: Start) -> FreeRun:
    """The run from a start to its end, or to where the plant leaves table or range."""
    n = len(data.commands)
    out = np.full((n, layout.N_OUT), np.nan)
    state = kernel_state(plant, start)
    linear = data.hold == "linear"
    surface, p, effects = plant.model
    p = plant_in_run(p, data)
    status, done = kernel.run(surface, p, effects, state, data.commands, np.zeros(n), *plant.timing, out, linear)
    out[done:] = np.nan
    return _ended(readings_of(plant, data, out), status, done)


def _ended(readings: Mapping[str, Array], status: int, done: int) -> FreeRun:
    if status == OK:
        return FreeRun(readings)
    return FreeRun(readings, int(done), f"{STATUS[int(status)]} at sample {int(done)}")


def kernel_state(plant: KernelPlant, start: Start) -> Array:
    """The kernel's state (N_STATE,) at a start."""
    state = initial_state(plant.parameters, *start.currents, start.position, start.velocity)
    if plant.effects is not None:
        start_effects(plant.surface, plant.parameters, plant.effects, state)
    return state


def guessed_start(plant: KernelPlant, data: RunData) -> Start:
    """Position and velocity of the straight line through the first samples, of a locked mover the mean position;
    currents as read or commanded."""
    zero = line_of(POSITION_COLUMN, plant.instruments)[1]
    read = (data.measured[POSITION_COLUMN] - zero) / plant.gain
    slope, position = 0.0, read.mean()
    if data.mover != "locked":
        slope, position = np.polyfit(np.arange(FIRST_LOOK) / data.rate, read[:FIRST_LOOK], 1)
    currents = [0.0, 0.0]
    if plant.parameters.drive != FORCE_DRIVE:
        for j in range(plant.parameters.sides):
            currents[j] = float(read_current(plant, data, j)[0])
    return Start((currents[0], currents[1]), float(position), float(slope))


def _bend(plant: KernelPlant, data: RunData) -> Array:
    """(2,) m, m/s: by how much the straight line of the first guess misses position and velocity at its beginning,
    since the mover accelerates; zeros of a locked one.

    The least-squares line through b t^2 over 0 ... T is b (T t - T^2/6).
    """
    if data.mover == "locked":
        return np.zeros(2)
    time = np.arange(FIRST_LOOK) / data.rate
    bent = abs(np.polyfit(time, data.measured[POSITION_COLUMN][:FIRST_LOOK] / plant.gain, 2)[0])
    return np.array([bent * time[-1] ** 2 / 6, bent * time[-1]])


def read_current(plant: KernelPlant, data: RunData, j: int) -> Array:
    """(n_sample,) current of side j, as read or commanded."""
    column = Channel("current", j + 1).column
    if column in data.measured:
        gain, zero = line_of(column, plant.instruments)
        return np.asarray((data.measured[column] - zero) / gain)
    p = plant.parameters
    gain, zero = (p.input_gain_1, p.input_zero_1) if j == 0 else (p.input_gain_2, p.input_zero_2)
    return np.asarray(gain * data.commands[:, j] + zero)


def start_sigmas(plant: KernelPlant, data: RunData, *, tolerance: Tolerance | None = None) -> Array:
    """One sigma of the first guess: position, velocity, and the currents that cannot jump; with a `tolerance` also of
    the instruments' zeros, by which the guess is off."""
    noise = data.noise[POSITION_COLUMN].sigma
    zero = (0.0, 0.0) if tolerance is None else (tolerance.position_zero, tolerance.current_zero)
    position = float(np.hypot(noise, zero[0]))
    lagging = []
    if drive_lags(plant.parameters):
        columns = side_columns("current", plant.parameters.sides)
        lagging = [float(np.hypot(data.noise[name].sigma, zero[1])) for name in columns if name in data.measured]
    return np.array([position, 0.0 if data.mover == "locked" else noise * data.rate, *lagging])


def moved_start(guess: Start, by: Array) -> Start:
    """A start moved by (position, velocity, currents ...)."""
    currents = np.array(guess.currents)
    currents[: by.size - 2] += by[2:]
    first, second = (float(value) for value in currents)
    return Start((first, second), guess.position + float(by[0]), guess.velocity + float(by[1]))


def measured_start(plant: KernelPlant, data: RunData) -> Start:
    """Where a run begins, most probably: the model's own run through its first samples, from a guess by the readings.

    A start taken from single readings would carry their noise into a lightly damped mode.
    """
    guess = guessed_start(plant, data)
    head = data.first(max(START_SAMPLES, int(START_SECONDS * data.rate)))
    sigmas = start_sigmas(plant, data)
    sigmas[:2] = np.hypot(sigmas[:2], _bend(plant, data))
    size = 1.0

    def residual(z: Array) -> Array:
        run = free_run(plant, head, moved_start(guess, z * sigmas))
        return weighted(run, head) / size

    def residuals(rows: Array) -> Array:
        return np.array([residual(z) for z in rows])

    try:
        fit = fit_map(residuals, np.zeros(sigmas.size), settings=START_FIT)
        size = max(1.0, float(np.sqrt(np.mean(fit.residual**2))))  # a model error is no information
        if size > 1.0:
            fit = fit_map(residuals, fit.parameters, settings=START_FIT)
    except ComputationError:
        return guess
    return moved_start(guess, fit.parameters * sigmas)


def weighted(run: FreeRun, data: RunData, scale: Mapping[str, float] | None = None) -> Array:
    """Measured less simulated over the noise (times `scale`), channel after channel; of those with stated noise, or
    position and currents."""
    scale, left_out = scale or {}, data.left_out
    parts = []
    for name in counted(data):
        sigma = data.noise[name].sigma * scale.get(name, 1.0)
        missed = data.measured[name] - run.readings[name]
        parts.append((bridged(missed, left_out[name]) if name in left_out else missed) / sigma)
    return np.concatenate(parts)


def counted(data: RunData) -> list[str]:
    """Channels that a fit looks at: voltages only where their noise is stated, no position that was set."""
    without = [POSITION_COLUMN] if data.still else []
    channels = [(name, channel) for name, channel in data.channels.items() if name not in without]
    return [name for name, channel in channels if channel.quantity != "voltage" or data.noise[name].stated]


def readings_of(plant: KernelPlant, data: RunData, out: Array) -> dict[str, Array]:
    """What a run's instruments read, before noise, of the kernel's rows (n_sample, N_OUT): channel to (n_sample,)."""
    channels = Channels.of(out, plant.parameters.sides)
    position = plant.gain * position_before_noise(channels, plant.readings, rate=data.rate)
    currents = out[:, :0]
    if plant.parameters.sides:
        currents = currents_before_noise(channels, plant.readings, rate=data.rate)
    voltages = out[:, layout.OUT_VOLTAGE_1 : layout.OUT_VOLTAGE_1 + 2]
    return _by_channel(plant, data, position, currents, voltages, out[:, layout.OUT_V])


def _by_channel(
    plant: KernelPlant, data: RunData, position: Array, currents: Array, voltages: Array, velocity: Array
) -> dict[str, Array]:
    """Channel to (n_sample,) of what is measured: position and velocity (n_sample,), currents and voltages
    (n_sample, n_side)."""
    readings = {}
    for name, channel in data.channels.items():
        if channel.quantity == "position":
            readings[name] = position
        elif channel.quantity == "velocity":
            readings[name] = velocity
        else:
            both = voltages if channel.quantity == "voltage" else currents
            readings[name] = both[:, channel.index]
        gain, zero = line_of(name, plant.instruments)
        if gain != 1.0 or zero != 0.0:
            readings[name] = gain * readings[name] + zero
    return readings


@dataclass(frozen=True, eq=False)
class CallableLaw:
    """A law that is asked sample by sample.

    Attributes
    ----------
    answer : of the sample's number and the simulated position reading, what it adds to the recorded commands, (2,)
    every : samples of the run between two questions
    delay : samples of the run until an answer acts
    """

    answer: Callable[[int, float], Array]
    every: int
    delay: int


def closed_run(plant: KernelPlant, data: RunData, start: Start, law: CallableLaw | None = None) -> FreeRun:
    """The run of the simulated loop, to its end or to where the plant leaves table or range.

    By `law`, or by the linear law of the data, which must be there then.
    """
    looped = _in_loop(plant)
    _, history = plant_at_rest(looped, position=start.position)
    state = kernel_state(plant, start)
    out = np.full((len(data.commands), _N_OUT), np.nan)
    if law is not None:
        status, done = _run_callable(looped, law, state, history, data.held, out)
    else:
        assert data.law is not None
        assert data.read is not None
        status, done = _run_linear(looped, data.law, state, history, data.held, data.read, out)
    out[done:] = np.nan
    nowhere = np.full(len(out), np.nan)  # a loop's velocity is no reading
    return _ended(_by_channel(plant, data, out[:, 0], out[:, 1:3], out[:, _VOLTAGES], nowhere), status, done)


def _in_loop(plant: KernelPlant) -> SampledPlant:
    """The plant with its instruments, whose position reading is `gain` times the position."""
    instruments = instruments_of(plant.readings, rate=plant.rate)
    polynomial = instruments.polynomial.copy()
    polynomial[0] *= plant.gain
    hum = instruments.hum.copy()
    hum[0] *= plant.gain
    scaled = instruments._replace(polynomial=polynomial, hum=hum, drift=plant.gain * instruments.drift)
    return SampledPlant(*plant.model, scaled, *plant.timing)


@compiled
def _run_linear(
    plant: SampledPlant, law: LoopLaw, state: Array, history: Array, commands: Array, recorded: Array, out: Array
) -> tuple[int, int]:
    """(status, samples done); recorded (n, 3) readings beside commands (n, 2), a row of `out` a sample."""
    n_state, n_out = law.a.shape[0], law.makes.size
    memory, following = np.zeros(n_state), np.zeros(n_state)
    waiting = np.zeros((law.delay + 1, n_out))
    deviation = np.zeros(law.reads.size)
    silence, voltage, command = np.zeros(3), np.zeros(2), np.zeros(2)
    for k in range(commands.shape[0]):
        row = out[k]
        read_instruments(plant, state, history, k, silence, row[_READINGS])
        for m in range(law.delay):
            copy_into(waiting[m], waiting[m + 1])
        if k % law.every == 0:
            for m in range(law.reads.size):
                deviation[m] = row[law.reads[m]] - recorded[k, law.reads[m]]
            set_combined(waiting[law.delay], law.c, memory, law.d, deviation)
            set_combined(following, law.a, memory, law.b, deviation)
            copy_into(memory, following)
        copy_into(command, commands[k])
        for m in range(n_out):
            command[law.makes[m]] += waiting[0, m]
        status = advance_sample(plant, state, command, 0.0, voltage)
        copy_into(row[_VOLTAGES], voltage)
        if status != OK:
            return status, k
    return OK, commands.shape[0]


def _run_callable(
    plant: SampledPlant, law: CallableLaw, state: Array, history: Array, commands: Array, out: Array
) -> tuple[int, int]:
    """(status, samples done) as `_run_linear`, by a law that is no compiled one."""
    waiting = np.zeros((law.delay + 1, 2))
    silence, voltage = np.zeros(3), np.zeros(2)
    for k in range(commands.shape[0]):
        row = out[k]
        read_instruments(plant, state, history, k, silence, row[_READINGS])
        waiting[:-1] = waiting[1:]
        if k % law.every == 0:
            waiting[law.delay] = law.answer(k, float(row[0]))
        status = advance_sample(plant, state, commands[k] + waiting[0], 0.0, voltage)
        row[_VOLTAGES] = voltage
        if status != OK:
            return status, k
    return OK, commands.shape[0]
