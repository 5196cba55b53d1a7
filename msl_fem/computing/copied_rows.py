"""Arrays copied, added and small matrices multiplied in loops, for compiled functions.

Numba takes a second to compile `target[:] = source`, most of it for the words of the error where shapes differ, and
longer for `a @ b`; of matrices this small a loop is as fast.
"""

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.compiled import compiled


@compiled
def copy_into(target: Array, source: Array) -> None:
    """Sets the numbers of a target (n,) to those of a source, which has as many."""
    for n in range(target.size):
        target[n] = source[n]


@compiled
def add_times(target: Array | Slopes, source: Array | Slopes, by: float) -> None:
    """Adds so many times a source (n,) to a target (n,)."""
    for n in range(target.size):
        target[n] += by * source[n]


@compiled
def set_combined(target: Array, a: Array, x: Array, b: Array, y: Array) -> None:
    """Sets a target (n,) to A x + B y, of matrices (n, m) and vectors (m,)."""
    for n in range(target.size):
        total = 0.0
        for m in range(x.size):
            total += a[n, m] * x[m]
        for m in range(y.size):
            total += b[n, m] * y[m]
        target[n] = total


@compiled
def set_congruent(target: Array, matrix: Array, middle: Array, product: Array) -> None:
    """Sets a target (n, n) to M P M' of a matrix M (n, m) and P (m, m); `product` (n, m) receives M P, so the target
    may be P."""
    for row in range(matrix.shape[0]):
        for column in range(middle.shape[1]):
            product[row, column] = 0.0
            for k in range(middle.shape[0]):
                product[row, column] += matrix[row, k] * middle[k, column]
    for row in range(matrix.shape[0]):
        for column in range(matrix.shape[0]):
            target[row, column] = 0.0
            for k in range(matrix.shape[1]):
                target[row, column] += product[row, k] * matrix[column, k]
