"""What columns say against themselves: copies of one another, values that were looked up, too few or too slow samples,
a voltage that is not the current's. Warnings, never refusals; no check knows a file.

Cells are compared as they were written: an exact copy leaves no noise of its own, whatever its unit.
"""

from collections.abc import Mapping
from itertools import combinations, permutations

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.record.log_noise import resolution_of

Columns = Mapping[str, Array]
FEWEST = 10
"""Rows below which a coincidence proves nothing."""
EXACT = 1e-6
"""Share of a column's spread that rounding may leave of an exact copy."""
ROUGH = 0.01
"""Share of the spread up to which rounding may be: a coarser column proves no copy."""
LIVE = 0.2
"""Correlation of successive samples, without the mean, below which the motion between them is lost."""
FEW_LEVELS = 64
NOTHING = 1e-100
"""What no sensor shows but as 0: its square is none."""


def affine_copies(columns: Columns) -> list[str]:
    """Pairs of columns (n_row,) that are one another's exact straight line: only one of them was measured."""
    doubts = []
    for (first, second), (slope, offset) in _copies(columns).items():
        line = f"{slope:.5g} {first} {offset:+.5g}"
        doubts.append(f"{second} is {line} in every row: a copy of {first}, no measurement of its own")
    return doubts


def _copies(columns: Columns) -> dict[tuple[str, str], tuple[float, float]]:
    """Slope and offset of the pairs whose line leaves no more than the rounding of either column, or of both."""
    lines = {}
    shown = {name: v for name, v in columns.items() if v.size >= FEWEST and np.ptp(v) > NOTHING}
    names = [name for name, v in shown.items() if np.unique(v).size >= 4]
    for first, second in combinations(names, 2):
        x, y = columns[first], columns[second]
        along = x - np.mean(x)
        slope = float(along @ y) / float(along @ along)
        offset = float(np.mean(y) - slope * np.mean(x))
        left, spread = float(np.max(np.abs(y - slope * x - offset))), float(np.std(y))
        own, other = 0.51 * _last_digit(y), abs(slope) * 0.51 * _last_digit(x)
        allowed = [a for a in (EXACT * spread, own, other, own + other) if a < ROUGH * spread]
        if allowed and left <= max(allowed):
            lines[first, second] = slope, offset
    return lines


def _last_digit(values: Array) -> float:
    """The least decimal step in which all values are written, to nine digits."""
    largest = float(np.max(np.abs(values))) or 1.0
    for digits in range(1, 10):
        step = 10.0 ** (np.floor(np.log10(largest)) - digits + 1)
        if np.max(np.abs(values / step - np.round(values / step))) < 1e-3:
            return float(step)
    return largest * 1e-9


def looked_up(columns: Columns) -> list[str]:
    """Columns (n_row,) that have one value for each value of another one, many times over, without being its straight
    line: a look-up of the other, or of what that was made of."""
    doubts = []
    named = {name: v for name, v in columns.items() if v.size >= 10 * FEWEST and np.unique(v).size >= FEWEST}
    copies = _copies(named)
    for first, second in permutations(named, 2):
        levels, place = np.unique(named[first], return_inverse=True)
        if levels.size > place.size / 3 or (first, second) in copies or (second, first) in copies:
            continue
        least, most = np.full(levels.size, np.inf), np.full(levels.size, -np.inf)
        np.minimum.at(least, place, named[second])
        np.maximum.at(most, place, named[second])
        if np.all(least == most):
            doubts.append(f"{second} has one value for each of the {levels.size} values of {first}: looked up from it")
    return doubts


def piled_up(columns: Columns) -> list[str]:
    """Columns (n_row,) of which a twentieth or more stands at the largest or least value: clipped or at rest there."""
    doubts = []
    for name, values in columns.items():
        levels, counts = np.unique(values, return_counts=True)
        if levels.size < FEWEST or values.size < 10 * FEWEST:
            continue
        for at, word in ((0, "least"), (-1, "largest")):
            if counts[at] > 0.05 * values.size and counts[at] > 5 * np.median(counts):
                share = counts[at] / values.size
                doubts.append(f"{name} stands at its {word} value {levels[at]:.6g} in {share:.0%} of the rows")
    return doubts


def coarse(columns: Columns) -> list[str]:
    """Columns (n_row,) of long records with few distinct values on equal steps: the step hides the noise."""
    doubts = []
    for name, values in columns.items():
        levels = np.unique(values).size
        if values.size >= 1000 and 3 <= levels <= FEW_LEVELS and resolution_of(values) > 0:
            doubts.append(f"{name} has {levels} distinct values, in steps of {resolution_of(values):.4g}")
    return doubts


def too_slow(columns: Columns) -> list[str]:
    """Columns (n_row,) in the order of time whose successive samples hardly correlate: what moves is faster than the
    samples, or noise alone. No velocity or acceleration comes from them."""
    doubts = []
    for name, values in columns.items():
        about = values - values.mean()
        power = float(about @ about)
        if values.size >= 100 and power > 0 and np.unique(values).size > 3:
            correlation = float(about[1:] @ about[:-1]) / power
            if correlation < LIVE:
                doubts.append(
                    f"{name}: successive samples correlate by {correlation:.2f}; what moves is faster than the samples "
                    "or noise alone, and no acceleration can come from it"
                )
    return doubts


def doubtful_signals(columns: Columns) -> list[str]:
    """All that measured columns (n_row,) say against themselves, whatever they are."""
    return [doubt for check in (affine_copies, looked_up, piled_up, coarse) for doubt in check(columns)]


def resistance_told(voltage: Array, current: Array, period: float) -> float | None:
    """Ohm that voltage and current (n_sample,) of a coil say together, None where they do not settle it.

    u = R i + d lambda/dt, and the flux linkage comes back while its integral goes on: over the run the integral of u
    follows that of i with the slope R (least squares, straight lines in lambda taken out).
    """
    charge, impulse = np.cumsum(current) * period, np.cumsum(voltage) * period
    step = np.ones_like(charge)
    matrix = np.c_[charge, current, step]
    scale = np.linalg.norm(matrix, axis=0)
    if np.any(scale == 0) or np.ptp(current) == 0:
        return None
    fit, *_ = np.linalg.lstsq(matrix / scale, impulse, rcond=None)
    left = impulse - (matrix / scale) @ fit
    told = float(np.ptp(matrix[:, 0] / scale[0] * fit[0]))
    return float(fit[0] / scale[0]) if told > 5 * float(np.std(left)) else None
