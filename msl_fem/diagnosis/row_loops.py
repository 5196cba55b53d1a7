"""What is done to each number of many rows of residuals, compiled: each row is read and written once."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.compiled import compiled
from msl_fem.computing.copied_rows import add_times
from msl_fem.computing.threads import in_threads


@compiled
def put_missed(row: Array, measured: Array, read: Array, gain: float, zero: float, unit: float) -> None:
    """Sets a row (n_sample,) to measured less gain times read and zero, over a unit."""
    for n in range(row.size):
        row[n] = (measured[n] - (gain * read[n] + zero)) / unit


@compiled
def _product(a: Array, b: Array) -> float:
    """The sum of a[n] b[n]; four sums at a time, or each would wait for the one before."""
    s_0, s_1, s_2, s_3 = 0.0, 0.0, 0.0, 0.0
    whole = a.size // 4
    for n in range(whole):
        s_0 += a[4 * n] * b[4 * n]
        s_1 += a[4 * n + 1] * b[4 * n + 1]
        s_2 += a[4 * n + 2] * b[4 * n + 2]
        s_3 += a[4 * n + 3] * b[4 * n + 3]
    for n in range(4 * whole, a.size):
        s_0 += a[n] * b[n]
    return (s_0 + s_1) + (s_2 + s_3)


@compiled
def put_moves(
    moves: Array, over: Array, slopes: Array, begins: NDArray[np.intp], inverse: Array, leave_out: bool
) -> None:  # fmt: skip
    """The moves (n_row, n_stretch, n_start) of starts that leave least of residuals over the noise (n_channel, n_row,
    n_sample), by their slopes (n_channel, n_start, n_sample) and (S'S + 1)^-1 (n_stretch, n_start, n_start); with
    `leave_out` the residuals become what is left."""
    n_channel, n_start, n_sample = slopes.shape
    asked = np.empty(n_start)
    for m in range(begins.size):
        begin, end = begins[m], begins[m + 1] if m + 1 < begins.size else n_sample
        for r in range(moves.shape[0]):  # the slopes of a stretch stay in the cache
            for k in range(n_start):
                asked[k] = 0.0
                for c in range(n_channel):
                    asked[k] += _product(over[c, r, begin:end], slopes[c, k, begin:end])
            for k in range(n_start):
                found = 0.0
                for j in range(n_start):
                    found += inverse[m, k, j] * asked[j]
                moves[r, m, k] = 0.0 - found
            if leave_out:
                for c in range(n_channel):
                    for k in range(n_start):
                        add_times(over[c, r, begin:end], slopes[c, k, begin:end], moves[r, m, k])


@compiled
def put_lines(numbers: Array, spectrum: NDArray[np.complex128], n_sample: int) -> None:
    """Real and imaginary parts of the first lines of spectra (n_channel, n_row, n_piece, n_line) of so many samples
    into rows (n_row, n_number), n_number = n_piece n_channel 2 lines, scaled as `noise.transformed` has them."""
    n_channel, n_row, n_piece, _ = spectrum.shape
    lines = numbers.shape[1] // (2 * n_channel * n_piece)
    scale, root = np.sqrt(2.0 / n_sample), np.sqrt(2.0)
    has_last = lines == n_sample // 2 + 1 and n_sample % 2 == 0
    for r in range(n_row):
        for piece in range(n_piece):
            for c in range(n_channel):
                at, line = 2 * lines * (n_channel * piece + c), spectrum[c, r, piece]
                for k in range(lines):
                    numbers[r, at + k] = line[k].real * scale
                    numbers[r, at + lines + k] = line[k].imag * scale
                numbers[r, at] /= root  # the mean has no imaginary part
                if has_last:
                    numbers[r, at + lines - 1] /= root


def put_slopes(
    columns: Sequence[Array | Slopes], moved: Array, before: Array, steps: Sequence[float] | Array, *, threads: int
) -> None:
    """Sets columns, each (n_number,), to the slopes between numbers before (n_number,) and behind steps, those behind
    each step (n_column, n_number)."""
    every = list(zip(columns, moved, steps, strict=True))
    in_threads(lambda one: put_slope(one[0], one[1], before, one[2]), every, threads)


@compiled
def put_slope(column: Array | Slopes, moved: Array, before: Array, step: float) -> None:
    """Sets a column (n_number,) to the slope between numbers before and behind a step."""
    for n in range(column.size):
        column[n] = (moved[n] - before[n]) / step


@compiled
def add_squares(count: Array, power: Array, numbers: Array, labels: NDArray[np.intp]) -> None:
    """Adds 1 to the count and the square of each number to the power of its label, (n_label,) each. Neighbours mostly
    have the same."""
    total, begin = 0.0, 0
    for n in range(labels.size):
        total += numbers[n] * numbers[n]
        if n + 1 == labels.size or labels[n + 1] != labels[n]:
            power[labels[n]] += total
            count[labels[n]] += n + 1 - begin
            total, begin = 0.0, n + 1


@compiled
def put_gram(gram: Array, slopes: Array, begins: NDArray[np.intp]) -> None:
    """S'S of each stretch (n_stretch, n_start, n_start), by slopes (n_channel, n_start, n_sample)."""
    n_channel, n_start, n_sample = slopes.shape
    for m in range(begins.size):
        begin, end = begins[m], begins[m + 1] if m + 1 < begins.size else n_sample
        for a in range(n_start):
            for b in range(a + 1):
                total = 0.0
                for c in range(n_channel):
                    total += _product(slopes[c, a, begin:end], slopes[c, b, begin:end])
                gram[m, a, b] = gram[m, b, a] = total
