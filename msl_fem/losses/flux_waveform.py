"""A periodic flux density: its rates of change by two routes, its closed loops, and whether it is resolved."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.errors import InputError

Array = NDArray[np.float64]
FEWEST, MOST = 32, 1_000_000  # samples a period
FINER = 8  # times as many samples for the mean of |dB/dt|^1.5, whose integrand has kinks
RESOLVED = 0.05  # largest difference of the two routes to <(dB/dt)^2>; white noise has 0.4, a jump more
STILL = 1e-9  # T: a swing that is rounding, not flux
JUMP = 4.0  # the step that closes the period, at most so many times the largest one within


@dataclass(frozen=True, eq=False)
class FluxWaveform:
    """One period of a flux density, sampled in equal steps from its beginning; the end is not repeated.

    Attributes
    ----------
    flux_density : (n_sample,) T
    frequency : of the period in Hz

    Raises
    ------
    InputError : too few samples, values that are not finite, a period that does not close, a wave that is not resolved
    """

    flux_density: Array
    frequency: float

    def __post_init__(self) -> None:
        b = np.array(self.flux_density, dtype=float)
        b.setflags(write=False)
        object.__setattr__(self, "flux_density", b)
        _check(b, self.frequency)
        if self.resolution_error > RESOLVED:
            raise InputError(
                f"the waveform is not resolved by {b.size} samples a period: two routes to the mean of (dB/dt)^2 "
                f"differ by {self.resolution_error:.0%}, allowed is {RESOLVED:.0%}; "
                "sample faster, or filter the noise out"
            )

    @cached_property
    def harmonics(self) -> Array:
        """(n_sample//2 + 1,) T: peak values of the Fourier series; the first is the mean."""
        b = self.flux_density
        peak = np.abs(np.fft.rfft(b)) * 2 / b.size
        peak[0] /= 2
        if b.size % 2 == 0:
            peak[-1] /= 2
        return np.asarray(peak)

    @cached_property
    def mean_square_rate(self) -> float:
        """<(dB/dt)^2> in T2/s2 by the Fourier series, 2 pi^2 sum (k f B_k)^2."""
        k = np.arange(self.harmonics.size)
        return float(2 * np.pi**2 * self.frequency**2 * np.sum((k * self.harmonics) ** 2))

    @cached_property
    def mean_square_rate_by_time(self) -> float:
        """<(dB/dt)^2> in T2/s2 by the second route: the time integral over straight lines between the samples."""
        step = np.diff(self.flux_density, append=self.flux_density[0])
        return float(self.flux_density.size * self.frequency**2 * np.sum(step**2))

    @property
    def resolution_error(self) -> float:
        """How far the two routes to <(dB/dt)^2> are apart, relative to the Fourier series'; 0 for what stands still."""
        if np.ptp(self.flux_density) < STILL:
            return 0.0
        return abs(self.mean_square_rate_by_time / self.mean_square_rate - 1)

    @cached_property
    def mean_rate_to_3_2(self) -> float:
        """<|dB/dt|^1.5> in (T/s)^1.5, from the Fourier series' derivative on a finer grid."""
        b = self.flux_density
        spectrum = np.fft.rfft(b)
        spectrum = spectrum * (2j * np.pi * self.frequency * np.arange(spectrum.size))
        if b.size % 2 == 0:
            spectrum[-1] = 0.0  # the highest of an even number has no phase
        rate = np.fft.irfft(spectrum, FINER * b.size) * FINER
        return float(np.mean(np.abs(rate) ** 1.5))

    @cached_property
    def loop_swings(self) -> Array:
        """(n_loop,) T: the full swing of each closed hysteresis loop of a period, see `closed_loops`."""
        return closed_loops(self.flux_density)


def _check(b: Array, frequency: float) -> None:
    if not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"a frequency of {frequency:g} Hz is not allowed; it must be above 0")
    if b.ndim != 1 or not FEWEST <= b.size <= MOST:
        raise InputError(f"a period of shape {b.shape} is not allowed; give {FEWEST} ... {MOST} samples in one row")
    if not np.isfinite(b).all():
        raise InputError(f"sample {int(np.argmin(np.isfinite(b)))} of the waveform is not a number")
    steps = np.abs(np.diff(b))
    closing = abs(b[0] - b[-1])
    if closing > max(JUMP * steps.max(), STILL):
        raise InputError(
            f"the waveform is not periodic: from its last sample back to its first it jumps by {closing:.3g} T, within "
            f"it steps by {steps.max():.3g} T at most; give whole periods, without repeating the first sample"
        )


def closed_loops(flux_density: ArrayLike) -> Array:
    """(n_loop,) the swings (max - min) of the closed loops that one period makes, largest last.

    Rainflow counting by three points, from the period's largest value on (ASTM E1049, 5.4.5): there every loop closes,
    minor ones with their own swing and the major one from the period's largest to its smallest value.
    """
    b = np.asarray(flux_density, dtype=float)
    b = np.roll(b, -int(np.argmax(b)))
    b = np.append(b, b[0])
    rising = np.diff(b[np.concatenate(([True], np.diff(b) != 0))])  # without repeats, so that each step has a sign
    if rising.size == 0:
        return np.zeros(0)
    values = np.concatenate(([b[0]], b[0] + np.cumsum(rising)))
    turns = np.concatenate(([True], np.diff(np.sign(rising)) != 0, [True]))
    stack: list[float] = []
    swings: list[float] = []
    for value in values[turns].tolist():
        stack.append(value)
        while len(stack) >= 4 and abs(stack[-1] - stack[-2]) >= abs(stack[-2] - stack[-3]) <= abs(
            stack[-3] - stack[-4]
        ):
            swings.append(abs(stack[-2] - stack[-3]))
            del stack[-3:-1]
    return np.array([*sorted(swings), float(b.max() - b.min())])
