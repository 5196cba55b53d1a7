"""Factors L D L^T of a sparse symmetric matrix without exchanges of pivots, front by front, and substitutions.

Multifrontal: each front sums the matrix's rows of its pivots and what its children leave, eliminates its pivots four at
a time, and leaves the rest to its parent (Duff and Reid 1983; see `elimination`). Of 1000 to 14 000 unknowns of plane
sections that takes 0.4 to 0.7 of the time of row after row (qdldl).
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.elimination import Fronts, Indices, fronts_of

PANEL = 4
# Loops over np.uint64: an index that might be negative would be wrapped, which keeps a loop from vector instructions.


class SymmetricFactors:
    """The factors of matrices of one pattern, and room for them.

    Parameters
    ----------
    rows, starts : (nnz,), (n + 1,) of the upper triangle's columns, the diagonal among them
    """

    def __init__(self, rows: NDArray[np.int32], starts: NDArray[np.int32]) -> None:
        self.fronts = fronts_of(rows, starts)
        self._make_room()

    def _make_room(self) -> None:
        fronts = self.fronts
        self._upper, self._inverse = np.empty(fronts.panel_start[-1]), np.empty(fronts.order.size)
        self._room = np.empty(fronts.largest), np.empty(fronts.stacked), np.empty(fronts.first.size, dtype=np.int64)

    def with_room_of_its_own(self) -> "SymmetricFactors":
        """For matrices of the same pattern, with none factored."""
        other = object.__new__(SymmetricFactors)
        other.fronts = self.fronts
        other._make_room()
        return other

    def factor(self, data: Array) -> bool:
        """Factor the matrix of these values (nnz,); False where a pivot is 0."""
        return _factor(data, self.fronts, self._upper, self._inverse, *self._room)

    def substitute(self, rights: Array, at: Indices) -> Array:
        """(k, N) the inverse times rows of `rights` (k, N), of which the matrix's unknowns are the places `at` (n,)."""
        return _substitute(rights, at, self.fronts, self._upper, self._inverse)


@compiled
def _factor(
    data: Array, fronts: Fronts, upper: Array, inverse: Array, rest: Array, stack: Array, waiting: Indices
) -> bool:
    """The rows D L^T of all pivots (panel after panel), and 1/D; False where a pivot is 0."""
    upper[:] = 0.0
    for k in range(data.size):
        upper[fronts.places[k]] += data[k]
    top = n_waiting = 0
    for s in range(fronts.first.size):
        pivots, size = fronts.pivots[s], fronts.size[s]
        after = size - pivots
        panel = upper[fronts.panel_start[s] : fronts.panel_start[s + 1]].reshape(pivots, size)
        left = rest[: after * size].reshape(after, size)  # rows after the pivots, in the panel's columns
        left[:] = 0.0
        for _ in range(fronts.children[s]):
            n_waiting -= 1
            child = waiting[n_waiting]
            n = fronts.size[child] - fronts.pivots[child]
            top -= n * n
            start = fronts.row_start[child]
            _take_in(stack[top : top + n * n].reshape(n, n), fronts.in_parent[start : start + n], panel, left)
        for begin in range(0, pivots, PANEL):
            end = min(begin + PANEL, pivots)
            for a in range(begin, end):
                if panel[a, a] == 0.0:
                    return False
                inverse[fronts.first[s] + a] = 1.0 / panel[a, a]
                _eliminate(panel[a], inverse[fronts.first[s] + a], a + 1, end, panel)
            _eliminate_from_rest(panel, inverse[fronts.first[s] : fronts.first[s] + pivots], begin, end, left)
        if after:
            for i in range(after):
                source, target = left[i], stack[top + i * after : top + (i + 1) * after]
                for j in range(np.uint64(i), np.uint64(after)):
                    target[j] = source[j + np.uint64(pivots)]
            waiting[n_waiting] = s
            n_waiting += 1
            top += after * after
    return True


@compiled
def _take_in(child: Array, in_parent: Indices, panel: Array, left: Array) -> None:
    """Adds what a child leaves (n, n) to its parent's front, in whose order its rows are."""
    pivots, n = panel.shape[0], in_parent.size
    for i in range(n):
        place = in_parent[i]
        source, target = child[i], panel[place] if place < pivots else left[place - pivots]
        for j in range(np.uint64(i), np.uint64(n)):
            target[in_parent[j]] += source[j]


@compiled
def _eliminate(pivot: Array, inverse: float, begin: int, end: int, rows: Array) -> None:
    """A pivot's row from some rows, each from its diagonal on."""
    for i in range(begin, end):
        share, row = pivot[i] * inverse, rows[i]
        for j in range(np.uint64(i), np.uint64(pivot.size)):
            row[j] -= share * pivot[j]


