"""The exact input transformation from a wanted force to coil currents.

Gutierrez and Ro (IEEE Trans. Magnetics 34(5), 1998, eqs. 15 to 18): u = F_1(i_1, g_1) - F_2(i_2, g_2) is the new input,
and i = f^-1(abs(u)/n, g) for the n magnets of the side that pulls; the other side carries no current, so there is no
bias. The force of one magnet grows with its current, so the inverse exists up to the force at the largest current.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.both_sides import BothSides, both_sides_of, limit_alone
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.guard import Guard, GuardArrays, limit_at
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.table.coenergy_surface import evaluate, evaluate_slopes

_GAP_SLOPE = 5  # row of an evaluation of the surface
_ITERATIONS = 60


class Inverse(NamedTuple):
    """What the compiled inverse needs: the belief's surface for each side, the guard, and how magnets make a side."""

    surface_1: Surface
    surface_2: Surface
    guard: GuardArrays
    gap_1: float  # m, of the sides at x = 0
    gap_2: float
    magnets: int  # a side
    current_share: float  # magnet current over side current
    current_limit: float  # A, of a magnet: the drive's and the table's end, whichever is lower
    sides: int
    both: BothSides  # what the map of a pair says of both currents


class SideModel(NamedTuple):
    """The surface of a side's magnet, and the side's gap (m) at x = 0."""

    surface: Surface
    gap: float


def inverse_of(plant: PlantParameters, guard: Guard, *sides: SideModel, pair: PairGuard | None = None) -> Inverse:
    """The compiled inverse of a believed plant, whose sides are as stated; one that is stated serves both.

    Both currents are judged together where the guard of the pair is given.

    Raises
    ------
    InputError : the force of a magnet does not grow with the current somewhere below the guard's last limit; a pair's
        guard of other levels, or of an actuator with one side
    """
    first, second = sides[0], sides[-1]
    table_end = min(float(side.surface.current[-1]) for side in sides)
    end = min(plant.current_share * plant.current_limit, table_end)
    inverse = Inverse(
        first.surface,
        second.surface,
        guard.arrays,
        first.gap,
        second.gap,
        plant.magnets,
        plant.current_share,
        end,
        plant.sides,
        both_sides_of(pair, sides=plant.sides, levels=guard.operating_map.levels),
    )
    for side in sides:
        _check_growth(inverse, side.surface)
    return inverse


def _check_growth(inverse: Inverse, surface: Surface) -> None:
    low, high = inverse.guard.gap[0], inverse.guard.gap[-1]
    if low < surface.gap[0] or high > surface.gap[-1]:
        raise InputError(
            f"the map's gaps {low * 1e3:.4g} ... {high * 1e3:.4g} mm reach beyond the table's "
            f"{surface.gap[0] * 1e3:.4g} ... {surface.gap[-1] * 1e3:.4g} mm; make the map of this table"
        )
    for gap in np.linspace(low, high, 4 * surface.gap.size):
        top = magnet_current_limit(inverse, float(gap))
        if inverse.both.relation >= 0 and not top > 0:
            continue  # the pair's map ends before, or the armature allows nothing
        for current in np.linspace(0, top, 4 * surface.current.size)[1:]:
            if not evaluate_slopes(*surface[:3], current, gap)[3] > 0:
                raise InputError(
                    f"the table's force does not grow with the current at {current:.4g} A, gap "
                    f"{format_quantity(float(gap), 'm')}: no unique current gives a wanted force; lower the levels of "
                    "the operating map, or make the table with more currents"
                )


@compiled
def side_surface(inverse: Inverse, side: int) -> Surface:
    """The believed surface of a side's magnet, 0 or 1."""
    return inverse.surface_1 if side == 0 else inverse.surface_2


@compiled
def believed_gap(inverse: Inverse, side: int, position: float) -> float:
    """The believed gap of a side in m with the mover at a position."""
    return inverse.gap_1 - position if side == 0 else inverse.gap_2 + position


@compiled
def level_limit(inverse: Inverse, level: int, gap: float) -> float:
    """The current of a magnet in A up to which a level is not reached, its side on alone; nan outside a map."""
    own = limit_at(inverse.guard, level, gap)
    armature = limit_alone(inverse.both, level, 0.5 * (inverse.gap_1 + inverse.gap_2) - gap)
    if not (np.isfinite(own) and armature == armature):
        return np.nan
    return float(min(own, armature))


@compiled
def magnet_current_limit(inverse: Inverse, gap: float) -> float:
    """The largest current of a magnet in A that drive, table and the guard's last level allow; 0 outside the map."""
    allowed = level_limit(inverse, inverse.guard.limit.shape[0] - 1, gap)
    return min(allowed, inverse.current_limit) if allowed > 0 else 0.0


@compiled
def magnet_force(surface: Surface, current: float, gap: float) -> float:
    """Force of a magnet in N; nan outside the table."""
    _, force, _, _ = evaluate_slopes(surface.gap, surface.current, surface.coefficients, current, gap)
    return float(force)


