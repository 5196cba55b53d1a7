"""The force that a measured motion takes, with effects: the inverse dynamics of a mover that a force drives.

Position and force pass one zero-phase low-pass; velocity and acceleration are central differences of the low-passed
position (A. Janot, P.-O. Vandanjon, M. Gautier, IEEE Trans. Control Syst. Technol. 22, 2014, 776-782). The second
difference of a mass under held forces is exactly the mean of those before and behind the sample; of an imposed motion
differences of five points are taken. An effect of the
sensor is undone on the way from reading to motion, one of the drive done to the commands, one of the mover adds to the
force; friction is the catalogue's stops at the measured position. Delays, lags and a second mass are filters.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.plant import PlantParameters
from msl_fem.plant.effects import MoverMotion, needed_force, values_of
from msl_fem.plant.effects.mechanisms import drive_lag, position_delay, sensor_lag
from msl_fem.plant.instruments import instruments_of, reading_at
from msl_fem.prediction import RunData
from msl_fem.prediction.run_data import POSITION_COLUMN

Spectrum = NDArray[np.complexfloating]
ORDER = 4
OF_POSITION = 2.5
"""The position's low-pass over the equation's: so it does not bend what the equation keeps."""
EDGE = 10.0  # periods of the equation's low-pass at either end that zero-phase filters bend
POWER = 0.98  # of the commands, which the equation's band holds
_SERIES = (1.0, 2.0, 5.0)


@dataclass(frozen=True)
class ZeroPhaseLowPass:
    """Zero-phase Butterworth filters of an inverse model: of the equation, in Hz, and of the position before it."""

    equation: float
    rate: float

    def smooth(self, signal: Array) -> Array:
        """A position before it is differentiated, and the commands beside it."""
        return self._passed(signal, min(OF_POSITION * self.equation, 0.45 * self.rate))

    def both_sides(self, force: Array) -> Array:
        """Either side of the equation."""
        return self._passed(force, self.equation)

    def kept(self, n_sample: int) -> slice:
        """The samples that the filters' edges leave.

        Raises
        ------
        InputError : they leave too little
        """
        edge = round(EDGE * self.rate / self.equation)
        if n_sample < 3 * edge:
            raise InputError(f"{n_sample} samples: the edges of the filters take {2 * edge}; record longer")
        return slice(edge, n_sample - edge)

    def _passed(self, signal: Array, cutoff: float) -> Array:
        sections = butter(ORDER, cutoff, fs=self.rate, output="sos")
        return np.asarray(sosfiltfilt(sections, signal), dtype=float)


def usual_low_pass(runs: Sequence[RunData]) -> ZeroPhaseLowPass:
    """The lowest of 1, 2, 5, 10 ... Hz below which the commands have `POWER` of their power."""
    highest, rate = 0.0, runs[0].rate
    for run in runs:
        force = run.held[:, 0]
        power = np.cumsum(np.abs(np.fft.rfft((force - force.mean()) * np.hanning(force.size))) ** 2)
        if power[-1] > 0:
            highest = max(highest, float(np.searchsorted(power, POWER * power[-1])) * rate / force.size)
    decade = 10.0 ** np.floor(np.log10(max(highest, 1e-3)))
    series = [s * decade for s in (*_SERIES, 10.0)]
    return ZeroPhaseLowPass(min(next(s for s in series if s >= highest), 0.2 * rate), rate)


def missing_force(
    plant: PlantParameters,
    data: RunData,
    effects: Array,
    *,
    gain: float,
    low_pass: ZeroPhaseLowPass,
    ratios: Mapping[str, Array] | None = None,
) -> Array:
    """The force applied less the force that the measured motion takes, (n_sample,) N, not yet low-passed.

    Parameters
    ----------
    plant : with the parameters to be tried
    data : position and commands already low-passed alike
    effects : (N_PARAMETER,) of the catalogue
    gain : position reading over position, beside the effects
    ratios : parameter to (n_sample,) by which a second input makes it larger, "damping" or "effect.parameter"
    """
    v = values_of(effects)
    motion = measured_motion(plant, data, effects, gain=gain, low_pass=low_pass)
    mass, damping, stiffness = (
        value * (ratios or {}).get(name, 1.0)
        for name, value in (
            ("moving_mass", plant.mass), ("damping", plant.damping), ("stiffness", plant.stiffness),
        )
    )  # fmt: skip
    plain = mass * motion.acceleration + damping * motion.velocity + stiffness * motion.position
    needed = needed_force(plant, scheduled_values(v, ratios or {}), motion)
    return applied_force(data, v) + plant.constant_force - (plain + needed)


def scheduled_values(v: Mapping[tuple[str, str], float], ratios: Mapping[str, Array]) -> dict[tuple[str, str], Any]:
    """Parameters of effects, those that a second input changes along the run, (n_sample,)."""
    found: dict[tuple[str, str], Any] = dict(v)
    for name, ratio in ratios.items():
        effect, _, parameter = name.rpartition(".")
        if effect and v[effect, parameter]:
            found[effect, parameter] = v[effect, parameter] * ratio
    return found


def applied_force(data: RunData, v: dict[tuple[str, str], float]) -> Array:
    """The force of the commands at the instants of the samples, (n_sample,) N.

    A command is held from its sample to the next, so at a sample it is the mean of both sides; what a machine reads of
    the force of a motion that it imposes is as it was at the sample.
    """
    command = data.held[:, 0]
    force = command.copy()
    if data.mover != "imposed":
        force[1:] = (command[1:] + command[:-1]) / 2
    lag, zero, delay = drive_lag(v)
    late = delay + v["time_delay", "command"]
    if late or lag:
        force = _filtered(force, data.rate, lambda s: np.exp(-s * late) * (1 + s * zero) / (1 + s * lag))
    return force


def measured_motion(
    plant: PlantParameters, data: RunData, effects: Array, *, gain: float, low_pass: ZeroPhaseLowPass
) -> MoverMotion:
    """The motion that a low-passed reading says, the sensor's effects undone."""
    v, instruments = values_of(effects), instruments_of(effects, rate=data.rate)
    reading = data.measured[POSITION_COLUMN] / gain - reading_at(instruments, 0, 0.0, data.time)
    seen = _undone(reading, instruments.polynomial[0])
    late, rate, pole = position_delay(v), data.rate, sensor_lag(v)[0]
    lag = pole + (0.0 if np.isinf(plant.sensor_bandwidth) else 1 / plant.sensor_bandwidth)
    share, read = v["structural_mode", "mass_share"], v["structural_mode", "load_reading"]
    natural = 2 * np.pi * v["structural_mode", "frequency"]
    zeta = v["structural_mode", "damping_ratio"]

    def mode(s: Spectrum) -> Spectrum:
        return -(s**2) / (s**2 + 2 * zeta * natural * s + natural**2)

    if late or lag or read:
        highest = 2 * np.pi * OF_POSITION * low_pass.equation  # beyond, the position is passed no more
        seen = _filtered(
            seen, rate, lambda s: np.exp(s * late) * (1 + s * lag) / (1 + read * mode(s)) * (np.abs(s) < 4 * highest)
        )
    velocity, acceleration = _differences(seen, rate, held=data.mover != "imposed")
    other = _filtered(acceleration, rate, mode) if share else np.zeros(seen.size)
    return MoverMotion(data.time, seen, velocity, acceleration, other)


