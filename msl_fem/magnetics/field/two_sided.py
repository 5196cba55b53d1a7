"""Two magnets on either side of the armature they share, which may be tilted: section, field, net force.

Cross coupling, and what two independent sides would miss.
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy, iron_notes, irons_of, level_of
from msl_fem.magnetics.field.end_effects import EndEffects, KnownFactors
from msl_fem.magnetics.field.magnet_field import check_point, chosen_ends
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition, two_sided_section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, solve_field
from msl_fem.magnetics.solver.mesh import triangulate
from msl_fem.magnetics.solver.virtual_work import MovingBody

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
    ends: KnownFactors = False


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
        magnet = pair_magnet(actuator)
        self.actuator = actuator
        self.position = position
        self.ends: KnownFactors = False
        self.accuracy = accuracy
        self.plan = two_sided_section(magnet, position)
        section = self.plan.section
        level = level_of(accuracy)
        irons = irons_of(section.iron, actuator.folder)
        self.notes = iron_notes(irons)
        mesh = coarser.model.mesh if coarser else triangulate(section, level.size)
        order = coarser.model.order + 1 if coarser else level.order
        self.model: FieldModel = FieldModel(mesh, irons, turns_density={}, order=order, symmetry=section.symmetry)
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
        potential = solution.potential
        half = self.plan.half
        force = self.body.force(potential)
        stress = self.body.force_stress_tensor(potential)
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


class TwoSidedStack:
    """Both magnets and the armature with the ends of their stacks, at one position without tilt; else `TwoSidedField`.

    The depth of the air in the gaps changes with them, and that has its share in the force (`PairField`).
    """

    def __init__(self, pair: PairField, position: TwoSidedPosition) -> None:
        self.pair, self.position = pair, position
        self.model, self.ends = pair.model, pair.ends
        self.notes = iron_notes(pair.irons)

    def refined(self) -> "TwoSidedStack":
        """The same mesh with one polynomial degree more."""
        return TwoSidedStack(self.pair.refined(), self.position)

    def solve(
        self, current_1: float, current_2: float, *, start: Array | None = None
    ) -> tuple[TwoSidedQuantities, FieldSolution]:
        """The quantities and the field at the coils' currents (A), from a potential nearby; raises NotConverged."""
        pair, currents = self.pair, (current_1, current_2)
        towards_1 = (self.position.gap_2 - self.position.gap_1) / 2
        solution = pair.solve(towards_1, *currents, start=start)
        found = pair.quantities(solution, currents)
        quantities = TwoSidedQuantities(
            net_force=found.force,
            net_force_stress_tensor=pair.force_stress_tensor(solution),
            side_force=0.0,
            torque=0.0,
            flux_linkage_1=found.flux_linkage_1,
            flux_linkage_2=found.flux_linkage_2,
            coenergy=found.coenergy,
        )
        return quantities, solution


def field_of_both(
    actuator: Actuator,
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
    end_effects: EndEffects = None,
) -> TwoSidedField | TwoSidedStack:
    """Both magnets meshed at a position; end effects as in `chosen_ends`, of a tilted armature none.

    Raises
    ------
    InputError : ends of a tilted armature, or of a kind that states none
    """
    if position.tilt and end_effects:
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} is of a plane section; leave out end effects or the tilt"
        )
    level, gaps = level_of(accuracy), (position.gap_1, position.gap_2)
    ends = chosen_ends(actuator, end_effects)
    if not ends or position.tilt:
        return TwoSidedField(actuator, position, accuracy=accuracy)
    mesh = pair_mesh(pair_magnet(actuator), float(np.sqrt(gaps[0] * gaps[1])), accuracy)
    pair = PairField(actuator, mesh, gap_sum=sum(gaps), order=level.order, end_effects=ends)
    return TwoSidedStack(pair, position)


def solve_two_sided(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
    end_effects: EndEffects = None,
) -> TwoSidedResult:
    """Net force and both flux linkages at the coils' currents (A), equal signs aiding, and the armature's position.

    The force's error is estimated by one polynomial degree more, as that of one magnet, from the changes of net force
    and coenergy; the relative change of the latter counts against the force of the stronger side alone. End effects are
    those of `field_of_both`.

    Raises
    ------
    InputError : a gap or a current that is not allowed, a tilt that leaves no gap, an unknown accuracy
    ComputationError : the mesher or Newton's iteration failed
    """
    level = level_of(accuracy)
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    if not abs(position.tilt) <= LARGEST_TILT:
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} is not allowed; it must be within "
            f"-{LARGEST_TILT:g} ... {LARGEST_TILT:g} rad"
        )
    field = field_of_both(actuator, position, accuracy=accuracy, end_effects=end_effects)
    quantities, solution = field.solve(*currents)
    better, _ = field.refined().solve(*currents)
    relative = abs(quantities.coenergy / better.coenergy - 1) if better.coenergy else 0.0
    scale = max(abs(better.net_force), *(abs(field.solve(*alone)[0].net_force) for alone in _alone(currents)))
    change = max(abs(quantities.net_force - better.net_force), relative * scale)
    return TwoSidedResult(
        currents=currents,
        position=position,
        quantities=quantities,
        force_error_estimate=max(level.safety * change, abs(quantities.net_force - quantities.net_force_stress_tensor)),
        unknowns=field.model.free.size,
        newton_iterations=len(solution.trail),
        notes=field.notes,
        ends=field.ends,
    )


def decoupling(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
    end_effects: EndEffects = None,
) -> Decoupling:
    """How much the sides of an actuator share, at currents (A), both not zero, and a position.

    Independent sides are each solved in the same section with the other coil dead: what is missed is that the
    armature's iron is shared, not that the other core is there.

    Raises
    ------
    InputError : a current is zero, and as `solve_two_sided`
    """
    return _decoupling_of(_compared(actuator, currents, position, accuracy, end_effects), currents)


def _compared(
    actuator: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    accuracy: Accuracy,
    end_effects: EndEffects,
) -> TwoSidedField | TwoSidedStack:
    """The field in which the sides are compared; InputError as `decoupling`."""
    if not all(currents):
        raise InputError(f"currents {currents[0]:g} A and {currents[1]:g} A: decoupling needs both, not zero")
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    return field_of_both(actuator, position, accuracy=accuracy, end_effects=end_effects)


def _decoupling_of(field: TwoSidedField | TwoSidedStack, currents: tuple[float, float]) -> Decoupling:
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


def polarity_costs(
    actuator: Actuator,
    sizes: tuple[float, float],
    position: TwoSidedPosition,
    *,
    accuracy: Accuracy = "normal",
    end_effects: EndEffects = None,
) -> dict[str, Decoupling]:
    """`decoupling` at currents of these sizes (A), opposing, whose fluxes add up in the armature, and aiding.

    Raises
    ------
    InputError : as `decoupling`
    """
    first, second = abs(sizes[0]), abs(sizes[1])
    field = _compared(actuator, (first, second), position, accuracy, end_effects)
    signs = (("opposing", -1.0), ("aiding", 1.0))
    return {name: _decoupling_of(field, (first, sign * second)) for name, sign in signs}


def _alone(currents: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (currents[0], 0.0), (0.0, currents[1])
