"""The field of a magnet of any kind at a stated accuracy, and which points may be solved."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy, PointResult, irons_of, level_of, solve_with_estimate
from msl_fem.magnetics.field.end_effects import deeper_air
from msl_fem.magnetics.kinds.kind import StackEnds
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.solver.magnetostatics import (
    FieldModel,
    FieldSolution,
    NewtonSettings,
    field_response,
    solve_field,
)
from msl_fem.magnetics.solver.mesh import TriangleMesh, triangulate
from msl_fem.magnetics.solver.postprocess import FieldQuantities, Probes, evaluate_field

SMALLEST_GAP = 1e-4  # of the core's half width: a thinner strip of air cannot be meshed
LARGEST_CURRENT_DENSITY = 1e10  # A/m2 in the copper; adiabatic, rho J^2 / (c d) is 5e5 K/s there

MOST_NODES = 1000  # gaps or currents of a table
CLOSEST = 1e-6  # of the largest: the least distance of two of them


class MagnetField:
    """A magnet's section meshed for gaps near `mesh.gap`, ready to be solved at any current and gap.

    With `end_effects` the air of strip and window is deeper than the stack. Raises ActuatorError, MaterialError or
    ComputationError (mesher).
    """

    def __init__(
        self, magnet: MagnetKind, mesh: TriangleMesh, *, folder: Path, order: int, end_effects: bool = False
    ) -> None:
        self.magnet = magnet
        self.folder = folder
        self.order = order
        self.end_effects = end_effects
        self.section: Section = magnet.section(mesh.gap)
        self.irons = irons_of(self.section.iron, folder)
        self.model = FieldModel(
            mesh,
            self.irons,
            turns_density=self.section.turns_density,
            order=order,
            symmetry=self.section.symmetry,
            air_depth=deeper_air(_ends_of(magnet), mesh.gap) if end_effects else None,
        )
        self.probes = Probes(self.model, self.section)

    def solve(self, current: float, gap: float, *, start: Array | None = None) -> FieldSolution:
        """The field at a coil current and a gap; raises NotConverged."""
        return solve_field(self.model, current, gap, start=start, settings=NewtonSettings())

    def slope(self, solution: FieldSolution) -> Array:
        """dA/di at the last solution: the predictor of the next current."""
        return field_response(self.model, solution).by_current

    def quantities(self, solution: FieldSolution) -> FieldQuantities:
        """The numbers of the last solution."""
        return evaluate_field(self.probes, solution)

    def refined(self) -> "MagnetField":
        """The same mesh with one polynomial degree more."""
        order = self.order + 1
        mesh = self.model.mesh
        return MagnetField(self.magnet, mesh, folder=self.folder, order=order, end_effects=self.end_effects)


def _ends_of(magnet: MagnetKind) -> StackEnds:
    """The stack's ends; InputError where the kind states none."""
    if magnet.stack_ends is None:
        raise InputError("this kind of magnet states no ends of a stack; leave the end effects out")
    return magnet.stack_ends


def magnet_mesh(magnet: MagnetKind, gap: float, accuracy: Accuracy = "normal") -> TriangleMesh:
    """The mesh of a magnet at a gap, for an accuracy level."""
    return triangulate(magnet.section(gap), LEVELS[accuracy].size)


def field_of(actuator: Actuator, gap: float, *, accuracy: Accuracy = "normal") -> MagnetField:
    """The field of an actuator's magnet, meshed at `gap`."""
    magnet = actuator.magnet_kind()
    return MagnetField(magnet, magnet_mesh(magnet, gap, accuracy), folder=actuator.folder, order=LEVELS[accuracy].order)


def check_point(actuator: Actuator, current: float, gap: float) -> None:
    """InputError unless the gap is of the section's size and the current one that copper bears for a moment."""
    magnet = actuator.magnet_kind()
    largest = magnet.half_width
    if not SMALLEST_GAP * largest <= gap <= largest:
        raise InputError(
            f"gap {format_quantity(gap, 'm')} is not allowed; it must be above 0, at least "
            f"{format_quantity(SMALLEST_GAP * largest, 'm')} and at most the core's half width, "
            f"{format_quantity(largest, 'm')}"
        )
    most = LARGEST_CURRENT_DENSITY * magnet.copper_area / magnet.turns
    if not abs(current) <= most:
        raise InputError(
            f"current {format_quantity(current, 'A')} is not allowed; it must be finite and within "
            f"-{most:.4g} ... {most:.4g} A: there the copper carries {LARGEST_CURRENT_DENSITY:g} A/m2, "
            "which melts it in milliseconds; lower it"
        )


def check_grid(actuator: Actuator, gaps: Sequence[float], currents: Sequence[float]) -> None:
    """InputError unless a table can be made of these gaps and currents: allowed points, apart, and not too many."""
    for gap in gaps:
        check_point(actuator, 0.0, gap)
    for current in currents:
        check_point(actuator, current, gaps[0])
    for name, values, unit in (("gaps", gaps, "m"), ("currents", currents, "A")):
        given = np.unique([0.0, *values])
        if given.size > MOST_NODES:
            raise InputError(f"{given.size} {name} are more than {MOST_NODES}; make the grid coarser")
        near = np.flatnonzero(np.diff(given) < CLOSEST * np.abs(given).max())
        if near.size:
            a, b = (format_quantity(float(v), unit) for v in given[near[0] : near[0] + 2])
            raise InputError(f"{name} {a} and {b} are closer than {CLOSEST:g} of the largest; leave one of them out")


def solve(actuator: Actuator, current: float, gap: float, *, accuracy: Accuracy = "normal") -> PointResult:
    """One field solution, with the force's error estimated by one polynomial degree more on the same mesh.

    Raises
    ------
    InputError : a gap that is not positive or larger than the core's half width, an unknown accuracy
    ComputationError : the mesher or Newton's iteration failed
    """
    return solve_with_field(actuator, current, gap, accuracy=accuracy)[0]


@one_blas_thread
def solve_with_field(
    actuator: Actuator, current: float, gap: float, *, accuracy: Accuracy = "normal"
) -> tuple[PointResult, MagnetField, FieldSolution]:
    """As `solve`, with the field itself for pictures."""
    level_of(accuracy)
    check_point(actuator, current, gap)
    field = field_of(actuator, gap, accuracy=accuracy)
    point, solution = solve_with_estimate(field, lambda meshed: meshed.solve(current, gap), accuracy=accuracy)
    return point, field, solution
