"""Numbers from a field: flux linkage, coenergy, force by two routes, slopes, flux density on sections."""

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.section import Line, Section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, field_response
from msl_fem.magnetics.solver.moving_air import moving_triangles
from msl_fem.magnetics.solver.strip import STRIP
from msl_fem.materials.constants import MU_0

N_SAMPLE = 48
END = 1e-6  # of a cut, so that a point at its end is inside the iron
TAIL_SHARE = 0.01
BESIDE = 1e-3
GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class SectionFluxDensity:
    """|B| in the iron over a cut, in T: mean and max."""

    mean: float
    max: float


@dataclass(frozen=True)
class FieldQuantities:
    """What a field solution says of one magnet of the full stack depth, in SI units.

    `force` is by virtual work and `force_stress_tensor` by the Maxwell stress in mid-gap, attractive positive; the
    slopes are exact derivatives of the discrete coenergy. `rests_on_tail` names the irons of which more
    than 1 % of the area lies beyond the last point of their curve (a corner always does).
    """

    force: float
    force_stress_tensor: float
    flux_linkage: float
    coenergy: float
    incremental_inductance: float
    force_current_slope: float
    force_gap_slope: float
    flux_density: Mapping[str, SectionFluxDensity]
    rests_on_tail: tuple[str, ...]


class CutProbe(NamedTuple):
    """A cut's region, the maps (n_point, n_dof) to the derivatives of A along x and y, the weights of its mean, and the
    elements that its points lie in.

    The first and the last point stand at the cut's ends, for the largest value alone. In a body of revolution the
    weights go with the radius, so that the mean is that over the cut's area.
    """

    region: str
    along_x: sparse.csr_matrix
    along_y: sparse.csr_matrix
    weight: Array
    elements: NDArray[np.int64]

    def mean(self, values: Array) -> float:
        """The mean over the cut's area of values (n_point,)."""
        return float(self.weight @ values[1:-1])


class Cuts(dict[str, CutProbe]):
    """The cuts of a section by name; read together, as one product with the potential."""

    @cached_property
    def _all(self) -> tuple[sparse.csr_matrix, dict[str, list[tuple[str, slice]]]]:
        """The maps along x, then along y, one below the other; by region its cuts and their rows."""
        rows: dict[str, list[tuple[str, slice]]] = {}
        n = 0
        for name, cut in self.items():
            rows.setdefault(cut.region, []).append((name, slice(n, n := n + cut.along_x.shape[0])))
        maps = [cut.along_x for cut in self.values()] + [cut.along_y for cut in self.values()]
        return sparse.vstack(maps, format="csr"), rows

    def flux_density(self, model: FieldModel, potential: Array) -> dict[str, SectionFluxDensity]:
        """|B| in the iron over each cut."""
        if not self:
            return {}
        maps, rows = self._all
        size = np.hypot(*(maps @ potential).reshape(2, -1))
        found = {}
        for region, cuts in rows.items():
            sheets = model.irons[region].iron.iron_flux_density(np.concatenate([size[own] for _, own in cuts]))
            ends = np.cumsum([own.stop - own.start for _, own in cuts])[:-1]
            for (name, _), values in zip(cuts, np.split(sheets, ends), strict=True):
                found[name] = SectionFluxDensity(self[name].mean(values), float(values.max()))
        return {name: found[name] for name in self}

    def means(self, model: FieldModel, potentials: Array) -> dict[str, Array]:
        """(n,) mean of |B| in the iron over each cut, of potentials (n, n_dof)."""
        maps, rows = self._all
        size = np.hypot(*(maps @ potentials.T).reshape(2, -1, len(potentials)))
        found = {}
        for region, cuts in rows.items():
            for name, own in cuts:
                sheets = model.irons[region].iron.iron_flux_density(size[own])
                found[name] = np.asarray(self[name].weight @ sheets[1:-1])
        return {name: found[name] for name in self}


