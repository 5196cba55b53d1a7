"""Factors L D L^T of a sparse symmetric matrix without exchanges of pivots, front by front, and substitutions.

Multifrontal: each front sums the matrix's rows of its pivots and what its children leave, eliminates its pivots, and
leaves the rest to its parent (Duff and Reid 1983; see `elimination`). Of 1000 to 14 000 unknowns of plane
sections that takes 0.4 to 0.8 of the time of row after row (qdldl).
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.dense_front import backward, eliminate, forward
from msl_fem.magnetics.solver.elimination import Fronts, Indices, fronts_of


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
        if not eliminate(panel, inverse[fronts.first[s] : fronts.first[s] + pivots], left):
            return False
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
            forward(panel, over, x[m, first[s] : first[s] + pivots[s]], after, x[m], own)
    for s in range(first.size - 1, -1, -1):
        panel = upper[panel_start[s] : panel_start[s + 1]].reshape(pivots[s], size[s])
        after, over = rows[row_start[s] : row_start[s + 1]], inverse[first[s] : first[s] + pivots[s]]
        for m in range(n_right):
            backward(panel, over, x[m, first[s] : first[s] + pivots[s]], after, x[m], own)
    out = np.zeros(rights.shape)
    for m in range(n_right):
        for k in range(n):
            out[m, at[order[k]]] = x[m, k]
    return out
