"""A magnet whose section is a foreign mesh with named regions: the file read through meshio and checked, the field."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy, PointResult, iron_notes, irons_of, level_of, solve_with_estimate
from msl_fem.magnetics.kinds.mesh_file import sorted_regions, turns_densities
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, field_response, solve_field
from msl_fem.magnetics.solver.postprocess import FieldQuantities, SectionFluxDensity, irons_on_tail
from msl_fem.magnetics.solver.virtual_work import BodyForce, MovingBody
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.materials.material import AnalyticIron, Iron

Indices = NDArray[np.int64]
LARGEST_AMPERE_TURNS = 1e8  # A: a coil of 1 cm2 of copper melts in milliseconds at 1e6 A
SAME_GAP = 1e-6  # relative: a gap asked for that differs more is another one


class MeshField:
    """A foreign mesh with irons and turns, ready to be solved at any current; raises as `solve_mesh_magnet`."""

    def __init__(self, actuator: Actuator, *, mesh: TriangleMesh | None = None, order: int = 2) -> None:
        self.actuator = actuator
        self.magnet = actuator.mesh_magnet()
        path = actuator.folder / self.magnet.mesh
        mesh = mesh or self.magnet.own_mesh()
        self.regions = sorted_regions(mesh, str(path))
        self.irons = self._irons()
        self.notes = (*self.magnet.doubts, *iron_notes(self.irons))
        self.model = FieldModel(
            mesh, self.irons, turns_density=turns_densities(mesh, self.regions, self.magnet.turns), order=order
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
