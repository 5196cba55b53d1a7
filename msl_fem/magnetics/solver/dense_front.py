"""Dense symmetric matrices, or the first rows of larger ones: pivots eliminated four at a time, and substitutions.

Rows are upper: entry j >= i of row i counts. Loops go over np.uint64: an index that might be negative would be wrapped,
which keeps a loop from vector instructions.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.elimination import Indices

PANEL = 4


@compiled
def eliminate(panel: Array, inverse: Array, left: Array) -> bool:
    """Rows of pivots (k, n) to D L^T, and 1/D (k,); False where a pivot is 0.

    The pivots go out of the rows after them, `left` (n - k, n), of which the columns from k on count.
    """
    pivots = panel.shape[0]
    for begin in range(0, pivots, PANEL):
        end = min(begin + PANEL, pivots)
        for a in range(begin, end):
            if panel[a, a] == 0.0:
                return False
            inverse[a] = 1.0 / panel[a, a]
            _eliminate_one(panel[a], inverse[a], a + 1, end, panel)
        _eliminate_panel(panel, inverse, begin, end, left)
    return True


@compiled
def _eliminate_one(pivot: Array, inverse: float, begin: int, end: int, rows: Array) -> None:
    """A pivot's row from some rows, each from its diagonal on."""
    for i in range(begin, end):
        share, row = pivot[i] * inverse, rows[i]
        for j in range(np.uint64(i), np.uint64(pivot.size)):
            row[j] -= share * pivot[j]


@compiled
def _eliminate_panel(panel: Array, inverse: Array, begin: int, end: int, left: Array) -> None:
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
    for i in range(end, size, 2):  # two rows at once, which share what is read of the pivots
        a, b, c, d = first[i] * over[0], second[i] * over[1], third[i] * over[2], fourth[i] * over[3]
        row = panel[i] if i < pivots else left[i - pivots]
        row[i] -= a * first[i] + b * second[i] + (c * third[i] + d * fourth[i])
        k = i + 1
        if k == size:
            break
        e, f, g, h = first[k] * over[0], second[k] * over[1], third[k] * over[2], fourth[k] * over[3]
        next_row = panel[k] if k < pivots else left[k - pivots]
        for j in range(np.uint64(k), np.uint64(size)):
            w, x, y, z = first[j], second[j], third[j], fourth[j]
            row[j] -= a * w + b * x + (c * y + d * z)
            next_row[j] -= e * w + f * x + (g * y + h * z)


@compiled
def forward(panel: Array, inverse: Array, mine: Array, rows: Indices, x: Array, own: Array) -> None:
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
def backward(panel: Array, inverse: Array, mine: Array, rows: Indices, x: Array, own: Array) -> None:
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
