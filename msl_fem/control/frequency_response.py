"""The measured closed-loop frequency response: small sines through the whole loop, correlated over whole periods."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun, PlantUnderTest, run_closed_loop
from msl_fem.control.design import ControllerDesign
from msl_fem.control.injection import least_jerk
from msl_fem.control.inverse import force_limits
from msl_fem.control.linear_loop import bandwidth, flat_band
from msl_fem.errors import InputError

Complex = NDArray[np.complex128]

AMPLITUDE = 2e-5
"""m: the source paper's small sines."""
_N_FREQUENCY, _LOWEST, _HIGHEST_SHARE = 33, 2.0, 0.2  # default: from 2 Hz to a fifth of the loop rate
_SETTLING = 0.15  # s, at least, before correlation begins
_APPROACH = 0.1  # s, to the middle of the sines
_LONGEST = 0.25  # s, about, of correlation; at least four periods
_LEAST_PERIODS = 4
_FORCE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Position over reference at frequencies.

    Attributes
    ----------
    frequency : (n_frequency,) Hz, as realised: whole periods fit whole samples
    response : (n_frequency,) complex, of the fundamental
    predicted : (n_frequency,) of the linear loop on the believed plant
    amplitude, position : m, of the sines, and the position they swing about
    """

    frequency: Array
    response: Complex
    predicted: Complex
    amplitude: float
    position: float

    @property
    def gain(self) -> Array:
        """|response| in dB, (n_frequency,)."""
        return np.asarray(20 * np.log10(np.abs(self.response)))

    @property
    def phase(self) -> Array:
        """Unwrapped phase in degrees, (n_frequency,)."""
        return np.asarray(np.degrees(np.unwrap(np.angle(self.response))))

    @property
    def bandwidth(self) -> float:
        """Hz at which the gain falls below -3 dB; nan where it does not."""
        return bandwidth(self.response, self.frequency)

    @property
    def flat_band(self) -> float:
        """The highest frequency in Hz up to which the gain stays within +-1 dB of 0 dB."""
        return flat_band(self.response, self.frequency)


@dataclass(frozen=True, eq=False)
class _SmallSine:
    time: Array
    position: Array
    velocity: Array
    acceleration: Array


def closed_loop_response(
    design: ControllerDesign,
    *,
    plant: PlantUnderTest,
    frequencies: Sequence[float] | None = None,
    amplitude: float = AMPLITUDE,
    position: float = 0.0,
) -> FrequencyResponse:
    """The response from reference to position, one run a frequency, without sensor noise.

    Parameters
    ----------
    frequencies : Hz, increasing, below half the loop rate; by default 33 from 2 Hz to a fifth of the loop rate, or to
        where the sines' inertia takes half of the force there is. Each is moved to the nearest whose periods fit whole
        samples
    amplitude, position : m, of the sines and of their middle

    Raises
    ------
    InputError : frequencies out of range; a reference outside the believed reach
    ComputationError : a run that the loop did not hold
    """
    period = design.law.plant.period
    highest = min(_HIGHEST_SHARE / period, _bearable(design, amplitude, position))
    usual = np.geomspace(_LOWEST, max(highest, 2 * _LOWEST), _N_FREQUENCY)
    f = usual if frequencies is None else np.asarray(frequencies, dtype=float)
    if f.ndim != 1 or f.size == 0 or not (np.diff(f) > 0).all() or not (f[0] > 0 and f[-1] < 0.5 / period):
        raise InputError(f"frequencies must increase between 0 and {0.5 / period:g} Hz, half the loop rate")
    realised = np.empty(f.size)
    response = np.empty(f.size, dtype=complex)
    for n, frequency in enumerate(f):
        periods = max(_LEAST_PERIODS, math.floor(_LONGEST * frequency))
        count = max(round(periods / (frequency * period)), 2 * periods + 1)
        realised[n] = periods / (count * period)
        settling = math.ceil(max(_SETTLING, 1 / frequency) / period)
        sine = _sine(realised[n], (settling + count, period), amplitude, position)
        run = run_closed_loop(design, sine, plant=plant)
        response[n] = _correlation(run, realised[n], count)
    return FrequencyResponse(realised, response, design.law.reference_response(realised), amplitude, position)


def _bearable(design: ControllerDesign, amplitude: float, position: float) -> float:
    """Hz up to which the inertia of a sine takes at most `_FORCE_SHARE` of the force beside that which holds it there.

    Of a rig with one side the load alone pulls back: what it holds is what is left downwards.
    """
    p = design.parameters
    held = (design.suspension + p.cubic * position**2) * position - p.constant_force
    lowest, highest = force_limits(p.inverse, np.array([position]))[:, 0]
    left = max(0.0, min(highest - held, held - lowest))
    acceleration = _FORCE_SHARE * left / design.law.plant.mass
    return math.sqrt(acceleration / amplitude) / (2 * math.pi)


def _sine(frequency: float, samples: tuple[int, float], amplitude: float, position: float) -> _SmallSine:
    """(n, period) samples of a sine about a position, with its derivatives."""
    n, period = samples
    w = 2 * np.pi * frequency
    t = np.arange(n, dtype=float) * period
    path = least_jerk(t, position, within=_APPROACH)
    swing = amplitude * np.array([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])
    return _SmallSine(t, *(path + swing))


def _correlation(run: ClosedLoopRun, frequency: float, count: int) -> complex:
    """Ratio of the fundamentals of position and reference over the last `count` samples."""
    turn = np.exp(-2j * np.pi * frequency * run.time[-count:])
    return complex(np.sum(run.position[-count:] * turn) / np.sum(run.reference[-count:] * turn))