class Probes:
    """Linear maps from the potential to the field where it is read; made once for a model."""

    def __init__(self, model: FieldModel, section: Section) -> None:
        self.cuts = Cuts((cut.name, cut_probe(model, cut)) for cut in section.cuts)
        self._read(model, section)

    def _read(self, model: FieldModel, section: Section) -> None:
        self.model, self.scale = model, section.scale
        points, elements, weight = mid_gap(model)
        self.line_weight = 2 * np.pi * points[0] * weight if model.axisymmetric else weight
        self.line_x, self.line_y = gradient_maps(model, points, elements)

    def moved(self, model: FieldModel, section: Section) -> "Probes":
        """The same probes of a section whose lines, and with them the mesh, lie elsewhere."""
        other = copy(self)
        other.cuts = Cuts((cut.name, cut_probe(model, cut, self.cuts[cut.name].elements)) for cut in section.cuts)
        other._read(model, section)
        return other

    def section_flux_density(self, potential: Array) -> dict[str, SectionFluxDensity]:
        """|B| in the iron over each cut."""
        return self.cuts.flux_density(self.model, potential)

    def force_stress_tensor(self, solution: FieldSolution) -> float:
        """Integral of (B_y^2 - B_x^2)/(2 mu_0) over the mid-gap line, in N (Maxwell's stress on a plane in air).

        Where the strip is deeper than the iron by a factor k, B is that times the air's own, and the force -W k'/k of a
        depth that changes with the gap is added, W the strip's energy: no stress in the section's plane knows of it.
        """
        k, slope, _ = self.model.air_depth.strip(solution.gap)
        b_y = -(self.line_x @ solution.potential)
        b_x = (self.line_y @ solution.potential) * (self.model.mesh.gap / solution.gap)
        in_plane = self.scale * float(self.line_weight @ (b_y**2 - b_x**2)) / (2 * MU_0) / k
        if not slope:
            return in_plane
        energy = self.model.strip_energy(solution.potential, solution.gap)
        return in_plane - self.scale * energy * slope / k


