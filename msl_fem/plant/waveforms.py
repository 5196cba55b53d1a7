"""Signals of unit size with their first and second derivative in time, each (3, n_sample)."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError

LARGEST_CREST = 3.0
_EDGE = 1e-9
"""Share of a period by which rounding may shift a switching instant without moving it to the next sample."""


def sine(time: Array, *, frequency: float) -> Array:
    """sin(2 pi f t): peak 1, starts at 0 and rises."""
    w = 2 * np.pi * frequency
    return np.array([np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)])


def square(time: Array, *, frequency: float) -> Array:
    """A square wave of peak 1 that starts at +1; its derivatives are 0 wherever they exist, and 0 here."""
    half_periods = np.floor(2 * frequency * time + _EDGE)
    return np.array([1 - 2 * (half_periods % 2), 0 * time, 0 * time])


def triangle(time: Array, *, frequency: float) -> Array:
    """A triangular wave of peak 1 that starts at 0 and rises, slope +-4 f; the second derivative is 0 here."""
    phase = (frequency * time + 0.25 + _EDGE) % 1
    return np.array([1 - 4 * np.abs(phase - _EDGE - 0.5), 4 * frequency * np.where(phase < 0.5, 1.0, -1.0), 0 * time])


def single_step(time: Array, *, delay: float) -> Array:
    """0 before `delay`, 1 from there on; the derivatives are 0 here."""
    return np.array([np.where(time >= delay * (1 - _EDGE), 1.0, 0.0), 0 * time, 0 * time])


def single_ramp(time: Array, *, duration: float) -> Array:
    """From 0 at a constant slope, 1 after `duration`."""
    return np.array([time / duration, np.full_like(time, 1 / duration), 0 * time])


def swept_sine(time: Array, *, frequencies: tuple[float, float], duration: float, logarithmic: bool) -> Array:
    """A sine of peak 1 whose frequency runs from the first to the second of `frequencies` within `duration`.

    Its phase is the integral of the frequency, linear f1 + (f2 - f1) t/T or logarithmic f1 (f2/f1)^(t/T), hence
    without a jump (M. Novak et al., "Synchronized swept-sine", J. Audio Eng. Soc. 63, 2015, eq. 2-5).
    """
    f1, f2 = frequencies
    if logarithmic and f1 != f2:
        growth = np.log(f2 / f1) / duration
        frequency = f1 * np.exp(growth * time)
        phase = 2 * np.pi * (frequency - f1) / growth
        chirp = growth * frequency
    else:
        chirp = np.full_like(time, (f2 - f1) / duration)
        frequency = f1 + chirp * time
        phase = 2 * np.pi * (f1 + 0.5 * chirp * time) * time
    w = 2 * np.pi * frequency
    dw = 2 * np.pi * chirp
    return np.array([np.sin(phase), w * np.cos(phase), dw * np.cos(phase) - w**2 * np.sin(phase)])


def faded(signal: Array, time: Array, *, duration: float, fade: float) -> Array:
    """The signal under a window that rises and falls within `fade` as half a cosine (Tukey's), derivatives included."""
    if fade == 0:
        return signal
    left = np.minimum(time, duration - time)
    w = np.pi / fade
    inside = left < fade
    side = np.where(time < duration / 2, 1.0, -1.0)
    window = np.where(inside, 0.5 - 0.5 * np.cos(w * left), 1.0)
    slope = np.where(inside, 0.5 * w * np.sin(w * left) * side, 0.0)
    curve = np.where(inside, 0.5 * w**2 * np.cos(w * left), 0.0)
    s, ds, dds = signal
    return np.array([window * s, slope * s + window * ds, curve * s + 2 * slope * ds + window * dds])


def flat_noise(lines: NDArray[np.intp], *, count: int, rate: float, generator: np.random.Generator) -> Array:
    """One period of `count` samples with equal power on `lines` (multiples of rate/count): RMS 1, bounded peaks.

    Random phases make the noise; where a peak is above 3 RMS (or sqrt(2 n_line), which no sum of so few sines exceeds),
    the signal is clipped and its phases alone are kept, until no peak is (E. Van der Ouderaa et al., "Peak factor
    minimization using a time-frequency domain swapping algorithm", IEEE Trans. Instrum. Meas. 37, 1988). So spectrum
    and RMS are exact, and the distribution is a normal one without its far tails.

    Raises
    ------
    InputError : the highest line is not below half the rate
    ComputationError : no phases were found that keep the peaks down
    """
    if 2 * lines[-1] >= count:
        raise InputError(f"line {lines[-1]} of {count} samples is not below half the rate; lower the highest frequency")
    scale = count / np.sqrt(2 * lines.size)
    bound = crest_bound(lines.size)
    for _ in range(20):
        phase = generator.uniform(0, 2 * np.pi, lines.size)
        for _ in range(100):
            spectrum = np.zeros(count // 2 + 1, complex)
            spectrum[lines] = scale * np.exp(1j * phase)
            signal = np.fft.irfft(spectrum, count)
            if np.abs(signal).max() <= bound:
                w = 2j * np.pi * rate / count * np.arange(spectrum.size)
                return np.array([signal, np.fft.irfft(w * spectrum, count), np.fft.irfft(w**2 * spectrum, count)])
            phase = np.angle(np.fft.rfft(np.clip(signal, -0.95 * bound, 0.95 * bound))[lines])
    raise ComputationError(f"no phases of {lines.size} lines keep the peaks below {bound:g} RMS; take another seed")


def crest_bound(lines: int) -> float:
    """Largest peak over RMS of `flat_noise` with this number of lines."""
    return min(LARGEST_CREST, float(np.sqrt(2 * lines)) * (1 + 1e-12))
