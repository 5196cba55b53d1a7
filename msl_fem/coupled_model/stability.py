"""How far the open loop is stable."""

import math

import numpy as np
from scipy.optimize import brentq

from msl_fem.actuator import Actuator
from msl_fem.coupled_model.equilibrium import net_force
from msl_fem.coupled_model.plant import plant_parameters
from msl_fem.table import MagneticTable

_POINTS = 400


def stability_limit(actuator: Actuator, table: MagneticTable) -> float:
    """The largest current (A, of a side, the same on all sides) up to which the open loop is stable at x = 0.

    There the magnets' negative stiffness has used up the spring: k + dF_1/dg + dF_2/dg = 0 at constant currents, the
    first root over the current. It holds for a voltage drive as well, whose currents are constant at the slow motion
    with which the mover departs. 0 without a spring; inf where no current within the drive's limit and the table
    reaches it.

    Raises
    ------
    InputError : a section of the actuator is missing
    OutOfTable : the nominal gap lies outside the table
    """
    plant = plant_parameters(actuator)
    if plant.sides == 0:
        return math.inf
    if plant.stiffness <= 0:
        return 0.0
    largest = min(plant.current_limit, float(table.current[-1]) / plant.current_share)

    def stiffness(current: float) -> float:
        point = np.array(0.0)
        return float(net_force(plant, table, currents=(current, current), position=point)[1])

    current = np.linspace(0.0, largest, _POINTS)
    values = np.array([stiffness(i) for i in current])
    below = np.flatnonzero(values <= 0)
    return float(brentq(stiffness, current[below[0] - 1], current[below[0]])) if below.size else math.inf
