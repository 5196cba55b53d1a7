"""Axisymmetric magnets with a plunger: the section at a displacement, its field, force by two routes, the table."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline, make_interp_spline

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.outlines import convex_corners, outlines_meet
from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, field_response, solve_field
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.solver.virtual_work import StressContour, displacement_share
from msl_fem.magnetics.triangles import hat_gradients
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron
from msl_fem.table.magnetic_table import MagneticTable

PLUNGER = "plunger"
SIZE = MeshSize(corner=0.05, gap=1.0, iron=0.25, growth=0.35)
FEWEST_GAPS = 4
FEWEST_CURRENTS = 4


@dataclass(frozen=True, eq=False)
class PlungerMagnet:
    """A magnet of revolution about r = 0 whose plunger moves along z; lengths in m.

    Attributes
    ----------
    fixed : polygons (r, z) of iron and coil, painted in order on the air
    plunger : polygon (r, z) of the plunger at displacement 0
    irons : region name to iron, "plunger" among them; every other region is vacuum
    turns_density : region name to turns per area in 1/m2, signed
    box : outer radius, lowest and highest z of the air; A = 0 there
    gap : the smallest distance of plunger and fixed iron, to which element sizes relate
    """

    fixed: tuple[Region, ...]
    plunger: tuple[tuple[float, float], ...]
    irons: "Mapping[str, Iron | AnalyticIron]"
    turns_density: Mapping[str, float]
    box: tuple[float, float, float]
    gap: float


@dataclass(frozen=True)
class PlungerResult:
    """One field solution of a plunger magnet, in SI units.

    `force` along +z by virtual work and `force_stress_tensor` by the Maxwell stress on a surface around the plunger;
    `plunger_flux` is the largest flux through a cross section of the plunger.
    """

    current: float
    displacement: float
    force: float
    force_stress_tensor: float
    flux_linkage: float
    coenergy: float
    incremental_inductance: float
    plunger_flux: float
    unknowns: int
    newton_iterations: int


@dataclass(frozen=True, eq=False)
class PlungerField:
    """A plunger magnet meshed at one displacement; `motion` (n_point,) is the virtual displacement along z.

    It is 1 on the plunger, 0 on what is fixed and on the box, harmonic and linear by triangle in the air between.
    """

    magnet: PlungerMagnet
    displacement: float
    model: FieldModel
    motion: Array = field(repr=False)

    def solve(self, current: float, *, start: Array | None = None) -> FieldSolution:
        """The field at a coil current; raises NotConverged."""
        return solve_field(self.model, current, self.model.mesh.gap, start=start)

    def evaluate(self, solution: FieldSolution) -> PlungerResult:
        """The numbers of the last solution."""
        model = self.model
        a = solution.potential
        flux_linkage = float(model.source @ a)
        nodes = np.unique(model.mesh.triangles[:, model.mesh.elements(PLUNGER)])
        flux = 2 * np.pi * model.mesh.points[0, nodes] * a[model.basis.nodal_dofs[0, nodes]]
        return PlungerResult(
            current=solution.current,
            displacement=self.displacement,
            force=force_by_virtual_work(model, solution, self.motion),
            force_stress_tensor=float(StressContour(model, self.motion).traction(a)[1].sum()),
            flux_linkage=flux_linkage,
            coenergy=solution.current * flux_linkage - model.energy(a, solution.gap),
            incremental_inductance=float(model.source @ field_response(model, solution).by_current),
            plunger_flux=float(flux[np.argmax(np.abs(flux))]),
            unknowns=model.free.size,
            newton_iterations=len(solution.trail),
        )


def plunger_section(magnet: PlungerMagnet, displacement: float) -> Section:
    """The half section r >= 0 with the plunger displaced along z; convex corners of the iron are graded.

    Raises
    ------
    InputError : the plunger would touch another region or the box's edge
    """
    moved = tuple((r, z + displacement) for r, z in magnet.plunger)
    edge, low, high = magnet.box
    air = Region("air", ((0.0, low), (edge, low), (edge, high), (0.0, high)))
    plunger = Region(PLUNGER, moved)
    for other in magnet.fixed:
        _check_apart(plunger, other, displacement)
    heights = [z for _, z in moved]
    if min(heights) <= low or max(heights) >= high or max(r for r, _ in moved) >= edge:
        raise InputError(
            f"at displacement {format_quantity(displacement, 'm')} the plunger leaves the air box, z = "
            f"{format_quantity(low, 'm')} ... {format_quantity(high, 'm')}; widen the box or move the plunger less"
        )
    iron = [r for r in magnet.fixed if r.name in magnet.irons]
    corners = [c for r in iron for c in convex_corners(r.vertices, moved, magnet.gap)]
    corners += convex_corners(moved, iron[0].vertices, magnet.gap, *(r.vertices for r in iron[1:]))
    names = {name: (material.name, 1.0) for name, material in magnet.irons.items()}
    regions = (air, *magnet.fixed, plunger)
    return Section(regions, tuple(corners), (), names, dict(magnet.turns_density), depth=1.0, gap=magnet.gap)


def plunger_field(
    magnet: PlungerMagnet, displacement: float, *, size: MeshSize | None = None, order: int = 3
) -> PlungerField:
    """The magnet meshed with its plunger at a displacement along z (m), ready to be solved.

    Raises
    ------
    InputError : see `plunger_section`
    ComputationError : the mesher gave up
    """
    mesh = triangulate(plunger_section(magnet, displacement), size or SIZE)
    motion = displacement_share(mesh, (PLUNGER,), air=("air",), symmetry="x=0")
    model = FieldModel(mesh, magnet.irons, turns_density=magnet.turns_density, order=order, axisymmetric=True)
    return PlungerField(magnet, displacement, model, motion)


def solve_plunger(
    magnet: PlungerMagnet, current: float, displacement: float, *, size: MeshSize | None = None, order: int = 3
) -> PlungerResult:
    """One field solution: coil current in A, displacement of the plunger along z in m.

    Raises
    ------
    InputError : see `plunger_section`
    ComputationError : the mesher or Newton's iteration failed
    """
    meshed = plunger_field(magnet, displacement, size=size, order=order)
    return meshed.evaluate(meshed.solve(current))


def force_by_virtual_work(model: FieldModel, solution: FieldSolution, motion: Array) -> float:
    """F_z in N: minus the exact derivative of the discrete energy at fixed potential when the nodes move along z.

    With z' = z + s v, r kept and the flux 2 pi r A through each circle kept, dB_r/ds = -B_r dv/dz, dB_z/ds = B_r dv/dr
    and the volume grows by dv/dz: F = integral of ((B_r^2 - B_z^2)/2 dv/dz - B_r B_z dv/dr)/mu_0 over the air
    (Coulomb 1983).
    """
    a = model.basis.interpolate(solution.potential)
    r = model.basis.global_coordinates()[0]
    b_z, b_r = a.grad[0] + np.asarray(a) / r, -a.grad[1]
    v_r, v_z = np.einsum("cje,ce->je", hat_gradients(model.mesh), motion[model.mesh.triangles])
    density = (b_r**2 - b_z**2) / 2 * v_z[:, None] - b_r * b_z * v_r[:, None]
    return float(np.sum(density * 2 * np.pi * r * model.basis.dx)) / MU_0


def _check_apart(plunger: Region, other: Region, displacement: float) -> None:
    """InputError where an outline enters or touches the other polygon."""
    if outlines_meet(plunger.vertices, other.vertices):
        raise InputError(
            f"at displacement {format_quantity(displacement, 'm')} the plunger touches the {other.name}; "
            "move it less or the other way"
        )


def plunger_table(
    magnet: PlungerMagnet,
    gap: ArrayLike,
    current: ArrayLike,
    *,
    size: MeshSize | None = None,
    order: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> MagneticTable:
    """The table of a plunger magnet whose air gap is the plunger's displacement and whose force closes it.

    Parameters
    ----------
    gap : (n_gap,) m, increasing and positive; each is meshed and solved on its own
    current : (n_current,) A, increasing and positive; the column 0 A is added
    progress : called with (gaps done, all gaps)

    Coenergy, flux linkage, force and incremental inductance are field solutions. The force's slopes are those of cubic
    splines through them: odd or even in the current, over log(gap).

    Raises
    ------
    InputError : too few nodes, or nodes that are not positive and increasing; a plunger that touches another part
    ComputationError : the mesher or Newton's iteration failed
    """
    gaps = _nodes("gaps", gap, FEWEST_GAPS)
    currents = _nodes("currents", current, FEWEST_CURRENTS)
    rows = []
    for done, displacement in enumerate(gaps, start=1):
        rows.append(_row(magnet, float(displacement), currents, size, order))
        if progress is not None:
            progress(done, gaps.size)
    solved = np.array(rows)
    coenergy, flux_linkage, force, inductance = (np.insert(solved[:, :, k], 0, 0.0, axis=1) for k in range(4))
    inductance[:, 0] = _at_rest(currents, inductance[:, 1:])
    everywhere = np.r_[0.0, currents]
    mirrored = np.r_[-currents[::-1], everywhere]
    along_current = [CubicSpline(mirrored, np.r_[row[:0:-1], row])(everywhere, 1) for row in force]
    along_gap = make_interp_spline(np.log(gaps), force, k=3)(np.log(gaps), 1) / gaps[:, None]
    return MagneticTable(
        gap=gaps,
        current=everywhere,
        nodes={
            "coenergy": coenergy,
            "flux_linkage": flux_linkage,
            "force": force,
            "incremental_inductance": inductance,
            "force_current_slope": np.array(along_current),
            "force_gap_slope": along_gap,
        },
        provenance={"solver": f"axisymmetric plunger magnet, P{order}, each gap on its own mesh"},
    )


def _row(
    magnet: PlungerMagnet, displacement: float, currents: Array, size: MeshSize | None, order: int
) -> list[tuple[float, float, float, float]]:
    """Coenergy, flux linkage, force that closes the gap and incremental inductance at each current."""
    field = plunger_field(magnet, displacement, size=size, order=order)
    start = None
    row = []
    for current in currents:
        solution = field.solve(float(current), start=start)
        start = solution.potential
        point = field.evaluate(solution)
        row.append((point.coenergy, point.flux_linkage, -point.force, point.incremental_inductance))
    return row


def _at_rest(currents: Array, inductance: Array) -> Array:
    """(n_gap,) incremental inductance without current, by an even parabola through the two smallest currents."""
    near, far = currents[:2] ** 2
    return (far * inductance[:, 0] - near * inductance[:, 1]) / (far - near)


def _nodes(name: str, values: ArrayLike, fewest: int) -> Array:
    nodes = np.array(values, dtype=float)
    if nodes.ndim != 1 or nodes.size < fewest or not (np.diff(nodes) > 0).all() or not nodes[0] > 0:
        raise InputError(f"{name} must be at least {fewest}, positive and increasing; these are {nodes.tolist()}")
    return nodes
