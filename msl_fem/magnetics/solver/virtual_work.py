"""Force and torque on a moving body in any mesh: virtual work at fixed potential, and Maxwell's stress around it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from msl_fem.errors import InputError
from msl_fem.magnetics.solver.magnetostatics import FieldModel
from msl_fem.magnetics.solver.mesh import TriangleMesh
from msl_fem.magnetics.solver.postprocess import gradient_maps
from msl_fem.materials.constants import MU_0

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Symmetry = Literal["none", "x=0"]
ON_AXIS = 1e-9  # of the mesh's width: a point nearer to x = 0 lies on the symmetry line
GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class BodyForce:
    """Force per unit depth on a body (N/m) and torque per unit depth about the centre given (N m/m, anticlockwise).

    Of a half section these are what its half contributes: twice `y` is the body's, `x` and `torque` mean nothing.
    """

    x: float
    y: float
    torque: float


class MovingBody:
    """A rigid body surrounded by air that does not touch what stands still, and how the air's mesh follows it.

    The share p of the body's displacement is 1 on the body, 0 on everything else that is not air and on the box, and
    harmonic in the air between (linear on each triangle).

    Parameters
    ----------
    model : a plane section, solved at its mesh's own gap
    moving : region names of the body
    air : region names of the air around
    symmetry : "x=0" for a half section, whose edge on x = 0 is no box: air may slide along it
    centre : (x, y) in m, that the torque refers to

    Raises
    ------
    InputError : the body is absent, touches what stands still or reaches the box
    """

    def __init__(
        self,
        model: FieldModel,
        moving: tuple[str, ...],
        *,
        air: tuple[str, ...],
        symmetry: Symmetry = "none",
        centre: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.model, self.mesh, self.centre = model, model.mesh, np.array(centre)
        self.share = displacement_share(self.mesh, moving, air=air, symmetry=symmetry)
        self._hat = hat_gradients(self.mesh)  # (corner, 2, triangle)
        shares = self.share[self.mesh.triangles]
        self._deforming = np.flatnonzero(np.ptp(shares, axis=0) > 0)
        self._contour = self._stress_contour()

    def force(self, potential: Array) -> BodyForce:
        """Force by virtual work at fixed potential: F = -dW/ds|_A along a displacement s (Coulomb 1983).

        The mesh moves by v (linear on each triangle, G = grad v), the nodal values of A stay. In air
        dW/ds = 1/(2 mu_0) integral of |grad A|^2 div v - 2 grad A . G grad A, the exact derivative of the discrete
        energy; in the body and in what stands still the energy does not change.
        """
        gradient = self.model.basis.interpolate(potential).grad[:, self._deforming]
        products = np.einsum("iep,jep,ep->ije", gradient, gradient, self.model.basis.dx[self._deforming]) / MU_0

        def along(velocity: Array) -> float:
            """-dW/ds where the body's points move with (2, n_point)."""
            moved = (self.share * velocity)[:, self.mesh.triangles[:, self._deforming]]  # (2, corner, triangle)
            g = np.einsum("kce,cje->kje", moved, self._hat[:, :, self._deforming])  # dv_k/dx_j
            stretch = 0.5 * (products[0, 0] + products[1, 1]) @ (g[0, 0] + g[1, 1])
            return -float(stretch - np.einsum("kje,jke->", g, products))

        x, y = self.mesh.points - self.centre[:, None]
        one, zero = np.ones_like(x), np.zeros_like(x)
        return BodyForce(along(np.stack([one, zero])), along(np.stack([zero, one])), along(np.stack([-y, x])))

    def force_stress_tensor(self, potential: Array) -> BodyForce:
        """Force by Maxwell's stress (B (B.n) - |B|^2 n / 2)/mu_0 on the contour p = 1/2 around the body."""
        points, normal, weight, (along_x, along_y) = self._contour
        b = np.stack([along_y @ potential, -(along_x @ potential)])
        across = (b * normal).sum(axis=0)
        traction = (b * across - 0.5 * (b**2).sum(axis=0) * normal) / MU_0 * weight
        x, y = points - self.centre[:, None]
        return BodyForce(float(traction[0].sum()), float(traction[1].sum()), float(x @ traction[1] - y @ traction[0]))

    def _stress_contour(self) -> tuple[Array, Array, Array, tuple[sparse.csr_matrix, sparse.csr_matrix]]:
        """Gauss points (2, n), outward normals (2, n), weights (n,) and gradient maps of the contour p = 1/2."""
        corners = self.mesh.triangles
        share = self.share[corners] - 0.5
        crossed = np.flatnonzero((share.min(axis=0) < 0) & (share.max(axis=0) > 0))
        share, corners = share[:, crossed], corners[:, crossed]
        ends = np.full((2, 2, crossed.size), np.nan)
        found = np.zeros(crossed.size, dtype=int)
        for k in range(3):
            cut = np.flatnonzero(share[k] * share[k - 1] < 0)
            t = share[k, cut] / (share[k, cut] - share[k - 1, cut])
            start, end = self.mesh.points[:, corners[k, cut]], self.mesh.points[:, corners[k - 1, cut]]
            ends[found[cut], :, cut] = (start + t * (end - start)).T
            found[cut] += 1
        slope = np.einsum("ce,cje->je", share, self._hat[:, :, crossed])
        normal = -slope / np.hypot(*slope)
        node, weight = GAUSS
        middle, half = ends.mean(axis=0), (ends[1] - ends[0]) / 2
        points = (middle[:, :, None] + half[:, :, None] * node).reshape(2, -1)
        elements = np.repeat(crossed, node.size)
        weights = (np.hypot(*half)[:, None] * weight).ravel()
        return points, np.repeat(normal, node.size, axis=1), weights, gradient_maps(self.model, points, elements)