def _differences(x: Array, rate: float, *, held: bool) -> tuple[Array, Array]:
    """Velocity and acceleration (n_sample,): three-point differences, which suit forces that are `held`; else those of
    five points, good to the fourth order (B. Fornberg, Math. Comp. 51, 1988, 699-706)."""
    velocity, acceleration = np.gradient(x, 1 / rate), np.zeros(x.size)
    acceleration[1:-1] = (x[2:] - 2 * x[1:-1] + x[:-2]) * rate**2
    if not held:
        velocity[2:-2] = (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) * rate / 12
        acceleration[2:-2] = (16 * (x[3:-1] + x[1:-3]) - (x[4:] + x[:-4]) - 30 * x[2:-2]) * rate**2 / 12
    return velocity, acceleration


def _undone(reading: Array, polynomial: Array) -> Array:
    """The position x of a reading slope x + square x^2 + cube x^3, by Newton steps."""
    _, slope, square, cube = polynomial
    x = reading / slope
    if square or cube:
        for _ in range(6):
            steep = slope + 2 * square * x + 3 * cube * x**2
            x = x - (slope * x + square * x**2 + cube * x**3 - reading) / np.where(np.abs(steep) > 0.1, steep, 0.1)
    return x


def _filtered(signal: Array, rate: float, answer: Callable[[Spectrum], Spectrum]) -> Array:
    """A signal through a filter's frequency response (of s); the line between its ends passes by its value at 0, its
    slope by the response's first derivative there."""
    n = signal.size
    time = np.arange(n) / rate
    slope = (signal[-1] - signal[0]) / time[-1]
    line = signal[0] + slope * time
    s = 2j * np.pi * np.fft.rfftfreq(n, 1 / rate)
    small = np.array([0.0, 1e-4j, -1e-4j])
    at = answer(small)
    steep = float(((at[1] - at[2]) / 2e-4j).real)
    still = float(at[0].real)
    return np.asarray(np.fft.irfft(np.fft.rfft(signal - line) * answer(s), n) + still * line + steep * slope)
