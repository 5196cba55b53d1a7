"""Symmetric systems of a reduced space's size at many states: made, factored and solved in compiled loops."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.dense_front import backward, eliminate, forward
from msl_fem.materials.curves import Indices


class SystemsAt:
    """The linear regions' stiffness at n states, and the factors of their tangents.

    Parameters
    ----------
    stiffness, place : (n_q, N, N) at each coordinate, and (n,) which of these
    """

    def __init__(self, stiffness: Array, place: Indices) -> None:
        self.stiffness, self.place = stiffness, place
        self._upper = np.empty((place.size, *stiffness.shape[1:]))
        self._inverse = np.empty(self._upper.shape[:2])

    def products(self, at: Indices, vectors: Array) -> Array:
        """(n_at, r, N) the stiffness at some states times vectors of this shape."""
        return linear_products(self.stiffness, self.place[at], vectors)

    def factor(self, at: Indices, tangents: Array) -> NDArray[np.bool_]:
        """Factor the stiffness plus tangents (n_at, N (N + 1)/2), upper triangles; (n_at,) whether it is definite."""
        return _factor(tangents, self.stiffness, self.place[at], at, self._upper, self._inverse)

    def substitute(self, at: Indices, rights: Array) -> Array:
        """(n_at, r, N) the inverses of the matrices last factored at some states times `rights` of this shape."""
        found = rights.copy()
        _substitute(self._upper, self._inverse, at, found)
        return found


@compiled
def linear_products(matrices: Array, place: Indices, vectors: Array) -> Array:
    """(n, r, N) of symmetric matrices (n_q, N, N), `place` (n,) says which, times vectors of this shape."""
    out = np.zeros(vectors.shape)
    size = np.uint64(vectors.shape[2])
    for k in range(place.size):
        matrix = matrices[place[k]]
        for m in range(vectors.shape[1]):
            vector, own = vectors[k, m], out[k, m]
            for i in range(vector.size):
                row, value = matrix[i], vector[i]
                for j in range(size):
                    own[j] += value * row[j]
    return out


@compiled
def _factor(
    tangents: Array, stiffness: Array, place: Indices, at: Indices, upper: Array, inverse: Array
) -> NDArray[np.bool_]:
    """As `SystemsAt.factor`; factors are written."""
    size = stiffness.shape[1]
    definite, nothing = np.empty(at.size, dtype=np.bool_), np.empty((0, size))
    for k in range(at.size):
        panel, matrix, own = upper[at[k]], stiffness[place[k]], tangents[k]
        begin = 0
        for i in range(size):
            source, target, packed = matrix[i], panel[i], own[begin : begin + size - i]
            for j in range(size - i):
                target[i + j] = source[i + j] + packed[j]
            begin += size - i
        definite[k] = eliminate(panel, inverse[at[k]], nothing) and inverse[at[k]].min() > 0.0
    return definite


@compiled
def _substitute(upper: Array, inverse: Array, at: Indices, rights: Array) -> None:
    """As `SystemsAt.substitute`, in place."""
    nothing, own = np.empty(0, dtype=np.int64), np.empty(upper.shape[1])
    for k in range(at.size):
        for m in range(rights.shape[1]):
            forward(upper[at[k]], inverse[at[k]], rights[k, m], nothing, rights[k, m], own)
            backward(upper[at[k]], inverse[at[k]], rights[k, m], nothing, rights[k, m], own)
