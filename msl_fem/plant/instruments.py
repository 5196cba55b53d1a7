"""What the instruments read: systematic effects of sensors and channels, then noise and resolution.

position  (1 + gain_error) y + quadratic y^2 + cubic y^3 + drift(t) + hum(t),  y the sensor's answer at t - delay
current   (1 + gain_j) i_j(t - delay) + offset_j + hum(t)
drift     offset + rate t + acceleration t^2/2 + jerk t^3/6

Told once, in `between` and `reading_of`: for whole runs as arrays, and compiled for loops that read sample by sample.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.plant import layout
from msl_fem.plant.effects import ByName
from msl_fem.plant.effects.mechanisms import position_delay

N_READING = 3
"""Of a sample: position, currents of side 1 and 2."""
# Columns of the history: the channels in the order of the readings, their slopes behind a sample and before it
AFTER, BEFORE, N_HISTORY = N_READING, 2 * N_READING, 3 * N_READING


class Instruments(NamedTuple):
    """What the instruments do. A reading is polynomial(y) + drift(t) + hum(t) + noise, y the channel `delay` ago.

    The channels stand in the order of the readings; in front there may be an axis of lanes.
    """

    rate: float  # samples a second
    delay: Array  # (..., N_READING) in samples
    polynomial: Array  # (..., N_READING, 4): constant, linear, quadratic, cubic
    drift: Array  # (..., N_READING, 3) of t, t^2, t^3
    hum: Array  # (..., N_READING, 2): cosine, sine
    hum_frequency: Any  # (...) rad/s
    resolution: float  # m, of the position; 0: none


def instruments_of(effects: Array, *, rate: float, resolution: float = 0.0) -> Instruments:
    """The instruments of parameters (..., N_PARAMETER) of the catalogue, at `rate` samples a second."""
    vectors = np.asarray(effects)
    v = ByName(vectors)
    shape = vectors.shape[:-1]
    polynomial, drift, hum = (np.zeros((*shape, N_READING, n)) for n in (4, 3, 2))
    delay = np.zeros((*shape, N_READING))
    set_instruments(v, rate, delay, polynomial, drift, hum)
    frequency = hum_frequency(v)
    return Instruments(rate, delay, polynomial, drift, hum, frequency if shape else float(frequency), resolution)


def set_instruments(v: Any, rate: float, delay: Array, polynomial: Array, drift: Array, hum: Array) -> None:
    """Fills the arrays of `Instruments`, which are zero, from parameters by effect and name."""
    polynomial[..., 0, 0] = v["sensor_drift", "offset"]
    polynomial[..., 0, 1] = 1.0 + v["position_sensor_nonlinearity", "gain_error"]
    polynomial[..., 0, 2] = v["position_sensor_nonlinearity", "quadratic"]
    polynomial[..., 0, 3] = v["position_sensor_nonlinearity", "cubic"]
    drift[..., 0, 0] = v["sensor_drift", "rate"]
    drift[..., 0, 1] = v["sensor_drift", "acceleration"] / 2
    drift[..., 0, 2] = v["sensor_drift", "jerk"] / 6
    for j in (1, 2):
        polynomial[..., j, 0] = v["current_sensor_error", f"offset_{j}"]
        polynomial[..., j, 1] = 1.0 + v["current_sensor_error", f"gain_{j}"]
    for n, channel in enumerate(("position", "current", "current")):
        hum[..., n, 0] = v["periodic_disturbance", f"{channel}_cosine"]
        hum[..., n, 1] = v["periodic_disturbance", f"{channel}_sine"]
    delay[..., 0] = rate * position_delay(v)
    delay[..., 1] = rate * v["time_delay", "current"]
    delay[..., 2] = delay[..., 1]


def hum_frequency(v: Any) -> Any:
    """Of the instruments, rad/s."""
    return 2 * np.pi * v["periodic_disturbance", "frequency"]


def between(low: Any, high: Any, after: Any, before: Any, share: Any) -> Any:
    """The cubic with these values at 0 and 1, and the slopes `after` 0 and `before` 1, at a share of the way."""
    hermite = low * (1 + 2 * share) + after * share
    return (1 - share) ** 2 * hermite + share**2 * (high * (3 - 2 * share) - before * (1 - share))


def reading_of(y: Any, time: Any, polynomial: Any, drift: Any, hum: Any) -> Any:
    """A reading before noise of a channel's value y at a time; `hum` is that of the moment."""
    constant, linear, quadratic, cubic = polynomial
    first, second, third = drift
    wander = time * (first + time * (second + time * third))
    return constant + y * (linear + y * (quadratic + y * cubic)) + wander + hum


