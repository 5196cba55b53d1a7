"""What the instruments read: systematic effects of sensors and channels, then noise and resolution.

position  (1 + gain_error) y + quadratic y^2 + cubic y^3 + drift(t) + hum(t),  y the sensor's answer at t - delay
current   (1 + gain_j) i_j(t - delay) + offset_j + hum(t)
drift     offset + rate t + acceleration t^2/2 + jerk t^3/6
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.plant import layout
from msl_fem.plant.effects import PARAMETER_INDEX
from msl_fem.plant.effects.mechanisms import position_delay

Array = NDArray[np.float64]


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
    v = _values(effects)
    slope = channels.sensor_slope
    y = delayed(channels.sensor, slope, slope[..., 1:], delay=position_delay(v), rate=rate)
    time = np.arange(y.shape[-1]) / rate
    reading = (1.0 + v["position_sensor_nonlinearity", "gain_error"]) * y
    for power, name in ((2, "quadratic"), (3, "cubic")):
        if np.any(v["position_sensor_nonlinearity", name]):
            reading = reading + v["position_sensor_nonlinearity", name] * y**power
    if any(np.any(v["sensor_drift", name]) for name in ("rate", "acceleration", "jerk")):
        drift = v["sensor_drift", "acceleration"] / 2 + time * v["sensor_drift", "jerk"] / 6
        reading = reading + time * (v["sensor_drift", "rate"] + time * drift)
    return reading + (v["sensor_drift", "offset"] + _hum(v, time, "position"))


def currents_before_noise(channels: Channels, effects: Array, *, rate: float) -> Array:
    """The currents as the record has them, before noise, (..., n_sample, n_side) A.

    Effects: current_sensor_error, time_delay, periodic_disturbance. Arguments as `position_before_noise`.
    """
    v = _values(effects)
    read = np.array(channels.current, dtype=float)
    hum = _hum(v, np.arange(read.shape[-2]) / rate, "current")
    for j in range(read.shape[-1]):
        i = delayed(
            channels.current[..., j], channels.slope_after[..., j], channels.slope_before[..., :-1, j],
            delay=v["time_delay", "current"], rate=rate,
        )  # fmt: skip
        gain, offset = v["current_sensor_error", f"gain_{j + 1}"], v["current_sensor_error", f"offset_{j + 1}"]
        read[..., j] = (1.0 + gain) * i + offset + hum
    return read


def delayed(values: Array, after: Array, before: Array, *, delay: Array, rate: float) -> Array:
    """The signal `delay` seconds ago, at the samples; before the first one, its value there.

    Between samples the signal is the cubic with its values and its slopes behind one and before the next sample.

    Parameters
    ----------
    values, after : (..., n_sample), and slopes behind the samples
    before : (..., n_sample - 1), slopes before all samples but the first
    delay : (..., 1)
    """
    if not np.any(delay):
        return values
    n = values.shape[-1]
    position = np.clip(np.arange(n) - delay * rate, 0.0, n - 1.0)
    k = np.minimum(position.astype(np.intp), max(n - 2, 0))
    s = position - k
    shape = np.broadcast_shapes(values.shape, k.shape)
    index, values = np.broadcast_to(k, shape), np.broadcast_to(values, shape)
    low, high = (np.take_along_axis(values, m, axis=-1) for m in (index, index + 1))
    first = np.take_along_axis(np.broadcast_to(after, shape), index, axis=-1) / rate
    last = np.take_along_axis(np.broadcast_to(before, (*shape[:-1], n - 1)), index, axis=-1) / rate
    hermite = low * (1 + 2 * s) + first * s
    return (1 - s) ** 2 * hermite + s**2 * (high * (3 - 2 * s) - last * (1 - s))


def _hum(v: dict[tuple[str, str], Array], time: Array, channel: str) -> Array:
    cosine, sine = v["periodic_disturbance", f"{channel}_cosine"], v["periodic_disturbance", f"{channel}_sine"]
    if not (np.any(cosine) or np.any(sine)):
        return np.zeros(1)
    phase = 2 * np.pi * v["periodic_disturbance", "frequency"] * time
    return np.asarray(cosine * np.cos(phase) + sine * np.sin(phase))


def _values(effects: Array) -> dict[tuple[str, str], Array]:
    """Each parameter, (..., 1)."""
    return {key: np.asarray(effects)[..., n, None] for key, n in PARAMETER_INDEX.items()}
