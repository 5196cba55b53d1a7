"""The irons' elements: what their energy's gradient and second derivative add to those of the whole section.

On every element B is a linear map F, its frame, of the jet of A on the reference triangle: the derivatives along two
sides and, with axial symmetry, the value. The frame is the element's own, the shape functions' jets are the same for
all: an element matrix is a short vector, w F^T T F at the points, times a constant table of products of jets (Kirby and
Logg, A compiler for variational forms, 2006).
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.magnetics.solver.tangent import Indices, Places
from msl_fem.materials.curves import NO_FIELD, Curves, curves_of, magnetise_all
from msl_fem.materials.material import AnalyticIron, Iron


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


class ElementTables(NamedTuple):
    """What compiled code takes of the elements.

    Attributes
    ----------
    dofs, frame, weight : of the geometry
    jets : (local, jet x point), and the same transposed
    metric : (couple, element, point or 1) entries of F^T F
    products : (couple x point, pair) of the jets of a pair of shape functions
    """

    dofs: Indices
    frame: Array
    weight: Array
    jets: Array
    jets_transposed: Array
    metric: Array
    products: Array


class IronElements:
    """The elements of one iron."""

    def __init__(self, geometry: ElementGeometry, iron: "Iron | AnalyticIron") -> None:
        self.iron = iron
        self.dofs = geometry.dofs
        self.weight = geometry.weight
        n_local, n_jet, _ = geometry.jets.shape
        couples = list(combinations_with_replacement(range(n_jet), 2))
        a, b = np.triu_indices(n_local)
        self.pairs = geometry.dofs[:, a], geometry.dofs[:, b]  # (element, pair) each
        jets = geometry.jets.transpose(1, 2, 0)
        products = []
        for j, k in couples:
            product = jets[j][:, a] * jets[k][:, b] + (j != k) * jets[k][:, a] * jets[j][:, b]
            products.append(product)
        flat = geometry.jets.reshape(n_local, -1)
        self._tables = ElementTables(
            np.ascontiguousarray(geometry.dofs),
            np.ascontiguousarray(geometry.frame),
            np.ascontiguousarray(geometry.weight),
            np.ascontiguousarray(flat),
            np.ascontiguousarray(flat.T),
            np.array([(geometry.frame[:, j] * geometry.frame[:, k]).sum(axis=0) for j, k in couples]),
            np.concatenate(products),
        )

    def with_iron(self, iron: "Iron | AnalyticIron") -> "IronElements":
        """The same elements of another iron."""
        other = copy(self)
        other.iron = iron
        other.__dict__.pop("_curves", None)
        return other

    @cached_property
    def _curves(self) -> Curves:
        return curves_of([self.iron])

    def flux_density(self, potential: Array) -> tuple[Array, Array]:
        """Gradient of A (2, element, point), and its size |B| (element, point)."""
        gradient = np.empty((2, *self.weight.shape))
        size = np.empty(self.weight.shape)
        _flux_density_of(potential, self._tables, gradient, size)
        return gradient, size

    def gradient_entries(self) -> Array:
        """(element, point, 2, local) what the potential at `dofs` is multiplied by in its gradient."""
        frame, jets = self._tables.frame, self._tables.jets
        every = np.broadcast_to(frame, (*frame.shape[:3], self.weight.shape[1]))
        return np.einsum("djep,ajp->epda", every, jets.reshape(len(jets), frame.shape[1], -1))

    def add_terms(self, potential: Array, places: Places, gradient: Array, data: Array) -> None:
        """Adds the energy's gradient to one of all unknowns (n_dof,), and its second derivative to values on a pattern.

        Each element's matrix is the integral of T = nu I + (dH/dB - nu) n n^T with B = n |B| and nu = H/B between its
        shape functions.

        Parameters
        ----------
        places : (element, pair) where the upper triangles at `pairs` belong in `data`, -1 for nowhere
        """
        if not isinstance(self.iron, AnalyticIron):
            _add_terms_of_curve(potential, self._tables, self._curves, places, gradient, data)
            return
        field, b = self.flux_density(potential)
        _add_terms(field, b, *self.iron.magnetise(b), self._tables, places, gradient, data)

    def energies(self, potentials: Array) -> Array:
        """(n,) integral of w(|B|) of potentials (n, n_dof): per unit depth in J/m, or of the whole in J."""
        b = np.stack([self.flux_density(a)[1] for a in potentials])
        return np.asarray((self.iron.energy_density(b) * self.weight).sum(axis=(1, 2)))


@compiled
def _flux_density_of(potential: Array, tables: ElementTables, gradient: Array, size: Array) -> None:
    """Both derivatives of A (2, element, point) and their size, written."""
    dofs, frame = tables.dofs, tables.frame
    n_element, n_point = size.shape
    n_jet, each = frame.shape[1], frame.shape[3] > 1
    own = np.empty(dofs.shape)
    for e in range(n_element):
        for a in range(dofs.shape[1]):
            own[e, a] = potential[dofs[e, a]]
    jet = np.dot(own, tables.jets)
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
def _add_terms(
    field: Array,
    b: Array,
    h: Array,
    slope: Array,
    tables: ElementTables,
    places: Places,
    gradient: Array,
    data: Array,
) -> None:
    """As `IronElements.add_terms`, of (dA/dx, dA/dy), |B|, H and dH/dB at the points."""
    dofs, frame, metric, weight = tables.dofs, tables.frame, tables.metric, tables.weight
    n_element, n_point = b.shape
    n_jet, each = frame.shape[1], frame.shape[3] > 1
    vector, matrix = np.empty((n_element, n_jet * n_point)), np.empty((n_element, metric.shape[0] * n_point))
    for e in range(n_element):
        for p in range(n_point):
            q = p if each else 0
            floor = max(b[e, p], NO_FIELD)
            over = 1.0 / floor
            nu = h[e, p] * over if b[e, p] > NO_FIELD else slope[e, p]
            x, y = field[0, e, p] * over, field[1, e, p] * over
            isotropic, extra = nu * weight[e, p], (slope[e, p] - nu) * weight[e, p]
            couple = 0
            for j in range(n_jet):
                along = frame[0, j, e, q] * x + frame[1, j, e, q] * y  # F^T n
                vector[e, j * n_point + p] = isotropic * floor * along  # w F^T H
                for k in range(j, n_jet):
                    across = frame[0, k, e, q] * x + frame[1, k, e, q] * y
                    matrix[e, couple * n_point + p] = isotropic * metric[couple, e, q] + extra * along * across
                    couple += 1
    vectors, matrices = np.dot(vector, tables.jets_transposed), np.dot(matrix, tables.products)
    for e in range(n_element):
        for a in range(dofs.shape[1]):
            gradient[dofs[e, a]] += vectors[e, a]
        for pair in range(places.shape[1]):
            if places[e, pair] >= 0:
                data[places[e, pair]] += matrices[e, pair]


@compiled
def _add_terms_of_curve(
    potential: Array, tables: ElementTables, curves: Curves, places: Places, gradient: Array, data: Array
) -> None:
    """As `IronElements.add_terms`, of an iron with a curve of points."""
    shape = tables.weight.shape
    field, b, h, slope = np.empty((2, *shape)), np.empty(shape), np.empty(shape), np.empty(shape)
    _flux_density_of(potential, tables, field, b)
    only = np.zeros(b.size, dtype=np.int64)
    magnetise_all(b.ravel(), only, curves, h.ravel(), slope.ravel())
    _add_terms(field, b, h, slope, tables, places, gradient, data)
