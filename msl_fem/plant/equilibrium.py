"""Where the mover rests at constant currents, and how stiff it is held there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from msl_fem.actuator import Actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.plant import PlantParameters, plant_parameters
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
Currents = tuple[float, float]
_POINTS = 801


@dataclass(frozen=True)
class Equilibrium:
    """A position where the forces balance at constant currents.

    Attributes
    ----------
    currents : of the sides, A; the second is 0 where there is one side
    position : m
    stiffness : static, at constant currents: k + dF_1/dg + dF_2/dg in N/m; the magnets' part is negative
    """

    currents: Currents
    position: float
    stiffness: float

    @property
    def stable(self) -> bool:
        """The mover returns after a small push while the currents are kept (with any damping)."""
        return self.stiffness > 0


def net_force(
    plant: PlantParameters, table: MagneticTable | None, *, currents: Currents, position: Array
) -> tuple[Array, Array]:
    """(net static force N, static stiffness N/m) on the mover at positions x in m, of their shape.

    f = F_1(i_1, g_0 - x) - F_2(i_2, g_0 + x) + F_const - k x, and its negative slope over x.

    Raises
    ------
    OutOfTable : a gap or current outside the table
    """
    x = np.asarray(position, dtype=float)
    force, stiffness = plant.constant_force - plant.stiffness * x, np.full(x.shape, plant.stiffness)
    for j in range(plant.sides):
        if table is None:
            raise InputError("the actuator has magnets and there is no table; make one with 'msl-fem table'")
        toward = 1 - 2 * j
        magnet = table.evaluate(plant.current_share * currents[j], plant.nominal_gap - toward * x)
        force = force + toward * plant.magnets * magnet["force"]
        stiffness = stiffness + plant.magnets * magnet["force_gap_slope"]
    return force, stiffness


def position_range(plant: PlantParameters, table: MagneticTable | None) -> tuple[float, float]:
    """The positions in m that travel and table allow; infinite where nothing bounds them.

    Raises
    ------
    InputError : the table has none of them
    """
    low, high = -plant.travel, plant.travel
    for j in range(plant.sides if table is not None else 0):
        assert table is not None
        ends = (1 - 2 * j) * (plant.nominal_gap - table.gap[[0, -1]])
        low, high = max(low, ends.min()), min(high, ends.max())
    if not low < high:
        raise InputError(
            f"no position between {-plant.travel:g} and {plant.travel:g} m has both gaps in the table "
            f"({table.rectangle if table else 'none'}); extend the sweep (--gaps)"
        )
    return float(low), float(high)


def equilibria(actuator: Actuator, table: MagneticTable | None, *, currents: Currents) -> tuple[Equilibrium, ...]:
    """All equilibria at constant side currents (A), by position, inside the travel and the table.

    Between neighbouring extremes of the net force, which are roots of the stiffness, there is at most one root of the
    force, so none is missed that 801 points resolve.

    Raises
    ------
    InputError : every position is one (no spring, no force); nothing bounds the search
    OutOfTable : a current outside the table
    """
    plant = plant_parameters(actuator)
    low, high = position_range(plant, table)
    if not np.isfinite(high - low):
        if plant.stiffness <= 0:
            raise InputError(f"{actuator.name}: without a spring and a range there is no equilibrium to look for")
        reach = 2 * abs(plant.constant_force) / plant.stiffness + 1.0
        low, high = -reach, reach

    def force(x: float) -> float:
        return float(net_force(plant, table, currents=currents, position=np.array(x))[0])

    def stiffness(x: float) -> float:
        return float(net_force(plant, table, currents=currents, position=np.array(x))[1])

    x = np.linspace(low, high, _POINTS)
    slope = net_force(plant, table, currents=currents, position=x)[1]
    turns = [brentq(stiffness, x[n], x[n + 1]) for n in np.flatnonzero(slope[:-1] * slope[1:] < 0)]
    x = np.sort(np.r_[x, turns])
    f = net_force(plant, table, currents=currents, position=x)[0]
    if np.abs(f).max() <= _rounding(plant, table):
        raise InputError(f"{actuator.name}: no force acts at these currents, every position is an equilibrium")
    roots = [brentq(force, x[n], x[n + 1], xtol=1e-15) for n in np.flatnonzero(f[:-1] * f[1:] < 0)]
    roots = sorted([*roots, *x[f == 0]])
    apart = [r for n, r in enumerate(roots) if n == 0 or r - roots[n - 1] > 1e-9 * (high - low)]
    return tuple(Equilibrium(currents, float(r), stiffness(r)) for r in apart)


def _rounding(plant: PlantParameters, table: MagneticTable | None) -> float:
    """A force in N that is none: the rounding of the table's interpolant."""
    largest = float(np.abs(table.nodes["force"]).max()) if table is not None and plant.sides else 0.0
    return 1e-12 * plant.magnets * largest


def resting_point(
    actuator: Actuator, table: MagneticTable | None, *, currents: Currents, start: float = 0.0
) -> Equilibrium:
    """The equilibrium to which the mover creeps from `start` (m) at constant side currents (A).

    It is the first one in the direction of the net force; at `start` itself where the forces balance there.

    Raises
    ------
    ComputationError : there is none before the travel or the table ends, or the one at `start` is unstable
    """
    found = equilibria(actuator, table, currents=currents)
    plant = plant_parameters(actuator)
    near = 1e-9 * plant.nominal_gap if np.isfinite(plant.nominal_gap) else 1e-12
    here = [e for e in found if abs(e.position - start) <= near]
    push = float(net_force(plant, table, currents=currents, position=np.array(start))[0])
    ahead = sorted((e for e in found if (e.position - start) * push > 0), key=lambda e: abs(e.position - start))
    reached = here or ahead
    if not reached or not reached[0].stable:
        why = "the equilibrium is unstable" if reached else "the mover is pulled to its end"
        raise ComputationError(
            f"{actuator.name}: at {currents[0]:.4g} A and {currents[1]:.4g} A, from x = {start * 1e3:.4g} mm, {why}; "
            "lower the currents, or close a loop around the position"
        )
    return reached[0]
