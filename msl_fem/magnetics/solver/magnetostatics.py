"""Nonlinear magnetostatics in two dimensions: weak form, exact tangent, damped Newton.

It knows regions, irons and turns, nothing of magnets. In a plane section the unknown is A_z; minimise
Pi(A) = W(A; g) - i f.A, W the field energy per unit depth, f the flux linkage per unit depth of a unit potential (e.g.
Bastos and Sadowski, Electromagnetic Modeling by Finite Element Methods, 2003, ch. 4). W is convex, so Newton with a
line search ends at the one solution.

The gap enters through a strip of air of height g, whose elements stretch with s = g / g_mesh:
W_strip = (A.S_x A s + A.S_y A / s) / 2 exactly, so every derivative with respect to the gap is exact as well. Where an
armature moves between two magnets there are two strips, and its position takes the place of the gap (`strip.py`).
Where the mesh has a motion there is no strip: the air around what moves deforms (`moving_air.py`).

In an axisymmetric section (x is r, y is z) the unknown is A_phi, zero on the axis; B_z = dA/dr + A/r takes the place of
the derivative along x, weights are multiplied by 2 pi r, the rest stays, and energy and flux linkage are those of the
whole. 2 pi r A is the flux through the circle of radius r. Quadratic elements for r A, the other choice, are 1.6 times
less accurate in the energy norm and one order in B on the axis.
"""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, ElementTriP2, ElementTriP3, ElementTriP4, MeshTri

from msl_fem.computing.arrays import Array
from msl_fem.errors import NotConverged
from msl_fem.magnetics.section import Symmetry
from msl_fem.magnetics.solver.iron_elements import ElementGeometry, IronElements
from msl_fem.magnetics.solver.moving_air import MovingAir, moving_triangles
from msl_fem.magnetics.solver.strip import AirDepth, Strip, StripStiffness
from msl_fem.magnetics.solver.tangent import SparseTangent
from msl_fem.magnetics.triangles import TriangleMesh, hat_gradients
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron

ELEMENTS = {2: ElementTriP2, 3: ElementTriP3, 4: ElementTriP4}
FALLING = 0.3  # from one of Newton's steps to the next, where they fall fast
FALLS_FAST = 1e-2  # a relative step below which Newton's steps are a constant times the square of the one before
NEAR = FALLS_FAST / FALLING  # a first step that falls fast from here began beside the solution
KEPT_FALLS = 0.2  # from one of Newton's steps to the next with the same factors, which else are made anew
KEPT_SAFETY = 5  # on the step that would come next, were it to shrink like the last one
ON_PLANE = 1e-9  # of the mesh's width: a point nearer to x = 0 lies on the plane of symmetry


@dataclass(frozen=True)
class NewtonSettings:
    """When Newton's iteration ends.

    Attributes
    ----------
    tolerance : on the energy norm of the error over that of the field, as `expected_error` tells it
    iterations : most steps before NotConverged
    kept : steps at most with the factors of the one before, where these fall fast enough; not where slopes are asked
        afterwards, as the factors at hand are then of a field further away
    """

    tolerance: float = 1e-7
    iterations: int = 60
    kept: int = 0


@dataclass(frozen=True, eq=False)
class FieldSolution:
    """A converged field: nodal potential, where it belongs, and how Newton got there.

    Attributes
    ----------
    potential : (n_dof,) A_z or A_phi in Wb/m at the free and fixed degrees of freedom
    current, gap : A, m
    trail : relative energy norm of each Newton step
    tangent : (nnz,) the energy's second derivative at the potential, on the model's pattern
    """

    potential: Array
    current: float
    gap: float
    trail: tuple[float, ...]
    tangent: Array = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
class FieldResponse:
    """Derivatives of the potential: dA/di and dA/dgap, (n_dof,) each, by back-substitution of the last tangent."""

    by_current: Array
    by_gap: Array


