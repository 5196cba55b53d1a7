"""Two magnets on either side of the armature they share, which may be tilted: section, field, net force.

Cross coupling, and what two independent sides would miss.
"""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import ActuatorError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy, iron_notes, irons_of, level_of
from msl_fem.magnetics.field.magnet_field import check_point
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.magnetics.section import Region, Section, rectangle
from msl_fem.magnetics.solver.magnetostatics import FieldModel, FieldSolution, solve_field
from msl_fem.magnetics.solver.mesh import triangulate
from msl_fem.magnetics.solver.virtual_work import MovingBody

SMALLEST_GAP = 0.02  # of the mean gap: what a tilt must leave at the armature's edge
Corner = tuple[float, float, float]
AIR = ("air", "gap", "window")
LARGEST_TILT = 0.1  # rad


@dataclass(frozen=True)
class TwoSidedPosition:
    """Where the armature stands: the gaps of side 1 (above) and side 2 in m, its tilt anticlockwise in rad."""

    gap_1: float
    gap_2: float
    tilt: float = 0.0


@dataclass(frozen=True)
class TwoSidedSection:
    """The section, the symmetry it uses, and where things are.

    Attributes
    ----------
    section : coils are the regions coil_1+, coil_2+ (x > 0) and, in a full section, coil_1-, coil_2-
    half : x >= 0 only, with A = 0 on x = 0; without tilt
    turns_density : by side, region to turns per area (1/m2): positive currents drive flux along the same direction
    centre : the armature's centre (x, y) in m
    """

    section: Section
    half: bool
    turns_density: tuple[dict[str, float], dict[str, float]]
    centre: tuple[float, float]


def two_sided_section(magnet: PlaneMagnet, position: TwoSidedPosition) -> TwoSidedSection:
    """Side 1 above and side 2, its mirror image, below an armature whose centre lies half its thickness below y = 0.

    Without tilt x = 0 is a flux line and half the section serves; a tilt turns the armature about its centre.

    Raises
    ------
    InputError : the tilted armature comes nearer to a core than a fiftieth of the gap
    """
    middle = -magnet.armature_thickness / 2
    half = position.tilt == 0.0
    armature = [_turned(x, y, position.tilt, middle) for x, y in _armature(magnet)]
    nearest = _nearest_gap(magnet, position)
    upper = magnet.section(position.gap_1)
    lower = magnet.section(position.gap_2)
    regions = _surroundings(magnet, position)
    corners: list[Corner] = []
    for side, part, gap in ((1, upper, position.gap_1), (2, lower, position.gap_2)):
        mirror = 1.0 if side == 1 else -1.0
        base = middle * (1 - mirror)  # side 2 is mirrored about the armature's middle
        for region in part.regions[1:]:  # without the air box
            if region.name in ("strip", "armature"):
                continue
            vertices = [(x, base + mirror * y) for x, y in region.vertices]
            name = _name(region.name, side)
            coil = region.name in part.turns_density
            regions.append(Region(f"{name}+" if coil else name, tuple(vertices)))
            if not half:
                mirrored = tuple((-x, y) for x, y in vertices)
                regions.append(Region(f"{name}-" if coil else name, mirrored))
        scale = (nearest / gap) ** (2 / 3)  # sizes at corners are in fractions of the section's gap
        above = [(x, base + mirror * y, s * scale) for x, y, s in part.corners if y > 0]
        corners += above if half else above + [(-x, y, s) for x, y, s in above]
    outline = [*armature[1:3], (0.0, 0.0), (0.0, 2 * middle)] if half else armature
    regions.append(Region("armature", tuple(outline)))
    corners += [(x, y, 1.0) for x, y in (armature[1:3] if half else armature)]
    turns = [_turns(upper, side, half=half) for side in (1, 2)]
    core = upper.iron["core"]
    section = Section(
        regions=tuple(regions),
        corners=tuple(corners),
        cuts=(),
        iron={"core_1": core, "core_2": core, "armature": upper.iron["armature"]},
        turns_density=turns[0] | turns[1],
        depth=magnet.stack_depth,
        gap=nearest,
        symmetry=upper.symmetry if half else "flux line",
    )
    return TwoSidedSection(section, half, (turns[0], turns[1]), (0.0, middle))


def _name(region: str, side: int) -> str:
    """The name of a side's region: windows are shared, and what is taken off the poles belongs to the gap."""
    return {"window": "window", "air": "gap"}.get(region, f"{region}_{side}")


