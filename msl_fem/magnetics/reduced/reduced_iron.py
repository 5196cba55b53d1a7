"""The irons' energy in a reduced space: gradient and second derivative at many states, by a quadrature."""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.materials.curves import NO_FIELD, Curves, Indices, magnetise_all


class ReducedIron(NamedTuple):
    """Quadrature of the irons' energy in a reduced space of N functions.

    Attributes
    ----------
    gradients : (2 n_point, N) both derivatives of each function, point after point; their size is |B|
    weight : (n_point,) positive
    iron : (n_point,) which of the curves
    """

    gradients: Array
    weight: Array
    iron: Indices
    curves: Curves


@compiled
def magnetise_fields(field: Array, iron: ReducedIron, curvature: Array) -> None:
    """Gradients (n, 2 n_point) of states to weighted H, in place; `curvature` (n, 3 n_point) is written unless empty.

    It holds w dH/dB: all its xx entries, then xy, then yy. With n = B/|B|: dH/dB = H/B + (dH/d|B| - H/B) n n^T.
    """
    n_point = iron.weight.size
    size, h, slope = np.empty(n_point), np.empty(n_point), np.empty(n_point)
    for k in range(field.shape[0]):
        for q in range(n_point):
            size[q] = np.sqrt(field[k, 2 * q] ** 2 + field[k, 2 * q + 1] ** 2)
        magnetise_all(size, iron.iron, iron.curves, h, slope)
        for q in range(n_point):
            x, y, b, w = field[k, 2 * q], field[k, 2 * q + 1], size[q], iron.weight[q]
            nu, excess = slope[q], 0.0
            if b > NO_FIELD:
                nu = h[q] / b
                excess = (slope[q] - nu) / (b * b)
            field[k, 2 * q], field[k, 2 * q + 1] = w * nu * x, w * nu * y
            if curvature.size:
                curvature[k, q] = w * (nu + excess * x * x)
                curvature[k, n_point + q] = w * excess * x * y
                curvature[k, 2 * n_point + q] = w * (nu + excess * y * y)


@compiled
def products_of(gradients: Array) -> Array:
    """(3 n_point, N (N + 1)/2) what the entries of `curvature` are multiplied by in a tangent's upper triangle."""
    n_point, size = gradients.shape[0] // 2, gradients.shape[1]
    products = np.empty((3 * n_point, size * (size + 1) // 2))
    for q in range(n_point):
        x, y = gradients[2 * q], gradients[2 * q + 1]
        place = 0
        for i in range(size):
            for j in range(i, size):
                products[q, place] = x[i] * x[j]
                products[n_point + q, place] = x[i] * y[j] + y[i] * x[j]
                products[2 * n_point + q, place] = y[i] * y[j]
                place += 1
    return products


class IronTerms:
    """Gradient and tangent of the irons' energy at states; many of these share the gradients' products.

    Parameters
    ----------
    iron : the quadrature
    many : whether there will be many states
    """

    def __init__(self, iron: ReducedIron, *, many: bool) -> None:
        self.iron = iron
        self.products = products_of(iron.gradients) if many else None
        self._rows = np.ascontiguousarray(iron.gradients.T)
        self._upper = np.triu_indices(len(self._rows))

    def at(self, states: Array) -> tuple[Array, Array]:
        """(n, N) the gradient and (n, 3 n_point) the curvature at states (n, N)."""
        field = states @ self.iron.gradients.T
        curvature = np.empty((len(states), 3 * self.iron.weight.size))
        magnetise_fields(field, self.iron, curvature)
        return field @ self.iron.gradients, curvature

    def tangents(self, curvature: Array) -> Array:
        """(n, N (N + 1)/2) of the tangents' upper triangles, row after row."""
        if self.products is not None:
            return np.asarray(curvature @ self.products)
        field = np.repeat(self._rows[None], len(curvature), axis=0)
        _bend_fields(field, curvature)
        return np.asarray((field @ self.iron.gradients)[:, *self._upper])

    def along(self, curvature: Array, vectors: Array) -> Array:
        """(n, r, N) the tangents times r vectors each (n, r, N)."""
        gradients = self.iron.gradients
        field = vectors.reshape(-1, gradients.shape[1]) @ gradients.T
        _bend_fields(field.reshape(*vectors.shape[:2], -1), curvature)
        return (field @ gradients).reshape(vectors.shape)


@compiled
def _bend_fields(field: Array, curvature: Array) -> None:
    """Gradients (n, r, 2 n_point) times the second derivative of the energy at their points, in place."""
    n_point = curvature.shape[1] // 3
    for k in range(field.shape[0]):
        for m in range(field.shape[1]):
            for q in range(n_point):
                x, y = field[k, m, 2 * q], field[k, m, 2 * q + 1]
                xx, xy, yy = curvature[k, q], curvature[k, n_point + q], curvature[k, 2 * n_point + q]
                field[k, m, 2 * q], field[k, m, 2 * q + 1] = xx * x + xy * y, xy * x + yy * y
