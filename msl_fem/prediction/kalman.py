"""Predictions of the coupled model one and more samples ahead: an extended Kalman predictor in innovation form.

State x of the kernel (some of its rows), readings y. From the state that is known at a sample the kernel's `advance`
gives both at the next one, and differences through it give G = d(x, y)/dx. With the joint covariance G P G' + noise, a
reading is one entry of (x, y) that becomes known: conditioning on the readings one by one is the measurement update
(Anderson and Moore, Optimal Filtering, 1979, sec. 6.4 and 8.2).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import copy_into, set_congruent
from msl_fem.plant.effects import PARAMETER_INDEX, ByName
from msl_fem.plant.effects.mechanical import COMPLIANCE, MODE_MASS
from msl_fem.plant.effects.mechanisms import position_delay
from msl_fem.plant.instruments import Channels, currents_before_noise, position_before_noise
from msl_fem.plant.kernel import advance
from msl_fem.plant.layout import (
    ADDED_READING,
    BASE,
    BASE_RATE,
    COIL_1,
    COIL_SLOPE_1,
    I1,
    MODE,
    MODE_RATE,
    N_STATE,
    OK,
    SENSOR,
    V,
    X,
)
from msl_fem.prediction.free_run import Start, guessed_start, kernel_state
from msl_fem.prediction.hypothesis import KernelPlant
from msl_fem.prediction.run_data import POSITION_COLUMN, RunData
from msl_fem.record.columns import CHANNELS

DIFFERENCE = {X: 1e-8, V: 1e-6, SENSOR: 1e-8, MODE: 1e-8, MODE_RATE: 1e-6, BASE: 1e-3, BASE_RATE: 1.0}
CURRENT_DIFFERENCE = 1e-5
TUNED_ON = 4000  # samples of each run
SPEEDS, CURRENTS = (-6, -5, -4, -3, -2, -1, 0), (-4, -3, -2, -1, 0)
"""Powers of ten of the process noise tried first, in units of position noise times rate, and of current noise."""
_POSITION_SENSOR = 2  # of `state_readings`; 0 and 1 are the currents
LEFT = "the state that the predictor follows left table or range at sample {}"


@dataclass(frozen=True)
class ProcessNoise:
    """Random steps of the state from a sample to the next, one sigma: velocity as it would be read (m/s), currents (A).

    As it would be read, since a fit of the sensor's gain must not weigh readings anew.
    """

    velocity: float
    current: float


@dataclass(frozen=True, eq=False)
class KalmanFilterRun:
    """A run as the predictor followed it.

    Attributes
    ----------
    one_step : channel to (n_sample,) predicted from the readings before; the first sample is nan
    states : (n_sample, N_STATE) with the readings up to the sample; rows behind `ended` are not there
    whitened : channel to (n_sample,) innovations over their predicted sigma
    log_likelihood : of the innovations, up to a constant
    ended : the sample where it stopped, None for a whole run
    """

    one_step: Mapping[str, Array]
    states: Array
    whitened: Mapping[str, Array]
    log_likelihood: float
    ended: int | None
    reason: str


def kalman_filter(
    plant: KernelPlant, data: RunData, noise: ProcessNoise, *, start: Start | None = None
) -> KalmanFilterRun:
    """The predictor along a run, from a start or from the first readings."""
    names = _read_channels(data)
    n = len(data.commands)
    sensed = np.column_stack([_sensed(plant, data, name) for name in names])
    predicted, whitened = np.full((2, n, len(names)), np.nan)
    states = np.full((n, N_STATE), np.nan)
    voltages = np.full((n, 2), np.nan)
    setting = _setting(plant, data, names, noise)
    state = kernel_state(plant, start or guessed_start(plant, data))
    rows = predicted, states, whitened, voltages
    done, log_likelihood = filter_run(*plant.model, plant.timing, setting, state, data.held, sensed, *rows)
    predicted[0] = np.nan
    ended = None if done == n else int(done)
    return KalmanFilterRun(
        _by_channel(plant, data, predicted, voltages),
        states[:done],
        {name: whitened[:, m] for m, name in enumerate(names)},
        float(log_likelihood) if ended is None else -np.inf,
        ended,
        "" if ended is None else LEFT.format(ended),
    )


def k_step(plant: KernelPlant, data: RunData, filtered: KalmanFilterRun, horizon: int) -> dict[str, Array]:
    """Channel to (n_sample,) predicted `horizon` samples ahead of the states a predictor knew; nan before, and where
    the plant would have left table or range."""
    names = _read_channels(data)
    n = len(data.commands)
    predicted = np.full((n, len(names)), np.nan)
    voltages = np.full((n, 2), np.nan)
    which, delay = _setting(plant, data, names, ProcessNoise(0.0, 0.0))[:2]
    timing, readings = plant.timing, (which, delay)
    ahead(*plant.model, timing, readings, filtered.states, data.held, horizon, predicted, voltages)
    return _by_channel(plant, data, predicted, voltages)


def _by_channel(plant: KernelPlant, data: RunData, predicted: Array, voltages: Array) -> dict[str, Array]:
    """What is read, of the predicted signals (n_sample, n_read) and mean voltages (n_sample, 2)."""
    readings = {name: _as_read(plant, data, name, predicted[:, m]) for m, name in enumerate(_read_channels(data))}
    for name, channel in data.channels.items():
        if channel.quantity == "voltage":
            readings[name] = voltages[:, channel.index]
    return readings


def tuned_process_noise(plant: KernelPlant, runs: Sequence[RunData]) -> ProcessNoise:
    """The process noise of the largest predictive likelihood on the heads of runs, on a grid of powers of ten, then of
    its square root."""
    heads = [run.first(TUNED_ON) for run in runs]
    speed = heads[0].noise[POSITION_COLUMN].sigma * heads[0].rate
    unit = _current_noise(heads[0])
    best, place = -np.inf, [-3.0, -2.0]

    def score(powers: Sequence[float]) -> float:
        noise = ProcessNoise(speed * 10 ** powers[0], unit * 10 ** powers[1])
        return sum(kalman_filter(plant, head, noise).log_likelihood for head in heads)

    for axis, tried in ((0, SPEEDS), (1, CURRENTS), (0, None), (1, None)):
        if axis == 1 and not unit:
            continue
        values = tried if tried is not None else (place[axis] - 0.5, place[axis] + 0.5)
        for value in values:
            at = list(place)
            at[axis] = float(value)
            if (likelihood := score(at)) > best:
                best, place = likelihood, at
    return ProcessNoise(speed * 10 ** place[0], unit * 10 ** place[1])


def _read_channels(data: RunData) -> list[str]:
    return [name for name, channel in data.channels.items() if channel.quantity != "voltage"]


def _setting(plant: KernelPlant, data: RunData, names: list[str], noise: ProcessNoise) -> tuple[Array, ...]:
    """What `filter_run` takes: readings, their delays, rows of the state, differences, variances."""
    p, position, current = plant.parameters, data.noise[POSITION_COLUMN].sigma, _current_noise(data)
    which = np.array([_POSITION_SENSOR if name == POSITION_COLUMN else CHANNELS[name].index for name in names])
    values = ByName(plant.readings)
    delay = np.where(which == _POSITION_SENSOR, position_delay(values), values["time_delay", "current"])
    rows = [I1 + j for j in range(p.sides)] + [X, V, SENSOR]
    if plant.effects is not None and plant.effects[MODE_MASS]:
        rows += [MODE, MODE_RATE]
    if plant.effects is not None and plant.effects[COMPLIANCE]:
        rows += [BASE, BASE_RATE]
    sizes = np.array([DIFFERENCE.get(row, CURRENT_DIFFERENCE) for row in rows])
    start, process = np.zeros(len(rows)), np.zeros(len(rows))
    known = {X: position, SENSOR: position, V: position * data.rate}
    for n, row in enumerate(rows):
        is_current = row < X
        start[n] = known.get(row, current if is_current else 0.0) ** 2
        if row == V:
            process[n] = (noise.velocity / plant.gain) ** 2
        elif is_current:
            process[n] = noise.current**2
    gains = np.where(which == _POSITION_SENSOR, plant.gain, 1.0)
    readings = (np.array([data.noise[name].sigma for name in names]) / gains) ** 2
    return which, delay, np.array(rows), sizes, start, process, readings


def _current_noise(data: RunData) -> float:
    """The largest noise of the currents that are read; 0 where none is."""
    currents = [data.noise[name].sigma for name in _read_channels(data) if name != POSITION_COLUMN]
    return max(currents, default=0.0)


def _as_read(plant: KernelPlant, data: RunData, name: str, sensed: Array) -> Array:
    """What an instrument reads, without the delay, of a sensor's or coil's signal (n_sample,)."""
    prompt = plant.readings.copy()
    for late in (("time_delay", "position"), ("time_delay", "current"), ("position_sensor_lag", "delay_share")):
        prompt[PARAMETER_INDEX[late]] = 0.0
    nothing, sides = np.zeros((sensed.size, 2)), np.zeros((sensed.size, 2))
    if name == POSITION_COLUMN:
        channels = Channels(sensed, nothing[:, 0], nothing, nothing, nothing)
        return plant.gain * position_before_noise(channels, prompt, rate=data.rate)
    side = CHANNELS[name].index
    sides[:, side] = sensed
    channels = Channels(nothing[:, 0], nothing[:, 0], sides, nothing, nothing)
    return currents_before_noise(channels, prompt, rate=data.rate)[:, side]


def _sensed(plant: KernelPlant, data: RunData, name: str) -> Array:
    """The sensor's or coil's signal that would be read as measured: the reading undone by fixed slope iteration."""
    measured = data.measured[name]
    slope = plant.gain if name == POSITION_COLUMN else 1.0
    signal = measured / slope
    for _ in range(20):
        miss = measured - _as_read(plant, data, name, signal)
        signal = signal + miss / slope
        if np.abs(miss).max() <= 1e-6 * data.noise[name].sigma:
            break
    return signal


@compiled
def state_readings(state, which, delay, y):  # type: ignore[no-untyped-def]
    """The readings y of a state: `which` 0, 1 currents, 2 the position sensor, each `delay` s ago to first order."""
    for m in range(which.size):
        if which[m] == _POSITION_SENSOR:
            y[m] = state[SENSOR] + state[ADDED_READING] - delay[m] * state[V]
        else:
            y[m] = state[COIL_1 + which[m]] - delay[m] * state[COIL_SLOPE_1 + which[m]]


@compiled
def filter_run(surface, p, e, timing, setting, state, commands, measured, predicted, states, whitened, voltages):  # type: ignore[no-untyped-def]
    """(samples done, log likelihood) of the predictor along a run.

    Parameters
    ----------
    timing : (step, steps a sample)
    setting : (which, delay, rows, sizes, start, process, noise): the readings and their delays; rows of the state that
        are estimated, sizes of their differences; variances of the start, a sample's process noise, the readings
    state : at the first sample, carried along
    measured, predicted, whitened : (n, n_y): readings; one-step predictions; innovations over their predicted sigma
    states : (n, N_STATE) as known with the sample's readings
    voltages : (n, 2) mean over the sample, predicted from these
    """
    step, n_step = timing
    which, delay, rows, sizes, start, process, noise = setting
    n_x, n_y = rows.size, which.size
    n = n_x + n_y
    covariance = np.diag(start)
    joint, slope, product = np.zeros((n, n)), np.zeros((n, n_x)), np.zeros((n, n_x))
    base, moved = np.zeros(n), np.zeros(n)
    mean, spare = np.zeros(2), np.zeros(2)
    trial = state.copy()
    copy_into(states[0], state)
    state_readings(state, which, delay, predicted[0])
    log_likelihood = 0.0
    for k in range(commands.shape[0]):
        if k > 0:
            copy_into(predicted[k], base[n_x:])
            for m in range(n_y):
                c = n_x + m
                error, variance = measured[k, m] - base[c], joint[c, c]
                whitened[k, m] = error / np.sqrt(variance)
                log_likelihood -= 0.5 * (whitened[k, m] ** 2 + np.log(variance))
                for i in range(n):
                    moved[i] = joint[i, c] / variance
                for i in range(n):
                    base[i] += moved[i] * error
                for i in range(n):
                    for j in range(n):
                        joint[i, j] -= moved[i] * moved[j] * variance
            for i in range(n_x):
                state[rows[i]] = base[i]
                for j in range(n_x):
                    covariance[i, j] = 0.5 * (joint[i, j] + joint[j, i])
            copy_into(states[k], state)
        copy_into(trial, state)
        if advance(surface, p, e, trial, commands[k], 0.0, step, n_step, mean) != OK:
            return k, log_likelihood
        _gather(trial, rows, which, delay, base)
        copy_into(voltages[k], mean)
        ended = trial.copy()
        for i in range(n_x):
            copy_into(trial, state)
            trial[rows[i]] += sizes[i]
            if advance(surface, p, e, trial, commands[k], 0.0, step, n_step, spare) == OK:
                _gather(trial, rows, which, delay, moved)
                for j in range(n):
                    slope[j, i] = (moved[j] - base[j]) / sizes[i]
        copy_into(state, ended)
        set_congruent(joint, slope, covariance, product)
        for i in range(n_x):
            joint[i, i] += process[i]
        for m in range(n_y):
            joint[n_x + m, n_x + m] += noise[m]
    return commands.shape[0], log_likelihood


@compiled
def _gather(state, rows, which, delay, out):  # type: ignore[no-untyped-def]
    for i in range(rows.size):
        out[i] = state[rows[i]]
    state_readings(state, which, delay, out[rows.size :])


@compiled
def ahead(surface, p, e, timing, readings, states, commands, horizon, predicted, voltages):  # type: ignore[no-untyped-def]
    """Predictions `horizon` samples ahead of each of `states` (n, N_STATE) into row k + horizon; nan where it fails.

    `voltages` receives the mean voltages of the sample before, the last that these states answer for. Returns the
    number of predictions that left the table or the range.
    """
    step, n_step = timing
    which, delay = readings
    mean, state, failed = np.zeros(2), states[0].copy(), 0
    for k in range(states.shape[0] - horizon):
        copy_into(state, states[k])
        status, done = OK, 0
        while done < horizon and status == OK:
            status = advance(surface, p, e, state, commands[k + done], 0.0, step, n_step, mean)
            done += 1
        if status == OK:
            state_readings(state, which, delay, predicted[k + horizon])
            copy_into(voltages[k + horizon - 1], mean)
        else:
            failed += 1
    return failed
