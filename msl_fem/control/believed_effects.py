"""Effects that a controller knows: what of them goes into its inverse, its linear plant and its constant force.

| effect | goes into |
| --- | --- |
| gap_offset | the gaps at which currents are inverted |
| early_saturation, fringing | the surface: W'(i, g) -> depth(g) W'(t i, g), as in the coupled model |
| stiffness_nonlinearity | the cubic force is carried by the magnets at the measured position |
| force_offset | the constant force |
| squeeze_film | the damping, as the films of all sides make it in the middle |
| amplifier_bandwidth, eddy_currents | the lag of the linear plant: the sum of the time constants |
| time_delay.command | whole samples into the delay, what is left into the lag |

Everything else is left to the feedback, and named.
"""

import math
from dataclasses import replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.belief import Belief
from msl_fem.control.believed_plant import BelievedPlant, believed_plant
from msl_fem.control.inverse import SideBelief, inverse_of
from msl_fem.maps.guard import Guard
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.plant.effects import CATALOGUE, EffectValues, design_change
from msl_fem.plant.plant import Surface, plant_parameters
from msl_fem.table.coenergy_surface import fit_coenergy_surface
from msl_fem.table.magnetic_table import MagneticTable


def belief_with_effects(
    actuator: Actuator, table: MagneticTable, operating_map: OperatingMap, effects: EffectValues
) -> Belief:
    """The belief in an actuator with effects. The guard stays that of the map.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : a table and a map that do not belong together
    """
    coupled = plant_parameters(actuator)
    change = design_change(effects, sides=coupled.sides)
    coupled = coupled._replace(constant_force=coupled.constant_force + change.constant_force)
    surface = surface_with_effects(table, effects)
    sides = [SideBelief(surface, coupled.nominal_gap + wider) for wider in (change.gap_1, change.gap_2)]
    return Belief(
        actuator,
        plant_with_effects(believed_plant(actuator), effects, sides=coupled.sides),
        coupled,
        inverse_of(coupled, Guard(operating_map), *sides),
        cubic=change.cubic,
        source="extended model",
        left_out=left_to_feedback(effects),
    )


def left_to_feedback(effects: EffectValues) -> tuple[str, ...]:
    """The stated parameters, as effect.parameter, that are neither neutral nor used by a belief."""
    return tuple(
        f"{effect}.{name}"
        for effect in effects.present
        for name, value in effects.stated[effect].items()
        if name in CATALOGUE[effect].amounts
        and name not in CATALOGUE[effect].design.parameters
        and value != CATALOGUE[effect].parameter(name).neutral
    )


def surface_with_effects(table: MagneticTable, effects: EffectValues) -> Surface:
    """The surface of a magnet with early saturation and fringing: the coenergy depth(g) W'(t i, g).

    Nodes at the currents i/t take the table's own values, so nothing is interpolated twice.
    """
    change = design_change(effects, sides=1)
    t, growth = change.current_scale, change.growth
    depth = (change.depth + growth * table.gap)[:, None]
    w = table.nodes
    nodes = {
        "coenergy": depth * w["coenergy"],
        "flux_linkage": t * depth * w["flux_linkage"],
        "force": depth * w["force"] - growth * w["coenergy"],
        "incremental_inductance": t**2 * depth * w["incremental_inductance"],
        "force_current_slope": t * (depth * w["force_current_slope"] - growth * w["flux_linkage"]),
        "force_gap_slope": depth * w["force_gap_slope"] + 2 * growth * w["force"],
    }
    made = fit_coenergy_surface(np.asarray(table.gap), np.asarray(table.current) / t, nodes)
    return Surface(*(np.array(a, dtype=np.float64, order="C") for a in (made.gap, made.current, made.coefficients)))


def plant_with_effects(plant: BelievedPlant, effects: EffectValues, *, sides: int) -> BelievedPlant:
    """The linear plant with its lags and delay, and the air films of its sides.

    A chain of lags is taken as one whose time constant is their sum: alike up to the second order in frequency.
    """
    change = design_change(effects, sides=sides)
    late = change.delay / plant.period
    whole = math.floor(late + 1e-9)
    time = 1.0 / (plant.lag * change.bandwidth) + change.lag
    time += max(late - whole, 0.0) * plant.period
    return replace(
        plant,
        damping=plant.damping + change.damping,
        lag=1.0 / time if time > 0 else math.inf,
        delay=plant.delay + whole,
    )
