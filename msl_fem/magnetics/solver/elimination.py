"""In which order, and in which groups, the unknowns of a sparse symmetric matrix are eliminated: once for a pattern.

Columns of the factors with nearly the same rows make one front, a dense matrix of its own (Duff and Reid, The
multifrontal solution of indefinite sparse symmetric linear equations, ACM Trans. Math. Softw. 9, 1983); a front takes
in its last child where that adds few zeros (Ashcraft and Grimes, ACM Trans. Math. Softw. 15, 1989). The order is that
of least degree (Amestoy, Davis and Duff, SIAM J. Matrix Anal. Appl. 17, 1996, as qdldl has it), then of the elimination
tree (Liu, SIAM J. Matrix Anal. Appl. 11, 1990).
"""

from typing import NamedTuple

import numpy as np
import qdldl
from numpy.typing import NDArray
from scipy import sparse

from msl_fem.computing.compiled import compiled

Indices = NDArray[np.int64]
SMALL, MIDDLE = 8, 24  # pivots of a front that is worth any zeros, or many
MANY, FEW = 0.4, 0.15  # zeros, of a front's entries


class Fronts(NamedTuple):
    """The fronts, children before parents. A front is of pivots and, after them, the later unknowns that they touch.

    Attributes
    ----------
    order : (n,) which unknown is eliminated when
    first, pivots, size : (front,) its first pivot's place in the order, how many there are, and the whole front's rows
    rows, row_start : places in the order of the rows after the pivots, front after front, and where a front's begin
    in_parent : for each of these rows, its place in the parent's front
    panel_start : (front + 1,) where the pivots' rows (pivots x size) begin in the factors
    children : (front,) how many are taken in
    places : (nnz,) where an entry of the matrix belongs in the factors
    largest, stacked : entries of the largest front's rows after the pivots, and most of all that wait for parents
    """

    order: Indices
    first: Indices
    pivots: Indices
    size: Indices
    rows: Indices
    row_start: Indices
    in_parent: Indices
    panel_start: Indices
    children: Indices
    places: Indices
    largest: int
    stacked: int


def fronts_of(rows: NDArray[np.int32], starts: NDArray[np.int32]) -> Fronts:
    """Of a symmetric matrix's pattern: rows (nnz,) of the upper triangle's columns, which begin at starts (n + 1,).

    The diagonal is in the pattern.
    """
    n = starts.size - 1
    column = np.repeat(np.arange(n), np.diff(starts))
    order = _least_degree(rows, starts, column)
    order = order[_postorder(_tree(*_earlier(*_places(order, rows, column), n)))]
    low, high = _places(order, rows, column)
    earlier = _earlier(low, high, n)
    tree = _tree(*earlier)
    below = _rows_below(*earlier, tree)
    first = np.r_[_grouped(tree, below), n]
    pivots, after = np.diff(first), below[first[1:] - 1]
    row_start, panel_start = np.r_[0, np.cumsum(after)], np.r_[0, np.cumsum(pivots * (pivots + after))]
    later, parent = _front_rows(first, row_start, high, *_by_place(low, n))
    return Fronts(
        order,
        first[:-1],
        pivots,
        pivots + after,
        later,
        row_start,
        _rows_in_parents(parent, first, later, row_start),
        panel_start,
        np.bincount(parent[parent >= 0], minlength=parent.size),
        _entry_places(low, high, first, later, row_start, panel_start),
        int((after * (pivots + after)).max()),
        _most_waiting(parent, after),
    )


def _least_degree(rows: NDArray[np.int32], starts: NDArray[np.int32], column: Indices) -> Indices:
    """(n,) by qdldl, which orders a matrix as it factors it: one whose diagonal outweighs the rest."""
    n = starts.size - 1
    degree = np.bincount(rows, minlength=n) + np.bincount(column, minlength=n)
    values = np.where(rows == column, 1.0 + degree[column], 1.0)
    upper = sparse.csc_matrix((values, rows, starts), shape=(n, n))
    return np.asarray(qdldl.Solver(upper, upper=True).factors()[2], dtype=np.int64)


def _places(order: Indices, rows: NDArray[np.int32], column: Indices) -> tuple[Indices, Indices]:
    """The earlier and the later of each entry's two places (nnz,) in an order."""
    place = np.empty(order.size, dtype=np.int64)
    place[order] = np.arange(order.size)
    return np.minimum(place[rows], place[column]), np.maximum(place[rows], place[column])


def _earlier(low: Indices, high: Indices, n: int) -> tuple[Indices, Indices]:
    """The earlier places by the later ones, and where these begin (n + 1,)."""
    by_high, begin = _by_place(high, n)
    return low[by_high], begin


@compiled
def _by_place(places: Indices, n: int) -> tuple[Indices, Indices]:
    """Which of the values (m,) are 0, then which are 1, up to n - 1; and where each's begin (n + 1,)."""
    begin, which = np.zeros(n + 1, dtype=np.int64), np.empty(places.size, dtype=np.int64)
    for k in range(places.size):
        begin[places[k] + 1] += 1
    for j in range(n):
        begin[j + 1] += begin[j]
    free = begin.copy()
    for k in range(places.size):
        which[free[places[k]]] = k
        free[places[k]] += 1
    return which, begin


@compiled
def _tree(earlier: Indices, begin: Indices) -> Indices:
    """(n,) the parent of each place, -1 of a root: the first later place that its column of the factors has."""
    n = begin.size - 1
    parent, above = np.full(n, -1), np.full(n, -1)
    for high in range(n):
        for k in range(begin[high], begin[high + 1]):
            low = earlier[k]
            while low != -1 and low < high:
                further = above[low]
                above[low] = high
                if further == -1:
                    parent[low] = high
                low = further
    return parent


