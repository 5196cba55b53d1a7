"""Whether the arrays of a table can be of one magnet: signs, and each array against the slopes that belong to it."""

from collections.abc import Mapping

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import TableError

SLOPES = (
    ("coenergy", "current", "flux_linkage", 1.0),
    ("coenergy", "gap", "force", -1.0),
    ("flux_linkage", "current", "incremental_inductance", 1.0),
    ("flux_linkage", "gap", "force_current_slope", -1.0),
    ("force", "current", "force_current_slope", 1.0),
    ("force", "gap", "force_gap_slope", 1.0),
)
"""Array, axis, the array that is its derivative along that axis, and with which sign: all of one coenergy."""
OF_THE_SLOPE = 0.25  # of the larger slope: what a slope that is not monotone inside a cell may add
OF_A_COARSE_CELL = 5.0  # the same where slopes or positions of the ends differ by a factor of 2 or more
OF_THE_LARGEST = 0.02  # of the largest value: noise of a measured table, a mesh's error
SMALLEST_SHARE = 1e-6  # of the largest force: below, the sign of a force is rounding


def check_consistency(gap: Array, current: Array, nodes: Mapping[str, Array]) -> None:
    """TableError where a sign is no magnet's, or where an array and its derivative contradict each other.

    Between two nodes an array changes by the mean of its derivative, which lies between the derivative's values at the
    nodes if that is monotone there; what `OF_THE_SLOPE` and the constants below it say is allowed beyond. Wrong units
    and signs are far outside; an error of a few per cent is not seen here but in the stated reciprocity error.
    """
    _check_signs(gap, current, nodes)
    for name, axis, slope, sign in SLOPES:
        x = current if axis == "current" else gap
        _check_slope(name, axis, slope, x, nodes[name], sign * nodes[slope])


def _check_signs(gap: Array, current: Array, nodes: Mapping[str, Array]) -> None:
    inductance = nodes["incremental_inductance"]
    if not (inductance > 0).all():
        m, n = np.unravel_index(np.argmin(inductance), inductance.shape)
        raise TableError(
            f"the incremental inductance is {inductance[m, n]:g} H at gap {gap[m]:g} m, current {current[n]:g} A; "
            "a coil's is above 0: look at the sign of flux linkage and current"
        )
    force = nodes["force"]
    if force.min() < -SMALLEST_SHARE * np.abs(force).max():
        m, n = np.unravel_index(np.argmin(force), force.shape)
        raise TableError(
            f"the force is {force[m, n]:g} N at gap {gap[m]:g} m, current {current[n]:g} A; attraction counts "
            "as positive: look at the sign of the variable 'force'"
        )


def _check_slope(name: str, axis: str, slope_name: str, x: Array, values: Array, slopes: Array) -> None:
    along = 1 if axis == "current" else 0
    step = np.expand_dims(np.diff(x), 1 - along)
    first, last = (np.take(slopes, cells, axis=along) for cells in (range(x.size - 1), range(1, x.size)))
    larger = np.maximum(np.abs(first), np.abs(last))
    near = np.expand_dims(x[1:] < 2 * x[:-1], 1 - along)
    fine = near & (np.minimum(np.abs(first), np.abs(last)) > larger / 2)
    allowance = step * larger * np.where(fine, OF_THE_SLOPE, OF_A_COARSE_CELL)
    low = step * np.minimum(first, last) - allowance
    high = step * np.maximum(first, last) + allowance
    change = np.diff(values, axis=along)
    noise = OF_THE_LARGEST * float(np.abs(values).max())
    for cells in (list(range(x.size)), [0, x.size - 1]):  # each cell, then the whole range
        starts = cells[:-1]
        parts = (np.add.reduceat(part, starts, axis=along) for part in (change, low, high))
        total, lowest, highest = parts
        excess = np.maximum(lowest - total, total - highest) - noise
        if not excess.max() > 0:
            continue
        m, n = np.unravel_index(np.argmax(excess), excess.shape)
        cell = (m, n)[along]
        unit = "A" if axis == "current" else "m"
        raise TableError(
            f"'{name}' changes by {total[m, n]:g} between {axis} {x[cells[cell]]:g} and {x[cells[cell + 1]]:g} {unit}, "
            f"by '{slope_name}' it must change by {lowest[m, n]:.4g} to {highest[m, n]:.4g}: they contradict each "
            f"other; look at the sign and the unit of both and of the {axis}s"
        )