def cut_probe(model: FieldModel, cut: Line, elements: NDArray[np.int64] | None = None) -> CutProbe:
    """The region that a cut lies in, the maps to its field, the weights of its mean.

    `elements` are those of its points on this mesh before it was moved; where they are not the points' any more, others
    are looked for.
    """
    start, end = np.array(cut.start), np.array(cut.end)
    # midpoints of equal parts for the mean; beside them the ends, where the largest values stand
    t = np.concatenate([[END], (np.arange(N_SAMPLE) + 0.5) / N_SAMPLE, [1 - END]])
    points = start[:, None] + (end - start)[:, None] * t
    if elements is None or not inside(model, points, elements):
        elements = np.asarray(model.skfem_mesh.element_finder()(*points))
    name = model.mesh.names[model.mesh.region[elements[N_SAMPLE // 2]]]
    area = points[0, 1:-1] if model.axisymmetric else np.ones(N_SAMPLE)
    return CutProbe(name, *gradient_maps(model, points, elements), area / area.sum(), elements)


def inside(model: FieldModel, points: Array, elements: NDArray[np.int64]) -> bool:
    """Whether points (2, n) lie in the elements given, or beside them by no more than `BESIDE` of their size."""
    local = model.basis.mapping.invF(points[:, :, None], tind=elements)[:, :, 0]
    return bool((local >= -BESIDE).all() and (local.sum(axis=0) <= 1 + BESIDE).all())


def region_probe(model: FieldModel, name: str) -> CutProbe:
    """A region in the place of a cut: three points in each triangle, weighted by its area."""
    mesh = model.mesh
    elements = mesh.elements(name)
    corners = mesh.points[:, mesh.triangles[:, elements]]  # (2, corner, element)
    inner = (0.5 * corners + corners.mean(axis=1, keepdims=True) * 0.5).reshape(2, -1)
    at = np.tile(elements, 3)
    area = np.tile(mesh.areas[elements], 3)
    ends = [0, *range(at.size), at.size - 1]  # a cut's first and last point count for the largest value alone
    return CutProbe(name, *gradient_maps(model, inner[:, ends], at[ends]), area / area.sum(), at[ends])


class FieldReader(Protocol):
    """What `evaluate_field` asks: `Probes`, or those of a mesh with a motion."""

    model: FieldModel
    scale: float

    def section_flux_density(self, potential: Array) -> dict[str, SectionFluxDensity]: ...

    def force_stress_tensor(self, solution: FieldSolution) -> float: ...


def evaluate_field(probes: FieldReader, solution: FieldSolution) -> FieldQuantities:
    """The quantities of a solution that was the last one its model solved (its tangent serves the slopes).

    Force by virtual work at fixed potential: F = dW/dg|_A = A.S_g A / 2, the exact derivative -dW'/dg of the discrete
    coenergy W' = i lambda - W (Coulomb 1983). With A_i = dA/di and A_g = dA/dg by back-substitution:
    dlambda/di = f.A_i, dF/di = A.S_g A_i, dF/dg = A.S_gg A / 2 + A.S_g A_g.
    """
    model = probes.model
    a = solution.potential
    scale = probes.scale
    first, second = model.strip_products(a, solution.gap)
    response = field_response(model, solution)
    flux_linkage = scale * float(model.source @ a)
    return FieldQuantities(
        force=scale * float(a @ first) / 2,
        force_stress_tensor=probes.force_stress_tensor(solution),
        flux_linkage=flux_linkage,
        coenergy=solution.current * flux_linkage - scale * model.energy(a, solution.gap),
        incremental_inductance=scale * float(model.source @ response.by_current),
        force_current_slope=scale * float(first @ response.by_current),
        force_gap_slope=scale * float(a @ second / 2 + first @ response.by_gap),
        flux_density=probes.section_flux_density(a),
        rests_on_tail=irons_on_tail(model, a),
    )


def irons_on_tail(model: FieldModel, potential: Array) -> tuple[str, ...]:
    """The irons of which more than 1 % of the area lies beyond the last point of their curve."""
    names = []
    for name, part in model.irons.items():
        beyond = part.flux_density(potential)[1] > part.iron.tail_from
        if part.weight[beyond].sum() > TAIL_SHARE * part.weight.sum():
            names.append(name)
    return tuple(names)


def triangle_flux_density(model: FieldModel, solution: FieldSolution) -> Array:
    """(2, n_triangle) mean B_x, B_y (or B_r, B_z) of each triangle in T, at the solution's gap."""
    a = model.basis.interpolate(solution.potential)
    gradient, weight = a.grad, model.basis.dx  # (2, triangle, point)
    if model.axisymmetric:  # r, phi, z are right-handed: phi points away from the reader of (r, z)
        r = model.basis.global_coordinates()[0]
        gradient = -np.stack([gradient[0] + np.asarray(a) / r, gradient[1]])
        weight = weight * r
    mean = (gradient * weight).sum(axis=2) / weight.sum(axis=1)
    b = np.stack([mean[1], -mean[0]])
    if model.mesh.motion is not None:
        return _carried(model, b, solution.gap)
    stretch = np.ones(mean.shape[1])
    stretch[model.mesh.elements(STRIP)] = model.mesh.gap / solution.gap
    return np.stack([b[0] * stretch, b[1]])


def _carried(model: FieldModel, b: Array, gap: float) -> Array:
    """B (2, n_triangle) on the deformed mesh, F B / J: the flux through every line that moves with it stays."""
    motion = model.mesh.motion
    assert motion is not None, "the mesh has a motion"
    moving = moving_triangles(model.mesh, motion)
    moved = motion.direction * (gap - model.mesh.gap)
    here = b[:, moving.elements]
    b[:, moving.elements] = (here + moved[:, None] * (moving.slope * here).sum(axis=0)) / (1 + moved @ moving.slope)
    return b


def gradient_maps(
    model: FieldModel, points: Array, elements: NDArray[np.int64]
) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
    """Maps (n_point, n_dof) to dA/dx and dA/dy at points (2, n_point) in the elements given, at the mesh's gap.

    In an axisymmetric section to dA/dr + A/r and dA/dz: the size of either pair is |B|.
    """
    mapping = model.basis.mapping
    local = mapping.invF(points[:, :, None], tind=elements)
    columns, values = [], []
    for k in range(model.basis.Nbfun):
        shape_function = model.basis.elem.gbasis(mapping, local, k, tind=elements)[0]
        gradient = shape_function.grad[:, :, 0]
        if model.axisymmetric:
            gradient = np.stack([gradient[0] + np.asarray(shape_function)[:, 0] / points[0], gradient[1]])
        columns.append(model.basis.element_dofs[k, elements])
        values.append(gradient)
    rows = np.tile(np.arange(elements.size), model.basis.Nbfun)
    at = (rows, np.concatenate(columns))
    stacked = np.concatenate(values, axis=1)
    shape = (elements.size, model.n_dof)
    return sparse.csr_matrix((stacked[0], at), shape=shape), sparse.csr_matrix((stacked[1], at), shape=shape)


def mid_gap(model: FieldModel, region: str = STRIP) -> tuple[Array, NDArray[np.int64], Array]:
    """Gauss points (2, n), their elements and weights on a line in or near the middle of a strip from y = 0 on."""
    mesh = model.mesh
    strip = mesh.elements(region)
    levels = np.unique(mesh.points[1, mesh.triangles[:, strip]]) / mesh.gap
    above = levels[levels > 0.5 + 1e-6][0]
    # a node on the line would belong to elements that only touch it: pass between it and the next
    middle = mesh.gap * (0.5 if np.abs(levels - 0.5).min() > 1e-6 else (0.5 + above) / 2)
    x, y = mesh.points[:, mesh.triangles[:, strip]]  # (3, element) each
    crossings = np.full((3, strip.size), np.nan)
    for k in range(3):
        (x0, y0), (x1, y1) = (x[k], y[k]), (x[k - 1], y[k - 1])
        crosses = (y0 - middle) * (y1 - middle) < 0
        along = (middle - y0) * (x1 - x0) / np.where(crosses, y1 - y0, 1.0)
        crossings[k, crosses] = (x0 + along)[crosses]
    cut = np.isfinite(crossings).sum(axis=0) == 2
    low = np.nanmin(crossings[:, cut], axis=0)
    high = np.nanmax(crossings[:, cut], axis=0)
    node, weight = GAUSS
    points_x = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * node
    weights = (high - low)[:, None] / 2 * weight
    elements = np.repeat(strip[cut], node.size)
    return np.stack([points_x.ravel(), np.full(points_x.size, middle)]), elements, weights.ravel()