@compiled
def magnet_current(surface: Surface, force: float, gap: float, largest: float) -> float:
    """The current of a magnet in A between 0 and `largest` that gives a force in N at the gap.

    Newton on the square root of the force, which is nearly straight in the current (F = const i^2 without saturation),
    kept inside a shrinking bracket. The force must lie between 0 and that at `largest`, inside the table; nan
    where it does not.
    """
    most = magnet_force(surface, largest, gap)
    if not 0.0 <= force <= most:
        return np.nan
    if force == 0.0:
        return 0.0
    low, high = 0.0, largest
    target = np.sqrt(force)
    current = largest * target / np.sqrt(most)
    for _ in range(_ITERATIONS):
        _, given, _, slope = evaluate_slopes(surface.gap, surface.current, surface.coefficients, current, gap)
        if given > force:
            high = current
        else:
            low = current
        root = np.sqrt(max(given, 0.0))
        newton = current + (target - root) * 2.0 * root / slope if slope > 0 else np.inf
        if abs(newton - current) <= 1e-13 * largest:  # before the bracket: it ends at the current itself
            return float(min(max(newton, 0.0), largest))
        following = newton if low < newton < high else 0.5 * (low + high)
        if abs(following - current) <= 1e-13 * largest:
            return float(following)
        current = following
    return float(current)


@dataclass(frozen=True)
class ForceDomain:
    """Forces on the mover that the input transformation can give at a position.

    Attributes
    ----------
    position : m
    lowest, highest : N, negative pulls towards -x; 0 where a side is missing
    current_lowest, current_highest : A, the side currents that give them
    """

    position: float
    lowest: float
    highest: float
    current_lowest: float
    current_highest: float


def force_domain(inverse: Inverse, position: float) -> ForceDomain:
    """The domain of the inverse at a position in m: the last level of the guard, the drive and the table bound it."""
    limits = np.array([_side_limit(inverse, j, position) for j in range(2)])
    return ForceDomain(position, -limits[1, 1], limits[0, 1], limits[1, 0], limits[0, 0])


@compiled
def _side_limit(inverse: Inverse, side: int, position: float) -> tuple[float, float]:
    """(current A, force N) of a side at its limit; zeros for a missing side and outside the map."""
    if side >= inverse.sides:
        return 0.0, 0.0
    gap = believed_gap(inverse, side, position)
    limit = magnet_current_limit(inverse, gap)
    if not limit > 0.0:
        return 0.0, 0.0
    return limit / inverse.current_share, inverse.magnets * magnet_force(side_surface(inverse, side), limit, gap)


@compiled
def force_limits(inverse: Inverse, position: Array) -> Array:
    """(2, n) N: lowest and highest force of `force_domain` at positions (n,) in m."""
    out = np.empty((2, position.size))
    for n in range(position.size):
        out[0, n] = -_side_limit(inverse, 1, position[n])[1]
        out[1, n] = _side_limit(inverse, 0, position[n])[1]
    return out


def held_stiffness(inverse: Inverse, force: float, position: float, *, overlap: float = 0.0) -> float:
    """dF/dx in N/m of the magnets' force at a position, the currents being held that give `force` there.

    With an overlap both sides pull, see `hand_over`.

    Raises
    ------
    InputError : the force lies outside the domain at the position
    """
    domain = force_domain(inverse, position)
    if not domain.lowest <= force <= domain.highest:
        raise InputError(
            f"{force:.4g} N at x = {position * 1e3:.4g} mm is outside the {domain.lowest:.4g} ... "
            f"{domain.highest:.4g} N that the magnets may give there; ask for a smaller travel"
        )
    total = 0.0
    for side, current in enumerate(magnet_currents(inverse, force, position, overlap)):
        if current > 0.0:
            out = np.empty(6)
            evaluate(*side_surface(inverse, side)[:3], current, believed_gap(inverse, side, position), out)
            total -= inverse.magnets * float(out[_GAP_SLOPE])
    return total


def magnet_currents(inverse: Inverse, force: float, position: float, overlap: float) -> tuple[float, float]:
    """A of a magnet of each side by the hand-over, the sides taken apart; cut where a side can pull no more."""
    currents = []
    for side, pull in enumerate(hand_over(force, overlap)[: inverse.sides]):
        gap = believed_gap(inverse, side, position)
        largest = magnet_current_limit(inverse, gap)
        current = magnet_current(side_surface(inverse, side), pull / inverse.magnets, gap, largest) if largest else 0.0
        currents.append(largest if np.isnan(current) else current)
    return currents[0], currents[1] if inverse.sides > 1 else 0.0


@compiled
def hand_over(force: float, overlap: float) -> tuple[float, float]:
    """What side 1 and side 2 pull with (N) for a force of both, F = F_1 - F_2.

    F_1 F_2 = overlap^2: one side falls as the other rises, and at F = 0 both pull with `overlap`. With overlap 0 one
    side pulls at a time (Gutierrez and Ro); then di/dF of a side that begins from nothing is infinite, for i goes with
    the root of F. The constant product is that of a class AB output stage (Gray, Hurst, Lewis, Meyer, Analysis and
    Design of Analog Integrated Circuits, 5th ed., sec. 5.4).
    """
    half = 0.5 * abs(force)
    larger = half + np.sqrt(half * half + overlap * overlap)
    smaller = overlap * overlap / larger if larger > 0.0 else 0.0
    return (larger, smaller) if force >= 0.0 else (smaller, larger)
