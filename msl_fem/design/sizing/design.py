"""A design, its constraints, and what it gives as a wound magnet, by the closed equations or by a field."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

from msl_fem.actuator import Actuator
from msl_fem.design.sizing.masses import Masses, masses
from msl_fem.design.sizing.requirement import Heat, Requirement
from msl_fem.losses import Cooling, Cycle, Heating, peak_rise, thermal_network
from msl_fem.magnetics.kinds import Magnet, MagnetKind
from msl_fem.magnetics.kinds.parts import Coil

LARGEST = 1e6  # of a violation
ROUNDING = 1e-9  # relative: what adding lengths costs
GRID = 1e-5
"""m; dimensions are multiples of it."""
LEAST_COIL = 5e-4
"""m; a narrower or lower coil is not wound."""


@dataclass(frozen=True)
class Constraint:
    """One demand on a design.

    Attributes
    ----------
    value, limit : in `unit`
    upper : the value must not be above the limit (else: not below it)
    """

    name: str
    value: float
    limit: float
    unit: str
    upper: bool

    @property
    def margin(self) -> float:
        """In `unit`; negative where the constraint is broken."""
        return self.limit - self.value if self.upper else self.value - self.limit

    @property
    def violation(self) -> float:
        """Relative to the limit; at most 0 where the constraint is kept, and never infinite."""
        return min(max(-self.margin / abs(self.limit) - ROUNDING, -LARGEST), LARGEST)

    @property
    def kept(self) -> bool:
        return self.violation <= 0

    def to_json(self) -> dict[str, Any]:
        """As JSON states it."""
        return {
            "name": self.name, "value": self.value, "limit": self.limit, "margin": self.margin, "unit": self.unit,
            "at": "most" if self.upper else "least",
        }  # fmt: skip


def at_most(name: str, value: float, limit: float, unit: str) -> Constraint:
    """The value must not be above the limit."""
    return Constraint(name, value, limit, unit, True)


def at_least(name: str, value: float, limit: float, unit: str) -> Constraint:
    """The value must not be below the limit."""
    return Constraint(name, value, limit, unit, False)


def total_violation(constraints: tuple[Constraint, ...]) -> float:
    """The sum of what is broken, relative to the limits; 0 where all is kept."""
    return sum(max(c.violation, 0.0) for c in constraints)


@dataclass(frozen=True)
class Design:
    """What a search varies. The stack's depth and the turns are no free choice: they follow from the field.

    In the plane a field does not know its depth: at a given magnetomotive force the flux densities stay and the force
    grows with the depth. So the magnetomotive force is that which brings `flux_density`, and the depth that which
    gives `force`: the current that gives the force brings just this flux density. A body of revolution has no depth;
    its iron grows round its window until it has the force (`grown`).

    Attributes
    ----------
    pole_width : m across the wound pole, its diameter where it is round
    return_width : m across the other pole; that of the wound one where both are alike
    yoke_thickness ... window_height : m
    flux_density : T in the iron, mean over the most loaded section, at `force`
    force : N of one magnet at the wanted gap
    """

    pole_width: float
    return_width: float
    yoke_thickness: float
    armature_thickness: float
    window_width: float
    window_height: float
    flux_density: float
    force: float


def on_grid(length: float) -> float:
    """The nearest multiple of the grid, as a number that prints short."""
    return round(round(length / GRID) * GRID, 9)


def grown(design: Design, factor: float) -> Design:
    """The design with its iron so many times as thick everywhere, its window as it is, on the grid."""
    names = ("pole_width", "return_width", "yoke_thickness", "armature_thickness")
    return replace(design, **{name: on_grid(factor * getattr(design, name)) for name in names})


def coil_size(design: Design, requirement: Requirement) -> tuple[float, float]:
    """Width and height in m of a coil; together they fill the window but for clearances. Negative without room."""
    winding = requirement.winding
    return (
        round(design.window_width / requirement.sized.coils - 2 * winding.leg_clearance, 9),
        round(design.window_height - winding.face_clearance - winding.back_clearance, 9),
    )


def coil_area(design: Design, requirement: Requirement) -> float:
    """m2 of all coils' cross sections, one side of each."""
    width, height = coil_size(design, requirement)
    return requirement.sized.coils * width * height


