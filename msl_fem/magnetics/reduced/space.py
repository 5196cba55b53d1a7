"""The space of a few solutions: their vectors, products that the reduced model needs, its orthonormal basis."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.reduced_iron import ReducedIron
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.magnetics.solver.moving_air import MovingAir
from msl_fem.magnetics.solver.strip import StripStiffness
from msl_fem.materials.curves import Curves, Indices, curves_of


@dataclass(frozen=True, eq=False)
class Quadrature:
    """The irons' points, element after element.

    Attributes
    ----------
    weight, iron : (n_point,) and which iron it is
    per_element : points
    gradient : (2 n_point, n_dof) both derivatives of a potential, point after point
    mean_gradient : (2 n_element, n_dof) their means over elements
    """

    weight: Array
    iron: Indices
    per_element: int
    gradient: sparse.csr_matrix
    mean_gradient: sparse.csr_matrix
    curves: Curves


def quadrature_of(model: FieldModel) -> Quadrature:
    """All points of a model's irons."""
    parts = list(model.irons.values())
    weight, dofs = (np.concatenate(each) for each in zip(*((part.weight, part.dofs) for part in parts), strict=True))
    iron = np.concatenate([np.full(part.weight.size, k) for k, part in enumerate(parts)])
    entries = np.concatenate([part.gradient_entries() for part in parts])
    share = weight / weight.sum(axis=1, keepdims=True)
    mean = np.einsum("ep,epda->eda", share, entries)[:, None]
    each, means = (_from_elements(values, dofs, model.n_dof) for values in (entries, mean))
    return Quadrature(weight.ravel(), iron, weight.shape[1], each, means, curves_of([part.iron for part in parts]))


def _from_elements(entries: Array, dofs: Indices, n_dof: int) -> sparse.csr_matrix:
    """Rows from entries (element, point, 2, local) at the elements' degrees of freedom (element, local)."""
    columns = np.broadcast_to(dofs[:, None, None], entries.shape).ravel()
    starts = np.arange(0, entries.size + 1, dofs.shape[1])
    return sparse.csr_matrix((entries.ravel(), columns, starts), (starts.size - 1, n_dof))


class SnapshotSpace:
    """Vectors added one by one; `basis` is their best orthonormal basis in the energy of the unsaturated irons.

    Parameters
    ----------
    model : the full one
    energy : (nnz,) values of the energy's second derivative without field, on the model's pattern
    """

    def __init__(self, model: FieldModel, energy: Array) -> None:
        self.model, self._energy = model, energy
        self.quadrature = quadrature_of(model)
        self._vectors: list[Array] = []
        self._images: list[Array] = []

    def __len__(self) -> int:
        return len(self._vectors)

    def add(self, vector: Array, share: float = 1.0) -> float:
        """Add a vector (n_dof,), made as large as its share of 1 in the energy norm; what it was divided by."""
        image = self.model.tangent.product(self._energy, vector)
        scale = max(float(vector @ image), 0.0) ** 0.5 / share
        if scale > 0.0 and np.isfinite(vector).all():
            self._vectors.append(vector / scale)
            self._images.append(image / scale)
        return scale

    def basis(self, tolerance: float) -> "Basis":
        """Proper orthogonal decomposition (Sirovich 1987), modes below `tolerance` times the vectors' size left out."""
        vectors = np.array(self._vectors).T
        gram = vectors.T @ np.array(self._images).T
        value, turn = np.linalg.eigh((gram + gram.T) / 2)
        kept = np.flatnonzero(value > max(tolerance**2, 1e-13 * value[-1]))[::-1]
        turn = turn[:, kept] / np.sqrt(value[kept])
        return Basis(self.model, self.quadrature, np.ascontiguousarray(vectors @ turn))

    def within(self, basis: "Basis", added: Sequence[int], scales: Sequence[float]) -> Array:
        """(n, N) in a basis of this space: the vectors added at these places, each times its scale."""
        images = np.stack([scale * self._images[k] for k, scale in zip(added, scales, strict=True)])
        return np.asarray(images @ basis.vectors)


@dataclass(frozen=True, eq=False)
class Basis:
    """N functions, orthonormal without field: `vectors` (n_dof, N)."""

    model: FieldModel
    quadrature: Quadrature
    vectors: Array

    @cached_property
    def gradients(self) -> Array:
        """(2 n_point, N) at all points of the irons."""
        return np.asarray(self.quadrature.gradient @ self.vectors)

    @property
    def size(self) -> int:
        return self.vectors.shape[1]

    def whole_iron(self) -> ReducedIron:
        """All of the quadrature."""
        every = self.quadrature
        return ReducedIron(self.gradients, every.weight, every.iron, every.curves)

    def coarse_iron(self) -> ReducedIron:
        """One point an element, with the mean of the gradient."""
        every = self.quadrature
        weight = every.weight.reshape(-1, every.per_element).sum(axis=1)
        mean = np.asarray(every.mean_gradient @ self.vectors)
        return ReducedIron(mean, weight, every.iron[:: every.per_element], every.curves)

    def some_iron(self, points: Indices, weight: Array) -> ReducedIron:
        """Points of the quadrature with weights of their own."""
        gradients = self.gradients.reshape(-1, 2, self.size)[points].reshape(-1, self.size)
        every = self.quadrature
        return ReducedIron(np.ascontiguousarray(gradients), weight, every.iron[points], every.curves)

    def linear_parts(self) -> "LinearParts":
        """The linear regions' stiffness in the basis."""
        model, v = self.model, self.vectors
        rest = v.T @ (model.stiffness_at_rest @ v)
        strips: list[StripStiffness | MovingAir] = []
        for strip in model.strips:
            if isinstance(strip, StripStiffness):
                nothing = np.empty(0)
                x, y = (v.T @ (matrix @ v) for matrix in (strip.x, strip.y))
                strips.append(StripStiffness(strip.strip, strip.mesh_height, x, y, nothing, nothing))
            else:
                strips.append(strip)
        return LinearParts(self, rest, strips)


@dataclass(frozen=True, eq=False)
class LinearParts:
    """What the linear regions add, N x N at any coordinate; affine in functions of it where there are strips."""

    basis: Basis
    rest: Array
    strips: "list[StripStiffness | MovingAir]"

    def first(self, basis: Basis) -> "LinearParts":
        """The same in the space of the first functions only."""
        n = basis.size
        strips = [
            replace(strip, x=strip.x[:n, :n], y=strip.y[:n, :n]) if isinstance(strip, StripStiffness) else strip
            for strip in self.strips
        ]
        return LinearParts(basis, self.rest[:n, :n], strips)

    def at(self, coordinate: float) -> tuple[Array, Array, Array]:
        """The stiffness and its first and second derivative with respect to the coordinate."""
        depth, v, one = self.basis.model.air_depth, self.basis.vectors, np.eye(self.basis.size)
        total, first, second = self.rest.copy(), np.zeros_like(self.rest), np.zeros_like(self.rest)
        for strip in self.strips:
            if isinstance(strip, StripStiffness):
                parts = [strip.product(one, coordinate, depth), *strip.slopes(one, coordinate, depth)]
            else:
                columns = [(strip.product(a, coordinate, depth), *strip.slopes(a, coordinate, depth)) for a in v.T]
                parts = [v.T @ np.stack([column[k] for column in columns], axis=1) for k in range(3)]
            total, first, second = total + parts[0], first + parts[1], second + parts[2]
        return total, first, second
