"""The cell of the coenergy spline in which a side is, kept at hand from one evaluation to the next.

A mover stays in one cell of the table for many steps. Its 36 coefficients and its edges are copied to a block of
their own, one a lane; an evaluation first looks whether all lanes are still inside.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, every, fma, lane_of, rows_of, set_lane, width

Array = NDArray[np.float64]

# Rows of a block: coefficients (powers of the gap first), edges of the cell, what a lane looks for, and where the
# coefficients of the lane's surface begin
_GAP_LOW, _GAP_HIGH, _CURRENT_LOW, _CURRENT_HIGH, _CURRENT, _GAP, SURFACE_START = 36, 37, 38, 39, 40, 41, 42
N_BLOCK = 43


class Surface(NamedTuple):
    """The arrays of a `CoenergySurface`: gap (n_gap,) m, current (n_current,) A, coefficients of the cells.

    For lanes, coefficients may have an axis more in front: surfaces over the same nodes.
    """

    gap: Array
    current: Array
    coefficients: Array


class Cells(NamedTuple):
    """A `Surface` as the kernel takes it."""

    gap: Rows
    current: Rows
    coefficients: Rows
    n_gap: int
    n_current: int


@compiled
def cells_of(surface: Surface) -> Cells:
    """The surface by its addresses; it must outlive them."""
    gap, current = surface.gap, surface.current
    return Cells(rows_of(gap), rows_of(current), rows_of(surface.coefficients.ravel()), gap.size, current.size)


@compiled
def inside_cell(work: Rows, block: int, current: Value, gap: Value) -> Flag:
    """Whether |current| and gap are in the cell of the block from that row; its upper edges belong to the next one."""
    within_gap = (work[block + _GAP_LOW] <= gap) & (gap < work[block + _GAP_HIGH])
    return within_gap & (work[block + _CURRENT_LOW] <= current) & (current < work[block + _CURRENT_HIGH])


@compiled
def enter_cell(cells: Cells, work: Rows, block: int, current: Value, gap: Value) -> Flag:
    """True where the block now holds the cell of |current| and gap; False outside the table, or not a number."""
    inside = inside_cell(work, block, current, gap)
    if not every(inside):
        _move(cells, work, block, current, gap)
        inside = inside_cell(work, block, current, gap)
    return inside


@compiled
def _move(cells: Cells, work: Rows, block: int, current: Value, gap: Value) -> None:
    """Fills the block in all lanes that have left their cell; not in those that have left the table."""
    work[block + _CURRENT] = current
    work[block + _GAP] = gap
    for lane in range(width(work)):
        i, g = lane_of(work, block + _CURRENT, lane), lane_of(work, block + _GAP, lane)
        m, n = _lower_node(cells.gap, cells.n_gap, g), _lower_node(cells.current, cells.n_current, i)
        if m >= 0 and n >= 0:
            start = int(lane_of(work, block + SURFACE_START, lane)) + (m * (cells.n_current - 1) + n) * 36
            for k in range(36):
                set_lane(work, block + k, lane, cells.coefficients[start + k])
            set_lane(work, block + _GAP_LOW, lane, cells.gap[m])
            set_lane(work, block + _GAP_HIGH, lane, _upper_edge(cells.gap, cells.n_gap, m))
            set_lane(work, block + _CURRENT_LOW, lane, cells.current[n])
            set_lane(work, block + _CURRENT_HIGH, lane, _upper_edge(cells.current, cells.n_current, n))


@compiled
def _lower_node(nodes: Rows, n_node: int, x: float) -> int:
    """The index m with nodes[m] <= x < nodes[m + 1], the last but one at the end, by bisection; -1 outside."""
    if not (nodes[0] <= x and x <= nodes[n_node - 1]):
        return -1
    low, high = 0, n_node - 1
    while high - low > 1:
        middle = (low + high) // 2
        if nodes[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled
def _upper_edge(nodes: Rows, n_node: int, m: int) -> float:
    """The first number above the cell from node m; the last cell has its upper node."""
    return nodes[m + 1] if m + 2 < n_node else np.nextafter(nodes[m + 1], np.inf)


@compiled
def _in_current(work: Rows, power: int, x: Value) -> tuple[Value, Value, Value]:
    """(value, slope, half the curvature) over the current of what multiplies a power of the gap, from that row."""
    a = work[power + 5]
    b = a
    a = fma(a, x, work[power + 4])
    c = b
    b = fma(b, x, a)
    a = fma(a, x, work[power + 3])
    c = fma(c, x, b)
    b = fma(b, x, a)
    a = fma(a, x, work[power + 2])
    c = fma(c, x, b)
    b = fma(b, x, a)
    a = fma(a, x, work[power + 1])
    return fma(a, x, work[power]), fma(b, x, a), fma(c, x, b)


@compiled
def cell_slopes(work: Rows, block: int, current: Value, gap: Value) -> tuple[Value, Value, Value]:
    """(W'_g, W'_ii, W'_ig) at |current| and gap inside the block's cell: what the equations of motion need."""
    x, y = current - work[block + _CURRENT_LOW], gap - work[block + _GAP_LOW]
    w = w_g = w_i = w_ig = w_ii = x - x
    for p in range(5, -1, -1):
        a, b, c = _in_current(work, block + 6 * p, x)
        w_g = fma(w_g, y, w)
        w = fma(w, y, a)
        w_ig = fma(w_ig, y, w_i)
        w_i = fma(w_i, y, b)
        w_ii = fma(w_ii, y, c)
    return w_g, 2.0 * w_ii, w_ig


@compiled
def cell_values(work: Rows, block: int, current: Value, gap: Value) -> tuple[Value, Value, Value, Value, Value]:
    """(W', W'_g, W'_i, W'_ii, W'_ig) at |current| and gap inside the block's cell; the slopes equal those of
    `cell_slopes` to the last bit."""
    x, y = current - work[block + _CURRENT_LOW], gap - work[block + _GAP_LOW]
    w = w_g = w_i = w_ig = w_ii = x - x
    for p in range(5, -1, -1):
        a, b, c = _in_current(work, block + 6 * p, x)
        w_g = fma(w_g, y, w)
        w = fma(w, y, a)
        w_ig = fma(w_ig, y, w_i)
        w_i = fma(w_i, y, b)
        w_ii = fma(w_ii, y, c)
    return w, w_g, w_i, 2.0 * w_ii, w_ig