def _box_facets(mesh: MeshTri, symmetry: Symmetry) -> NDArray[np.int64]:
    """The facets on which A = 0: all of the edge, but for an equipotential on x = 0."""
    facets = np.asarray(mesh.boundary_facets())
    if symmetry != "equipotential":
        return facets
    x = mesh.p[0, mesh.facets[:, facets]]
    return facets[(np.abs(x) > ON_PLANE * np.ptp(mesh.p[0])).any(axis=0)]


def _pairs(basis: Basis) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column of each entry of the elements' matrices (local, local, element)."""
    rows = np.repeat(basis.element_dofs, basis.Nbfun, axis=0).ravel()
    return rows, np.tile(basis.element_dofs, (basis.Nbfun, 1)).ravel()


def _gradients(basis: Basis, axisymmetric: bool) -> tuple[Array, Array]:
    """(dA/dx, dA/dy) or (dA/dr + A/r, dA/dz), (local, 2, element, point), and weights (element, point).

    The size of either pair is |B|.
    """
    gradients = np.stack([basis.basis[k][0].grad for k in range(basis.Nbfun)])
    if not axisymmetric:
        return gradients, basis.dx
    r = basis.global_coordinates()[0]
    gradients[:, 0] += np.stack([np.asarray(basis.basis[k][0]) for k in range(basis.Nbfun)]) / r
    return gradients, 2 * np.pi * r * basis.dx


def _iron_geometry(basis: Basis, axisymmetric: bool) -> ElementGeometry:
    """The elements of a basis, with the jets and frames of `_gradients`."""
    shapes = [basis.elem.lbasis(basis.X, k) for k in range(basis.Nbfun)]
    jets = np.stack([derivative for _, derivative in shapes])
    if not axisymmetric:
        frame = basis.mapping.invDF(basis.X[:, :1], basis.tind).transpose(1, 0, 2, 3)
        return ElementGeometry(np.ascontiguousarray(basis.element_dofs.T), jets, frame, basis.dx)
    r = basis.global_coordinates()[0]
    jets = np.concatenate([jets, np.stack([value for value, _ in shapes])[:, None]], axis=1)
    slopes = basis.mapping.invDF(basis.X, basis.tind).transpose(1, 0, 2, 3)
    frame = np.concatenate([slopes, np.stack([1 / r, np.zeros_like(r)])[:, None]], axis=1)
    return ElementGeometry(np.ascontiguousarray(basis.element_dofs.T), jets, frame, 2 * np.pi * r * basis.dx)


