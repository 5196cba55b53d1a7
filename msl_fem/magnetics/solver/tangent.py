"""Symmetric matrices of one sparsity pattern, put together from pieces: values, products, factors of the last one."""

from collections.abc import Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import NotConverged
from msl_fem.magnetics.solver.factors import SymmetricFactors

REFINEMENTS = 1
Indices = NDArray[np.int64]
Places = NDArray[np.int32]


@compiled
def _times_upper(
    rows: NDArray[np.int32], starts: NDArray[np.int32], data: Array, free: Indices, vector: Array
) -> Array:
    """(n,) of a symmetric matrix over the free entries, given by its upper triangle, and a vector (n,); else 0."""
    inner, product, out = np.empty(free.size), np.zeros(free.size), np.zeros(vector.size)
    for column in range(free.size):
        inner[column] = vector[free[column]]
        value, total = inner[column], 0.0
        for k in range(starts[column], starts[column + 1]):
            row = rows[k]
            if row == column:
                total += data[k] * value
                continue
            product[row] += data[k] * value
            total += data[k] * inner[row]
        product[column] += total
    for column in range(free.size):
        out[free[column]] = product[column]
    return out


class SparseTangent:
    """The pattern of all matrices that are sums of pieces, and the factors of the last one factored.

    Only the upper triangle over the free unknowns is kept; what lies elsewhere in a piece is left out.

    Parameters
    ----------
    free, n : the free unknowns among n
    pieces : rows and columns of the values of each piece, of one shape
    """

    def __init__(self, free: Indices, n: int, pieces: Sequence[tuple[Indices, Indices]]) -> None:
        self._free = free
        number = np.full(n, -1)
        number[free] = np.arange(free.size)
        used, keys = [], []
        for piece in pieces:
            rows, columns = (number[indices.ravel()] for indices in piece)
            inside = np.flatnonzero((rows >= 0) & (rows <= columns))
            used.append(inside)
            keys.append(columns[inside] * free.size + rows[inside])
        unique, place = np.unique(np.concatenate(keys), return_inverse=True)
        starts = np.cumsum([k.size for k in keys])[:-1]
        self._pieces = list(zip(used, np.split(place, starts), strict=True))
        self.nnz = unique.size
        columns, rows = np.divmod(unique, free.size)
        starts = np.searchsorted(columns, np.arange(free.size + 1))
        self._pattern = rows.astype(np.int32), starts.astype(np.int32)
        self._factors: SymmetricFactors | None = None  # ordered once for all values
        self._factored = False

    def unfactored(self) -> "SparseTangent":
        """The same pattern for a matrix of its own."""
        other = copy(self)
        other._factors = None if self._factors is None else self._factors.with_room_of_its_own()
        other._factored = False
        return other

    def gather(self, piece: int, values: Array) -> Array:
        """A piece's values summed into the pattern, (nnz,)."""
        used, place = self._pieces[piece]
        return np.asarray(np.bincount(place, values.reshape(-1)[used], minlength=self.nnz), dtype=float)

    def places(self, piece: int, shape: tuple[int, ...]) -> Places:
        """Where in the pattern a piece's values belong, of their shape; -1 for those that are left out."""
        used, place = self._pieces[piece]
        places = np.full(shape, -1, dtype=np.int32)
        places.ravel()[used] = place
        return places

    def factor(self, data: Array) -> None:
        """Factor the matrix whose values (nnz,) are given; NotConverged where it is singular."""
        if self._factors is None:
            self._factors = SymmetricFactors(*self._pattern)
        self._factored = self._factors.factor(data)
        if not self._factored:
            raise NotConverged("the tangent is singular; check the iron's B-H curve")

    def substitute(self, right: Array) -> Array:
        """The inverse of the matrix last factored times `right`, both (n,) or (k, n); fixed entries are zero."""
        assert self._factors is not None, "a matrix has been factored"
        assert self._factored, "a matrix has been factored"
        found = self._factors.substitute(np.atleast_2d(right), self._free)
        return found.reshape(right.shape)

    def product(self, data: Array, vector: Array) -> Array:
        """The matrix of these values times a vector (n,) that is zero at fixed entries, as is the answer."""
        return _times_upper(*self._pattern, data, self._free, vector)

    def refined_substitute(self, right: Array, data: Array) -> Array:
        """The inverse of the matrix of these values times `right`, (n,), from the factors of one nearby."""
        answer = self.substitute(right)
        for _ in range(REFINEMENTS):
            answer += self.substitute(right - self.product(data, answer))
        return answer
