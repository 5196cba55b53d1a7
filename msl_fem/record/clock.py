"""Time columns that are rounded, jittered or of several rates: equal steps where rounding alone hides them, else
resampling, with what it does to the noise."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError

LARGEST_JITTER = 0.01
"""Of a sampling period."""
CONTRADICTION = 0.01
"""Share by which the duration of a log's own time may differ from what a given rate makes of it."""
COARSEST = 0.9
"""Share of a period to which a time may be rounded to be taken in equal steps: beyond, a lost row would look alike."""
LONGEST_GAP = 3.0
"""Median steps that are bridged at most."""
TAPS = 12
"""Half the length of the low-pass before every n-th sample is taken, in kept samples."""


def equal_steps(time: Array) -> tuple[float, float] | None:
    """(start, period) in s of the equal steps that a time column shows after rounding; None where rounding alone cannot
    make it of equal steps.

    The column's own resolution is the smallest difference between two of its steps. Rounding moves an instant by half
    of it at most.
    """
    step = np.diff(time)
    if time.size < 3 or not np.isfinite(step).all() or step.min() <= 0:
        return None
    count = np.arange(time.size)
    period, start = np.polyfit(count, time, 1)
    off = time - (start + period * count)
    steps = np.unique(np.round(step / period, 9))
    if steps.size == 1:
        return float(time[0]), float(period)
    resolution = float(np.diff(steps).min()) * period
    reach = 0.5 * (off.max() - off.min())
    if reach > 0.5 * resolution * 1.02 + 1e-9 * period or resolution > COARSEST * period:
        return None
    return float(start + 0.5 * (off.max() + off.min())), float(period)


def jitter_of(time: Array) -> float:
    """The largest deviation of a step from the median one, over it; inf where the time stands still."""
    step = np.diff(time)
    period = float(np.median(step))
    return float(np.max(np.abs(step / period - 1))) if period > 0 else np.inf


def evened(time: Array) -> tuple[Array, str]:
    """The time (n_sample,) in s in equal steps, and a remark, where it jitters by rounding alone; else as it is."""
    if time.size < 3 or jitter_of(time) <= LARGEST_JITTER * (1 + 1e-9):
        return time, ""
    steps = equal_steps(time)
    if steps is None:
        return time, ""
    start, period = steps
    remark = f"the time is rounded; taken in equal steps of {period:.7g} s"
    even: Array = start + period * np.arange(time.size, dtype=np.float64)
    return even, remark


def timed_by(rate: float, time: Array | None, count: int, *, file: Path | str) -> tuple[Array, str]:
    """The time (count,) in s at a rate in Hz, which goes before the log's own time, and a remark where they differ.

    Raises
    ------
    RecordError : the log's own time lasts 1 % longer or shorter than so many samples do at this rate
    """
    if time is None:
        return np.arange(count) / rate, ""
    own = (float(time[-1]) - float(time[0])) / max(count - 1, 1)
    if not np.isfinite(own) or abs(own * rate - 1) > CONTRADICTION:
        stated = f"{1 / own:.6g} Hz" if own > 0 and np.isfinite(own) else "no rate"
        raise RecordError(
            f"{file}: the time column says {stated} in the mean, --rate {rate:.6g} Hz, more than {CONTRADICTION:.0%} "
            "apart; rows are missing, or the unit is another: correct one, or name no source for time_s"
        )
    differs = abs(own * rate - 1) > 1e-5 or jitter_of(time) > LARGEST_JITTER
    remark = f"the rate given, {rate:.7g} Hz, goes before the time column's" if differs else ""
    return time[0] + np.arange(count) / rate, remark


@dataclass(frozen=True, eq=False)
class Resampled:
    """A signal at equal steps.

    Attributes
    ----------
    values : (n_sample,)
    noise_gain : sigma of white noise afterwards over before
    correlation : of neighbouring samples of that noise
    """

    values: Array
    noise_gain: float
    correlation: float


