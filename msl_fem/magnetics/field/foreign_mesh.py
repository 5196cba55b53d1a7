"""A magnet whose section is a foreign mesh with named regions: the file read through meshio and checked, the field."""

import contextlib
import io
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import refuse_what_never_ends
from msl_fem.magnetics.field.accuracy import Accuracy, PointResult, irons_of, level_of, solve_with_estimate
from msl_fem.magnetics.field.mesh_checks import anticlockwise, check_finite
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, field_response, solve_field
from msl_fem.magnetics.solver.postprocess import FieldQuantities, SectionFluxDensity, irons_on_tail
from msl_fem.magnetics.solver.virtual_work import BodyForce, MovingBody, boundary_points
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.material import AnalyticIron, Iron

Indices = NDArray[np.int64]
IGNORED = {"vertex", "line", "line3"}
FLAT = 1e-9  # of the mesh's size: what z may vary
LARGEST_AMPERE_TURNS = 1e8  # A: a coil of 1 cm2 of copper melts in milliseconds at 1e6 A
KINDS = ("core", "armature", "coil+", "coil-", "air")
SAME_GAP = 1e-6  # relative: a gap asked for that differs more is another one
AREAS_AGREE = 1e-3  # relative: of the coil's two sides


def read_mesh(path: Path, *, unit: float = 1.0, gap: float) -> TriangleMesh:
    """The triangles of a file, anticlockwise, with the names of their regions; points without a triangle are left out.

    Parameters
    ----------
    path : a gmsh file with physical names, or any format of meshio with named cell sets
    unit : the length of one unit of the file's coordinates in m
    gap : the gap that the mesh was made at, in m

    Raises
    ------
    InputError : the file cannot be read, has other cells than straight triangles, is not plane, a triangle has no
        area, triangles overlap, or some have no region's name or two
    """
    content = _read(path)
    kinds = {block.type for block in content.cells} - IGNORED
    if kinds != {"triangle"}:
        listed = ", ".join(sorted(kinds)) or "none"
        raise InputError(
            f"{path}: cells are {listed}; only straight three-node triangles are allowed: save first order"
        )
    points = np.asarray(content.points, dtype=float)
    check_finite(points, path)
    if points.shape[1] > 2 and np.ptp(points[:, 2]) > FLAT * np.ptp(points[:, :2]):
        raise InputError(f"{path}: the mesh is not plane, z varies; lay it into the x-y plane")
    blocks = [k for k, block in enumerate(content.cells) if block.type == "triangle"]
    triangles = np.concatenate([content.cells[k].data for k in blocks]).T.astype(np.int64)
    region, names = _regions(content, blocks, triangles.shape[1], path)
    used, places = np.unique(triangles, return_inverse=True)
    corners = places.reshape(triangles.shape)
    xy = points[used, :2].T * unit
    return TriangleMesh(np.ascontiguousarray(xy), anticlockwise(xy, corners, path), region, names, gap)


def _read(path: Path) -> Any:
    chatter = io.StringIO()
    try:
        refuse_what_never_ends(path)
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter):
            return meshio.read(path)
    except (Exception, SystemExit) as err:  # meshio ends the process where no reader fits
        reason = "no format of meshio fits" if isinstance(err, SystemExit) else str(err) or type(err).__name__
        raise InputError(f"{path}: cannot be read as a mesh ({reason}); give a gmsh file") from err


def _regions(content: Any, blocks: list[int], n: int, path: Path) -> tuple[Indices, tuple[str, ...]]:
    """Each triangle's index into the names, and the names."""
    region = np.full(n, -1)
    sizes = [len(content.cells[k].data) for k in blocks]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    physical = content.cell_data.get("gmsh:physical")
    names: list[str] = []
    if physical is not None and content.field_data:
        tags = np.concatenate([physical[k] for k in blocks])
        for name, (tag, dimension) in content.field_data.items():
            if dimension == 2 and (tags == tag).any():
                region[tags == tag] = len(names)
                names.append(name)
    else:
        for name, cells in content.cell_sets.items():
            members = [np.empty(0, dtype=int)]
            for start, k in zip(starts, blocks, strict=False):
                if cells[k] is not None:
                    members.append(start + np.asarray(cells[k], dtype=int))
            chosen = np.concatenate(members)
            if chosen.size == 0 or name.startswith("gmsh:"):
                continue
            if (region[chosen] >= 0).any():
                raise InputError(f"{path}: region '{name}' shares triangles with another one; regions may not overlap")
            region[chosen] = len(names)
            names.append(name)
    if (region < 0).any():
        raise InputError(
            f"{path}: {np.count_nonzero(region < 0)} of {n} triangles belong to no named region; "
            "give every surface a physical name (or cell set)"
        )
    return region.astype(np.int64), tuple(names)


class MeshField:
    """A foreign mesh with irons and turns, ready to be solved at any current; raises as `solve_mesh_magnet`."""

    def __init__(self, actuator: Actuator, *, mesh: TriangleMesh | None = None, order: int = 2) -> None:
        self.actuator = actuator
        self.magnet = actuator.mesh_magnet()
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
        iron = self.magnet.iron
        stated = dict.fromkeys(self.regions["core"], (iron.core, iron.core_stacking))
        stated |= dict.fromkeys(self.regions["armature"], (iron.armature, iron.armature_stacking))
        return irons_of(stated, self.actuator.folder)

    def solve(self, current: float) -> FieldSolution:
        """The field at a coil current; raises NotConverged."""
        return solve_field(self.model, current, self.magnet.gap)

    def quantities(self, solution: FieldSolution) -> FieldQuantities:
        """The numbers of the last solution; flux densities are means and maxima over the iron regions.

        Force by virtual work is a quadratic form Q of A, so dF/di = Q(A + A_i) - Q(A) - Q(A_i) with A_i = dA/di.
        There is no slope by the gap: it is NaN.
        """
        a = solution.potential
        model = self.model
        depth = self.magnet.stack_depth
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
            rests_on_tail=irons_on_tail(model, a),
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
    level = level_of(accuracy)
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
    field = MeshField(actuator, order=level.order)
    return solve_with_estimate(field, lambda meshed: meshed.solve(current), accuracy=accuracy)[0]


def _sorted_regions(mesh: TriangleMesh, path: str) -> dict[str, tuple[str, ...]]:
    """The mesh's regions by kind; InputError where a name says nothing, a kind is missing, or air does not surround."""
    regions = {kind: tuple(n for n in mesh.names if n.startswith(kind)) for kind in KINDS}
    unknown = set(mesh.names).difference(*regions.values())
    if unknown:
        raise InputError(
            f"{path}: region '{min(unknown)}' is unknown; names begin with core, armature, coil+, coil- or air"
        )
    missing = [kind for kind, names in regions.items() if not names]
    if missing:
        raise InputError(f"{path}: no region's name begins with '{missing[0]}'; regions are {', '.join(mesh.names)}")
    solid_names = set(mesh.names) - set(regions["air"])
    solid = np.unique(mesh.triangles[:, mesh.elements(*solid_names)])
    outside = np.intersect1d(solid, boundary_points(mesh))
    if outside.size:
        x, y = mesh.points[:, outside[0]] * 1e3
        raise InputError(
            f"{path}: iron or coil lies on the mesh's edge at x = {x:g} mm, y = {y:g} mm; surround the section with "
            "air, and let regions that touch share their points"
        )
    return regions


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
