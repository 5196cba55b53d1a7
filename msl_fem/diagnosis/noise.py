"""The colour of the noise, estimated with a fit: spectral densities of each channel in bands.

The discrete Fourier transform of a residual holds, at every frequency, numbers that are nearly independent with the
variance of the noise's spectrum (Whittle, Ark. Mat. 2, 1953, 423-434). In a band the density is taken as constant, with
a weak prior at the white noise of the instrument's sigma (an inverse gamma distribution of `PRIOR` degrees of freedom).
Integrating it out leaves, for a band of n real numbers with the sum of squares Q over the white density,

    (n + PRIOR)/2 log((Q + PRIOR)/(n + PRIOR)).

No instrument's noise is ten times its stated sigma at the lowest frequencies, so in the lowest band the density ends
at a ceiling: what is above it, an offset or a drift, counts by its square. Where a fit trades a channel for another, by
taking its error for noise, every octave has a ceiling (`ceilings`). With these alone from the start, fits next to a
resonance end in minima of their own.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.row_loops import add_squares, put_lines
from msl_fem.prediction import RunData
from msl_fem.prediction.free_run import counted

SLOW_CEILING = 100.0
"""The largest density of the noise over the white one in the lowest band; half of it in the next, and so on."""
LEAST_CEILING = 10.0
"""That of the bands above."""
MISSTATED = 3.0
"""How many times as loud as stated an instrument may be where the highest frequencies show it."""
HIGHEST_BAND = 0.8
"""Of half the sampling rate: above it a residual is the instruments' noise."""
WINDOWED_LINES = 1.4
"""Two standard errors of an RMS of n lines are this over sqrt(n) under the window, by which neighbours depend."""
FLAT = 0.1
"""Between thirds of the upper half of a spectrum, up to which it is flat."""
RANGE_OF_THREE = 3.3
"""Standard errors that three estimates of one number differ by at most in 95 of 100 (the studentized range)."""
HEARD = 0.02  # of the noise's density: lines where the model's readings stay below it tell nothing
WINDOWED = 1.3  # a margin above the highest line that is heard
PRIOR = 4.0
OCTAVE = 2.0
FEWEST = 8  # lines of the longest run, all its pieces together, that a band holds at least


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """Which lines of which piece of a run belong to which band; a run of one stretch is one piece.

    Attributes
    ----------
    edges : (n_band + 1,) Hz; the last is the highest frequency that a fit looks at
    lines : number of lines kept of each piece
    band_of : of each piece, (n_line,) the band of a line
    """

    edges: Array
    lines: tuple[int, ...]
    band_of: tuple[NDArray[np.intp], ...]

    @property
    def n_band(self) -> int:
        return self.edges.size - 1


def ceilings(n_band: int, n_channel: int, *, strict: bool) -> Array:
    """(n_channel n_band,) the largest densities over the white one that noise can have, channel after channel: in the
    lowest band, or `strict` in every one."""
    found = np.full(n_band, np.inf)
    if strict:
        found = np.maximum(SLOW_CEILING / OCTAVE ** np.arange(n_band), LEAST_CEILING)
    elif n_band > 1:
        found[0] = SLOW_CEILING
    return np.tile(found, n_channel)