def displacement_share(
    mesh: TriangleMesh, moving: tuple[str, ...], *, air: tuple[str, ...], symmetry: Symmetry = "none"
) -> Array:
    """p (n_point,): 1 on the body, 0 on what stands still, harmonic in the air; raises as `MovingBody`."""
    body = np.unique(mesh.triangles[:, mesh.elements(*moving)])
    if body.size == 0:
        raise InputError(f"the mesh has no region {' or '.join(moving)}; its regions are {', '.join(mesh.names)}")
    still = np.unique(mesh.triangles[:, mesh.elements(*(set(mesh.names) - {*moving, *air}))])
    box = boundary_points(mesh)
    if symmetry == "x=0":
        box = box[np.abs(mesh.points[0, box]) > ON_AXIS * np.ptp(mesh.points[0])]
    still = np.union1d(still, box)
    both = np.intersect1d(body, still)
    if both.size:
        x, y = mesh.points[:, both[0]] * 1e3
        raise InputError(
            f"the moving body {' + '.join(moving)} touches what stands still, at x = {x:g} mm, y = {y:g} mm; "
            "leave air around it"
        )
    share = np.zeros(mesh.points.shape[1])
    share[body] = 1.0
    free = np.setdiff1d(np.unique(mesh.triangles), np.union1d(body, still))
    matrix = _laplacian(mesh)
    share[free] = spsolve(matrix[free][:, free].tocsc(), -(matrix[free] @ share))
    return share


def boundary_points(mesh: TriangleMesh) -> Indices:
    """Indices of the points on edges that belong to one triangle only."""
    edges, count = np.unique(
        np.sort(
            np.concatenate([mesh.triangles[[0, 1]], mesh.triangles[[1, 2]], mesh.triangles[[2, 0]]], axis=1), axis=0
        ),
        axis=1,
        return_counts=True,
    )
    return np.unique(edges[:, count == 1])


def hat_gradients(mesh: TriangleMesh) -> Array:
    """(corner, 2, triangle) gradients of the linear functions that are 1 at a corner and 0 at the others."""
    x, y = mesh.points[:, mesh.triangles]  # (corner, triangle)
    twice_area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    after, before = [1, 2, 0], [2, 0, 1]
    return np.stack([y[after] - y[before], x[before] - x[after]], axis=1) / twice_area


def _laplacian(mesh: TriangleMesh) -> sparse.csr_matrix:
    hat = hat_gradients(mesh)
    x, y = mesh.points[:, mesh.triangles]
    area = np.abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2
    values = np.einsum("ake,bke,e->abe", hat, hat, area)
    rows = np.repeat(mesh.triangles, 3, axis=0).ravel()
    columns = np.tile(mesh.triangles, (3, 1)).ravel()
    n = mesh.points.shape[1]
    return sparse.csr_matrix((values.ravel(), (rows, columns)), shape=(n, n))