def common_span(times: list[Array], rate: float, *, file: Path | str) -> Array:
    """Instants (n_sample,) in s at a rate in Hz over what all time columns cover; RecordError where that is nothing."""
    start, end = max(float(t[0]) for t in times), min(float(t[-1]) for t in times)
    count = int(np.floor((end - start) * rate * (1 + 1e-12))) + 1 if end > start else 0
    if count < 2:
        raise RecordError(f"{file}: the signals share no stretch of time to be resampled; look at the sources of time")
    return start + np.arange(count) / rate


def resample(values: Array, time: Array, grid: Array, *, source: str, file: Path | str) -> Resampled:
    """A signal (n_old,) at irregular instants, at the instants of a grid (n_sample,) of equal steps.

    Lagrange's cubic through the four samples around each instant; where the grid is slower than the signal by two or
    more, it is drawn at a multiple of its rate and low-passed below half of it (windowed sinc, no phase) before every
    n-th is taken. Noise afterwards follows from the weights, those of the cubics and then the taps.

    Raises
    ------
    RecordError : time that does not increase, a gap of more than three median steps, fewer than four values
    """
    kept = ~np.isnan(values)
    values, time = values[kept], time[kept]
    _refuse_gaps(time, source, file)
    period = float(grid[1] - grid[0])
    often = max(1, round(period / float(np.median(np.diff(time)))))
    fine = grid[0] + np.arange((grid.size - 1) * often + 1) * (period / often)
    first, weights = _cubic_weights(time, fine)
    drawn = np.einsum("kj,kj->k", weights, values[first[:, None] + np.arange(4)])
    covariance = _covariance(first, weights)
    if often > 1:
        taps = np.sinc(0.9 / often * np.arange(-TAPS * often, TAPS * often + 1)) * np.blackman(2 * TAPS * often + 1)
        taps /= taps.sum()
        padded = np.pad(drawn, TAPS * often, mode="reflect", reflect_type="odd")
        drawn = np.convolve(padded, taps, mode="valid")[::often]
        own = np.correlate(taps, taps, "full")
        symmetric = np.concatenate([covariance[:0:-1], covariance])
        covariance = np.convolve(own, symmetric)[own.size // 2 + covariance.size - 1 :: often]
    return Resampled(drawn, float(np.sqrt(covariance[0])), float(covariance[1] / covariance[0]))


def _cubic_weights(time: Array, fine: Array) -> tuple[NDArray[np.intp], Array]:
    """First of four samples for each instant (n_fine,), and their Lagrange weights (n_fine, 4)."""
    first = np.clip(np.searchsorted(time, fine, side="right") - 2, 0, time.size - 4)
    nodes = time[first[:, None] + np.arange(4)]
    weights = np.ones((fine.size, 4))
    for j in range(4):
        for other in range(4):
            if other != j:
                weights[:, j] *= (fine - nodes[:, other]) / (nodes[:, j] - nodes[:, other])
    return first, weights


def _covariance(first: NDArray[np.intp], weights: Array) -> Array:
    """(5,) mean covariance at the lags 0 to 4 that weights make of white noise of power 1."""
    covariance = np.zeros(5)
    for lag in range(min(5, first.size)):
        count = first.size - lag
        shift = first[lag:] - first[:count]
        for j in range(4):
            partner = j + shift
            inside = partner < 4
            shared = weights[:count][inside, partner[inside]] * weights[lag:, j][inside]
            covariance[lag] += float(shared.sum()) / count
    return covariance


def _refuse_gaps(time: Array, source: str, file: Path | str) -> None:
    step = np.diff(time)
    if time.size < 4 or step.min() <= 0 or not np.isfinite(time).all():
        at = int(np.argmax(~(step > 0))) + 1 if time.size > 3 else 0
        raise RecordError(
            f"{file}: the time of '{source}' does not increase at sample {at}; sort the rows, or give --rate"
        )
    longest = LONGEST_GAP * float(np.median(step))
    if step.max() > longest:
        at = int(np.argmax(step > longest))
        raise RecordError(
            f"{file}: '{source}' has no value from {time[at]:.6g} s to {time[at + 1]:.6g} s, more than {LONGEST_GAP:g} "
            "steps; take the parts before and behind with --from and --to"
        )