@compiled
def _postorder(parent: Indices) -> Indices:
    """(n,) places with all below a parent just before it."""
    n = parent.size
    child, next_one = np.full(n, -1), np.full(n, -1)
    for j in range(n - 1, -1, -1):
        if parent[j] >= 0:
            next_one[j] = child[parent[j]]
            child[parent[j]] = j
    order, waiting = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    done = 0
    for root in range(n):
        if parent[root] >= 0:
            continue
        depth = 0
        waiting[0] = root
        while depth >= 0:
            j = waiting[depth]
            lower = child[j]
            if lower == -1:
                order[done] = j
                done += 1
                depth -= 1
            else:
                child[j] = next_one[lower]
                depth += 1
                waiting[depth] = lower
    return order


@compiled
def _rows_below(earlier: Indices, begin: Indices, parent: Indices) -> Indices:
    """(n,) rows of each column of the factors below the diagonal."""
    n = parent.size
    count, seen = np.zeros(n, dtype=np.int64), np.full(n, -1)
    for high in range(n):
        seen[high] = high
        for k in range(begin[high], begin[high + 1]):
            low = earlier[k]
            while seen[low] != high:
                seen[low] = high
                count[low] += 1
                low = parent[low]
    return count


@compiled
def _grouped(parent: Indices, below: Indices) -> Indices:
    """(front,) the first pivots of fronts: columns that follow each other with the same rows, or nearly."""
    n = parent.size
    first, zeros = np.empty(n, dtype=np.int64), np.zeros(n)
    count = begin = 0
    for j in range(n):
        if j + 1 < n and parent[j] == j + 1 and below[j] == below[j + 1] + 1:
            continue
        first[count], zeros[count] = begin, 0.0
        begin = j + 1
        while count > 0:
            middle, before = first[count], first[count - 1]
            if not middle <= parent[middle - 1] <= j:  # what lies before is no child
                break
            total = zeros[count] + zeros[count - 1]
            total += (middle - before) * (j + 1 - middle + below[j] - below[middle - 1])
            size = j + 1 - before
            share = total / (size * (size + 1) / 2 + size * below[j])
            if size > SMALL and share > FEW and not (size <= MIDDLE and share <= MANY):
                break
            zeros[count - 1] = total
            count -= 1
        count += 1
    return first[:count].copy()


@compiled
def _front_rows(
    first: Indices, row_start: Indices, high: Indices, by_low: Indices, low_begin: Indices
) -> tuple[Indices, Indices]:
    """The fronts' rows after the pivots, and (front,) each front's parent, -1 of a root.

    Parameters
    ----------
    first : (front + 1,) the last one n
    high : (nnz,) the later place of each entry
    by_low, low_begin : entries by the earlier place, and where each place's begin
    """
    n_front, n = first.size - 1, first[-1]
    front, seen = np.empty(n, dtype=np.int64), np.full(n, -1)
    rows, parent = np.empty(row_start[-1], dtype=np.int64), np.full(n_front, -1)
    child, sibling = np.full(n_front, -1), np.full(n_front, -1)
    for s in range(n_front):
        front[first[s] : first[s + 1]] = s
    for s in range(n_front):
        count = row_start[s]
        for k in range(low_begin[first[s]], low_begin[first[s + 1]]):
            row = high[by_low[k]]
            if row >= first[s + 1] and seen[row] != s:
                seen[row] = s
                rows[count] = row
                count += 1
        c = child[s]
        while c != -1:
            for row in rows[row_start[c] : row_start[c + 1]]:
                if row >= first[s + 1] and seen[row] != s:
                    seen[row] = s
                    rows[count] = row
                    count += 1
            c = sibling[c]
        rows[row_start[s] : count].sort()
        if count > row_start[s]:
            parent[s] = front[rows[row_start[s]]]
            sibling[s], child[parent[s]] = child[parent[s]], s
    return rows, parent


@compiled
def _rows_in_parents(parent: Indices, first: Indices, rows: Indices, row_start: Indices) -> Indices:
    """For each of the rows of the fronts, its place in the parent's front."""
    found = np.empty(rows.size, dtype=np.int64)
    for s in range(parent.size):
        p = parent[s]
        k = row_start[p]
        for m in range(row_start[s], row_start[s + 1]):
            if rows[m] < first[p + 1]:
                found[m] = rows[m] - first[p]
                continue
            while rows[k] < rows[m]:
                k += 1
            found[m] = first[p + 1] - first[p] + k - row_start[p]
    return found


@compiled
def _entry_places(
    low: Indices, high: Indices, first: Indices, rows: Indices, row_start: Indices, panel_start: Indices
) -> Indices:
    """(nnz,) where entries of the two places belong in the factors."""
    found = np.empty(low.size, dtype=np.int64)
    front = np.searchsorted(first, low, side="right") - 1
    for k in range(low.size):
        s = front[k]
        pivots, own = first[s + 1] - first[s], rows[row_start[s] : row_start[s + 1]]
        column = high[k] - first[s]
        if column >= pivots:
            column = pivots + np.searchsorted(own, high[k])
        found[k] = panel_start[s] + (low[k] - first[s]) * (pivots + own.size) + column
    return found


@compiled
def _most_waiting(parent: Indices, after: Indices) -> int:
    """Entries of what fronts leave to their parents, with `after` (front,) rows each, where most of them wait."""
    most = now = 0
    taken = np.zeros(parent.size, dtype=np.int64)
    for s in range(parent.size):
        now += after[s] ** 2 - taken[s]
        most = max(most, now)
        if parent[s] >= 0:
            taken[parent[s]] += after[s] ** 2
    return most
