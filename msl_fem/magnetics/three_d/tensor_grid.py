"""Boxes between the planes of three axes: nodes of a polynomial degree, where the planes lie, which nodes meet."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array

Indices = NDArray[np.int64]
SAME = 1e-9  # of the box: planes that are closer are one


@dataclass(frozen=True)
class SizeNear:
    """Elements are no longer than `size` (m) at a coordinate (m), and grow from there."""

    coordinate: float
    size: float


@dataclass(frozen=True, eq=False)
class TensorGrid:
    """Boxes between planes; nodes are numbered with z fastest.

    Attributes
    ----------
    planes : of x, y and z, (n_x + 1,), (n_y + 1,), (n_z + 1,) in m, ascending
    order : polynomial degree of the elements, 1 or 2
    """

    planes: tuple[Array, Array, Array]
    order: int = 2

    @property
    def cells(self) -> tuple[int, int, int]:
        x, y, z = self.planes
        return x.size - 1, y.size - 1, z.size - 1

    @property
    def nodes(self) -> tuple[int, int, int]:
        n_x, n_y, n_z = self.cells
        return n_x * self.order + 1, n_y * self.order + 1, n_z * self.order + 1

    @property
    def n_nodes(self) -> int:
        return int(np.prod(self.nodes))

    @cached_property
    def sizes(self) -> tuple[Array, Array, Array]:
        """Edge lengths of the boxes along x, y and z in m."""
        x, y, z = (np.diff(planes) for planes in self.planes)
        return x, y, z

    @cached_property
    def volumes(self) -> Array:
        """m3 of the boxes, (n_cell,)."""
        x, y, z = self.sizes
        return np.einsum("i,j,k->ijk", x, y, z).ravel()

    def axis_nodes(self, axis: int) -> Array:
        """Coordinates of the nodes along an axis, (n,) m."""
        planes, size = self.planes[axis], self.sizes[axis]
        share = np.arange(self.order) / self.order
        return np.append((planes[:-1, None] + size[:, None] * share).ravel(), planes[-1])

    def centres(self) -> tuple[Array, Array, Array]:
        """x, y, z of the boxes' centres, (n_cell,) m each."""
        middle = [(planes[1:] + planes[:-1]) / 2 for planes in self.planes]
        x, y, z = np.meshgrid(*middle, indexing="ij")
        return x.ravel(), y.ravel(), z.ravel()

    def points(self, share: Array) -> tuple[Array, Array, Array]:
        """x, y, z in m, (n_cell, n_point) each, of points of every box; `share` (n_point, 3) of its edges."""
        corners = np.meshgrid(*(planes[:-1] for planes in self.planes), indexing="ij")
        edges = np.meshgrid(*self.sizes, indexing="ij")
        x, y, z = (
            corner.ravel()[:, None] + edge.ravel()[:, None] * share[None, :, axis]
            for axis, (corner, edge) in enumerate(zip(corners, edges, strict=True))
        )
        return x, y, z

    def interpolation(self, target: "TensorGrid") -> "AxisMatrices":
        """The matrices, one an axis, that take values at this grid's nodes to the nodes of another of the same box."""
        x, y, z = (self._axis_interpolation(axis, target.axis_nodes(axis)) for axis in range(3))
        return AxisMatrices((x, y, z))

    def _axis_interpolation(self, axis: int, at: Array) -> Array:
        planes = self.planes[axis]
        cell = np.clip(np.searchsorted(planes, at, side="right") - 1, 0, planes.size - 2)
        values = basis_values(self.order, (at - planes[cell]) / self.sizes[axis][cell])
        matrix = np.zeros((at.size, self.nodes[axis]))
        for k in range(self.order + 1):
            matrix[np.arange(at.size), cell * self.order + k] += values[:, k]
        return matrix


@dataclass(frozen=True, eq=False)
class AxisMatrices:
    """A product of one matrix an axis, applied to values at nodes."""

    matrices: tuple[Array, Array, Array]

    def __call__(self, values: Array) -> Array:
        x, y, z = self.matrices
        shaped = values.reshape(x.shape[1], y.shape[1], z.shape[1])
        return np.einsum("ai,bj,ck,ijk->abc", x, y, z, shaped, optimize=True).ravel()


def basis_values(order: int, t: Array) -> Array:
    """Lagrange's polynomials on equidistant nodes of [0, 1], at t (n,): (n, order + 1)."""
    nodes = np.arange(order + 1) / order
    values = np.ones((t.size, order + 1))
    for k in range(order + 1):
        for other in np.delete(nodes, k):
            values[:, k] *= (t - other) / (nodes[k] - other)
    return values


def basis_slopes(order: int, t: Array) -> Array:
    """Slopes of `basis_values` at t (n,): (n, order + 1)."""
    nodes = np.arange(order + 1) / order
    slopes = np.zeros((t.size, order + 1))
    for k in range(order + 1):
        polynomial = np.poly1d(np.delete(nodes, k), r=True)
        slopes[:, k] = (polynomial.deriv() / polynomial(nodes[k]))(t)
    return slopes


def graded_planes(
    breaks: Sequence[float], near: Sequence[SizeNear], *, growth: float, refinement: float = 1.0
) -> Array:
    """Planes through all breaks; between them as many more as the sizes ask for, (n,) m.

    At x the length may be the least of size + growth |x - coordinate|; each interval is cut where the integral of the
    inverse length passes equal shares. `refinement` multiplies the number of elements.
    """
    ends = np.unique(np.asarray(breaks, dtype=float))
    ends = ends[np.r_[True, np.diff(ends) > SAME * (ends[-1] - ends[0])]]
    planes = [ends[:1]]
    for a, b in zip(ends[:-1], ends[1:], strict=True):
        fine = np.linspace(a, b, 401)
        length = np.min([s.size + growth * np.abs(fine - s.coordinate) for s in near], axis=0)
        middle = 2 / (length[1:] + length[:-1])
        passed = np.r_[0.0, np.cumsum(middle * np.diff(fine))]
        parts = max(1, round(refinement * passed[-1]))
        inner = np.interp(np.linspace(0, passed[-1], parts + 1)[1:-1], passed, fine)
        planes.append(np.r_[inner, b])
    return np.concatenate(planes)


def axis_reach(n_cells: int, order: int) -> tuple[Indices, Indices]:
    """Along one axis the first node that shares an element with a node, and how many do; (n_node,) each."""
    node = np.arange(n_cells * order + 1)
    at_plane = node % order == 0
    first = np.where(at_plane, node - order, node - node % order)
    last = np.where(at_plane, node + order, node - node % order + order)
    first, last = np.maximum(first, 0), np.minimum(last, n_cells * order)
    return first, last - first + 1
