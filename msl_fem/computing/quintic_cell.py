"""Polynomials of degree five through the value and the first two derivatives at both ends, in one and three variables.

Printed as C too, so that what leaves to another machine expands its cells to the same bits.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled

ORDERS = 3
"""Value, first and second derivative."""
AT_NODE = ORDERS**3
"""Numbers a node of three variables: by orders along the first, the third, the second variable."""
PADDED = 8
"""Places for the powers of the second variable, six of them used, so that the machine takes them at once."""
N_CELL = 36 * PADDED
"""Rows of a cell: by powers of the first, the third, the second variable."""


def expanded(first: Array, second: Array, third: Array, nodes: Array) -> Array:
    """(n_cell, N_CELL): the coefficients of every cell, the cells by first, second, third variable.

    Parameters
    ----------
    first, second, third : (n_1,), (n_2,), (n_3,) nodes of the variables, increasing
    nodes : (n_1, n_2, n_3, AT_NODE): derivatives, their orders along the first, the third, the second variable
    """
    cells = np.zeros(((first.size - 1) * (second.size - 1) * (third.size - 1), N_CELL))
    expand_all(first, second, third, nodes, cells)
    return cells


@compiled
def expand_all(first, second, third, nodes, cells):  # type: ignore[no-untyped-def]
    """The coefficients of every cell into cells (n_cell, N_CELL)."""
    c = 0
    for k in range(first.size - 1):
        for m in range(second.size - 1):
            for n in range(third.size - 1):
                expand_cell(first, second, third, nodes, k, m, n, cells[c])
                c += 1


@compiled
def expand_cell(first, second, third, nodes, k, m, n, cell):  # type: ignore[no-untyped-def]
    """The coefficients of the cell from node (k, m, n) into cell (N_CELL,), see `expanded`."""
    for corner in range(8):
        a, b, c = corner // 4, corner // 2 % 2, corner % 2
        row = (ORDERS * a * 6 + ORDERS * b) * PADDED + ORDERS * c
        for q in range(AT_NODE):
            cell[row + (q // 9 * 6 + q // 3 % 3) * PADDED + q % 3] = nodes[k + a, m + c, n + b, q]
    by_first, by_third = 6 * PADDED, PADDED
    ends_to_powers(cell, by_first, by_third, 1, first[k + 1] - first[k])
    ends_to_powers(cell, 1, by_first, by_third, second[m + 1] - second[m])
    ends_to_powers(cell, by_third, by_first, 1, third[n + 1] - third[n])


@compiled
def ends_to_powers(cell, stride, outer, inner, length):  # type: ignore[no-untyped-def]
    """(f, f', f'') at 0 and at `length`, every `stride` places, become the coefficients of the powers 0 to 5; so do
    those 6 by 6 that begin at multiples of the strides `outer` and `inner`.

    The rest behind the Taylor polynomial of the start is y^3 (a + b y + c y^2) with its value, slope and curvature at
    the end (Hermite interpolation; de Boor, A Practical Guide to Splines, 2001, ch. I).
    """
    per = 1.0 / length
    cube = per * per * per
    for k in range(36):
        row = k // 6 * outer + k % 6 * inner
        f, slope, curvature = cell[row], cell[row + stride], 0.5 * cell[row + 2 * stride]
        at_end, slope_end = cell[row + 3 * stride], cell[row + 4 * stride]
        step, bend = slope * length, curvature * length * length
        rest = at_end - (f + step + bend)
        rise = slope_end * length - (step + 2.0 * bend)
        turn = 0.5 * cell[row + 5 * stride] * length * length - bend
        cell[row + 2 * stride] = curvature
        cell[row + 3 * stride] = (10.0 * rest - 4.0 * rise + turn) * cube
        cell[row + 4 * stride] = (7.0 * rise - 15.0 * rest - 2.0 * turn) * cube * per
        cell[row + 5 * stride] = (6.0 * rest - 3.0 * rise + turn) * cube * per * per
