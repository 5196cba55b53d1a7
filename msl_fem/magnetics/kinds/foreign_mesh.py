"""The field of a magnet whose section is a foreign mesh with named regions."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.e_core import LEVELS, Accuracy, PointResult
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, field_response, solve_field
from msl_fem.magnetics.solver.mesh import TriangleMesh
from msl_fem.magnetics.solver.mesh_file import read_mesh
from msl_fem.magnetics.solver.postprocess import TAIL_SHARE, FieldQuantities, SectionFluxDensity
from msl_fem.magnetics.solver.virtual_work import BodyForce, MovingBody, boundary_points
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

LARGEST_AMPERE_TURNS = 1e8  # A: a coil of 1 cm2 of copper melts in milliseconds at 1e6 A

Array = NDArray[np.float64]
KINDS = ("core", "armature", "coil+", "coil-", "air")
SAME_GAP = 1e-6  # relative: a gap asked for that differs more is another one
AREAS_AGREE = 1e-3  # relative: of the coil's two sides


class MeshField:
    """A foreign mesh with irons and turns, ready to be solved at any current; raises as `solve_mesh_magnet`."""

    def __init__(self, actuator: Actuator, *, mesh: TriangleMesh | None = None, order: int = 2) -> None:
        self.actuator, self.magnet = actuator, actuator.mesh_magnet()
        path = actuator.folder / self.magnet.mesh
        if mesh is None:
            mesh = read_mesh(path, unit=self.magnet.length_unit, gap=self.magnet.gap)
        self.regions = _sorted_regions(mesh, str(path))
        self.irons = self._irons()
        self.model = FieldModel(
            mesh, self.irons, turns_density=_turns(mesh, self.regions, self.magnet.turns), order=order
        )
        self.body = MovingBody(self.model, self.regions["armature"], air=self.regions["air"])

    def refined(self) -> "MeshField":
        """The same mesh with one polynomial degree more."""
        return MeshField(self.actuator, mesh=self.model.mesh, order=self.model.order + 1)

    def _irons(self) -> dict[str, Iron | AnalyticIron]:
        iron, folder = self.magnet.iron, self.actuator.folder
        kinds = {"core": (iron.core, iron.core_stacking), "armature": (iron.armature, iron.armature_stacking)}
        return {
            region: laminated(load_iron(name, folder=folder), stacking)
            for kind, (name, stacking) in kinds.items()
            for region in self.regions[kind]
        }

    def solve(self, current: float) -> FieldSolution:
        """The field at a coil current; raises NotConverged."""
        return solve_field(self.model, current, self.magnet.gap)

    def quantities(self, solution: FieldSolution) -> FieldQuantities:
        """The numbers of the last solution; flux densities are means and maxima over the iron regions.

        Force by virtual work is a quadratic form Q of A, so dF/di = Q(A + A_i) - Q(A) - Q(A_i) with A_i = dA/di.
        There is no slope by the gap: it is NaN.
        """
        a, model, depth = solution.potential, self.model, self.magnet.stack_depth
        by_current = field_response(model, solution).by_current
        scale = float(np.abs(by_current).max() / max(np.abs(a).max(), 1e-300)) or 1.0  # keeps the difference accurate
        step = by_current / scale
        force = self._pull(self.body.force(a))
        slope = (self._pull(self.body.force(a + step)) - force - self._pull(self.body.force(step))) * scale
        flux_linkage = depth * float(model.source @ a)
        return FieldQuantities(
            force=force,
            force_stress_tensor=self._pull(self.body.force_stress_tensor(a)),
            flux_linkage=flux_linkage,
            coenergy=solution.current * flux_linkage - depth * model.energy(a, solution.gap),
            incremental_inductance=depth * float(model.source @ by_current),
            force_current_slope=slope,
            force_gap_slope=float("nan"),
            flux_density=self._flux_density(a),
            rests_on_tail=tuple(
                name
                for name, part in model.irons.items()
                if part.weight[part.flux_density(a)[1] > part.iron.tail_from].sum() > TAIL_SHARE * part.weight.sum()
            ),
        )

    def _pull(self, force: BodyForce) -> float:
        sign, axis = self.magnet.pull
        return (1 if sign == "+" else -1) * (force.x if axis == "x" else force.y) * self.magnet.stack_depth

    def _flux_density(self, potential: Array) -> dict[str, SectionFluxDensity]:
        out = {}
        for name, part in self.model.irons.items():
            sheets = part.iron.iron_flux_density(part.flux_density(potential)[1])
            out[name] = SectionFluxDensity(float((sheets * part.weight).sum() / part.weight.sum()), float(sheets.max()))
        return out


def solve_mesh_magnet(
    actuator: Actuator, current: float, gap: float | None = None, *, accuracy: Accuracy = "normal"
) -> PointResult:
    """One field solution on a foreign mesh, with the force's error estimated by one polynomial degree more.

    The mesh fixes the gap: `gap` is left out, or is the gap that the actuator file states. `accuracy` chooses the
    polynomial degree; how fine the mesh is, and so what is reached, is up to the mesh: read the estimate.

    Raises
    ------
    InputError : another gap than the mesh's, a region's name that says nothing, no armature, coil, core or air, iron or
        coil on the mesh's edge, coil sides of different area, an unreadable mesh
    NotConverged : Newton's iteration failed
    """
    magnet = actuator.mesh_magnet()
    if accuracy not in LEVELS:
        raise InputError(f"accuracy '{accuracy}' is unknown; choose one of {', '.join(LEVELS)}")
    if gap is not None and not abs(gap / magnet.gap - 1) <= SAME_GAP:
        raise InputError(
            f"gap {format_quantity(gap, 'm')} is not that of the mesh, {format_quantity(magnet.gap, 'm')}; "
            "leave the gap out, or make a mesh at the gap wanted"
        )
    most = LARGEST_AMPERE_TURNS / magnet.turns
    if not abs(current) <= most:
        raise InputError(
            f"current {current:g} A is not allowed; it must be finite, within -{most:.4g} ... {most:.4g} A"
        )
    field = MeshField(actuator, order=LEVELS[accuracy].order)
    solution = field.solve(current)
    found = field.quantities(solution)
    finer = field.refined()
    better = finer.quantities(finer.solve(current))
    pairs = [(found.force, better.force), (found.coenergy, better.coenergy)]
    error = LEVELS[accuracy].safety * max(abs(c - f) / abs(f) if f else 0.0 for c, f in pairs)
    notes = tuple(dict.fromkeys(iron.note for iron in field.irons.values() if iron.note))
    if found.rests_on_tail:
        where = " and ".join(found.rests_on_tail)
        notes += (f"more than 1 % of the {where} lies beyond the B-H curve's last point, on its saturation tail",)
    unknowns = field.model.free.size
    return PointResult(current, magnet.gap, found, error, unknowns, len(solution.trail), solution.trail, notes)


def _sorted_regions(mesh: TriangleMesh, path: str) -> dict[str, tuple[str, ...]]:
    """The mesh's regions by kind; InputError where a name says nothing, a kind is missing, or air does not surround."""
    found = {kind: tuple(n for n in mesh.names if n.startswith(kind)) for kind in KINDS}
    unknown = set(mesh.names).difference(*found.values())
    if unknown:
        raise InputError(
            f"{path}: region '{min(unknown)}' is unknown; names begin with core, armature, coil+, coil- or air"
        )
    missing = [kind for kind, names in found.items() if not names]
    if missing:
        raise InputError(f"{path}: no region's name begins with '{missing[0]}'; regions are {', '.join(mesh.names)}")
    solid = np.unique(mesh.triangles[:, mesh.elements(*(n for k in KINDS[:-1] for n in found[k]))])
    outside = np.intersect1d(solid, boundary_points(mesh))
    if outside.size:
        x, y = mesh.points[:, outside[0]] * 1e3
        raise InputError(
            f"{path}: iron or coil lies on the mesh's edge at x = {x:g} mm, y = {y:g} mm; surround the section with "
            "air, and let regions that touch share their points"
        )
    return found


def _turns(mesh: TriangleMesh, regions: dict[str, tuple[str, ...]], turns: int) -> dict[str, float]:
    """Region to turns per area (1/m2), signed; InputError where the coil's sides differ in area."""
    (x0, x1, x2), (y0, y1, y2) = mesh.points[:, mesh.triangles]
    area = ((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2
    out: dict[str, float] = {}
    areas: list[float] = []
    for kind, sign in (("coil+", 1), ("coil-", -1)):
        areas.append(float(area[mesh.elements(*regions[kind])].sum()))
        out |= dict.fromkeys(regions[kind], sign * turns / areas[-1])
    if abs(areas[0] / areas[1] - 1) > AREAS_AGREE:
        raise InputError(
            f"the coil's sides coil+ and coil- have areas of {areas[0] * 1e6:g} and {areas[1] * 1e6:g} mm2; "
            "they must be equal"
        )
    return out
