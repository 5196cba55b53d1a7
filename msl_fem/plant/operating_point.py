"""Operating points: where the mover rests at constant currents, the linear model there, how far it is stable."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.plant import (
    PlantParameters,
    plant_parameters,
)
from msl_fem.plant.two_sides import Currents, shared_by_sides
from msl_fem.table.magnetic_table import MagneticTable

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
    force = plant.constant_force - plant.stiffness * x
    stiffness = np.full(x.shape, plant.stiffness)
    for j in range(plant.sides):
        if table is None:
            raise InputError("the actuator has magnets and there is no table; make one with 'msl-fem table'")
        toward = 1 - 2 * j
        magnet = table.evaluate(plant.current_share * currents[j], plant.nominal_gap - toward * x)
        force = force + toward * plant.magnets * magnet["force"]
        stiffness = stiffness + plant.magnets * magnet["force_gap_slope"]
    shared = shared_by_sides(plant, table, currents=currents, position=x)
    if shared is not None:
        force = force + plant.magnets * shared["x"]
        stiffness = stiffness - plant.magnets * shared["xx"]
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
    if plant.sides and table is not None and table.shared is not None:
        ends = table.shared.surface.position
        low, high = max(low, ends[0]), min(high, ends[-1])
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
    turns = [_root(stiffness, x[n], x[n + 1]) for n in np.flatnonzero(slope[:-1] * slope[1:] < 0)]
    x = np.sort(np.r_[x, turns])
    f = net_force(plant, table, currents=currents, position=x)[0]
    if np.abs(f).max() <= _rounding(plant, table):
        raise InputError(f"{actuator.name}: no force acts at these currents, every position is an equilibrium")
    roots = [_root(force, x[n], x[n + 1], xtol=1e-15) for n in np.flatnonzero(f[:-1] * f[1:] < 0)]
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
    known = equilibria(actuator, table, currents=currents)
    plant = plant_parameters(actuator)
    near = 1e-9 * plant.nominal_gap if np.isfinite(plant.nominal_gap) else 1e-12
    here = [e for e in known if abs(e.position - start) <= near]
    push = float(net_force(plant, table, currents=currents, position=np.array(start))[0])
    ahead = sorted((e for e in known if (e.position - start) * push > 0), key=lambda e: abs(e.position - start))
    reached = here or ahead
    if not reached or not reached[0].stable:
        why = "the equilibrium is unstable" if reached else "the mover is pulled to its end"
        raise ComputationError(
            f"{actuator.name}: at {currents[0]:.4g} A and {currents[1]:.4g} A, from x = {start * 1e3:.4g} mm, {why}; "
            "lower the currents, or close a loop around the position"
        )
    return reached[0]


_CURRENTS_TRIED = 400


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

    current = np.linspace(0.0, largest, _CURRENTS_TRIED)
    values = np.array([stiffness(i) for i in current])
    below = np.flatnonzero(values <= 0)
    return _root(stiffness, current[below[0] - 1], current[below[0]]) if below.size else math.inf


def _root(function: Callable[[float], float], low: float, high: float, **accuracy: float) -> float:
    """Where a function that changes its sign between two points is zero (Brent 1973)."""
    from scipy.optimize import brentq  # here, for its import takes longer than all the rest of a plant

    return float(brentq(function, low, high, **accuracy))


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
    i = np.asarray(currents, dtype=float)
    x = np.asarray(positions, dtype=float)
    stiffness = np.array([net_force(plant, table, currents=(c, c), position=x)[1] for c in i])
    with np.errstate(invalid="ignore"):
        natural = np.sqrt(np.where(stiffness > 0, stiffness, np.nan) / plant.mass) / (2 * math.pi)
    largest = min(plant.current_limit, float(table.current[-1]) / plant.current_share)
    fine = np.linspace(0.0, largest, _CURRENTS_TRIED)
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