class FieldModel:
    """A discretised section: everything that does not depend on current, gap or field, made once.

    Parameters
    ----------
    mesh : triangles with region names
    irons : region name to iron; every other region is vacuum
    turns_density : region name to turns per area in 1/m2, signed
    order : polynomial degree of the potential, 2 to 4
    axisymmetric : the mesh lies in the half plane (r, z), r >= 0; results are those of the whole, not per unit depth
    symmetry : what x = 0 is, see `Section`; A is free on an equipotential
    air_depth : of air that is deeper than the iron; results are per unit depth of the iron
    strips : regions of air that stretch, where the mesh has no motion; "gap" in the methods below is the coordinate
        that their heights follow
    """

    def __init__(
        self,
        mesh: TriangleMesh,
        irons: "Mapping[str, Iron | AnalyticIron]",
        *,
        turns_density: Mapping[str, float],
        order: int = 2,
        axisymmetric: bool = False,
        symmetry: Symmetry = "flux line",
        air_depth: AirDepth | None = None,
        strips: Sequence[Strip] = (Strip(),),
    ) -> None:
        axisymmetric = axisymmetric or symmetry == "axis"
        self.mesh, self.order, self.axisymmetric = mesh, order, axisymmetric
        self.air_depth = air_depth or AirDepth()
        self._linear_degree = 2 * order if axisymmetric else 2 * order - 2  # of |B|^2 r and |B|^2
        self.skfem_mesh = MeshTri(np.ascontiguousarray(mesh.points), np.ascontiguousarray(mesh.triangles))
        whole = Basis(self.skfem_mesh, ELEMENTS[order](), intorder=self._linear_degree)
        self.basis = whole
        self.n_dof = whole.N
        fixed = whole.get_dofs(_box_facets(self.skfem_mesh, symmetry)).all()
        self.free, self._fixed = np.setdiff1d(np.arange(self.n_dof), fixed), fixed
        self._strips = tuple(strips) if mesh.motion is None else ()
        moving = None if mesh.motion is None else moving_triangles(mesh, mesh.motion)
        self._still = mesh.elements(*set(mesh.names) - set(irons) - {strip.region for strip in self._strips})
        if moving is not None:
            self._still = np.setdiff1d(self._still, moving.elements)
        self.irons: dict[str, IronElements] = {}
        for name, iron in irons.items():
            self.irons[name] = IronElements(self._iron_geometry(name), iron)
        self.source = self._source(turns_density)
        linear = self._linear_parts()
        pieces = [(matrix.row, matrix.col) for matrix in linear]
        if moving is not None:
            deforming = self._part(moving.elements, self._linear_degree)
            pieces.append(_pairs(deforming))
        n_linear = len(pieces)
        pieces += [(np.minimum(*part.pairs), np.maximum(*part.pairs)) for part in self.irons.values()]
        self.tangent = SparseTangent(self.free, self.n_dof, pieces)
        self._iron_places = [
            self.tangent.places(k, part.pairs[0].shape) for k, part in enumerate(self.irons.values(), start=n_linear)
        ]
        self._take(linear)
        if moving is not None:
            gradients, weight = _gradients(deforming, axisymmetric)
            self.strips.append(
                MovingAir(
                    moving,
                    mesh.gap,
                    dofs=deforming.element_dofs,
                    gradients=gradients,
                    weight=weight,
                    gather=partial(self.tangent.gather, len(linear)),
                )
            )
        self.last_response: tuple[FieldSolution, FieldResponse] | None = None

    def _linear_parts(self) -> list[sparse.coo_matrix]:
        """The stiffness of what neither stretches nor deforms, then for each strip those along x and along y."""
        pairs = [self._stiffness(self.mesh.elements(strip.region)) for strip in self._strips]
        return [self._stiffness(self._still, whole=True)[0], *(matrix for pair in pairs for matrix in pair)]

    def _take(self, linear: "list[sparse.coo_matrix]") -> None:
        """Let these be the linear regions' parts, of the same pattern as ever."""
        values = [self.tangent.gather(k, matrix.data) for k, matrix in enumerate(linear)]
        full = [matrix.tocsr() for matrix in linear]
        self._rest, self._rest_values = full[0], values[0]
        self.strips: list[StripStiffness | MovingAir] = [
            StripStiffness(strip, self.mesh.gap, *full[k : k + 2], *values[k : k + 2])
            for strip, k in zip(self._strips, range(1, len(linear), 2), strict=True)
        ]
        self._linear = np.nan, values[0]  # the gap and the linear regions' values there

    def moved(
        self, points: Array, turns_density: Mapping[str, float], *, air_depth: AirDepth | None = None
    ) -> "FieldModel":
        """The same elements with their corners elsewhere (2, n_point); a mesh with a motion cannot be moved."""
        assert self.mesh.motion is None, "the mesh has strips"
        other = self._unsolved()
        other.mesh, other.air_depth = replace(self.mesh, points=points), air_depth or AirDepth()
        other.skfem_mesh = MeshTri(np.ascontiguousarray(points), self.skfem_mesh.t, sort_t=False, validate=False)
        other.basis = Basis(
            other.skfem_mesh, ELEMENTS[self.order](), intorder=self._linear_degree, dofs=self.basis.dofs
        )
        other.irons = {name: IronElements(other._iron_geometry(name), part.iron) for name, part in self.irons.items()}
        other.source = other._source(turns_density)
        other._take(other._linear_parts())
        return other

    def in_air(self, air_depth: AirDepth) -> "FieldModel":
        """The same discretisation with air of another depth; a mesh with a motion has none."""
        assert self.mesh.motion is None, "the mesh has strips"
        other = self._unsolved()
        other.air_depth = air_depth
        other._take(other._linear_parts())
        return other

    def with_turns(self, turns_density: Mapping[str, float]) -> "FieldModel":
        """The same discretisation with other turns, for sections with several coils.

        For coil currents i_k drive it by the densities i_k n_k at a current of 1; `source` of the densities n_k alone
        gives coil k's flux linkage.
        """
        other = self._unsolved()
        other.source = self._source(turns_density)
        return other

    def with_irons(self, irons: "Mapping[str, Iron | AnalyticIron]") -> "FieldModel":
        """The same discretisation with other irons in the same regions."""
        other = self._unsolved()
        other.irons = {name: part.with_iron(irons[name]) for name, part in self.irons.items()}
        return other

    def _unsolved(self) -> "FieldModel":
        other = copy(self)
        other.tangent = self.tangent.unfactored()
        other.last_response = None
        return other

    @property
    def stiffness_at_rest(self) -> sparse.csr_matrix:
        """(n_dof, n_dof) of the linear regions that neither stretch nor deform."""
        return self._rest

    @property
    def motion_share(self) -> Array:
        """(n_dof,) share of the mesh's motion at the degrees of freedom, which are values at points."""
        mesh = self.mesh
        assert mesh.motion is not None, "the mesh has a motion"
        slope = np.einsum("ce,cje->je", mesh.motion.share[mesh.triangles], hat_gradients(mesh))
        origin = mesh.triangles[0]
        dofs = self.basis.element_dofs
        away = self.basis.doflocs[:, dofs] - mesh.points[:, origin][:, None]
        share = np.empty(self.n_dof)
        share[dofs] = mesh.motion.share[origin] + np.einsum("je,jke->ke", slope, away)
        return share

    def _part(self, elements: NDArray[np.int64], degree: int) -> Basis:
        """The basis on some elements, with a quadrature that is exact up to a degree."""
        return Basis(
            self.skfem_mesh,
            ELEMENTS[self.order](),
            mapping=self.basis.mapping,
            intorder=degree,
            elements=elements,
            dofs=self.basis.dofs,
            disable_doflocs=True,
        )

    def _iron_geometry(self, name: str) -> ElementGeometry:
        return _iron_geometry(self._part(self.mesh.elements(name), 2 * self.order), self.axisymmetric)

    def _stiffness(self, elements: NDArray[np.int64], *, whole: bool = False) -> list[sparse.coo_matrix]:
        """Integrals of dA/dx dA'/dx and dA/dy dA'/dy over mu_0 (and the air's depth), each (n_dof, n_dof); or the sum.

        Entries that cancel are kept, so that the pattern is that of the elements alone.
        """
        shape = self.n_dof, self.n_dof
        if elements.size == 0:
            return [sparse.coo_matrix(shape)] * (1 if whole else 2)
        basis = self._part(elements, self._linear_degree)
        gradient, weight = _gradients(basis, self.axisymmetric)
        if self.air_depth.regions:
            weight = weight / self._depth_factor(elements, np.asarray(basis.global_coordinates()))
        rows, columns = _pairs(basis)
        each = [
            np.einsum("aep,bep,ep->abe", g, g, weight / MU_0, optimize=True).ravel()
            for g in (gradient[:, 0], gradient[:, 1])
        ]
        values = [each[0] + each[1]] if whole else each
        return [sparse.csc_matrix((value, (rows, columns)), shape=shape).tocoo() for value in values]

    def _depth_factor(self, elements: NDArray[np.int64], points: Array) -> Array:
        """The air's depth factor (element, point) outside the strip."""
        factor = np.ones(points.shape[1:])
        for name, depth in self.air_depth.regions.items():
            inside = np.isin(elements, self.mesh.elements(name))
            factor[inside] = depth(points[:, inside])
        return factor

    def _source(self, turns_density: Mapping[str, float]) -> Array:
        """f (n_dof,): flux linkage (per unit depth in the plane) is f.A, and i f is the load."""
        load = np.zeros(self.n_dof)
        for name, density in turns_density.items():
            basis = self._part(self.mesh.elements(name), 2 * self.order)
            weight = basis.dx
            if self.axisymmetric:
                weight = 2 * np.pi * basis.global_coordinates()[0] * weight
            for k in range(basis.Nbfun):
                np.add.at(load, basis.element_dofs[k], density * (basis.basis[k][0] * weight).sum(axis=1))
        return load

    def linear_product(self, potential: Array, gap: float) -> Array:
        """The product of the linear regions' stiffness at a gap with a potential, (n_dof,).

        Where the potential is zero at fixed entries, the product is left at zero there.
        """
        if not potential[self._fixed].any():
            return self.tangent.product(self._linear_at(gap), potential)
        product: Array = self._rest @ potential
        for strip in self.strips:
            product = product + strip.product(potential, gap, self.air_depth)
        return product

    def _linear_at(self, gap: float) -> Array:
        """The linear regions' stiffness at a gap, on the tangent's pattern (nnz,)."""
        if self._linear[0] != gap:
            values = [strip.values(gap, self.air_depth) for strip in self.strips]
            self._linear = gap, sum(values, self._rest_values)
        return self._linear[1]

    def strip_energy(self, potential: Array, gap: float) -> float:
        """Field energy of the strips, as `energy`."""
        return 0.5 * sum(float(potential @ strip.product(potential, gap, self.air_depth)) for strip in self.strips)

    def strip_products(self, potential: Array, gap: float) -> tuple[Array, Array]:
        """First and second derivative with respect to the gap of `linear_product`, (n_dof,) each."""
        slopes = [strip.slopes(potential, gap, self.air_depth) for strip in self.strips]
        return np.sum([first for first, _ in slopes], axis=0), np.sum([second for _, second in slopes], axis=0)

    def assemble(self, potential: Array, gap: float) -> tuple[Array, Array]:
        """Gradient of W (n_dof,), and its second derivative's values on the pattern (nnz,)."""
        gradient = self.linear_product(potential, gap)
        data = self._linear_at(gap).copy()
        for part, places in zip(self.irons.values(), self._iron_places, strict=True):
            part.add_terms(potential, places, gradient, data)
        return gradient, data

    def energy(self, potential: Array, gap: float) -> float:
        """Field energy W: per unit depth in J/m, or of the whole in J."""
        return float(self.energies(potential[None], gap)[0])

    def energies(self, potentials: Array, gap: float) -> Array:
        """(n,) `energy` of potentials (n, n_dof) at one gap."""
        linear = np.array([0.5 * float(a @ self.linear_product(a, gap)) for a in potentials])
        return np.asarray(sum((part.energies(potentials) for part in self.irons.values()), linear))


