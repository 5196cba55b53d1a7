"""The field of one actuator's magnet: section, irons, mesh and model put together, at a stated accuracy."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator, ECore
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.end_effects import deeper_air
from msl_fem.magnetics.solver.magnetostatics import (
    FieldModel,
    FieldSolution,
    NewtonSettings,
    field_response,
    solve_field,
)
from msl_fem.magnetics.solver.mesh import MeshSize, TriangleMesh, triangulate
from msl_fem.magnetics.solver.postprocess import FieldQuantities, Probes, evaluate_field
from msl_fem.magnetics.solver.section import Section, e_core_section
from msl_fem.materials.material import AnalyticIron, Iron, laminated, load_iron

Array = NDArray[np.float64]
Accuracy = Literal["fast", "normal", "fine"]


@dataclass(frozen=True)
class Discretisation:
    """Mesh sizes and polynomial degree of an accuracy level, and the factor of its error estimate.

    The force's relative error is estimated as `safety` times the larger of the relative changes of force and coenergy
    with one polynomial degree more on the same mesh. At a right-angled iron corner A behaves like r^(2/3), so a
    quadratic quantity's error falls like p^(-8/3) (Babuska and Suri 1987) and the change is 0.66 (p = 2) or 0.54
    (p = 3) of it: 2 covers both. Measured as needed, over E1's reference and at 78 (`fine`: 114) points of random
    magnets with a measured B-H curve: `fast` 2.05, `normal` 1.75, `fine` 3.7, in the median about 1. At `fine` the
    fronts of saturation inside the iron show at the knee of its curve, where a higher degree does not bring much.
    """

    size: MeshSize
    order: int
    safety: float = 2.0


LEVELS: dict[str, Discretisation] = {
    "fast": Discretisation(MeshSize(corner=0.1, gap=1.5, iron=0.6, growth=0.7), 2, 2.5),
    "normal": Discretisation(MeshSize(corner=0.02, gap=2.0, iron=0.6, growth=0.5), 2),
    "fine": Discretisation(MeshSize(corner=0.004, gap=3.0, iron=0.6, growth=0.75, across=0.2), 3, 4.0),
}


SMALLEST_GAP = 1e-4  # of the core's half width: a thinner strip of air cannot be meshed
LARGEST_CURRENT_DENSITY = 1e10  # A/m2 in the copper; adiabatic, rho J^2 / (c d) is 5e5 K/s there

MOST_NODES, CLOSEST = 1000, 1e-6  # of a table's gaps or currents; their distance, of the largest


@dataclass(frozen=True)
class PointResult:
    """One field solution of one magnet: `quantities`, the force's error estimate, and what it took.

    Attributes
    ----------
    force_error_estimate : relative to the force, see `Discretisation`
    notes : what the reader must know: an iron's curve that was cut, a result that rests on a saturation tail
    """

    current: float
    gap: float
    quantities: FieldQuantities
    force_error_estimate: float
    unknowns: int
    newton_iterations: int
    residual_trail: tuple[float, ...]
    notes: tuple[str, ...] = ()


class MagnetField:
    """A magnet's section meshed for gaps near `mesh.gap`, ready to be solved at any current and gap.

    With `end_effects` the air of strip and window is deeper than the stack. Raises ActuatorError, MaterialError or
    ComputationError (mesher).
    """

    def __init__(
        self, magnet: ECore, mesh: TriangleMesh, *, folder: Path, order: int, end_effects: bool = False
    ) -> None:
        self.magnet, self.folder, self.order, self.end_effects = magnet, folder, order, end_effects
        self.section: Section = e_core_section(magnet, mesh.gap)
        self.irons: dict[str, Iron | AnalyticIron] = {
            region: laminated(load_iron(name, folder=folder), stacking)
            for region, (name, stacking) in self.section.iron.items()
        }
        self.model = FieldModel(
            mesh,
            self.irons,
            turns_density=self.section.turns_density,
            order=order,
            air_depth=deeper_air(magnet, mesh.gap) if end_effects else None,
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
        mesh, order = self.model.mesh, self.order + 1
        return MagnetField(self.magnet, mesh, folder=self.folder, order=order, end_effects=self.end_effects)


def magnet_mesh(magnet: ECore, gap: float, accuracy: Accuracy = "normal") -> TriangleMesh:
    """The mesh of a magnet at a gap, for an accuracy level."""
    return triangulate(e_core_section(magnet, gap), LEVELS[accuracy].size)


def field_of(actuator: Actuator, gap: float, *, accuracy: Accuracy = "normal") -> MagnetField:
    """The field of an actuator's magnet, meshed at `gap`."""
    magnet = actuator.e_core()
    return MagnetField(magnet, magnet_mesh(magnet, gap, accuracy), folder=actuator.folder, order=LEVELS[accuracy].order)


def force_error_estimate(level: Discretisation, found: FieldQuantities, finer: FieldQuantities) -> float:
    """The estimated relative error of a level's force, from the same point with one polynomial degree more."""
    pairs = [(found.force, finer.force), (found.coenergy, finer.coenergy)]
    return level.safety * max(abs(c - f) / abs(f) if f else 0.0 for c, f in pairs)


def check_point(actuator: Actuator, current: float, gap: float) -> None:
    """InputError unless the gap is of the section's size and the current one that copper bears for a moment."""
    magnet = actuator.e_core()
    largest = magnet.half_width
    if not SMALLEST_GAP * largest <= gap <= largest:
        raise InputError(
            f"gap {format_quantity(gap, 'm')} is not allowed; it must be above 0, at least "
            f"{format_quantity(SMALLEST_GAP * largest, 'm')} and at most the core's half width, "
            f"{format_quantity(largest, 'm')}"
        )
    most = LARGEST_CURRENT_DENSITY * magnet.coil.fill_factor * magnet.coil_section / magnet.coil.turns
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
    if accuracy not in LEVELS:
        raise InputError(f"accuracy '{accuracy}' is unknown; choose one of {', '.join(LEVELS)}")
    check_point(actuator, current, gap)
    field = field_of(actuator, gap, accuracy=accuracy)
    solution = field.solve(current, gap)
    quantities = field.quantities(solution)
    finer = field.refined()
    better = finer.quantities(finer.solve(current, gap))
    error = force_error_estimate(LEVELS[accuracy], quantities, better)
    notes = tuple(dict.fromkeys(iron.note for iron in field.irons.values() if iron.note))
    if quantities.rests_on_tail:
        regions = " and ".join(quantities.rests_on_tail)
        notes += (f"more than 1 % of the {regions} lies beyond the B-H curve's last point, on its saturation tail",)
    unknowns, iterations = field.model.free.size, len(solution.trail)
    point = PointResult(current, gap, quantities, error, unknowns, iterations, solution.trail, notes)
    return point, field, solution