_FAITHFUL = (0.0, 1.0, 0.0, 0.0)  # of an instrument that reads what is there
_between = compiled(between)
_reading_of = compiled(reading_of)


@dataclass(frozen=True)
class Channels:
    """What the kernel hands to the instruments, (..., n_sample), the currents (..., n_sample, n_side).

    Slopes in time are those of the sensor at the samples, of the currents behind them and before the next ones.
    """

    sensor: Array
    sensor_slope: Array
    current: Array
    slope_after: Array
    slope_before: Array

    @classmethod
    def of(cls, out: Array, n_side: int) -> "Channels":
        """From rows (..., n_sample, N_OUT) of the kernel."""
        return cls(
            out[..., layout.OUT_SENSOR],
            out[..., layout.OUT_SENSOR_SLOPE],
            out[..., layout.OUT_I1 : layout.OUT_I1 + n_side],
            out[..., layout.OUT_SLOPE_AFTER_1 : layout.OUT_SLOPE_AFTER_1 + n_side],
            out[..., layout.OUT_SLOPE_BEFORE_1 : layout.OUT_SLOPE_BEFORE_1 + n_side],
        )


def position_before_noise(channels: Channels, effects: Array, *, rate: float) -> Array:
    """The position as the record has it, before noise, (..., n_sample) m.

    Effects: position_sensor_nonlinearity, time_delay, periodic_disturbance, sensor_drift; of position_sensor_lag what
    is a delay, the pole is the kernel's.

    Parameters
    ----------
    effects : (..., N_PARAMETER) of the catalogue
    rate : samples a second
    """
    slope = channels.sensor_slope
    return _channel_readings(instruments_of(effects, rate=rate), 0, channels.sensor, slope, slope[..., 1:])


def currents_before_noise(channels: Channels, effects: Array, *, rate: float) -> Array:
    """The currents as the record has them, before noise, (..., n_sample, n_side) A.

    Effects: current_sensor_error, time_delay, periodic_disturbance. Arguments as `position_before_noise`.
    """
    instruments = instruments_of(effects, rate=rate)
    readings = np.array(channels.current, dtype=float)
    for j in range(readings.shape[-1]):
        signal, after = channels.current[..., j], channels.slope_after[..., j]
        before = channels.slope_before[..., :-1, j]
        readings[..., j] = _channel_readings(instruments, 1 + j, signal, after, before)
    return readings


def _channel_readings(instruments: Instruments, n: int, signal: Array, after: Array, before: Array) -> Array:
    """What instrument n reads of a signal (..., n_sample) with its slopes behind and before the samples."""
    rate, late = instruments.rate, instruments.delay[..., n, None]
    y = delayed(signal, after / rate, before / rate, samples=late) if np.any(late) else signal
    return reading_at(instruments, n, y, np.arange(signal.shape[-1]) / rate)


def reading_at(instruments: Instruments, n: int, y: Array | float, time: Array) -> Array:
    """What instrument n reads, before noise and without its delay, of values y at times in s, (..., n_sample).

    Of y = 0 that is what its readings hold beside what they measure: offset, drift and hum.
    """
    i = instruments
    hum: Any = 0.0
    if np.any(i.hum[..., n, :]):
        phase = np.asarray(i.hum_frequency)[..., None] * time
        hum = i.hum[..., n, 0, None] * np.cos(phase) + i.hum[..., n, 1, None] * np.sin(phase)
    if _reads_what_is_there(i, n):
        return np.asarray(y + hum)
    polynomial = [i.polynomial[..., n, k, None] for k in range(4)]
    drift = [i.drift[..., n, k, None] for k in range(3)]
    return np.asarray(reading_of(y, time, polynomial, drift, hum))


def is_faithful(effects: Array, n: int, *, rate: float) -> bool:
    """Whether instrument n reads what is there, at once, with parameters (..., N_PARAMETER) of the catalogue."""
    i = instruments_of(effects, rate=rate)
    return _reads_what_is_there(i, n) and not np.any(i.hum[..., n, :]) and not np.any(i.delay[..., n])