def _turns(part: Section, side: int, *, half: bool) -> dict[str, float]:
    """Region to turns per area (1/m2); in a mirrored half currents change their sign where x = 0 is a flux line."""
    sign = -1 if part.symmetry == "flux line" else 1
    turns = {f"{name}_{side}+": density for name, density in part.turns_density.items()}
    if not half:
        turns |= {f"{name}_{side}-": sign * density for name, density in part.turns_density.items()}
    return turns


def _plane_magnet(actuator: Actuator) -> PlaneMagnet:
    """The magnet, where its mirror image can share its armature; ActuatorError that says why otherwise."""
    magnet = actuator.magnet_kind("the field of both sides")
    if isinstance(magnet, PlaneMagnet):
        return magnet
    raise ActuatorError(
        f"{actuator.name}: the field of both sides is that of plane sections with a flat armature between; "
        "this magnet has none to share"
    )


def _armature(magnet: PlaneMagnet) -> list[tuple[float, float]]:
    wide = magnet.armature_half_width
    low = -magnet.armature_thickness
    return [(-wide, low), (wide, low), (wide, 0.0), (-wide, 0.0)]


def _turned(x: float, y: float, tilt: float, middle: float) -> tuple[float, float]:
    c, s = np.cos(tilt), np.sin(tilt)
    return float(x * c - (y - middle) * s), float(middle + x * s + (y - middle) * c)


def _nearest_gap(magnet: PlaneMagnet, position: TwoSidedPosition) -> float:
    """The smallest distance between armature and pole faces; InputError where nothing is left."""
    smaller = min(position.gap_1, position.gap_2)
    corner = magnet.half_width if magnet.armature_overhang == 0 else magnet.armature_half_width
    left = smaller - corner * abs(np.sin(position.tilt))
    if left < SMALLEST_GAP * smaller:
        largest = np.arcsin(min(1.0, (1 - SMALLEST_GAP) * smaller / corner))
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} brings the armature against a core; at a gap of "
            f"{format_quantity(smaller, 'm')} it may be at most {format_quantity(float(largest), 'rad')}"
        )
    return float(left)


def _surroundings(magnet: PlaneMagnet, position: TwoSidedPosition) -> list[Region]:
    """The air box and the air between the cores."""
    air, thick = magnet.air_box, magnet.armature_thickness
    wide = max(magnet.half_width, magnet.armature_half_width)
    side = magnet.half_width + air.side
    left = 0.0 if position.tilt == 0.0 else 1.0
    top = position.gap_1 + magnet.height + air.top
    bottom = -thick - position.gap_2 - magnet.height - air.top
    reach = wide + thick  # past the corners of a tilted armature
    return [
        rectangle("air", -left * side, bottom, side, top),
        rectangle("gap", -left * reach, -thick - position.gap_2, reach, position.gap_1),
    ]


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
        magnet = _plane_magnet(actuator)
        self.actuator = actuator
        self.position = position
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
    level = level_of(accuracy)
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    if not abs(position.tilt) <= LARGEST_TILT:
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} is not allowed; it must be within "
            f"-{LARGEST_TILT:g} ... {LARGEST_TILT:g} rad"
        )
    field = TwoSidedField(actuator, position, accuracy=accuracy)
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
    return _decoupling_of(_field_of_both(actuator, currents, position, accuracy), currents)


def _field_of_both(
    actuator: Actuator, currents: tuple[float, float], position: TwoSidedPosition, accuracy: Accuracy
) -> TwoSidedField:
    """The field in which the sides are compared; InputError as `decoupling`."""
    if not all(currents):
        raise InputError(f"currents {currents[0]:g} A and {currents[1]:g} A: decoupling needs both, not zero")
    for current, gap in zip(currents, (position.gap_1, position.gap_2), strict=True):
        check_point(actuator, current, gap)
    return TwoSidedField(actuator, position, accuracy=accuracy)


def _decoupling_of(field: TwoSidedField, currents: tuple[float, float]) -> Decoupling:
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
    actuator: Actuator, sizes: tuple[float, float], position: TwoSidedPosition, *, accuracy: Accuracy = "normal"
) -> dict[str, Decoupling]:
    """`decoupling` at currents of these sizes (A), opposing, whose fluxes add up in the armature, and aiding.

    Raises
    ------
    InputError : as `decoupling`
    """
    first, second = abs(sizes[0]), abs(sizes[1])
    field = _field_of_both(actuator, (first, second), position, accuracy)
    signs = (("opposing", -1.0), ("aiding", 1.0))
    return {name: _decoupling_of(field, (first, sign * second)) for name, sign in signs}


def _alone(currents: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    return (currents[0], 0.0), (0.0, currents[1])