def building_constraints(design: Design, requirement: Requirement) -> tuple[Constraint, ...]:
    """What must hold before a field can be solved: a coil in its window, and a section inside the envelope."""
    width, height = coil_size(design, requirement)
    return (
        at_least("coil_width", width, LEAST_COIL, "m"),
        at_least("coil_height", height, LEAST_COIL, "m"),
        *envelope_constraints(plain_magnet(design, requirement, depth=GRID), requirement),  # the end turns alone
    )


def envelope_constraints(magnet: MagnetKind, requirement: Requirement) -> tuple[Constraint, ...]:
    """The sides of the magnet's box at the wanted gap that the requirement limits."""
    size = magnet.outer_size
    assert size is not None, "a kind that is sized states its outer size"
    width, height, depth = size
    found = {"width": width, "height": requirement.force.gap + height, "depth": depth}
    limits = {name: getattr(requirement.envelope, name) for name in found}
    return tuple(at_most(f"envelope_{n}", found[n], limit, "m") for n, limit in limits.items() if limit is not None)


def section_lengths(design: Design, requirement: Requirement) -> tuple[float, ...]:
    """The lengths in m that an actuator file states of the section; a clearance may be 0."""
    winding = requirement.winding
    return (
        design.pole_width, design.return_width, design.yoke_thickness, design.armature_thickness,
        design.window_width, design.window_height, *coil_size(design, requirement),
        winding.leg_clearance, winding.face_clearance,
    )  # fmt: skip


def magnet_of(
    design: Design, requirement: Requirement, *, depth: float, turns: int, fill: float | None = None
) -> MagnetKind:
    """The magnet as an actuator file states it; a body of revolution takes no notice of the depth.

    Raises
    ------
    ValueError : proportions that no section may have
    """
    fill = requirement.winding.fill_factor if fill is None else fill
    coil = Coil(**_coil(design, requirement), turns=turns, fill_factor=fill)
    return requirement.magnet_class.model_validate(_content(design, requirement, depth) | {"coil": coil})


def plain_magnet(design: Design, requirement: Requirement, *, depth: float = 1.0) -> MagnetKind:
    """The magnet with one turn a coil, 1 m deep, unchecked: the closed equations take thousands."""
    blank = requirement.blank_magnet
    coil = blank.coil.model_copy(update=_coil(design, requirement))
    return blank.model_copy(update=_content(design, requirement, depth) | {"coil": coil})


def _content(design: Design, requirement: Requirement, depth: float) -> dict[str, Any]:
    sized = requirement.sized
    content = {
        "kind": requirement.magnet.kind,
        sized.pole: design.pole_width,
        "window_width": design.window_width,
        "window_height": design.window_height,
        "yoke_thickness": design.yoke_thickness,
        "armature_thickness": design.armature_thickness,
        "iron": requirement.iron,
    }
    if sized.return_pole is not None:
        content[sized.return_pole] = design.return_width
    return content if requirement.revolved else content | {"stack_depth": depth}


def _coil(design: Design, requirement: Requirement) -> dict[str, Any]:
    width, height = coil_size(design, requirement)
    winding = requirement.winding
    return {
        "width": width,
        "height": height,
        "leg_clearance": winding.leg_clearance,
        "face_clearance": winding.face_clearance,
    }