def _reads_what_is_there(i: Instruments, n: int) -> bool:
    """Whether instrument n has no more than hum and a delay."""
    return bool(np.all(i.polynomial[..., n, :] == _FAITHFUL)) and not np.any(i.drift[..., n, :])


def delayed(values: Array, after: Array, before: Array, *, samples: Array) -> Array:
    """The signal some samples ago, at the samples; before the first one, its value there.

    Between samples the signal is the cubic with its values and its slopes behind one and before the next sample.

    Parameters
    ----------
    values, after : (..., n_sample), and slopes a sample behind the samples
    before : (..., n_sample - 1), slopes a sample before all samples but the first
    samples : (..., 1)
    """
    n = values.shape[-1]
    position = np.clip(np.arange(n) - samples, 0.0, n - 1.0)
    k = np.minimum(position.astype(np.intp), max(n - 2, 0))
    shape = np.broadcast_shapes(values.shape, k.shape)
    index, values = np.broadcast_to(k, shape), np.broadcast_to(values, shape)
    low, high = (np.take_along_axis(values, m, axis=-1) for m in (index, index + 1))
    first = np.take_along_axis(np.broadcast_to(after, shape), index, axis=-1)
    last = np.take_along_axis(np.broadcast_to(before, (*shape[:-1], n - 1)), index, axis=-1)
    return np.asarray(between(low, high, first, last, position - k))


@compiled
def read_sample(instruments: Instruments, sides: int, history: Array, k: int, noise: Array, readings: Array) -> None:
    """What the instruments read at sample k of the channels in `history`, with `noise`, into readings (N_READING,)."""
    i = instruments
    time = k / i.rate
    cosine, sine = np.cos(i.hum_frequency * time), np.sin(i.hum_frequency * time)
    for n in range(N_READING):
        a, d = i.polynomial[n], i.drift[n]
        y = _delayed_sample(history, k, n, i.delay[n], i.rate)
        hum = i.hum[n, 0] * cosine + i.hum[n, 1] * sine
        readings[n] = _reading_of(y, time, (a[0], a[1], a[2], a[3]), (d[0], d[1], d[2]), hum) + noise[n]
    if i.resolution > 0.0:
        readings[0] = np.round(readings[0] / i.resolution) * i.resolution
    for n in range(1 + sides, N_READING):
        readings[n] = 0.0


@compiled
def _delayed_sample(history: Array, k: int, n: int, delay: float, rate: float) -> float:
    """Channel n as it was `delay` samples before sample k; before the first one, its value there."""
    depth = history.shape[0]
    at = max(k - delay, 0.0)
    low = int(at)
    begin = history[low % depth]
    if at == low:
        return float(begin[n])
    end = history[(low + 1) % depth]
    return float(_between(begin[n], end[n], begin[AFTER + n] / rate, end[BEFORE + n] / rate, at - low))


def position_reading(actuator: Actuator, sensed: Array, *, generator: np.random.Generator | None) -> Array:
    """The readings in m of a position that has passed the sensor's bandwidth: white noise, then rounding to its steps.

    `sensed` may have any shape; without a generator there is no noise.
    """
    sensor = actuator.position_sensor
    reading = np.array(sensed, dtype=float)
    if generator is not None and sensor.noise > 0:
        reading = reading + sensor.noise * generator.standard_normal(reading.shape)
    return np.round(reading / sensor.resolution) * sensor.resolution if sensor.resolution > 0 else reading


def current_reading(actuator: Actuator, current: Array, *, generator: np.random.Generator | None) -> Array:
    """The readings in A of the sides' currents, of any shape: white noise; without a generator none."""
    reading = np.array(current, dtype=float)
    if generator is None or actuator.current_sensor.noise == 0:
        return reading
    return reading + actuator.current_sensor.noise * generator.standard_normal(reading.shape)


def reading_noise(actuator: Actuator, n_sample: int, *, generator: np.random.Generator | None) -> Array:
    """White noise of the readings, (n_sample, N_READING) m and A, drawn in the order of `simulate`; without a generator
    zeros."""
    noise = np.zeros((n_sample, N_READING))
    if generator is None:
        return noise
    sides = actuator.sides.count if actuator.sides else 0
    if actuator.position_sensor.noise > 0:
        noise[:, 0] = actuator.position_sensor.noise * generator.standard_normal(n_sample)
    if actuator.current_sensor.noise > 0 and sides:
        noise[:, 1 : 1 + sides] = actuator.current_sensor.noise * generator.standard_normal((n_sample, sides))
    return noise
