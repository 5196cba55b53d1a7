"""Elements of a tensor grid, compiled: H at the integration points, the coenergy's slope and curvature.

The arrays of points are (n_cell, n_point, ...); a matrix is the data of compressed rows whose columns are, for each
node, the product of three intervals (`tensor_grid.axis_reach`), so that a place in it is computed, not looked up.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.three_d.coenergy_law import CoenergyCurves, respond
from msl_fem.magnetics.three_d.tensor_grid import TensorGrid, axis_reach, basis_slopes, basis_values

Indices = NDArray[np.int64]


class Elements(NamedTuple):
    """A tensor grid as compiled code reads it.

    Attributes
    ----------
    cells, nodes : along x, y and z
    order : polynomial degree
    x, y, z : edge lengths in m
    weights : (n_point,) of the integration points, of a box of volume 1
    gradient : (n_point, n_local, 3) of the basis, on a box of edge 1
    """

    cells: tuple[int, int, int]
    nodes: tuple[int, int, int]
    order: int
    x: Array
    y: Array
    z: Array
    weights: Array
    gradient: Array


class MatrixRows(NamedTuple):
    """The rows of a matrix over a grid's nodes: where each begins, and its interval of columns along each axis."""

    begin: NDArray[np.int32]
    first_x: Indices
    count_x: Indices
    first_y: Indices
    count_y: Indices
    first_z: Indices
    count_z: Indices


def integration_points(order: int) -> tuple[Array, Array]:
    """Gauss points (n_point, 3) and weights (n_point,) of a box of edge 1, order + 1 along each axis."""
    t, weight = np.polynomial.legendre.leggauss(order + 1)
    t, weight = (t + 1) / 2, weight / 2
    points = np.stack(np.meshgrid(t, t, t, indexing="ij"), axis=-1).reshape(-1, 3)
    return points, np.einsum("i,j,k->ijk", weight, weight, weight).ravel()


def basis_gradient(order: int, points: Array) -> Array:
    """(n_point, n_local, 3): the gradient of the basis on a box of edge 1; the last axis' index runs fastest."""
    value = [basis_values(order, points[:, axis]) for axis in range(3)]
    slope = [basis_slopes(order, points[:, axis]) for axis in range(3)]
    parts = []
    for axis in range(3):
        x, y, z = (slope[k] if k == axis else value[k] for k in range(3))
        parts.append(np.einsum("qa,qb,qc->qabc", x, y, z).reshape(points.shape[0], -1))
    return np.ascontiguousarray(np.stack(parts, axis=-1))


def elements_of(grid: TensorGrid) -> Elements:
    """A grid for compiled code."""
    points, weights = integration_points(grid.order)
    return Elements(grid.cells, grid.nodes, grid.order, *grid.sizes, weights, basis_gradient(grid.order, points))


def matrix_rows(grid: TensorGrid) -> tuple[MatrixRows, NDArray[np.int32]]:
    """The rows of the grid's matrices, and the columns of all entries."""
    reach = [axis_reach(n, grid.order) for n in grid.cells]
    counts = np.einsum("i,j,k->ijk", *(count for _, count in reach)).ravel()
    begin = np.r_[0, np.cumsum(counts)].astype(np.int32)
    (first_x, count_x), (first_y, count_y), (first_z, count_z) = reach
    rows = MatrixRows(begin, first_x, count_x, first_y, count_y, first_z, count_z)
    return rows, _columns(rows, grid.nodes)


@compiled
def _columns(rows: MatrixRows, nodes: tuple[int, int, int]) -> NDArray[np.int32]:
    columns = np.empty(rows.begin[-1], dtype=np.int32)
    place = 0
    for i in range(nodes[0]):
        for j in range(nodes[1]):
            for k in range(nodes[2]):
                for a in range(rows.first_x[i], rows.first_x[i] + rows.count_x[i]):
                    for b in range(rows.first_y[j], rows.first_y[j] + rows.count_y[j]):
                        for c in range(rows.first_z[k], rows.first_z[k] + rows.count_z[k]):
                            columns[place] = (a * nodes[1] + b) * nodes[2] + c
                            place += 1
    return columns


@compiled
def _local_nodes(cell: int, grid: Elements, nodes: Indices) -> None:
    """The numbers of a box's nodes."""
    k = cell % grid.cells[2]
    j = cell // grid.cells[2] % grid.cells[1]
    i = cell // (grid.cells[2] * grid.cells[1])
    place = 0
    for a in range(grid.order + 1):
        for b in range(grid.order + 1):
            base = ((i * grid.order + a) * grid.nodes[1] + j * grid.order + b) * grid.nodes[2] + k * grid.order
            for c in range(grid.order + 1):
                nodes[place] = base + c
                place += 1


