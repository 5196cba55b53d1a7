"""Few points with positive weights in the place of a quadrature: energy-conserving sampling and weighting.

Which sums must be kept: Farhat, Avery, Chapman and Cortial, Int. J. Numer. Meth. Eng. 98 (2014); Hernandez, Caicedo and
Ferrer, Comput. Methods Appl. Mech. Eng. 313 (2017). They seek the weights by non-negative least squares; here m sums of
positive terms are kept exactly by m of the points, whose weights stay positive (Caratheodory's theorem, for quadratures
Tchakaloff 1957), halving the points again and again (Maalouf, Jubran and Feldman, NeurIPS 2019). It cannot stall where
the sums are nearly dependent. Positive weights keep the reduced energy convex.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dgetrf

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled

Indices = NDArray[np.int64]
TELLING = 4  # times as many points as rows, of their principal combinations
GROUPS = 2  # times as many as sums, in a round
NO_PIVOT = 1e-14
RIDGE = 1e-12


def principal_directions(rows: Array, weight: Array, tolerance: float) -> Array:
    """(m, n_row) combinations of rows (n_row, n_point) that are orthonormal under the weights (n_point,).

    Combinations below `tolerance` times the largest one are left out. Of many points some tell.
    """
    step = max(1, weight.size // (TELLING * len(rows)))
    scaled = rows[:, ::step] * np.sqrt(step * weight[::step])
    square, turn = eigh(dsyrk(1.0, scaled, lower=1), overwrite_a=True, driver="evd")
    kept = square > max(tolerance**2, 1e-13) * square[-1]
    return np.asarray((turn[:, kept] / np.sqrt(square[kept])).T)


def sparse_weights(rows: Array, weight: Array, *, tolerance: float) -> tuple[Indices, Array]:
    """Points and their positive weights, that keep the sums of the rows (n_row, n_point), the principal ones best.

    The sum of the weights is kept as well.
    """
    directions = principal_directions(rows, weight, tolerance)
    m = len(directions) + 1
    target, constant, columns = rows @ weight, weight.sum() ** -0.5, np.ascontiguousarray(rows.T)
    points, weight = np.arange(weight.size), weight.copy()
    while points.size > m:
        n_group = min(GROUPS * m, points.size)
        group = np.arange(points.size) * n_group // points.size
        begin = np.searchsorted(group, np.arange(n_group + 1))
        size = np.add.reduceat(weight, begin[:-1])
        mean = (
            directions @ (sparse.csr_matrix((weight / size[group], points, begin), (n_group, len(columns))) @ columns).T
        )
        factor = fewest(np.vstack([mean, np.full(n_group, constant)]), size) / size
        weight = weight * factor[group]
        kept = weight > 0
        points, weight = points[kept], weight[kept]
    return _polished(rows, target, points, weight)


def _polished(rows: Array, target: Array, points: Indices, weight: Array) -> tuple[Indices, Array]:
    """The weights moved as little as keeps the rows' own sums best; points of negative ones are left out."""
    while True:
        columns = rows[:, points]
        size = np.linalg.norm(columns, axis=0)
        size[size == 0.0] = 1.0
        columns = columns / size
        square = columns.T @ columns
        square.flat[:: points.size + 1] += RIDGE
        missing = target - rows[:, points] @ weight
        moved = weight + cho_solve(cho_factor(square, check_finite=False), columns.T @ missing) / size
        if (moved > 0).all():
            return points, moved
        kept = moved > 0
        points, weight = points[kept], weight[kept]


def fewest(columns: Array, weight: Array) -> Array:
    """Weights (n,) with the same columns @ weight, columns (m, n), of which at most m are positive, the others 0."""
    weight = weight.copy()
    _eliminate(null_space(columns), weight)
    return np.maximum(weight, 0.0)


def null_space(columns: Array) -> Array:
    """(n - m, n) independent vectors that the columns (m, n) map to 0, from factors L U of the transposed matrix.

    With columns^T = P (L_1; L_2) U they are (-L_2 L_1^-1, I) P^T; row exchanges keep L well-conditioned, whatever U is.
    """
    m, n = columns.shape
    factors, exchanged, _ = dgetrf(columns.T)
    order = np.arange(n)
    for k, other in enumerate(exchanged):
        order[[k, other]] = order[[other, k]]
    free = np.zeros((max(n - m, 0), n))
    if n > m:
        free[:, order[:m]] = -dtrsm(1.0, factors[:m], factors[m:], side=1, lower=1, diag=1)
        free[np.arange(n - m), order[m:]] = 1.0
    return free


@compiled
def _eliminate(free: Array, weight: Array) -> None:
    """Moves the weights (n,) along vectors (k, n) that change no sum until a weight is 0, one for each; both written.

    The other vectors are freed of the weight that has gone.
    """
    for k in range(free.shape[0]):
        along = free[k]
        if along.max() < -along.min():
            along = -along
        step, out = np.inf, 0
        for j in range(weight.size):
            if along[j] > NO_PIVOT and weight[j] < step * along[j]:
                step, out = weight[j] / along[j], j
        for j in range(weight.size):
            weight[j] -= step * along[j]
        weight[out] = 0.0
        for row in range(k + 1, free.shape[0]):
            share = free[row, out] / along[out]
            for j in range(weight.size):
                free[row, j] -= share * along[j]
            free[row, out] = 0.0
