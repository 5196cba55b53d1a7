"""The space of a few solutions: their vectors, products that the reduced model needs, its orthonormal basis."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.reduced.reduced_iron import ReducedIron
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.magnetics.solver.moving_air import MovingAir
from msl_fem.magnetics.solver.strip import StripStiffness
from msl_fem.materials.curves import Curves, Indices, curves_of


@dataclass(frozen=True, eq=False)
class Quadrature:
    """The irons' points: weights (n_point,), which iron, and the points of each element together."""

    weight: Array
    iron: Indices
    per_element: int
    curves: Curves


def quadrature_of(model: FieldModel) -> Quadrature:
    """All points of a model's irons, element after element."""
    parts = list(model.irons.values())
    weight = np.concatenate([part.weight.ravel() for part in parts])
    iron = np.concatenate([np.full(part.weight.size, k) for k, part in enumerate(parts)])
    return Quadrature(weight, iron, parts[0].weight.shape[1], curves_of([part.iron for part in parts]))


def iron_gradients(model: FieldModel, vectors: Array) -> Array:
    """(2 n_point, n) both derivatives at all points of a model's irons, of n vectors (n_dof, n)."""
    columns = []
    for vector in np.ascontiguousarray(vectors.T):
        pairs = [part.flux_density(vector)[0].reshape(2, -1) for part in model.irons.values()]
        columns.append(np.concatenate(pairs, axis=1).T.ravel())
    return np.ascontiguousarray(np.stack(columns, axis=1))


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
        self._gradients: list[Array] = []

    def __len__(self) -> int:
        return len(self._vectors)

    def add(self, vector: Array, share: float = 1.0) -> float:
        """Add a vector (n_dof,), made as large as its share of 1 in the energy norm; what it was divided by."""
        image = self.model.tangent.product(self._energy, vector)
        scale = max(float(vector @ image), 0.0) ** 0.5 / share
        if scale > 0.0 and np.isfinite(vector).all():
            self._vectors.append(vector / scale)
            self._images.append(image / scale)
            self._gradients.append(iron_gradients(self.model, vector[:, None])[:, 0] / scale)
        return scale

    def basis(self, tolerance: float) -> "Basis":
        """Proper orthogonal decomposition (Sirovich 1987), modes below `tolerance` times the vectors' size left out."""
        vectors = np.array(self._vectors).T
        gram = vectors.T @ np.array(self._images).T
        value, turn = np.linalg.eigh((gram + gram.T) / 2)
        kept = np.flatnonzero(value > max(tolerance**2, 1e-13 * value[-1]))[::-1]
        turn = turn[:, kept] / np.sqrt(value[kept])
        gradients = np.array(self._gradients).T @ turn
        return Basis(self.model, self.quadrature, np.ascontiguousarray(vectors @ turn), np.ascontiguousarray(gradients))

    def within(self, basis: "Basis", added: Sequence[int], scales: Sequence[float]) -> Array:
        """(n, N) in a basis of this space: the vectors added at these places, each times its scale."""
        images = np.stack([self._images[k] for k in added], axis=1) * np.array(scales)
        return np.asarray((basis.vectors.T @ images).T)


@dataclass(frozen=True, eq=False)
class Basis:
    """N functions, orthonormal without field; `vectors` (n_dof, N), `gradients` (2 n_point, N) at all iron points."""

    model: FieldModel
    quadrature: Quadrature
    vectors: Array
    gradients: Array

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
        weight = every.weight.reshape(-1, every.per_element)
        share = weight / weight.sum(axis=1, keepdims=True)
        gradients = self.gradients.reshape(-1, every.per_element, 2, self.size)
        mean = np.einsum("ep,epjk->ejk", share, gradients, optimize=True).reshape(-1, self.size)
        iron = every.iron[:: every.per_element]
        return ReducedIron(np.ascontiguousarray(mean), weight.sum(axis=1), iron, every.curves)

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