def solve_field(
    model: FieldModel,
    current: float,
    gap: float,
    *,
    start: Array | None = None,
    settings: NewtonSettings | None = None,
) -> FieldSolution:
    """The field at a coil current (A) and a gap (m).

    After it, `model` holds the tangent's factors of the last iteration: `field_response` uses them.

    Raises
    ------
    NotConverged : the steps did not fall below the tolerance; the message has the trail
    """
    settings = settings or NewtonSettings()
    potential = np.zeros(model.n_dof) if start is None else start.copy()
    load = current * model.source
    gradient, data = model.assemble(potential, gap)
    trail: list[float] = []
    for _ in range(settings.iterations):
        model.tangent.factor(data)
        residual = gradient - load
        step = -model.tangent.substitute(residual)
        descent = -float(step @ residual)
        potential, gradient, data = _line_search(model, potential, step, gap=gap, load=load, descent=descent)
        scale = float(potential @ gradient)
        if not np.isfinite(descent) or not np.isfinite(scale):
            trail.append(np.nan)
            break
        trail.append((descent / scale) ** 0.5 if scale > 0 and descent > 0 else 0.0)
        if expected_error(trail) <= settings.tolerance:
            return FieldSolution(potential, current, gap, tuple(trail), data)
        for _ in range(settings.kept):
            residual = gradient - load
            step = -model.tangent.substitute(residual)
            before, descent = descent, -float(step @ residual)
            if not 0 <= descent <= KEPT_FALLS**2 * before:
                break
            potential = potential + step
            gradient, data = model.assemble(potential, gap)
            trail.append((descent / scale) ** 0.5)
            if KEPT_SAFETY * trail[-1] * (descent / before) ** 0.5 <= settings.tolerance:
                return FieldSolution(potential, current, gap, tuple(trail), data)
    raise NotConverged(
        f"the field at {current:g} A and gap {gap * 1e3:g} mm did not converge in {len(trail)} Newton steps; "
        f"relative steps {', '.join(f'{t:.1e}' for t in trail[-6:])}; check the iron's B-H curve or start nearer"
    )


