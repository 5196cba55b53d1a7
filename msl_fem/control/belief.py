"""What a controller believes of its plant: the linear motion, the magnets' surfaces, the guard, how far it can go."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.control.believed_plant import BelievedPlant, believed_plant
from msl_fem.control.inverse import Inverse, SideBelief, force_domain, held_stiffness, inverse_of
from msl_fem.control.linear_loop import AtPosition
from msl_fem.errors import InputError
from msl_fem.maps.guard import Guard
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.plant.plant import PlantParameters, plant_parameters, surface_of
from msl_fem.table.magnetic_table import MagneticTable

_N_REACH = 101


@dataclass(frozen=True, eq=False)
class Belief:
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
    """

    actuator: Actuator
    plant: BelievedPlant
    coupled: PlantParameters
    inverse: Inverse
    cubic: float = 0.0
    source: str = "table"
    left_out: tuple[str, ...] = ()

    def holding_force(self, position: float) -> float:
        """N of the magnets that hold the mover at a position in m."""
        return float((self.plant.stiffness + self.cubic * position**2) * position - self.coupled.constant_force)

    def domain(self) -> dict[str, Any]:
        """The JSON object of where the input transformation has an inverse."""
        guard, middle = self.inverse.guard, force_domain(self.inverse, 0.0)
        return {
            "source": self.source,
            "gap_m": [float(guard.gap[0]), float(guard.gap[-1])],
            "magnet_current_A": [0.0, self.inverse.current_limit],
            "force_in_the_middle_N": [middle.lowest, middle.highest],
            "known_but_left_to_feedback": list(self.left_out),
        }

    def place(self, position: float, *, overlap: float = 0.0) -> AtPosition:
        """The magnets near a position in m that they hold through the inverse; raises as `held_stiffness`."""
        held = held_stiffness(self.inverse, self.holding_force(position), position, overlap=overlap)
        return AtPosition(held - 3 * self.cubic * position**2)


def belief_of(actuator: Actuator, table: MagneticTable, operating_map: OperatingMap) -> Belief:
    """The belief that the actuator is as its file, table and map say.

    Raises
    ------
    ActuatorError : a section that a design needs is missing
    InputError : a table and a map that do not belong together
    """
    plant, coupled = believed_plant(actuator), plant_parameters(actuator)
    side = SideBelief(surface_of(table), coupled.nominal_gap)
    return Belief(actuator, plant, coupled, inverse_of(coupled, Guard(operating_map), side))


def reach_of(belief: Belief) -> tuple[float, float]:
    """Lowest and highest position in m that the magnets can hold within guard, drive, table and travel.

    Raises
    ------
    InputError : not even the middle
    """
    inverse, ends = belief.inverse, []
    for sign in (-1.0, 1.0):
        last = None
        for x in sign * np.linspace(0, min(belief.coupled.travel, inverse.gap_1, inverse.gap_2), _N_REACH):
            domain = force_domain(inverse, float(x))
            judged = domain.highest > 0 and (inverse.sides == 1 or domain.lowest < 0)
            if not (judged and domain.lowest <= belief.holding_force(float(x)) <= domain.highest):
                break
            last = float(x)
        if last is None:
            raise InputError(
                "the magnets cannot hold the middle of the travel within the guard, the drive and the table; "
                "look at the operating map at the nominal gap"
            )
        ends.append(last)
    return ends[0], ends[1]
