"""Air that follows a moving body: its stiffness at any displacement, exact in each triangle, and its derivatives.

A triangle whose corners move by p d s (p the share of the displacement s, d its direction) is mapped by
F = I + s d p', p' = grad p, with J = det F = 1 + s a, a = d.p'. The energy density J |F^-T G|^2 of a gradient G is

    J |G|^2 - 2 s (p'.G)(d.G) + s^2 |p'|^2 (d.G)^2 / J

so that the stiffness J K_0 - s K_1 + w K_2, w = s^2 |p'|^2 / J, has exact derivatives with respect to s (Coulomb 1983).
A strip between two lines is the case p' = d / height. With an axis d is along it, and A/r, which is part of G, stays.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.solver.strip import AirDepth
from msl_fem.magnetics.triangles import MeshMotion, TriangleMesh, hat_gradients
from msl_fem.materials.constants import MU_0

LEAST_STRETCH = 0.1  # of a triangle's area, to which a displacement may press it


@dataclass(frozen=True, eq=False)
class MovingTriangles:
    """The triangles of a mesh that a motion deforms.

    Attributes
    ----------
    elements : (n,) indices
    slope : (2, n) gradient p' of the share in 1/m
    direction : (2,) d
    """

    elements: NDArray[np.int64]
    slope: Array
    direction: Array

    @property
    def along(self) -> Array:
        """(n,) a = d.p' in 1/m."""
        return np.asarray(self.direction @ self.slope)

    def reach(self) -> tuple[float, float]:
        """The displacements in m between which no triangle is pressed below `LEAST_STRETCH` of its area."""
        a = self.along
        most = 1 - LEAST_STRETCH
        return -most / max(float(a.max()), 1e-300), most / max(float(-a.min()), 1e-300)


def moving_triangles(mesh: TriangleMesh, motion: MeshMotion) -> MovingTriangles:
    """Those whose corners do not all move alike."""
    share = motion.share[mesh.triangles]
    elements = np.flatnonzero(np.ptp(share, axis=0) > 0)
    slope = np.einsum("ce,cje->je", share[:, elements], hat_gradients(mesh)[:, :, elements])
    return MovingTriangles(elements, slope, motion.direction)


class MovingAir:
    """The stiffness of the triangles that follow a motion; stands beside `StripStiffness` and is asked the same.

    Parameters
    ----------
    triangles, mesh_gap : what deforms, and the gap in m at which it does not
    dofs : (local, n) degrees of freedom of each triangle
    gradients, weight : (local, 2, n, point) derivatives of the local functions, (n, point) weights in m2 (or m3)
    gather : (local, local, n) values summed into the tangent's pattern
    """

    def __init__(
        self,
        triangles: MovingTriangles,
        mesh_gap: float,
        *,
        dofs: NDArray[np.int64],
        gradients: Array,
        weight: Array,
        gather: Callable[[Array], Array],
    ) -> None:
        self._gap, self._dofs, self._gather = mesh_gap, dofs, gather
        self._along = triangles.along
        self._square = (triangles.slope**2).sum(axis=0)
        across = np.einsum("je,ajep->aep", triangles.slope, gradients)
        forward = np.einsum("j,ajep->aep", triangles.direction, gradients)
        density = weight / MU_0
        mixed = np.einsum("aep,bep,ep->abe", across, forward, density, optimize=True)
        self._whole = np.einsum("ajep,bjep,ep->abe", gradients, gradients, density, optimize=True)
        self._mixed = mixed + mixed.transpose(1, 0, 2)
        self._forward = np.einsum("aep,bep,ep->abe", forward, forward, density, optimize=True)

    def _matrices(self, gap: float) -> tuple[Array, Array, Array]:
        """The triangles' matrices (local, local, n) at a gap, and their first and second derivatives."""
        s, a, square = gap - self._gap, self._along, self._square
        j = 1 + s * a
        weight = s**2 * square / j
        first = square * (2 * s / j - s**2 * a / j**2)
        second = square * (2 / j - 4 * s * a / j**2 + 2 * s**2 * a**2 / j**3)
        return (
            j * self._whole - s * self._mixed + weight * self._forward,
            a * self._whole - self._mixed + first * self._forward,
            second * self._forward,
        )

    def _times(self, matrices: Array, potential: Array) -> Array:
        local = np.einsum("abe,be->ae", matrices, potential[self._dofs], optimize=True)
        return np.bincount(self._dofs.ravel(), local.ravel(), minlength=potential.size).astype(float)

    def values(self, coordinate: float, depth: AirDepth) -> Array:
        """S on the tangent's pattern, (nnz,)."""
        del depth  # of a strip alone
        return self._gather(self._matrices(coordinate)[0])

    def product(self, potential: Array, coordinate: float, depth: AirDepth) -> Array:
        """S A, (n_dof,)."""
        del depth
        return self._times(self._matrices(coordinate)[0], potential)

    def slopes(self, potential: Array, coordinate: float, depth: AirDepth) -> tuple[Array, Array]:
        """First and second derivative of S A with respect to the coordinate, (n_dof,) each."""
        del depth
        _, first, second = self._matrices(coordinate)
        return self._times(first, potential), self._times(second, potential)
