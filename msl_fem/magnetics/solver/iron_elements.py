"""The elements of one iron: residual vectors and exact tangents from tables on the reference triangle.

On every element B is a linear map F, its frame, of the jet of A on the reference triangle: the derivatives along two
sides and, with axial symmetry, the value. The frame is the element's own, the shape functions' jets are the same for
all: an element matrix is a short vector, w F^T T F at the points, times a constant table of products of jets, and all
of them are one product of two dense matrices (Kirby and Logg, A compiler for variational forms, 2006).
"""

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from msl_fem.materials.material import AnalyticIron, Iron

Array = NDArray[np.float64]
NO_FIELD = 1e-12  # T: below it H is taken as linear in B


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
        self.dofs, self.weight, self._frame = geometry.dofs, geometry.weight, geometry.frame
        n_local, self._n_jet, self._n_point = geometry.jets.shape
        self._jets = geometry.jets.reshape(n_local, -1)
        self._couples = list(combinations_with_replacement(range(self._n_jet), 2))
        self._metric = [(self._frame[:, j] * self._frame[:, k]).sum(axis=0) for j, k in self._couples]
        a, b = np.triu_indices(n_local)
        self.pairs = geometry.dofs[:, a], geometry.dofs[:, b]  # (element, pair) each
        jets = geometry.jets.transpose(1, 2, 0)
        products = [jets[j][:, a] * jets[k][:, b] + (j != k) * jets[k][:, a] * jets[j][:, b] for j, k in self._couples]
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
        isotropic, extra = nu * self.weight, (slope - nu) * self.weight
        vector = np.concatenate([isotropic * floor * m for m in along], axis=1) @ self._jets.T
        tangent = [
            isotropic * metric + extra * (along[j] * along[k])
            for (j, k), metric in zip(self._couples, self._metric, strict=True)
        ]
        return vector, np.concatenate(tangent, axis=1) @ self._products

    def energy(self, potential: Array) -> float:
        """Integral of w(|B|): per unit depth in J/m, or of the whole in J."""
        _, b = self.flux_density(potential)
        return float(np.sum(self.iron.energy_density(b) * self.weight))
