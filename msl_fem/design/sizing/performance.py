"""What a magnet gives at its working point, whoever says so (closed equations or a field), and with which winding."""

import math
from dataclasses import dataclass

from msl_fem.actuator import Actuator, ECore
from msl_fem.design.sizing.constraints import Constraint, at_least, at_most
from msl_fem.design.sizing.design import Design, magnet_of
from msl_fem.design.sizing.mass import Masses, masses
from msl_fem.design.sizing.requirement import Heat, Requirement
from msl_fem.losses import Cooling, Cycle, Heating, peak_rise, thermal_network


@dataclass(frozen=True)
class PlanePoint:
    """One working point of a section, per metre of depth; one turn, so that the current is the magnetomotive force.

    Attributes
    ----------
    ampere_turns : A
    force : N/m
    force_slope : N/(A m), dF/d(ampere turns)
    inductance : H/m, incremental, of one turn
    flux_density : T in the iron, mean over `section`, the most loaded one
    """

    ampere_turns: float
    force: float
    force_slope: float
    inductance: float
    flux_density: float
    section: str


@dataclass(frozen=True)
class Performance:
    """A wound magnet at the current that gives its force.

    Attributes
    ----------
    magnet : with its depth and turns
    current : A in the coil
    force, flux_density, section : at that current
    resistance : ohm, 20 degC
    loss : W, copper at 20 degC and that current
    inductance : H, incremental at that current
    current_density : A/m2 in the copper
    slew_rate : N/s that the supply can raise the force by, at that current
    temperature_rise : K of the winding above the air; inf where no temperature balances the loss
    """

    magnet: ECore
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
    temperature_rise: float


def wound(design: Design, point: PlanePoint, requirement: Requirement, *, depth: float) -> Performance:
    """The magnet of a depth with the turns that its supply asks for.

    Turns share a given magnetomotive force between current and voltage: the fewest whose current stays below the
    supply's are taken, which leaves the most voltage for dF/dt = (dF/di) (V - R i) / (dlambda/di). A stated wire
    diameter fixes the turns instead, as many as the copper's area holds (one at least).

    Raises
    ------
    ValueError : proportions that no section may have
    """
    fill = None
    plain = magnet_of(design, requirement, depth=depth, turns=1)
    if requirement.winding.wire_diameter is None:
        turns = max(1, math.ceil(point.ampere_turns / requirement.coil_current * (1 - 1e-12)))
    else:
        wire = math.pi / 4 * requirement.winding.wire_diameter**2
        turns = max(1, math.floor(requirement.winding.fill_factor * plain.coil_section / wire))
        fill = min(turns * wire / plain.coil_section, 1 - 1e-9)
    magnet = magnet_of(design, requirement, depth=depth, turns=turns, fill=fill)
    current, resistance = point.ampere_turns / turns, magnet.winding_resistance
    loss, inductance = resistance * current**2, turns**2 * point.inductance * depth
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
        current_density=point.ampere_turns / (magnet.coil.fill_factor * magnet.coil_section),
        slew_rate=point.force_slope * depth * turns * headroom / inductance,
        temperature_rise=_temperature_rise(magnet, current, requirement.heat),
    )


def _temperature_rise(magnet: ECore, current: float, heat: Heat) -> float:
    """By the network of winding and core, the current flowing for `duty` of a short period (`msl_fem.losses`)."""
    alone = Actuator(schema=1, name="magnet", magnet=magnet)
    network = thermal_network(alone, Cooling(heat_transfer_coefficient=heat.heat_transfer))
    return peak_rise(network, Heating(magnet.winding_resistance), current, cycle=Cycle(heat.duty))


def performance_constraints(found: Performance, requirement: Requirement) -> tuple[Constraint, ...]:
    """The demands on a wound magnet, those of its envelope's depth included."""
    heat, envelope = requirement.heat, requirement.envelope
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
    if envelope.depth is not None:
        coil = found.magnet.coil
        total = found.magnet.stack_depth + 2 * (coil.leg_clearance + coil.width)
        demands.append(at_most("envelope_depth", total, envelope.depth, "m"))
    return tuple(demands)
