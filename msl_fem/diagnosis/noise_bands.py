"""The colour of the noise: spectral densities of each channel in bands, estimated together with the fit (Whittle).

The discrete Fourier transform of a residual holds, at every frequency, numbers that are nearly independent with the
variance of the noise's spectrum (Whittle, Ark. Mat. 2, 1953, 423-434). In a band the density is taken as constant, with
a weak prior at the white noise of the instrument's sigma (an inverse gamma distribution of `PRIOR` degrees of freedom).
Integrating it out leaves, for a band of n real numbers with the sum of squares Q over the white density,

    (n + PRIOR)/2 log((Q + PRIOR)/(n + PRIOR)).

No instrument's noise is ten times its stated sigma at the lowest frequencies, so in the lowest band the density ends
at a ceiling (`fit.SLOW_CEILING`): what is above it, an offset or a drift, counts by its square.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PRIOR = 4.0
OCTAVE = 2.0
FEWEST = 8  # lines of the longest run that a band holds at least


@dataclass(frozen=True, eq=False)
class Bands:
    """Which lines of which run belong to which band.

    Attributes
    ----------
    edges : (n_band + 1,) Hz; the last is the highest frequency that a fit looks at
    counts : channel to (n_band,) real numbers in each band, all runs together
    lines : number of lines kept of each run
    band_of : of each run, (n_line,) the band of a line
    """

    edges: Array
    lines: tuple[int, ...]
    band_of: tuple[NDArray[np.intp], ...]

    @property
    def n_band(self) -> int:
        return self.edges.size - 1


def make_bands(samples: Sequence[int], rate: float, *, highest: float) -> Bands:
    """Octaves below the highest frequency, the lowest one from 0."""
    longest = max(samples) / rate
    edges = [min(highest, rate / 2)]
    while edges[-1] / OCTAVE > FEWEST / longest:
        edges.append(edges[-1] / OCTAVE)
    grid = np.array([0.0, *edges[-1::-1]])
    lines, band_of = [], []
    for n in samples:
        f = np.fft.rfftfreq(n, 1 / rate)
        kept = int(np.searchsorted(f, grid[-1], side="right"))
        lines.append(kept)
        band_of.append(np.clip(np.searchsorted(grid, f[:kept], side="right") - 1, 0, grid.size - 2))
    return Bands(grid, tuple(lines), tuple(band_of))


def transformed(values: Array, n_line: int) -> Array:
    """Real and imaginary parts of the first lines, (..., 2 n_line); of white noise each has its variance."""
    found = np.fft.rfft(values, axis=-1)[..., :n_line]
    n = values.shape[-1]
    parts = np.concatenate([found.real, found.imag], axis=-1) * np.sqrt(2.0 / n)
    parts[..., 0] /= np.sqrt(2.0)  # the mean has no imaginary part
    if n_line == n // 2 + 1 and n % 2 == 0:
        parts[..., n_line - 1] /= np.sqrt(2.0)
    return parts
