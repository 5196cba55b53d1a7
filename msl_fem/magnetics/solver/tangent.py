"""The exact tangent: element matrices of one iron, put together into symmetric matrices of one sparsity pattern.

On every element B is a linear map F, its frame, of the jet of A on the reference triangle: the derivatives along two
sides and, with axial symmetry, the value. The frame is the element's own, the shape functions' jets are the same for
all: an element matrix is a short vector, w F^T T F at the points, times a constant table of products of jets, and all
of them are one product of two dense matrices (Kirby and Logg, A compiler for variational forms, 2006).
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import qdldl
from numpy.typing import NDArray
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.errors import NotConverged
from msl_fem.materials.material import AnalyticIron, Iron

NO_FIELD = 1e-12  # T: below it H is taken as linear in B
REFINEMENTS = 1


@dataclass(frozen=True, eq=False)
class ElementGeometry:
    """Some elements of one degree, and their quadrature.

    Attributes
    ----------
    dofs : (element, local) degrees of freedom
    jets : (local, jet, point) derivatives along the reference triangle's sides (and value) of its shape functions
    frame : (2, jet, element, point or 1) jet to (dA/dx, dA/dy), or (dA/dr + A/r, dA/dz), whose size is |B|
    weight : (element, point) of the quadrature
    """

    dofs: NDArray[np.int64]
    jets: Array
    frame: Array
    weight: Array


class IronElements:
    """The elements of one iron, whose B-H curve may be exchanged."""

    def __init__(self, geometry: ElementGeometry, iron: "Iron | AnalyticIron") -> None:
        self.iron = iron
        self.dofs = geometry.dofs
        self.weight = geometry.weight
        self._frame = geometry.frame
        n_local, self._n_jet, self._n_point = geometry.jets.shape
        self._jets = geometry.jets.reshape(n_local, -1)
        self._couples = list(combinations_with_replacement(range(self._n_jet), 2))
        self._metric = [(self._frame[:, j] * self._frame[:, k]).sum(axis=0) for j, k in self._couples]
        a, b = np.triu_indices(n_local)
        self.pairs = geometry.dofs[:, a], geometry.dofs[:, b]  # (element, pair) each
        jets = geometry.jets.transpose(1, 2, 0)
        products = []
        for j, k in self._couples:
            product = jets[j][:, a] * jets[k][:, b] + (j != k) * jets[k][:, a] * jets[j][:, b]
            products.append(product)
        self._products = np.concatenate(products)  # (couple and point, pair)

    def flux_density(self, potential: Array) -> tuple[Array, Array]:
        """Gradient of A (2, element, point), and its size |B| (element, point)."""
        jet = (potential[self.dofs] @ self._jets).reshape(-1, self._n_jet, self._n_point)
        x, y = (sum(f[j] * jet[:, j] for j in range(self._n_jet)) for f in self._frame)
        return np.stack([x, y]), np.sqrt(x**2 + y**2)

    def residual_and_tangent(self, potential: Array) -> tuple[Array, Array]:
        """Element vectors (element, local), and the upper triangles of the matrices (element, pair) at `pairs`.

        T = nu I + (dH/dB - nu) n n^T with B = n |B| and nu = H/B.
        """
        gradient, b = self.flux_density(potential)
        h, slope = self.iron.magnetise(b)
        floor = np.maximum(b, NO_FIELD)
        nu = np.where(b > NO_FIELD, h / floor, slope)
        x, y = gradient / floor
        along = [self._frame[0, j] * x + self._frame[1, j] * y for j in range(self._n_jet)]  # F^T n
        isotropic = nu * self.weight
        extra = (slope - nu) * self.weight
        vector = np.concatenate([isotropic * floor * m for m in along], axis=1) @ self._jets.T
        tangent = []
        for (j, k), metric in zip(self._couples, self._metric, strict=True):
            tangent.append(isotropic * metric + extra * (along[j] * along[k]))
        return vector, np.concatenate(tangent, axis=1) @ self._products

    def energy(self, potential: Array) -> float:
        """Integral of w(|B|): per unit depth in J/m, or of the whole in J."""
        _, b = self.flux_density(potential)
        return float(np.sum(self.iron.energy_density(b) * self.weight))


Indices = NDArray[np.int64]


class SparseTangent:
    """The pattern of all matrices that are sums of pieces, and the factors of the last one factored.

    Only the upper triangle over the free unknowns is kept; what lies elsewhere in a piece is left out.

    Parameters
    ----------
    free, n : the free unknowns among n
    pieces : rows and columns of the values of each piece, of one shape
    """

    def __init__(self, free: Indices, n: int, pieces: Sequence[tuple[Indices, Indices]]) -> None:
        self._free, self._n = free, n
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
        self._solver: qdldl.Solver | None = None

    def unfactored(self) -> "SparseTangent":
        """The same pattern for a matrix of its own."""
        other = copy(self)
        other._solver = None
        return other

    def gather(self, piece: int, values: Array) -> Array:
        """A piece's values summed into the pattern, (nnz,)."""
        used, place = self._pieces[piece]
        return np.asarray(np.bincount(place, values.reshape(-1)[used], minlength=self.nnz), dtype=float)

    def factor(self, data: Array) -> None:
        """Factor the matrix whose values (nnz,) are given; NotConverged where it is singular."""
        matrix = self._matrix(data)
        try:
            if self._solver is None:
                self._solver = qdldl.Solver(matrix, upper=True)  # orders the unknowns, once for all values
            else:
                self._solver.update(matrix, upper=True)
        except RuntimeError as err:
            self._solver = None
            raise NotConverged(f"the tangent is singular ({err}); check the iron's B-H curve") from err

    def substitute(self, right: Array) -> Array:
        """The inverse of the matrix last factored times `right`, both (n,); fixed entries are zero."""
        assert self._solver is not None, "a matrix has been factored"
        out = np.zeros(self._n)
        out[self._free] = self._solver.solve(right[self._free])
        return out

    def product(self, data: Array, vector: Array) -> Array:
        """The matrix of these values times a vector (n,) that is zero at fixed entries, as is the answer."""
        upper, inner = self._matrix(data), vector[self._free]
        out = np.zeros(self._n)
        out[self._free] = upper @ inner + upper.T @ inner - upper.diagonal() * inner
        return out

    def refined_substitute(self, right: Array, data: Array) -> Array:
        """The inverse of the matrix of these values times `right`, (n,), from the factors of one nearby."""
        answer = self.substitute(right)
        for _ in range(REFINEMENTS):
            answer += self.substitute(right - self.product(data, answer))
        return answer

    def _matrix(self, data: Array) -> sparse.csc_matrix:
        return sparse.csc_matrix((data, *self._pattern), shape=(self._free.size,) * 2)