@dataclass(frozen=True)
class SectionPoint:
    """One working point of a section 1 m deep, or of a body of revolution; the magnetomotive force is the current.

    Attributes
    ----------
    ampere_turns : A
    force : N
    force_slope : N/A, dF/d(ampere turns)
    inductance : H, incremental, of one turn
    flux_density : T in the iron, mean over `section`, the most loaded one
    flux_densities : T in the iron by section, means
    """

    ampere_turns: float
    force: float
    force_slope: float
    inductance: float
    flux_density: float
    section: str
    flux_densities: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Performance:
    """A wound magnet at the current that gives its force.

    Attributes
    ----------
    magnet : with its depth and turns
    current : A in the coil
    force, flux_density, section, flux_densities : at that current
    resistance : ohm, 20 degC
    loss : W, copper at 20 degC and that current
    inductance : H, incremental at that current
    current_density : A/m2 in the copper
    slew_rate : N/s that the supply can raise the force by, at that current
    heat : how it is cooled, and for how much of the time it is driven
    """

    magnet: MagnetKind
    masses: Masses
    current: float
    force: float
    flux_density: float
    section: str
    resistance: float
    loss: float
    inductance: float
    current_density: float
    slew_rate: float
    heat: Heat
    flux_densities: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def temperature_rise(self) -> float:
        """K of the winding above the air, by the network of winding and core; inf where no temperature balances it.

        The current flows for `duty` of a short period (`msl_fem.losses`).
        """
        alone = Actuator(schema=1, name="magnet", magnet=cast(Magnet, self.magnet))
        network = thermal_network(alone, Cooling(heat_transfer_coefficient=self.heat.heat_transfer))
        return peak_rise(network, Heating(self.resistance), self.current, cycle=Cycle(self.heat.duty))


def wound(design: Design, point: SectionPoint, requirement: Requirement, *, depth: float) -> Performance:
    """The magnet of a depth (1 where there is none) with the turns that its supply asks for.

    Turns share a given magnetomotive force between current and voltage: the fewest whose current stays below the
    supply's are taken, which leaves the most voltage for dF/dt = (dF/di) (V - R i) / (dlambda/di). A stated wire
    diameter fixes the turns instead, as many as the copper's area holds (one a coil at least).

    Raises
    ------
    ValueError : proportions that no section may have
    """
    fill = None
    coils = requirement.sized.coils
    area = coil_area(design, requirement)
    if requirement.winding.wire_diameter is None:
        turns = coils * max(1, math.ceil(point.ampere_turns / requirement.coil_current / coils * (1 - 1e-12)))
    else:
        wire = math.pi / 4 * requirement.winding.wire_diameter**2
        turns = coils * max(1, math.floor(requirement.winding.fill_factor * area / wire / coils))
        fill = min(turns * wire / area, 1 - 1e-9)
    magnet = magnet_of(design, requirement, depth=depth, turns=turns, fill=fill)
    current = point.ampere_turns / turns
    resistance = magnet.winding_resistance
    loss = resistance * current**2
    inductance = turns**2 * point.inductance * depth
    headroom = requirement.coil_voltage - resistance * current
    return Performance(
        magnet=magnet,
        masses=masses(magnet, requirement.densities),
        current=current,
        force=point.force * depth,
        flux_density=point.flux_density,
        section=point.section,
        resistance=resistance,
        loss=loss,
        inductance=inductance,
        current_density=point.ampere_turns / magnet.copper_area,
        slew_rate=point.force_slope * depth * turns * headroom / inductance,
        heat=requirement.heat,
        flux_densities=point.flux_densities,
    )


def performance_constraints(found: Performance, requirement: Requirement) -> tuple[Constraint, ...]:
    """The demands on a wound magnet, those of its envelope's depth included."""
    heat = requirement.heat
    demands = [
        at_least("force", found.force, requirement.force.minimum, "N"),
        at_most("flux_density", found.flux_density, requirement.flux.limit, "T"),
        at_most("current", found.current, requirement.coil_current, "A"),
        at_most("voltage", found.resistance * found.current, requirement.coil_voltage, "V"),
    ]
    if requirement.force.slew_rate is not None:
        demands.append(at_least("force_slew_rate", found.slew_rate, requirement.force.slew_rate, "N/s"))
    if heat.largest_current_density is not None:
        demands.append(at_most("current_density", found.current_density, heat.largest_current_density, "A/m^2"))
    if heat.temperature_rise is not None:
        demands.append(at_most("temperature_rise", found.temperature_rise, heat.temperature_rise, "K"))
    demands += [c for c in envelope_constraints(found.magnet, requirement) if c.name == "envelope_depth"]
    return tuple(demands)
