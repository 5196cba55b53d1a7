"""The exact input transformation from a wanted force to coil currents, and the output stage under the guard.

Gutierrez and Ro (IEEE Trans. Magnetics 34(5), 1998, eqs. 15 to 18): u = F_1(i_1, g_1) - F_2(i_2, g_2) is the new input,
and i = f^-1(abs(u)/n, g) for the n magnets of the side that pulls; the other side carries no current, so there is no
bias. The force of one magnet grows with its current, so the inverse exists up to the force at the largest current.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.guard import Guard, GuardArrays, limit_at
from msl_fem.plant.plant import PlantParameters, Surface
from msl_fem.table.coenergy_surface import evaluate, evaluate_slopes

_GAP_SLOPE = 5  # row of an evaluation of the surface
_ITERATIONS = 60
INVERSE, BIAS = 0, 1


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


class SideModel(NamedTuple):
    """The surface of a side's magnet, and the side's gap (m) at x = 0."""

    surface: Surface
    gap: float


def inverse_of(plant: PlantParameters, guard: Guard, *sides: SideModel) -> Inverse:
    """The compiled inverse of a believed plant, whose sides are as stated; one that is stated serves both.

    Raises
    ------
    InputError : the force of a magnet does not grow with the current somewhere below the guard's last limit
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
        top = magnet_current_limit(inverse, gap)
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
def magnet_current_limit(inverse: Inverse, gap: float) -> float:
    """The largest current of a magnet in A that drive, table and the guard's last level allow; 0 outside the map."""
    allowed = limit_at(inverse.guard, inverse.guard.limit.shape[0] - 1, gap)
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
    pulls = hand_over(force, overlap)
    total = 0.0
    for side in range(inverse.sides):
        gap = believed_gap(inverse, side, position)
        surface = side_surface(inverse, side)
        limit = magnet_current_limit(inverse, gap)
        if pulls[side] > 0.0 and limit > 0.0:
            current = magnet_current(surface, pulls[side] / inverse.magnets, gap, limit)
            out = np.empty(6)
            evaluate(*surface[:3], current, gap, out)
            total -= inverse.magnets * float(out[_GAP_SLOPE])
    return total


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


# What the guard and the limits say of a side's command; of a step counts the worst
PREFERRED, DISCOURAGED, FORCE_LIMITED, VIOLATION = range(4)


class OutputStage(NamedTuple):
    """How a force becomes currents.

    INVERSE: the exact input transformation at the gap to come; with an overlap both sides pull near zero force.
    BIAS: i_1 = bias + d, i_2 = bias - d with d = force/force_per_current, the tangent of the plant at the bias.
    """

    kind: int
    overlap: float  # N
    bias: float  # A, of a side
    force_per_current: float  # N/A


HARD_HAND_OVER = OutputStage(INVERSE, 0.0, 0.0, 1.0)
"""The source paper's: one side pulls at a time."""


@compiled
def commanded_currents(
    stage: OutputStage, inverse: Inverse, force: float, positions: tuple[float, float], command: Array
) -> tuple[float, int]:
    """(force in N that the belief expects, the worst verdict); side currents in A into command (2,).

    `positions` are the measured one and the one to come, m: currents are inverted at the one to come, and the stricter
    limit of the two counts. A current that the guard's last level forbids is cut to it, VIOLATION; one beyond the drive
    or the table is cut, FORCE_LIMITED. A force that is no number gives no current, and VIOLATION.
    """
    command[0] = command[1] = 0.0
    if not np.isfinite(force):
        return 0.0, VIOLATION
    if stage.kind == BIAS:
        return _about_bias(stage, inverse, force, positions[0], command)
    pulls = hand_over(force, stage.overlap)
    given, verdict = 0.0, PREFERRED
    for side in range(2):
        pull = pulls[0] if side == 0 else pulls[1]
        if pull > 0.0:
            if side >= inverse.sides:
                verdict = max(verdict, FORCE_LIMITED)
            else:
                side_force, side_verdict = _pull(inverse, side, pull, positions, command)
                given += side_force if side == 0 else -side_force
                verdict = max(verdict, side_verdict)
    return given, verdict


@compiled
def _pull(
    inverse: Inverse, side: int, pull: float, positions: tuple[float, float], command: Array
) -> tuple[float, int]:
    """(force given, verdict) of a side that is to pull with a force in N."""
    last = inverse.guard.limit.shape[0] - 1
    now = believed_gap(inverse, side, positions[0])
    gap = believed_gap(inverse, side, positions[1])
    if not limit_at(inverse.guard, last, gap) >= 0:
        gap = now  # what is to come cannot be judged: the measured gap can, or nothing
    allowed = min(limit_at(inverse.guard, last, now), limit_at(inverse.guard, last, gap))
    if not allowed >= 0:
        return 0.0, VIOLATION
    surface = side_surface(inverse, side)
    largest = min(magnet_current_limit(inverse, gap), allowed)
    most = inverse.magnets * magnet_force(surface, largest, gap)
    if not pull <= most:
        command[side] = largest / inverse.current_share
        return most, VIOLATION if allowed <= inverse.current_limit else FORCE_LIMITED
    current = magnet_current(surface, pull / inverse.magnets, gap, largest)
    command[side] = current / inverse.current_share
    mild = min(limit_at(inverse.guard, 0, now), limit_at(inverse.guard, 0, gap))
    return pull, PREFERRED if current <= mild else DISCOURAGED


@compiled
def _about_bias(
    stage: OutputStage, inverse: Inverse, force: float, position: float, command: Array
) -> tuple[float, int]:
    """(force by the tangent, the worst verdict): a side's current is cut at nothing and at its limits."""
    verdict = PREFERRED
    difference = force / stage.force_per_current
    for side in range(2):
        current = (stage.bias + difference if side == 0 else stage.bias - difference) * inverse.current_share
        gap = believed_gap(inverse, side, position)
        side_verdict = _about_bias_of_side(inverse, side, current, gap, command)
        verdict = max(verdict, side_verdict)
    return 0.5 * stage.force_per_current * (command[0] - command[1]), verdict


@compiled
def _about_bias_of_side(inverse: Inverse, side: int, current: float, gap: float, command: Array) -> int:
    """The verdict on a magnet's current, which is cut at nothing and at its limits."""
    allowed = limit_at(inverse.guard, inverse.guard.limit.shape[0] - 1, gap)
    if not allowed >= 0:
        return VIOLATION
    largest = min(allowed, inverse.current_limit)
    command[side] = min(max(current, 0.0), largest) / inverse.current_share
    if current > largest:
        return VIOLATION if allowed <= inverse.current_limit else FORCE_LIMITED
    return DISCOURAGED if current > limit_at(inverse.guard, 0, gap) else PREFERRED
