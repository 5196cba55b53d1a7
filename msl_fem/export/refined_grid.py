"""A table's surface on a finer grid, for tools that interpolate between points in their own, coarser way."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.table.magnetic_table import NODES, MagneticTable

Array = NDArray[np.float64]
_AT_REST = (
    "coenergy",
    "flux_linkage",
    "force",
    "force_current_slope",
)  # what vanishes without current, to the last bit
PARTS = 4  # of each interval between the table's nodes: linear interpolation between the points errs 16 times less


@dataclass(frozen=True, eq=False)
class RefinedGrid:
    """Values of the coenergy surface and its derivatives on a grid that holds all of the table's nodes.

    Attributes
    ----------
    gap, current : (n_gap,) m and (n_current,) A, increasing; the first current is 0
    values : arrays (n_gap, n_current) of the quantities of a table
    linear_error : largest error in the cells' middles of linear interpolation of `force` and `flux_linkage`, each over
        the largest value
    """

    gap: Array
    current: Array
    values: dict[str, Array]
    linear_error: dict[str, float]


def refined_grid(table: MagneticTable, *, parts: int = PARTS) -> RefinedGrid:
    """The table's surface with every interval of gap and current cut into `parts`."""
    gap, current = _cut(table.gap, parts), _cut(table.current, parts)
    values = table.evaluate(*np.meshgrid(current, gap))
    for name in _AT_REST:
        values[name] = np.where(current == 0.0, 0.0, values[name])
    middle = table.evaluate(*np.meshgrid(_middles(current), _middles(gap)))
    errors = {}
    for name in ("force", "flux_linkage"):
        corners = 0.5 * (values[name][:-1] + values[name][1:])
        linear = 0.5 * (corners[:, :-1] + corners[:, 1:])
        errors[name] = float(np.abs(linear - middle[name]).max() / np.abs(values[name]).max())
    return RefinedGrid(gap, current, {name: values[name] for name in NODES}, errors)


def _cut(nodes: Array, parts: int) -> Array:
    """The nodes themselves, to the last bit, and `parts` - 1 points between any two."""
    shares = np.arange(parts) / parts
    inner = nodes[:-1, None] + shares * np.diff(nodes)[:, None]
    return np.r_[inner.ravel(), nodes[-1]]


def _middles(points: Array) -> Array:
    return np.asarray(0.5 * (points[:-1] + points[1:]))
