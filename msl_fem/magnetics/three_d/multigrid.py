"""Conjugate gradients for a matrix on a tensor grid, preconditioned by multigrid on the same nodes.

On the nodes of second-order elements the linear elements of half their size, and with masses lumped the seven-point
differences, are spectrally equivalent to the second-order matrix whatever the sizes (Deville and Mund, SIAM J. Sci.
Stat. Comput. 11, 1990): the number of steps does not grow with the grid. The seven-point matrix has no positive
entries beside its diagonal, so that classical algebraic multigrid (Ruge and Stueben, 1987) takes its long thin boxes
and its jumps of permeability. What it does not know, the second order and the direction of a saturated iron's slope,
is of short range: a sweep of Gauss and Seidel on the matrix itself before and after takes it (on E1 in saturation 46
steps in place of 274).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.three_d.tensor_grid import TensorGrid

if TYPE_CHECKING:  # imported where a matrix is solved: most users never do
    from scipy.sparse import csr_array

MOST_STEPS = 300
HELD = 1e12
"""What the diagonal of a held node is multiplied by."""
Indices = NDArray[np.int32]
Preconditioner = Callable[[Array], Array]


@dataclass(frozen=True)
class LinearAnswer:
    """The solution of a linear system and the steps of conjugate gradients that it took."""

    values: Array
    steps: int


def seven_points(grid: TensorGrid, permeability: Array, held: NDArray[np.bool_]) -> "csr_array":
    """The differences between neighbouring nodes, weighted by the permeability (n_cell, 3) along each axis.

    Each box is cut at its nodes; an edge between two nodes carries a quarter of each box part around it.
    """
    from scipy.sparse import coo_array

    order = grid.order
    shaped = permeability.reshape(*grid.cells, 3)
    for axis in range(3):
        shaped = np.repeat(shaped, order, axis=axis)
    sizes = [np.repeat(size / order, order) for size in grid.sizes]
    number = np.arange(grid.n_nodes).reshape(grid.nodes)
    begins, ends, links = [], [], []
    for axis in range(3):
        across = [k for k in range(3) if k != axis]
        link = shaped[..., axis] / _along(sizes[axis], axis)
        for k in across:
            part = link * _along(sizes[k], k) / 2
            pad = [(0, 0)] * 3
            pad[k] = (1, 1)
            padded = np.pad(part, pad)
            link = np.take(padded, range(1, padded.shape[k]), k) + np.take(padded, range(padded.shape[k] - 1), k)
        n = number.shape[axis]
        begins.append(np.take(number, range(n - 1), axis).ravel())
        ends.append(np.take(number, range(1, n), axis).ravel())
        links.append(link.ravel())
    a, b, link = np.concatenate(begins), np.concatenate(ends), np.concatenate(links)
    diagonal = np.bincount(a, link, grid.n_nodes) + np.bincount(b, link, grid.n_nodes)
    diagonal = np.where(held, HELD * diagonal, diagonal)
    nodes = number.ravel()
    rows, columns = np.concatenate([a, b, nodes]), np.concatenate([b, a, nodes])
    return coo_array((np.concatenate([-link, -link, diagonal]), (rows, columns))).tocsr()


def _along(values: Array, axis: int) -> Array:
    shape = [1, 1, 1]
    shape[axis] = values.size
    return values.reshape(shape)


def preconditioner(matrix: "csr_array", points: "csr_array") -> Preconditioner:
    """A sweep on the matrix, one V cycle of classical multigrid on its seven points, and the sweep backwards.

    Raises
    ------
    InputError : pyamg is missing
    """
    try:
        import pyamg
    except ImportError as err:
        raise InputError("three dimensions need pyamg; install it: pip install 'msl-fem[three-d]'") from err
    from scipy.sparse import csr_matrix

    levels = pyamg.ruge_stuben_solver(csr_matrix(points), max_coarse=200, coarse_solver="splu")
    cycle = levels.aspreconditioner(cycle="V")

    def precondition(right: Array) -> Array:
        x = np.zeros_like(right)
        _sweep(matrix.indptr, matrix.indices, matrix.data, x, right, 1)
        x += cycle.matvec(right - matrix @ x)
        _sweep(matrix.indptr, matrix.indices, matrix.data, x, right, -1)
        return x

    return precondition


@compiled
def _sweep(begin: Indices, columns: Indices, entries: Array, x: Array, right: Array, way: int) -> None:
    """Gauss and Seidel: each unknown in turn from its row, forwards (1) or backwards (-1)."""
    for k in range(x.size):
        row = k if way > 0 else x.size - 1 - k
        rest, diagonal = right[row], 0.0
        for place in range(begin[row], begin[row + 1]):
            if columns[place] == row:
                diagonal = entries[place]
            else:
                rest -= entries[place] * x[columns[place]]
        x[row] = rest / diagonal


def conjugate_gradients(
    matrix: "csr_array", right: Array, precondition: Preconditioner, *, drop: float
) -> LinearAnswer:
    """The solution to a residual of `drop` of the right side's, both in the preconditioner's norm.

    Raises
    ------
    ComputationError : not reached in 300 steps
    """
    x, residual = np.zeros_like(right), right.copy()
    image = precondition(residual)
    direction = image.copy()
    size = target = float(residual @ image)
    for step in range(MOST_STEPS):
        if size <= drop**2 * target:
            return LinearAnswer(x, step)
        product = matrix @ direction
        length = size / float(direction @ product)
        x += length * direction
        residual -= length * product
        image = precondition(residual)
        size, former = float(residual @ image), size
        direction = image + size / former * direction
    raise ComputationError(f"conjugate gradients did not converge in {MOST_STEPS} steps; give a coarser accuracy")