@compiled
def _edges(cell: int, grid: Elements, edges: Array) -> float:
    """A box's edge lengths; returns its volume."""
    edges[0] = grid.x[cell // (grid.cells[2] * grid.cells[1])]
    edges[1] = grid.y[cell // grid.cells[2] % grid.cells[1]]
    edges[2] = grid.z[cell % grid.cells[2]]
    return edges[0] * edges[1] * edges[2]


@compiled
def potential_gradient(potential: Array, grid: Elements) -> Array:
    """The potential's gradient at the integration points, (n_cell, n_point, 3)."""
    n_cell = grid.cells[0] * grid.cells[1] * grid.cells[2]
    n_point, n_local = grid.gradient.shape[:2]
    out = np.zeros((n_cell, n_point, 3))
    nodes, edges = np.empty(n_local, dtype=np.int64), np.empty(3)
    for cell in range(n_cell):
        _local_nodes(cell, grid, nodes)
        _edges(cell, grid, edges)
        for q in range(n_point):
            for a in range(n_local):
                value = potential[nodes[a]]
                for k in range(3):
                    out[cell, q, k] += value * grid.gradient[q, a, k]
            for k in range(3):
                out[cell, q, k] /= edges[k]
    return out


@compiled
def respond_everywhere(field: Array, iron: Indices, curves: CoenergyCurves) -> tuple[Array, Array, Array]:
    """Coenergy density (n_cell, n_point), B (..., 3) and dB/dH (..., 6) at H (n_cell, n_point, 3)."""
    n_cell, n_point = field.shape[:2]
    coenergy = np.empty((n_cell, n_point))
    flux, tangent = np.empty((n_cell, n_point, 3)), np.empty((n_cell, n_point, 6))
    for cell in range(n_cell):
        for q in range(n_point):
            coenergy[cell, q] = respond(field[cell, q], iron[cell], curves, flux[cell, q], tangent[cell, q])
    return coenergy, flux, tangent


@compiled
def divergence(flux: Array, grid: Elements) -> Array:
    """Minus the integral of B times the gradient of each node's basis, (n_node,): the coenergy's slope in Wb."""
    n_cell = grid.cells[0] * grid.cells[1] * grid.cells[2]
    n_point, n_local = grid.gradient.shape[:2]
    out = np.zeros(grid.nodes[0] * grid.nodes[1] * grid.nodes[2])
    nodes, edges = np.empty(n_local, dtype=np.int64), np.empty(3)
    for cell in range(n_cell):
        _local_nodes(cell, grid, nodes)
        volume = _edges(cell, grid, edges)
        for q in range(n_point):
            for a in range(n_local):
                inner = 0.0
                for k in range(3):
                    inner += flux[cell, q, k] * grid.gradient[q, a, k] / edges[k]
                out[nodes[a]] -= volume * grid.weights[q] * inner
    return out


@compiled
def _cell_matrix(tangent: Array, volume: float, edges: Array, grid: Elements, pulled: Array, matrix: Array) -> None:
    """The curvature of one box: the lower half of `matrix` is overwritten; `pulled` is room for (n_local, 3)."""
    n_point, n_local = grid.gradient.shape[:2]
    matrix[:] = 0.0
    for q in range(n_point):
        weight = volume * grid.weights[q]
        xx = tangent[q, 0] * weight / edges[0] ** 2
        yy = tangent[q, 1] * weight / edges[1] ** 2
        zz = tangent[q, 2] * weight / edges[2] ** 2
        xy = tangent[q, 3] * weight / (edges[0] * edges[1])
        xz = tangent[q, 4] * weight / (edges[0] * edges[2])
        yz = tangent[q, 5] * weight / (edges[1] * edges[2])
        for a in range(n_local):
            x, y, z = grid.gradient[q, a, 0], grid.gradient[q, a, 1], grid.gradient[q, a, 2]
            pulled[a, 0] = xx * x + xy * y + xz * z
            pulled[a, 1] = xy * x + yy * y + yz * z
            pulled[a, 2] = xz * x + yz * y + zz * z
        for a in range(n_local):
            x, y, z = pulled[a, 0], pulled[a, 1], pulled[a, 2]
            for b in range(a + 1):
                gradient = grid.gradient[q, b]
                matrix[a, b] += x * gradient[0] + y * gradient[1] + z * gradient[2]


@compiled
def curvature(tangent: Array, grid: Elements, rows: MatrixRows) -> Array:
    """The entries of the coenergy's curvature, the integral of grad_a . dB/dH . grad_b, in the order of `rows`."""
    n_cell = grid.cells[0] * grid.cells[1] * grid.cells[2]
    n_local = grid.gradient.shape[1]
    data = np.zeros(rows.begin[-1])
    nodes, edges = np.empty(n_local, dtype=np.int64), np.empty(3)
    pulled, matrix = np.empty((n_local, 3)), np.empty((n_local, n_local))
    n_y, n_z = grid.nodes[1], grid.nodes[2]
    for cell in range(n_cell):
        _local_nodes(cell, grid, nodes)
        volume = _edges(cell, grid, edges)
        _cell_matrix(tangent[cell], volume, edges, grid, pulled, matrix)
        for a in range(n_local):
            i, j, k = nodes[a] // (n_y * n_z), nodes[a] // n_z % n_y, nodes[a] % n_z
            for b in range(n_local):
                u, v, w = nodes[b] // (n_y * n_z), nodes[b] // n_z % n_y, nodes[b] % n_z
                place = (u - rows.first_x[i]) * rows.count_y[j] + v - rows.first_y[j]
                place = rows.begin[nodes[a]] + place * rows.count_z[k] + w - rows.first_z[k]
                data[place] += matrix[a, b] if b <= a else matrix[b, a]
    return data
