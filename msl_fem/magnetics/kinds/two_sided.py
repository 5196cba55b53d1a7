"""Two magnets and the armature they share: net force, cross coupling, and what independence would miss."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.e_core import LEVELS, Accuracy, check_point
from msl_fem.magnetics.kinds.two_sided_section import TwoSidedPosition, two_sided_section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, solve_field
from msl_fem.magnetics.solver.mesh import triangulate
from msl_fem.magnetics.solver.virtual_work import MovingBody
from msl_fem.materials.material import laminated, load_iron

Array = NDArray[np.float64]
AIR = ("air", "gap", "window")
LARGEST_TILT = 0.1  # rad


@dataclass(frozen=True)
class TwoSidedQuantities:
    """What a field of both magnets says, for the full stack depth, in SI units.

    Attributes
    ----------
    net_force : on the armature, towards side 1, by virtual work; net_force_stress_tensor by Maxwell's stress around it
    side_force : across, along +x; 0 without tilt
    torque : on the armature about its centre, anticlockwise; 0 without tilt
    coenergy : of both coils together
    """

    net_force: float
    net_force_stress_tensor: float
    side_force: float
    torque: float
    flux_linkage_1: float
    flux_linkage_2: float
    coenergy: float


@dataclass(frozen=True)
class TwoSidedResult:
    """One solution of the two-sided section: where, the quantities, the force's error, and what it took.

    `force_error_estimate` is in N, as that of the net force may be larger than the force itself; see `solve_two_sided`.
    """

    currents: tuple[float, float]
    position: TwoSidedPosition
    quantities: TwoSidedQuantities
    force_error_estimate: float
    unknowns: int
    newton_iterations: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Decoupling:
    """How far two sides of an actuator are from independent at one point.

    Attributes
    ----------
    linked_share_1, linked_share_2 : flux linkage of the other coil, without current, over that of the one that has it
    force_error : net force of two independent sides less that of both together, over the larger side's force
    flux_error_1, flux_error_2 : the same of each flux linkage, over the flux linkage together
    """

    linked_share_1: float
    linked_share_2: float
    force_error: float
    flux_error_1: float
    flux_error_2: float


class TwoSidedField:
    """Both magnets and the armature, meshed at one position, ready for any currents; raises as `solve_two_sided`."""

    def __init__(
        self,
        actuator: Actuator,
        position: TwoSidedPosition,
        *,
        accuracy: Accuracy = "normal",
        coarser: "TwoSidedField | None" = None,
    ) -> None:
        magnet = actuator.e_core()
        self.actuator, self.position, self.accuracy = actuator, position, accuracy
        self.plan = two_sided_section(magnet, position)
        section, level = self.plan.section, LEVELS[accuracy]
        irons = {
            region: laminated(load_iron(name, folder=actuator.folder), stacking)
            for region, (name, stacking) in section.iron.items()
        }
        self.notes = tuple(dict.fromkeys(iron.note for iron in irons.values() if iron.note))
        mesh = coarser.model.mesh if coarser else triangulate(section, level.size)
        order = coarser.model.order + 1 if coarser else level.order
        self.model: FieldModel = FieldModel(mesh, irons, turns_density={}, order=order)
        self.depth = section.depth * (2 if self.plan.half else 1)
        self.linkage = [self.model.with_turns(turns).source for turns in self.plan.turns_density]
        self.body = MovingBody(
            self.model,
            ("armature",),
            air=tuple(n for n in AIR if n in mesh.names),
            symmetry="x=0" if self.plan.half else "none",
            centre=self.plan.centre,
        )

    def refined(self) -> "TwoSidedField":
        """The same mesh with one polynomial degree more."""
        return TwoSidedField(self.actuator, self.position, accuracy=self.accuracy, coarser=self)

    def solve(
        self, current_1: float, current_2: float, *, start: Array | None = None
    ) -> tuple[TwoSidedQuantities, FieldSolution]:
        """The quantities and the field at the coils' currents (A), from a potential nearby; raises NotConverged."""
        densities = {
            region: current * density
            for current, turns in zip((current_1, current_2), self.plan.turns_density, strict=True)
            for region, density in turns.items()
        }
        model = self.model.with_turns(densities)
        solution = solve_field(model, 1.0, model.mesh.gap, start=start)
        potential, half = solution.potential, self.plan.half
        force, stress = self.body.force(potential), self.body.force_stress_tensor(potential)
        flux = [self.depth * float(linkage @ potential) for linkage in self.linkage]
        coenergy = current_1 * flux[0] + current_2 * flux[1] - self.depth * model.energy(potential, model.mesh.gap)
        quantities = TwoSidedQuantities(
            net_force=self.depth * force.y,
            net_force_stress_tensor=self.depth * stress.y,
            side_force=0.0 if half else self.depth * force.x,
            torque=0.0 if half else self.depth * force.torque,
            flux_linkage_1=flux[0],
            flux_linkage_2=flux[1],
            coenergy=coenergy,
        )
        return quantities, solution


