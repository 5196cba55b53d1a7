"""What a controller is designed for: linear plant, magnets, guard, reach.

After feedback linearization (Gutierrez and Ro, IEEE Trans. Magnetics 34(5), 1998, eqs. 15 to 18) the plant is m x'' + c
x' + k x = f, where f follows the commanded force u through the drive's lag, f' = w (u - f), and u acts `delay` samples
after the measurement that it answers.

Effects that a controller knows go into its inverse, its linear plant and its constant force:

| effect | goes into |
| --- | --- |
| gap_offset | the gaps at which currents are inverted |
| early_saturation, fringing | the surface: W'(i, g) -> depth(g) W'(t i, g), as in the coupled model |
| stiffness_nonlinearity | the cubic force is carried by the magnets at the measured position |
| force_offset | the constant force |
| squeeze_film | the damping, as the films of all sides make it in the middle |
| amplifier_bandwidth, eddy_currents | the lag of the linear plant: the sum of the time constants |
| time_delay.command | whole samples into the delay, what is left into the lag |
| leakage_inductance, mutual_inductance | the flux linkage of the current loop, where the drive gives voltages |

Everything else is left to the feedback, and named.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.control.current_loop import KNOWN_STRAY, CurrentLoopDesign, designed_current_loop
from msl_fem.control.inverse import (
    Inverse,
    SideModel,
    force_domain,
    held_stiffness,
    inverse_of,
    magnet_currents,
)
from msl_fem.control.linear_plant import LinearPlant, linear_plant
from msl_fem.errors import InputError
from msl_fem.maps.guard import Guard
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import PairMap
from msl_fem.plant.effects import CATALOGUE, EffectValues, design_change
from msl_fem.plant.plant import PlantParameters, Surface, as_surface, plant_parameters, surface_of
from msl_fem.plant.two_sides import check_shared
from msl_fem.table.coenergy_surface import fit_coenergy_surface
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_surface import SharedCoenergy

_N_REACH = 101


@dataclass(frozen=True)
class AtPosition:
    """What the magnets do near a frozen position.

    Attributes
    ----------
    magnet_stiffness : N/m, dF/dx at held currents, against the suspension
    cancelled : N/m, what of it the input transformation takes off again; None: all
    gain : force that a commanded force gives, over what the design believes
    """

    magnet_stiffness: float = 0.0
    cancelled: float | None = None
    gain: float = 1.0

    @property
    def taken_off(self) -> float:
        """N/m, `cancelled` as a number."""
        return self.magnet_stiffness if self.cancelled is None else self.cancelled


MIDDLE = AtPosition()
"""Where no current is held."""


@dataclass(frozen=True, eq=False)
class DesignModel:
    """What a controller is designed for.

    Attributes
    ----------
    actuator : the file that is believed
    plant : motion, drive and delay, linear and sampled
    coupled : the numbers of the coupled model
    inverse : from forces to currents, with the guard
    cubic : N/m^3, of the suspension
    source : what the input transformation comes from, in words
    left_out : known parameters of effects that the design has no place for, left to the feedback
    shared : what both sides' armature adds where both are on; None: the sides are believed apart
    current_loop : around a voltage drive
    """

    actuator: Actuator
    plant: LinearPlant
    coupled: PlantParameters
    inverse: Inverse
    cubic: float = 0.0
    source: str = "table"
    left_out: tuple[str, ...] = ()
    shared: SharedCoenergy | None = None
    current_loop: CurrentLoopDesign | None = None

    def holding_force(self, position: float) -> float:
        """N of the magnets that hold the mover at a position in m."""
        return float((self.plant.stiffness + self.cubic * position**2) * position - self.coupled.constant_force)

    def domain(self) -> dict[str, Any]:
        """The JSON object of where the input transformation has an inverse."""
        guard = self.inverse.guard
        middle = force_domain(self.inverse, 0.0)
        return {
            "source": self.source,
            "gap_m": [float(guard.gap[0]), float(guard.gap[-1])],
            "magnet_current_A": [0.0, self.inverse.current_limit],
            "guard": "each side by its own map" if self.inverse.both.relation < 0 else "both sides by the pair's map",
            "force_in_the_middle_N": [middle.lowest, middle.highest],
            "known_but_left_to_feedback": list(self.left_out),
        }

    def place(self, position: float, *, overlap: float = 0.0) -> AtPosition:
        """The magnets near a position in m that they hold through the inverse; raises as `held_stiffness`."""
        force = self.holding_force(position)
        held = held_stiffness(self.inverse, force, position, overlap=overlap)
        if overlap and self.shared is not None:
            magnet = np.array(magnet_currents(self.inverse, force, position, overlap))
            held += self.common_forces(magnet / self.coupled.current_share, position)[2]
        return AtPosition(held - 3 * self.cubic * position**2)

    def common_forces(self, currents: Array, position: float) -> tuple[float, float, float]:
        """What the sides' armature adds where both carry currents (2,) in A: force (N), its slope by the first current
        less the second (N/A), its slope by the position (N/m)."""
        if self.shared is None:
            return 0.0, 0.0, 0.0
        plant, on = self.coupled, (currents > 0.0) * np.array([1.0, -1.0])
        turned = plant.current_share * np.array([1.0, plant.polarity])
        both = self.shared.evaluate(np.array(position), *(turned * currents))
        by_currents = turned * [float(both["x1"]), float(both["x2"])]
        return (
            plant.magnets * float(both["x"]),
            plant.magnets * float(by_currents @ on),
            plant.magnets * float(both["xx"]),
        )


def design_model_of(
    actuator: Actuator, table: MagneticTable, operating_map: OperatingMap, pair: PairMap | None = None
) -> DesignModel:
    """The belief that the actuator is as its file, table and map say; its guard judges both currents by the pair's map.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : a table and a map that do not belong together; a current loop that cannot be
    """
    coupled = plant_parameters(actuator)
    side = SideModel(surface_of(table)._replace(mutual=None), coupled.nominal_gap)
    check_shared(coupled, table)
    inverse = inverse_of(coupled, Guard(operating_map), side, pair=guard_of_pair(actuator, pair))
    loop = designed_current_loop(actuator, inverse, coupled)
    plant = linear_plant(actuator, loop)
    return DesignModel(actuator, plant, coupled, inverse, shared=table.shared, current_loop=loop)


def guard_of_pair(actuator: Actuator, record: PairMap | None) -> PairGuard | None:
    """The guard of a pair's map; InputError where it is of the other polarity than the actuator's sides."""
    if record is None:
        return None
    if actuator.sides is not None and record.polarity != actuator.sides.polarity:
        raise InputError(
            f"the pair's map is for {record.polarity} currents and sides.polarity of {actuator.name} is "
            f"'{actuator.sides.polarity}'; make the map of this actuator's pair"
        )
    return PairGuard(record)


def reach_of(model: DesignModel) -> tuple[float, float]:
    """Lowest and highest position in m that the magnets can hold within guard, drive, table and travel.

    Raises
    ------
    InputError : not even the middle
    """
    inverse, ends = model.inverse, []
    for sign in (-1.0, 1.0):
        last = None
        for x in sign * np.linspace(0, min(model.coupled.travel, inverse.gap_1, inverse.gap_2), _N_REACH):
            domain = force_domain(inverse, float(x))
            judged = domain.highest > 0 and (inverse.sides == 1 or domain.lowest < 0)
            if not (judged and domain.lowest <= model.holding_force(float(x)) <= domain.highest):
                break
            last = float(x)
        if last is None:
            raise InputError(
                "the magnets cannot hold the middle of the travel within the guard, the drive and the table; "
                "look at the operating map at the nominal gap"
            )
        ends.append(last)
    return ends[0], ends[1]


def design_model_with_effects(
    actuator: Actuator,
    table: MagneticTable,
    operating_map: OperatingMap,
    effects: EffectValues,
    pair: PairMap | None = None,
) -> DesignModel:
    """The belief in an actuator with effects. The guard stays that of the map.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : a table and a map that do not belong together; a current loop that cannot be
    """
    coupled = plant_parameters(actuator)
    change = design_change(effects, sides=coupled.sides)
    coupled = coupled._replace(constant_force=coupled.constant_force + change.constant_force)
    check_shared(coupled, table)
    surface = surface_with_effects(table, effects)
    sides = [SideModel(surface, coupled.nominal_gap + wider) for wider in (change.gap_1, change.gap_2)]
    inverse = inverse_of(coupled, Guard(operating_map), *sides, pair=guard_of_pair(actuator, pair))
    loop = designed_current_loop(actuator, inverse, coupled, effects)
    return DesignModel(
        actuator,
        plant_with_effects(linear_plant(actuator, loop), effects, sides=coupled.sides),
        coupled,
        inverse,
        cubic=change.cubic,
        source="extended model",
        left_out=tuple(name for name in left_to_feedback(effects) if loop is None or name not in KNOWN_STRAY),
        shared=table.shared,
        current_loop=loop,
    )


def design_model_as_believed(
    actuator: Actuator,
    table: MagneticTable,
    operating_map: OperatingMap,
    effects: EffectValues | None,
    pair: PairMap | None = None,
) -> DesignModel:
    """The design model of a belief, effects beside the table where there are any; raises as `design_model_of`."""
    if effects is None:
        return design_model_of(actuator, table, operating_map, pair)
    return replace(design_model_with_effects(actuator, table, operating_map, effects, pair), source="as designed")


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
    return as_surface(fit_coenergy_surface(np.asarray(table.gap), np.asarray(table.current) / t, nodes))


def plant_with_effects(plant: LinearPlant, effects: EffectValues, *, sides: int) -> LinearPlant:
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
        stiffness=plant.stiffness + change.stiffness,
        damping=plant.damping + change.damping,
        lag=1.0 / time if time > 0 else math.inf,
        delay=plant.delay + whole,
    )
