"""How far the open loop is stable: at x = 0, and over positions and currents."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.plant.equilibrium import net_force
from msl_fem.plant.plant import plant_parameters
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
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


@dataclass(frozen=True, eq=False)
class OpenLoopMap:
    """The open loop over a grid of equal currents on all sides and positions, held there by whatever force it takes.

    Attributes
    ----------
    currents, positions : (n_current,) A, (n_position,) m
    stiffness : (n_current, n_position) static, at constant currents, N/m; not positive: unstable
    natural_frequency : (n_current, n_position) of the mover on that stiffness, Hz; nan where it is unstable
    boundary : (n_position,) the current in A above which the open loop is unstable there; inf where none within the
        drive's limit and the table makes it so, 0 without a spring
    """

    currents: Array
    positions: Array
    stiffness: Array
    natural_frequency: Array
    boundary: Array

    @property
    def stable(self) -> NDArray[np.bool_]:
        """(n_current, n_position) whether the mover returns after a small push while the currents are kept."""
        return self.stiffness > 0


def open_loop_map(actuator: Actuator, table: MagneticTable, *, currents: Array, positions: Array) -> OpenLoopMap:
    """Stiffness, natural frequency and stability over currents (A, of a side) and positions (m).

    Raises
    ------
    InputError : a section of the actuator is missing, or it has no magnets
    OutOfTable : a current, or a gap at one of the positions, outside the table
    """
    plant = plant_parameters(actuator)
    if plant.sides == 0:
        raise InputError(f"{actuator.name} has no magnets; its stiffness is motion.stiffness everywhere")
    i, x = np.asarray(currents, dtype=float), np.asarray(positions, dtype=float)
    stiffness = np.array([net_force(plant, table, currents=(c, c), position=x)[1] for c in i])
    with np.errstate(invalid="ignore"):
        natural = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / plant.mass) / (2 * math.pi)
    largest = min(plant.current_limit, float(table.current[-1]) / plant.current_share)
    fine = np.linspace(0.0, largest, _POINTS)
    along = np.array([net_force(plant, table, currents=(c, c), position=x)[1] for c in fine])
    return OpenLoopMap(i, x, stiffness, natural, np.array([_first_root(fine, column) for column in along.T]))


def _first_root(current: Array, stiffness: Array) -> float:
    """Where the stiffness first falls to 0, linear between the points; inf where it does not."""
    below = np.flatnonzero(stiffness <= 0)
    if not below.size:
        return math.inf
    n = int(below[0])
    if n == 0:
        return 0.0
    share = stiffness[n - 1] / (stiffness[n - 1] - stiffness[n])
    return float(current[n - 1] + share * (current[n] - current[n - 1]))