@compiled
def _eliminate_from_rest(panel: Array, inverse: Array, begin: int, end: int, left: Array) -> None:
    """Pivots' rows from the rows after them, of the panel and of what is left, each from its diagonal on."""
    pivots, size = panel.shape
    if end - begin < PANEL:  # the last ones
        for a in range(begin, end):
            for i in range(end, size):
                share, pivot, row = panel[a, i] * inverse[a], panel[a], left[i - pivots]
                for j in range(np.uint64(i), np.uint64(size)):
                    row[j] -= share * pivot[j]
        return
    first, second, third, fourth = panel[begin], panel[begin + 1], panel[begin + 2], panel[begin + 3]
    over = inverse[begin], inverse[begin + 1], inverse[begin + 2], inverse[begin + 3]
    for i in range(end, size):
        a, b, c, d = first[i] * over[0], second[i] * over[1], third[i] * over[2], fourth[i] * over[3]
        row = panel[i] if i < pivots else left[i - pivots]
        for j in range(np.uint64(i), np.uint64(size)):
            row[j] -= a * first[j] + b * second[j] + (c * third[j] + d * fourth[j])


@compiled
def _substitute(rights: Array, at: Indices, fronts: Fronts, upper: Array, inverse: Array) -> Array:
    """As `SymmetricFactors.substitute`."""
    order, first, rows, row_start = fronts.order, fronts.first, fronts.rows, fronts.row_start
    pivots, size, panel_start = fronts.pivots, fronts.size, fronts.panel_start
    n_right, n = rights.shape[0], at.size
    x = np.empty((n_right, n))
    for m in range(n_right):
        for k in range(n):
            x[m, k] = rights[m, at[order[k]]]
    own = np.empty(size.max())
    for s in range(first.size):
        panel = upper[panel_start[s] : panel_start[s + 1]].reshape(pivots[s], size[s])
        after, over = rows[row_start[s] : row_start[s + 1]], inverse[first[s] : first[s] + pivots[s]]
        for m in range(n_right):
            _forward(panel, over, x[m, first[s] : first[s] + pivots[s]], after, x[m], own)
    for s in range(first.size - 1, -1, -1):
        panel = upper[panel_start[s] : panel_start[s + 1]].reshape(pivots[s], size[s])
        after, over = rows[row_start[s] : row_start[s + 1]], inverse[first[s] : first[s] + pivots[s]]
        for m in range(n_right):
            _backward(panel, over, x[m, first[s] : first[s] + pivots[s]], after, x[m], own)
    out = np.zeros(rights.shape)
    for m in range(n_right):
        for k in range(n):
            out[m, at[order[k]]] = x[m, k]
    return out


@compiled
def _forward(panel: Array, inverse: Array, mine: Array, rows: Indices, x: Array, own: Array) -> None:
    """A front's pivots out of the later places `rows` of x, of which its own, `mine`, are divided by D."""
    pivots, size = panel.shape
    n = np.uint64(size)
    own[:pivots] = mine
    own[pivots:size] = 0.0
    for a in range(0, pivots - PANEL + 1, PANEL):
        first, second, third, fourth = panel[a], panel[a + 1], panel[a + 2], panel[a + 3]
        w = own[a] * inverse[a]
        x_1 = own[a + 1] - w * first[a + 1]
        y = x_1 * inverse[a + 1]
        x_2 = own[a + 2] - w * first[a + 2] - y * second[a + 2]
        z = x_2 * inverse[a + 2]
        x_3 = own[a + 3] - w * first[a + 3] - y * second[a + 3] - z * third[a + 3]
        u = x_3 * inverse[a + 3]
        mine[a], mine[a + 1], mine[a + 2], mine[a + 3] = w, y, z, u
        for j in range(np.uint64(a + PANEL), n):
            own[j] -= w * first[j] + y * second[j] + (z * third[j] + u * fourth[j])
    for a in range(pivots - pivots % PANEL, pivots):
        row, value = panel[a], own[a] * inverse[a]
        mine[a] = value
        for j in range(np.uint64(a + 1), n):
            own[j] -= value * row[j]
    for j in range(rows.size):
        x[rows[j]] += own[pivots + j]


@compiled
def _backward(panel: Array, inverse: Array, mine: Array, rows: Indices, x: Array, own: Array) -> None:
    """The later places `rows` of x out of a front's pivots, `mine`."""
    pivots, size = panel.shape
    n = np.uint64(size)
    own[:pivots] = mine
    for j in range(rows.size):
        own[pivots + j] = x[rows[j]]
    whole = pivots - pivots % PANEL
    for a in range(pivots - 1, whole - 1, -1):
        row, total = panel[a], 0.0
        for j in range(np.uint64(a + 1), n):
            total += row[j] * own[j]
        own[a] -= total * inverse[a]
    for a in range(whole - PANEL, -1, -PANEL):
        first, second, third, fourth = panel[a], panel[a + 1], panel[a + 2], panel[a + 3]
        w = y = z = u = 0.0
        for j in range(np.uint64(a + PANEL), n):
            w += first[j] * own[j]
            y += second[j] * own[j]
            z += third[j] * own[j]
            u += fourth[j] * own[j]
        own[a + 3] -= u * inverse[a + 3]
        own[a + 2] -= (z + third[a + 3] * own[a + 3]) * inverse[a + 2]
        own[a + 1] -= (y + second[a + 2] * own[a + 2] + second[a + 3] * own[a + 3]) * inverse[a + 1]
        w += first[a + 1] * own[a + 1] + first[a + 2] * own[a + 2] + first[a + 3] * own[a + 3]
        own[a] -= w * inverse[a]
    mine[:] = own[:pivots]