def expected_error(trail: Sequence[float]) -> float:
    """The relative error that the last of Newton's steps leaves, from the relative sizes of the steps so far.

    Where three steps in a row fall fast, each is a constant times the square of the one before (Kantorovich), and the
    error is about the step that would come next, which is taken ten times here, for curves that are smooth piece by
    piece; else no more can be said than that it is below the last step. Two steps tell, if less (a hundred times is
    taken), where the first one is small: that from nothing is as large as the field, whatever follows.
    """
    last = trail[-1]
    if len(trail) < 2 or last > FALLS_FAST:
        return last
    before, earlier = trail[-2], trail[-3] if len(trail) > 2 else NEAR
    if not last <= FALLING * before <= FALLING**2 * earlier:
        return last
    safety = 10 if len(trail) > 2 else 100
    return min(last, safety * last * (last / before) ** 2)


def _line_search(
    model: FieldModel, potential: Array, step: Array, *, gap: float, load: Array, descent: float
) -> tuple[Array, Array, Array]:
    """Potential, gradient and tangent where the energy's slope along the step is small enough.

    Along the step Pi is convex with slope -descent at 0: the full step is taken unless the slope there says that it
    overshot by more than half; then the root of the slope is bracketed (regula falsi, Illinois).
    """
    low, low_slope, high, high_slope = 0.0, -descent, 1.0, 0.0
    t = 1.0
    for _ in range(30):
        trial = potential + t * step
        gradient, data = model.assemble(trial, gap)
        slope = float(step @ (gradient - load))
        if abs(slope) <= 0.5 * descent or (t == 1.0 and slope < 0) or descent <= 0:
            break
        if slope > 0:
            high, high_slope = t, slope
            low_slope /= 2
        else:
            low, low_slope = t, slope
            high_slope /= 2
        t = low - low_slope * (high - low) / (high_slope - low_slope)
    return trial, gradient, data


def field_response(model: FieldModel, solution: FieldSolution) -> FieldResponse:
    """dA/di and dA/dgap at a solution that was the last one `model` solved, by back-substitutions.

    The factors are those of the tangent one Newton step before; iterative refinement takes their answers to the tangent
    at the solution itself.
    """
    if model.last_response is None or model.last_response[0] is not solution:
        first, _ = model.strip_products(solution.potential, solution.gap)
        response = FieldResponse(
            model.tangent.refined_substitute(model.source, solution.tangent),
            -model.tangent.refined_substitute(first, solution.tangent),
        )
        model.last_response = solution, response
    return model.last_response[1]