def solve_two_sided(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
) -> TwoSidedResult:
    """Net force and both flux linkages at the coils' currents (A), equal signs aiding, and the armature's position.

    The force's error is estimated by one polynomial degree more, as that of one magnet, from the changes of net force
    and coenergy; the relative change of the latter counts against the force of the stronger side alone.

    Raises
    ------
    InputError : a gap or a current that is not allowed, a tilt that leaves no gap, an unknown accuracy
    ComputationError : the mesher or Newton's iteration failed
    """
    if accuracy not in LEVELS:
        raise InputError(f"accuracy '{accuracy}' is unknown; choose one of {', '.join(LEVELS)}")
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    if not abs(position.tilt) <= LARGEST_TILT:
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} is not allowed; it must be within "
            f"-{LARGEST_TILT:g} ... {LARGEST_TILT:g} rad"
        )
    field = TwoSidedField(actuator, position, accuracy=accuracy)
    found, solution = field.solve(*currents)
    better, _ = field.refined().solve(*currents)
    relative = abs(found.coenergy / better.coenergy - 1) if better.coenergy else 0.0
    scale = max(abs(better.net_force), *(abs(field.solve(*alone)[0].net_force) for alone in _alone(currents)))
    change = max(abs(found.net_force - better.net_force), relative * scale)
    return TwoSidedResult(
        currents,
        position,
        found,
        LEVELS[accuracy].safety * change,
        field.model.free.size,
        len(solution.trail),
        field.notes,
    )


def decoupling(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
) -> Decoupling:
    """How much the sides of an actuator share, at currents (A), both not zero, and a position.

    Independent sides are each solved in the same section with the other coil dead: what is missed is that the
    armature's iron is shared, not that the other core is there.

    Raises
    ------
    InputError : a current is zero, and as `solve_two_sided`
    """
    if not all(currents):
        raise InputError(f"currents {currents[0]:g} A and {currents[1]:g} A: decoupling needs both, not zero")
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    field = TwoSidedField(actuator, position, accuracy=accuracy)
    both = field.solve(*currents)[0]
    first, second = (field.solve(*alone)[0] for alone in _alone(currents))
    force = first.net_force + second.net_force - both.net_force
    return Decoupling(
        linked_share_1=first.flux_linkage_2 / first.flux_linkage_1,
        linked_share_2=second.flux_linkage_1 / second.flux_linkage_2,
        force_error=force / max(abs(first.net_force), abs(second.net_force)),
        flux_error_1=(first.flux_linkage_1 - both.flux_linkage_1) / both.flux_linkage_1,
        flux_error_2=(second.flux_linkage_2 - both.flux_linkage_2) / both.flux_linkage_2,
    )


def _alone(currents: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (currents[0], 0.0), (0.0, currents[1])
