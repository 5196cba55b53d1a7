"""Predictions of the coupled model one and more samples ahead: an extended Kalman predictor in innovation form."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.plant.coefficients import COMPLIANCE, MODE_MASS
from msl_fem.plant.effects import POSITION as PLACE
from msl_fem.plant.effects.lags import position_delay
from msl_fem.plant.readings import Channels, currents_before_noise, position_before_noise
from msl_fem.plant.state import BASE, BASE_RATE, I1, MODE, MODE_RATE, N_STATE, SENSOR, V, X
from msl_fem.prediction.believed import KernelPlant
from msl_fem.prediction.free_run import Start, guessed_start, kernel_state
from msl_fem.prediction.kalman_kernel import ahead, filter_run
from msl_fem.prediction.run_data import POSITION_COLUMN, RunData

Array = NDArray[np.float64]
DIFFERENCE = {X: 1e-8, V: 1e-6, SENSOR: 1e-8, MODE: 1e-8, MODE_RATE: 1e-6, BASE: 1e-3, BASE_RATE: 1.0}
CURRENT_DIFFERENCE = 1e-5
TUNED_ON = 4000  # samples of each run
SPEEDS, CURRENTS = (-6, -5, -4, -3, -2, -1, 0), (-4, -3, -2, -1, 0)
"""Powers of ten of the process noise tried first, in units of position noise times rate, and of current noise."""
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
    states, voltages = np.full((n, N_STATE), np.nan), np.full((n, 2), np.nan)
    done, log_likelihood = filter_run(
        plant.surface, plant.parameters, plant.effects, (plant.step, plant.substeps),
        _setting(plant, data, names, noise), kernel_state(plant, start or guessed_start(plant, data)), data.commands,
        sensed, predicted, states, whitened, voltages,
    )  # fmt: skip
    predicted[0] = np.nan
    one_step = {name: _as_read(plant, data, name, predicted[:, m]) for m, name in enumerate(names)}
    one_step |= {name: voltages[:, int(name[8]) - 1] for name in data.measured if name.startswith("voltage")}
    ended = None if done == n else int(done)
    return KalmanFilterRun(
        one_step,
        states[:done],
        {name: whitened[:, m] for m, name in enumerate(names)},
        float(log_likelihood) if ended is None else -np.inf,
        ended,
        "" if ended is None else LEFT.format(ended),
    )


def k_step(plant: KernelPlant, data: RunData, found: KalmanFilterRun, horizon: int) -> dict[str, Array]:
    """Channel to (n_sample,) predicted `horizon` samples ahead of the states a predictor knew; nan before, and where
    the plant would have left table or range."""
    names = _read_channels(data)
    n = len(data.commands)
    predicted, voltages = np.full((n, len(names)), np.nan), np.full((n, 2), np.nan)
    which, delay = _setting(plant, data, names, ProcessNoise(0.0, 0.0))[:2]
    ahead(
        plant.surface, plant.parameters, plant.effects, (plant.step, plant.substeps), (which, delay), found.states,
        data.commands, horizon, predicted, voltages,
    )  # fmt: skip
    made = {name: _as_read(plant, data, name, predicted[:, m]) for m, name in enumerate(names)}
    return made | {name: voltages[:, int(name[8]) - 1] for name in data.measured if name.startswith("voltage")}


def tuned_process_noise(plant: KernelPlant, runs: Sequence[RunData]) -> ProcessNoise:
    """The process noise of the largest predictive likelihood on the heads of runs, on a grid of powers of ten, then of
    its square root."""
    heads = [run.first(TUNED_ON) for run in runs]
    speed = heads[0].noise[POSITION_COLUMN].sigma * heads[0].rate
    currents = [heads[0].noise[name].sigma for name in _read_channels(heads[0]) if name != POSITION_COLUMN]
    unit = max(currents, default=0.0)
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
            if (found := score(at)) > best:
                best, place = found, at
    return ProcessNoise(speed * 10 ** place[0], unit * 10 ** place[1])


def _read_channels(data: RunData) -> list[str]:
    return [name for name in data.measured if not name.startswith("voltage")]


def _setting(plant: KernelPlant, data: RunData, names: list[str], noise: ProcessNoise) -> tuple[Array, ...]:
    """What `filter_run` takes: readings, their delays, rows of the state, differences, variances."""
    which = np.array([2 if name == POSITION_COLUMN else int(name[8]) - 1 for name in names])
    values = {key: float(plant.readings[n]) for key, n in PLACE.items()}
    delay = np.where(which == 2, position_delay(values), values["time_delay", "current"])
    rows = [I1 + j for j in range(plant.parameters.sides)] + [X, V, SENSOR]
    if plant.effects is not None:
        rows += [MODE, MODE_RATE] if plant.effects[MODE_MASS] else []
        rows += [BASE, BASE_RATE] if plant.effects[COMPLIANCE] else []
    sizes = np.array([DIFFERENCE.get(row, CURRENT_DIFFERENCE) for row in rows])
    gains = {name: plant.gain if name == POSITION_COLUMN else 1.0 for name in names}
    readings = np.array([(data.noise[name].sigma / gains[name]) ** 2 for name in names])
    position = data.noise[POSITION_COLUMN].sigma
    currents = [data.noise[name].sigma for name in names if name != POSITION_COLUMN]
    current = max(currents, default=0.0)
    begin = {X: position, SENSOR: position, V: position * data.rate}
    start = np.array([begin.get(row, current if row < X else 0.0) ** 2 for row in rows])
    process = np.array(
        [(noise.velocity / plant.gain) ** 2 if r == V else noise.current**2 if r < X else 0.0 for r in rows]
    )
    return which, delay, np.array(rows), sizes, start, process, readings


def _as_read(plant: KernelPlant, data: RunData, name: str, sensed: Array) -> Array:
    """What an instrument reads, without the delay, of a sensor's or coil's signal (n_sample,)."""
    prompt = plant.readings.copy()
    for late in (("time_delay", "position"), ("time_delay", "current"), ("position_sensor_lag", "delay_share")):
        prompt[PLACE[late]] = 0.0
    nothing, sides = np.zeros((sensed.size, 2)), np.zeros((sensed.size, 2))
    if name == POSITION_COLUMN:
        channels = Channels(sensed, nothing[:, 0], nothing, nothing, nothing)
        return plant.gain * position_before_noise(channels, prompt, rate=data.rate)
    side = int(name[8]) - 1
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
