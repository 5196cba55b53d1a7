"""Force and torque on a moving body in any mesh: virtual work at fixed potential, and Maxwell's stress around it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution
from msl_fem.magnetics.solver.postprocess import (
    Cuts,
    SectionFluxDensity,
    cut_probe,
    gradient_maps,
    region_probe,
)
from msl_fem.magnetics.triangles import TriangleMesh, boundary_points, hat_gradients
from msl_fem.materials.constants import MU_0

Indices = NDArray[np.int64]
Symmetry = Literal["none", "x=0"]
ON_AXIS = 1e-9  # of the mesh's width: a point nearer to x = 0 lies on the symmetry line
HALFWAY = 0.5  # displacement share on the line around the body on which the stress is integrated
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
        self.model = model
        self.mesh = model.mesh
        self.centre = np.array(centre)
        self.share = displacement_share(self.mesh, moving, air=air, symmetry=symmetry)
        self._hat = hat_gradients(self.mesh)  # (corner, 2, triangle)
        shares = self.share[self.mesh.triangles]
        self._deforming = np.flatnonzero(np.ptp(shares, axis=0) > 0)
        self._contour = StressContour(model, self.share)

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
        still, moving = np.zeros_like(x), np.ones_like(x)
        turning = np.stack([-y, x])
        return BodyForce(along(np.stack([moving, still])), along(np.stack([still, moving])), along(turning))

    def force_stress_tensor(self, potential: Array) -> BodyForce:
        """Force by Maxwell's stress (B (B.n) - |B|^2 n / 2)/mu_0 on the contour p = 1/2 around the body."""
        traction = self._contour.traction(potential)
        x, y = self._contour.points - self.centre[:, None]
        return BodyForce(float(traction[0].sum()), float(traction[1].sum()), float(x @ traction[1] - y @ traction[0]))


class StressContour:
    """The line around a moving body on which its displacement share p is 1/2; it lies in air.

    Attributes
    ----------
    points, normal : (2, n) Gauss points in m, outward unit normals
    weight : (n,) of the points in m; in an axisymmetric section in m2, over the whole circumference
    slope : (2, n) gradient of p in 1/m
    """

    def __init__(self, model: FieldModel, share: Array) -> None:
        mesh = model.mesh
        shares = share[mesh.triangles]
        above = shares > HALFWAY
        crossed = np.flatnonzero(above.any(axis=0) & ~above.all(axis=0))
        shares = shares[:, crossed]
        start, end = _crossings(mesh.points[:, mesh.triangles[:, crossed]], shares)
        slope = np.einsum("ce,cje->je", shares, hat_gradients(mesh)[:, :, crossed])
        node, weight = GAUSS
        middle, half = (start + end) / 2, (end - start) / 2
        self.points = (middle[:, :, None] + half[:, :, None] * node).reshape(2, -1)
        self.slope = np.repeat(slope, node.size, axis=1)
        self.normal = -self.slope / np.hypot(*self.slope)
        self.weight = (np.hypot(*half)[:, None] * weight).ravel()
        if model.axisymmetric:
            self.weight = self.weight * 2 * np.pi * self.points[0]
        self._along_x, self._along_y = gradient_maps(model, self.points, np.repeat(crossed, node.size))

    def flux_density(self, potential: Array) -> Array:
        """(2, n) B in T at the points, on the mesh as it is."""
        return np.stack([self._along_y @ potential, -(self._along_x @ potential)])

    def traction(self, potential: Array) -> Array:
        """(2, n) Maxwell's stress (B (B.n) - |B|^2 n / 2)/mu_0 times the weights: the sum is the force on the body.

        N/m per unit depth in the plane; N in an axisymmetric section, where only the component along z adds up.
        """
        return _stress(self.flux_density(potential), self.normal * self.weight)

    def displaced_traction(self, potential: Array, displacement: Array) -> Array:
        """`traction` on the mesh whose points have moved by p times a displacement (2,) in m.

        With F = I + displacement grad p' and J = det F flux is kept, B' = F B / J, and areas are J F^-T n dA (Nanson).
        """
        j = 1 + displacement @ self.slope
        b = self.flux_density(potential)
        b = (b + displacement[:, None] * (self.slope * b).sum(axis=0)) / j
        area = self.normal * self.weight
        return _stress(b, j * area - self.slope * (displacement @ area))


def _stress(b: Array, area: Array) -> Array:
    """(2, n) (B (B.a) - |B|^2 a / 2)/mu_0 of B and area vectors a, (2, n) each."""
    return np.asarray((b * (b * area).sum(axis=0) - 0.5 * (b**2).sum(axis=0) * area) / MU_0)


def _crossings(corners: Array, share: Array) -> tuple[Array, Array]:
    """Both points (2, element) where p = 1/2 crosses the edges of triangles with corners (2, 3, element)."""
    above = share > HALFWAY
    alone = np.argmax(above != (above.sum(axis=0) >= 2), axis=0)  # the corner on one side, the other two on the other
    every = np.arange(share.shape[1])
    ends = []
    for step in (1, 2):
        other = (alone + step) % 3
        t = (HALFWAY - share[alone, every]) / (share[other, every] - share[alone, every])
        ends.append(corners[:, alone, every] + t * (corners[:, other, every] - corners[:, alone, every]))
    return ends[0], ends[1]


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


def _laplacian(mesh: TriangleMesh) -> sparse.csr_matrix:
    hat = hat_gradients(mesh)
    x, y = mesh.points[:, mesh.triangles]
    area = np.abs((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2
    values = np.einsum("ake,bke,e->abe", hat, hat, area)
    rows = np.repeat(mesh.triangles, 3, axis=0).ravel()
    columns = np.tile(mesh.triangles, (3, 1)).ravel()
    n = mesh.points.shape[1]
    return sparse.csr_matrix((values.ravel(), (rows, columns)), shape=(n, n))


class MovingProbes:
    """What is read on a section whose mesh has a motion; stands beside `Probes` and is asked the same.

    Flux densities are those of the section's cuts; where it has none, means and largest values
    over the area of each iron.
    """

    def __init__(self, model: FieldModel, section: Section) -> None:
        assert model.mesh.motion is not None, "the mesh has a motion"
        self.model = model
        self.scale = section.scale
        self.cuts = Cuts((cut.name, cut_probe(model, cut)) for cut in section.cuts)
        if not self.cuts:
            self.cuts = Cuts((name, region_probe(model, name)) for name in model.irons)
        self._motion = model.mesh.motion
        self._contour = StressContour(model, self._motion.share)

    def section_flux_density(self, potential: Array) -> dict[str, SectionFluxDensity]:
        """|B| in the iron over each cut, or each iron."""
        return self.cuts.flux_density(self.model, potential)

    def force_stress_tensor(self, solution: FieldSolution) -> float:
        """The force in N against the motion, by Maxwell's stress around the body."""
        direction = self._motion.direction
        moved = direction * (solution.gap - self.model.mesh.gap)
        traction = self._contour.displaced_traction(solution.potential, moved).sum(axis=1)
        return -self.scale * float(direction @ traction)
