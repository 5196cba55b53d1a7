"""The exact tangent: element matrices of one iron, put together into symmetric matrices of one sparsity pattern.

On every element B is a linear map F, its frame, of the jet of A on the reference triangle: the derivatives along two
sides and, with axial symmetry, the value. The frame is the element's own, the shape functions' jets are the same for
all: an element matrix is a short vector, w F^T T F at the points, times a constant table of products of jets, and all
of them are one product of two dense matrices (Kirby and Logg, A compiler for variational forms, 2006).
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import qdldl
from numpy.typing import NDArray
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import NotConverged
from msl_fem.materials.curves import NO_FIELD, Curves, curves_of, magnetise_all
from msl_fem.materials.material import AnalyticIron, Iron

REFINEMENTS = 1
Indices = NDArray[np.int64]


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

    dofs: Indices
    jets: Array
    frame: Array
    weight: Array


class IronElements:
    """The elements of one iron."""

    def __init__(self, geometry: ElementGeometry, iron: "Iron | AnalyticIron") -> None:
        self.iron = iron
        self.dofs = geometry.dofs
        self.weight = geometry.weight
        self._frame = geometry.frame
        n_local, self._n_jet, self._n_point = geometry.jets.shape
        self._jets = geometry.jets.reshape(n_local, -1)
        couples = list(combinations_with_replacement(range(self._n_jet), 2))
        self._metric = np.array([(self._frame[:, j] * self._frame[:, k]).sum(axis=0) for j, k in couples])
        a, b = np.triu_indices(n_local)
        self.pairs = geometry.dofs[:, a], geometry.dofs[:, b]  # (element, pair) each
        jets = geometry.jets.transpose(1, 2, 0)
        products = []
        for j, k in couples:
            product = jets[j][:, a] * jets[k][:, b] + (j != k) * jets[k][:, a] * jets[j][:, b]
            products.append(product)
        self._products = np.concatenate(products)  # (couple and point, pair)

    def with_iron(self, iron: "Iron | AnalyticIron") -> "IronElements":
        """The same elements of another iron."""
        other = copy(self)
        other.iron = iron
        other.__dict__.pop("_curves", None)
        return other

    @cached_property
    def _curves(self) -> Curves:
        return curves_of([self.iron])

    @cached_property
    def _first(self) -> Indices:
        return np.zeros(self.weight.size, dtype=np.int64)

    def flux_density(self, potential: Array) -> tuple[Array, Array]:
        """Gradient of A (2, element, point), and its size |B| (element, point)."""
        gradient = np.empty((2, *self.weight.shape))
        size = np.empty(self.weight.shape)
        _gradients_of(potential[self.dofs] @ self._jets, self._frame, gradient, size)
        return gradient, size

    def residual_and_tangent(self, potential: Array) -> tuple[Array, Array]:
        """Element vectors (element, local), and the upper triangles of the matrices (element, pair) at `pairs`.

        T = nu I + (dH/dB - nu) n n^T with B = n |B| and nu = H/B.
        """
        gradient, b = self.flux_density(potential)
        h, slope = self._magnetise(b)
        n_element = len(self.dofs)
        vector = np.empty((n_element, self._jets.shape[1]))
        tangent = np.empty((n_element, len(self._products)))
        _terms_of(gradient, b, h, slope, self._frame, self._metric, self.weight, vector, tangent)
        return vector @ self._jets.T, tangent @ self._products

    def _magnetise(self, b: Array) -> tuple[Array, Array]:
        """As `Iron.magnetise`, compiled for curves of points."""
        if isinstance(self.iron, AnalyticIron):
            return self.iron.magnetise(b)
        h, slope = np.empty_like(b), np.empty_like(b)
        magnetise_all(b.ravel(), self._first, self._curves, h.ravel(), slope.ravel())
        return h, slope

    def energies(self, potentials: Array) -> Array:
        """(n,) integral of w(|B|) of potentials (n, n_dof): per unit depth in J/m, or of the whole in J."""
        b = np.stack([self.flux_density(a)[1] for a in potentials])
        return np.asarray((self.iron.energy_density(b) * self.weight).sum(axis=(1, 2)))


@compiled
def _gradients_of(jet: Array, frame: Array, gradient: Array, size: Array) -> None:
    """Both derivatives of A (2, element, point) and their size from the jets (element, jet x point), written."""
    n_element, n_point = size.shape
    n_jet, each = frame.shape[1], frame.shape[3] > 1
    for e in range(n_element):
        for p in range(n_point):
            q = p if each else 0
            x = y = 0.0
            for j in range(n_jet):
                x += frame[0, j, e, q] * jet[e, j * n_point + p]
                y += frame[1, j, e, q] * jet[e, j * n_point + p]
            gradient[0, e, p], gradient[1, e, p] = x, y
            size[e, p] = np.sqrt(x * x + y * y)


@compiled
def _terms_of(
    gradient: Array,
    b: Array,
    h: Array,
    slope: Array,
    frame: Array,
    metric: Array,
    weight: Array,
    vector: Array,
    tangent: Array,
) -> None:
    """Weighted w F^T H (element, jet x point) and w F^T T F (element, couple x point), written."""
    n_element, n_point = b.shape
    n_jet, each = frame.shape[1], frame.shape[3] > 1
    for e in range(n_element):
        for p in range(n_point):
            q = p if each else 0
            floor = max(b[e, p], NO_FIELD)
            nu = h[e, p] / floor if b[e, p] > NO_FIELD else slope[e, p]
            x, y = gradient[0, e, p] / floor, gradient[1, e, p] / floor
            isotropic, extra = nu * weight[e, p], (slope[e, p] - nu) * weight[e, p]
            couple = 0
            for j in range(n_jet):
                along = frame[0, j, e, q] * x + frame[1, j, e, q] * y  # F^T n
                vector[e, j * n_point + p] = isotropic * floor * along
                for k in range(j, n_jet):
                    across = frame[0, k, e, q] * x + frame[1, k, e, q] * y
                    tangent[e, couple * n_point + p] = isotropic * metric[couple, e, q] + extra * along * across
                    couple += 1


@compiled
def _times_upper(rows: NDArray[np.int32], starts: NDArray[np.int32], data: Array, vector: Array, out: Array) -> None:
    """The product of a symmetric matrix, given by its upper triangle, with a vector (n,), added to `out` (n,)."""
    for column in range(vector.size):
        for k in range(starts[column], starts[column + 1]):
            row = rows[k]
            out[row] += data[k] * vector[column]
            if row != column:
                out[column] += data[k] * vector[row]


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
        self._upper = sparse.csc_matrix((np.zeros(self.nnz), *self._pattern), shape=(free.size,) * 2)
        self._solver: qdldl.Solver | None = None

    def unfactored(self) -> "SparseTangent":
        """The same pattern for a matrix of its own."""
        other = copy(self)
        other._upper, other._solver = self._upper.copy(), None
        return other

    def gather(self, piece: int, values: Array) -> Array:
        """A piece's values summed into the pattern, (nnz,)."""
        used, place = self._pieces[piece]
        return np.asarray(np.bincount(place, values.reshape(-1)[used], minlength=self.nnz), dtype=float)

    def factor(self, data: Array) -> None:
        """Factor the matrix whose values (nnz,) are given; NotConverged where it is singular."""
        self._upper.data = data
        try:
            if self._solver is None:
                self._solver = qdldl.Solver(self._upper, upper=True)  # orders the unknowns, once for all values
            else:
                self._solver.update(self._upper, upper=True)
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
        inner = np.zeros(self._free.size)
        _times_upper(*self._pattern, data, vector[self._free], inner)
        out = np.zeros(self._n)
        out[self._free] = inner
        return out

    def refined_substitute(self, right: Array, data: Array) -> Array:
        """The inverse of the matrix of these values times `right`, (n,), from the factors of one nearby."""
        answer = self.substitute(right)
        for _ in range(REFINEMENTS):
            answer += self.substitute(right - self.product(data, answer))
        return answer
