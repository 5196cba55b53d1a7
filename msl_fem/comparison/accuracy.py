"""How far a model is from a measurement, and where: one number, by band of frequency, over a variable."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError

Array = NDArray[np.float64]
FEWEST = 8  # samples of a bin or lines of a band that still say something


def nrmse(measured: Array, model: Array) -> float:
    """RMS of (measured - model) over the standard deviation of measured, (n_sample,) each; nan where model is nan.

    Raises
    ------
    InputError : different lengths, or a measured channel that never moves
    """
    error, scale = _error(measured, model)
    return float(np.sqrt(np.mean(error**2)) / scale)


@dataclass(frozen=True, eq=False)
class Spread:
    """RMS and mean of a residual over bins of a variable.

    Attributes
    ----------
    edges : (n_bin + 1,) of the variable
    rms, mean : (n_bin,) of the residual; nan where a bin holds too few samples
    count : (n_bin,) samples
    """

    edges: Array
    rms: Array
    mean: Array
    count: NDArray[np.intp]


def over_variable(residual: Array, variable: Array, *, bins: int = 12) -> Spread:
    """The residual over equally filled bins of a variable, (n_sample,) each; fewer bins where values repeat.

    Raises
    ------
    InputError : different lengths
    """
    if residual.shape != variable.shape:
        raise InputError(f"a residual of {residual.size} samples over {variable.size} values; give equally many")
    edges = np.unique(np.quantile(variable, np.linspace(0, 1, bins + 1)))
    if edges.size < 2:
        edges = np.array([edges[0], edges[0] + max(abs(edges[0]), 1.0) * 1e-12])
    which = np.clip(np.searchsorted(edges, variable, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(which, minlength=edges.size - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(which, residual, edges.size - 1) / count
        rms = np.sqrt(np.bincount(which, residual**2, edges.size - 1) / count)
    thin = count < FEWEST
    return Spread(edges, np.where(thin, np.nan, rms), np.where(thin, np.nan, mean), count)


@dataclass(frozen=True, eq=False)
class Bands:
    """A channel and its residual by band of frequency.

    Attributes
    ----------
    edges : (n_band + 1,) Hz
    measured, residual : (n_band,) RMS of what lies in the band; nan where it holds too few lines
    """

    edges: Array
    measured: Array
    residual: Array

    @property
    def nrmse(self) -> Array:
        """(n_band,) the residual over the measured in the band."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.residual / self.measured


def by_band(measured: Array, model: Array, *, rate: float, edges: Array | None = None) -> Bands:
    """The residual by band, by Parseval's theorem on windowed lines; octave bands from 1 Hz by default.

    A Hann window keeps what a run does not repeat from leaking into other bands. The mean is left out.

    Raises
    ------
    InputError : different lengths, a channel that never moves
    """
    error, _ = _error(measured, model)
    bounds = octaves(measured.size / rate, rate / 2) if edges is None else np.asarray(edges, dtype=float)
    window = np.hanning(measured.size)
    frequency = np.fft.rfftfreq(measured.size, 1 / rate)
    weight = 2 / (measured.size * np.sum(window**2))
    found = []
    for signal in (measured - measured.mean(), error - error.mean()):
        power = weight * np.abs(np.fft.rfft(window * signal)) ** 2
        lines = [(frequency >= low) & (frequency < high) for low, high in zip(bounds[:-1], bounds[1:], strict=True)]
        found.append([np.sqrt(power[k].sum()) if k.sum() >= FEWEST else np.nan for k in lines])
    return Bands(bounds, np.array(found[0]), np.array(found[1]))


def octaves(duration: float, highest: float) -> Array:
    """Edges of octaves in Hz, from ten periods in the duration or 1 Hz on, up to `highest`."""
    lowest = max(1.0, 10 / duration)
    count = max(1, int(np.floor(np.log2(highest / lowest))))
    return np.append(lowest * 2.0 ** np.arange(count), highest)


def _error(measured: Array, model: Array) -> tuple[Array, float]:
    if measured.shape != model.shape or measured.ndim != 1:
        raise InputError(f"measured has the shape {measured.shape}, the model {model.shape}; give equal lengths")
    scale = float(measured.std())
    if not scale > 1e-12 * float(np.abs(measured).max(initial=0.0)):
        raise InputError("the measured channel never moves, so no error can be relative to it; leave it out")
    return measured - model, scale