def loudness(over: Sequence[Array], read: Sequence[NDArray[np.bool_]] | None = None) -> float:
    """How many times as loud as stated, 1/`MISSTATED` to `MISSTATED`, residuals over the noise's sigma, (n_sample,) of
    each run, show an instrument to be: louder by its highest frequencies in all runs, where no model error is left that
    it could be, with two standard errors; quieter where the upper half of its spectrum is flat, for a filter's noise is
    less there than where it counts. Samples that are not `read` but bridged hold no noise."""
    read = read if read is not None else [np.ones(values.size, dtype=bool) for values in over]
    spectra = [_windowed_lines(values, own) for values, own in zip(over, read, strict=True)]
    louder = min(_louder(lines) for lines in spectra)
    if louder > 1.0:
        return min(louder, MISSTATED)
    upper = [np.array_split(lines[lines.size // 2 :], 3) for lines in spectra]
    flat = [thirds for thirds in upper if _is_flat(thirds)]
    if not flat:
        return 1.0
    pooled = [np.concatenate(parts) for parts in zip(*flat, strict=True)]
    quieter = max(float(np.sqrt(part.mean())) for part in pooled)
    return max(quieter, 1 / MISSTATED) if quieter < 1 - WINDOWED_LINES / np.sqrt(pooled[0].size) else 1.0


def _windowed_lines(values: Array, read: NDArray[np.bool_]) -> Array:
    """Power density over the stated one's at a residual's frequencies."""
    window = np.hanning(values.size)
    return np.asarray(np.abs(np.fft.rfft(values * window)) ** 2 / np.sum(window[read] ** 2))


def _louder(lines: Array) -> float:
    """How many times as loud the highest frequencies are, with two standard errors; 1 within these."""
    top = float(np.sqrt(lines[int(HIGHEST_BAND * lines.size) :].mean()))
    two_errors = WINDOWED_LINES / np.sqrt((1 - HIGHEST_BAND) * lines.size)
    return float(top * (1 + two_errors)) if top > 1 + two_errors else 1.0


def _is_flat(thirds: Sequence[Array]) -> bool:
    """Whether parts of a spectrum are as loud as each other, as far as so many lines can tell."""
    sizes = [float(np.sqrt(part.mean())) for part in thirds]
    by_chance = RANGE_OF_THREE * WINDOWED_LINES / 2 / np.sqrt(thirds[0].size)
    return max(sizes) - min(sizes) < max(FLAT, by_chance) * max(sizes)


def make_bands(samples: Sequence[int], rate: float, *, highest: float, longest: int | None = None) -> NoiseBands:
    """Octaves below the highest frequency, the lowest one from 0.

    Parameters
    ----------
    samples : of each piece
    longest : samples of the longest run where pieces are parts of runs: what its pieces tell of a line counts together
    """
    seconds = (longest or max(samples)) / rate
    edges = [min(highest, rate / 2)]
    while edges[-1] / OCTAVE > FEWEST / seconds:
        edges.append(edges[-1] / OCTAVE)
    every = [np.asarray(np.fft.rfftfreq(n, 1 / rate), dtype=np.float64) for n in samples]
    spectra = [f[f <= edges[0]] for f in every]
    octaves = np.array([0.0, *edges[-1::-1]])
    held = np.unique(np.concatenate([_band_of(f, octaves) for f in spectra]))  # between lines of pieces there are none
    grid = np.append(octaves[held], edges[0])
    return NoiseBands(grid, tuple(f.size for f in spectra), tuple(_band_of(f, grid) for f in spectra))


def _band_of(frequency: Array, edges: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, edges.size - 2).astype(np.intp)


def transformed(values: Array, n_line: int) -> Array:
    """Real and imaginary parts of the first lines, (..., 2 n_line); of white noise each has its variance."""
    parts = np.empty((*values.shape[:-1], 2 * n_line))
    rows = np.ascontiguousarray(values).reshape(1, -1, 1, values.shape[-1])
    put_lines(parts.reshape(-1, 2 * n_line), np.fft.rfft(rows), values.shape[-1])
    return parts


def in_time(parts: Array, n: int) -> Array:
    """(n,) values whose first lines are these (`transformed`), and whose others are nothing."""
    real, imaginary = np.split(parts, 2)
    lines = (real + 1j * imaginary) * np.sqrt(n / 2.0)
    lines[0] *= np.sqrt(2.0)
    if lines.size == n // 2 + 1 and n % 2 == 0:
        lines[-1] *= np.sqrt(2.0)
    return np.asarray(np.fft.irfft(lines, n))


def highest_line(run: RunData, readings: Mapping[str, Array]) -> float:
    """The highest frequency in Hz at which the model's readings stand out of the noise."""
    found = 0.0
    for name in counted(run):
        signal = readings[name]
        signal = signal[np.isfinite(signal)]
        if signal.size < 64:
            signal = run.measured[name]
        window = np.hanning(signal.size)
        power = np.abs(np.fft.rfft((signal - signal.mean()) * window)) ** 2 / np.sum(window**2)
        width = max(1, power.size // 400)
        smooth = np.convolve(power, np.full(width, 1 / width), mode="same")
        loud = np.flatnonzero(smooth > HEARD * run.noise[name].sigma ** 2)
        if loud.size:
            found = max(found, loud[-1] * run.rate / signal.size)
    return min(max(WINDOWED * found, 20 * run.rate / len(run.commands)), run.rate / 2)


@dataclass(frozen=True, eq=False)
class NoiseWeights:
    """The noise's densities over the white one by band label, how many numbers each has, and the objective's data part.

    Attributes
    ----------
    density : (n_label,)
    root : (n_number,) one over the square root of each number's density
    nats : the data's part of S
    count, limits : (n_label,) the numbers that tell a density, those of its prior among them, and its ceiling
    wander : (n_number,) of each density the share of a zero that wanders (`wander`); None: none does
    """

    density: Array
    root: Array
    nats: float
    count: Array
    limits: Array
    wander: Array | None = None

    @property
    def of_noise(self) -> Array | float:
        """(n_number,) of each density the share of the noise, or 1 of all."""
        return 1.0 if self.wander is None else 1 - self.wander

    def again(self, squares: Array) -> tuple[float, Array]:
        """(the objective's data part up to a constant, the densities over those before) where the numbers of the labels
        have these sums of squares (n_label,) over the densities before; these stay where a zero wanders."""
        if self.wander is not None:
            return float(squares.sum()) / 2, np.ones(squares.size)
        power = squares * self.density + PRIOR
        density = np.minimum(power / self.count, self.limits)
        return _nats(density, power, self.count), density / self.density


def weights_of(residual: Array, labels: NDArray[np.intp], ceilings: Array, spent: Array | float = 0.0) -> NoiseWeights:
    """The most probable densities given a residual (n_number,), none above its ceiling (n_label,); of a band's numbers
    so many (n_label,) are `spent` on starts that were eliminated."""
    count, power = PRIOR - spent + np.zeros(len(ceilings)), np.full(len(ceilings), PRIOR)
    add_squares(count, power, residual, labels)
    density = np.minimum(power / count, ceilings)
    root = np.take(1 / np.sqrt(density), labels)
    return NoiseWeights(density, root, _nats(density, power, count), count, ceilings)


def _nats(density: Array, power: Array, count: Array) -> float:
    """Minus the log likelihood of so many numbers of these sums of squares, their densities integrated out."""
    return float(np.sum(count * (np.log(density) - 1) + power / density) / 2)
