"""The working point of a section by field solutions: the ampere turns that bring a flux density in the iron.

Of a stack with its ends the depth is found along with them, which has a force: each field tells by how much either is
off, and its slopes along the current what the force is where the flux density is right.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.design.sizing.design import SectionPoint
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.field_map.readings import LevelReading, Potentials, reader_of
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, field_response
from msl_fem.magnetics.solver.postprocess import FieldQuantities
from msl_fem.maps.level_currents import Criterion

TOLERANCE = 3e-4
"""Relative, on the flux density that is aimed at."""
MOST_SOLVES = 12
NEAR: dict[Accuracy, float] = {"fast": 2e-3, "normal": TOLERANCE, "fine": TOLERANCE}
"""Relative, on the flux density, from where the slopes along the current lead on to a stack's point."""
SAME_DEPTH: dict[Accuracy, float] = {"fast": 5e-3, "normal": 0.0, "fine": 0.0}
"""The relative step of the depth that fields need not solve."""


@dataclass(frozen=True)
class FieldPoint:
    """A working point, and the number of field solutions that it took.

    Attributes
    ----------
    depth : m, of the stack that was solved with its ends; 0 where the point is that of any depth
    """

    point: SectionPoint
    solves: int
    depth: float = 0.0


@one_blas_thread
def field_point(
    magnet: MagnetKind, gap: float, flux_density: float, *, guess: float, folder: Path, accuracy: Accuracy = "fast",
    end_effects: EndEffects = False,
) -> FieldPoint:  # fmt: skip
    """The point at which the most loaded section's mean flux density in the iron is the one given.

    Parameters
    ----------
    magnet : of any turns, and without end effects of any depth
    guess : ampere turns to begin with, from the closed equations

    Below the knee the flux density is nearly proportional to the magnetomotive force, so the first step is the rule of
    three, the next are secants; each field starts from the tangent prediction of the one before.

    Raises
    ------
    ComputationError : the mesher failed, a field did not converge, or the flux density was not reached
    """
    mesh = magnet_mesh(magnet, gap, accuracy)
    field = MagnetField(magnet, mesh, folder=folder, order=LEVELS[accuracy].order, end_effects=end_effects)
    depth = magnet.section(magnet.half_width).depth if field.ends else 0.0
    current, start = guess / magnet.turns, None
    known: list[tuple[float, float]] = []
    for n in range(1, MOST_SOLVES + 1):
        solution = field.solve(current, gap, start=start)
        quantities = field.quantities(solution)
        section, mean = most_loaded(quantities)
        if abs(mean / flux_density - 1) <= TOLERANCE:
            point = _per_metre(quantities, magnet, current, (section, mean))
            return FieldPoint(point, n, depth)
        known.append((current, mean))
        following = _next_current(known, flux_density)
        start = solution.potential + field.slope(solution) * (following - current)
        current = following
    raise NotConverged(
        f"the flux density {flux_density:g} T was not reached in {MOST_SOLVES} field solutions; last: "
        f"{known[-1][1]:.6g} T at {known[-1][0] * magnet.turns:.6g} ampere turns; look at the iron's B-H curve"
    )


@dataclass(frozen=True)
class StackDemand:
    """What a stack with its ends is to have.

    Attributes
    ----------
    flux_density, force : T in the iron of the most loaded section, N of the whole stack
    magnet : of a depth in m, with a number of turns that no depth changes
    allowed : whether a depth is
    on_grid : the depth that is made in place of one
    """

    flux_density: float
    force: float
    magnet: Callable[[float], MagnetKind]
    allowed: Callable[[float], bool]
    on_grid: Callable[[float], float]


@one_blas_thread
def stack_point(
    demand: StackDemand, gap: float, begin: FieldPoint, *, slope: float, folder: Path, accuracy: Accuracy,
    end_effects: EndEffects,
) -> FieldPoint:  # fmt: skip
    """The ampere turns and the depth, on the grid, at which a stack has its flux density and its force.

    Ends do not grow with the stack: one that is deeper by a piece has the force of that piece without ends more, so
    that the closed equations' force per depth is the `slope` of the first step of the depth; the next are secants. The
    current's steps are Newton's. A depth that is not allowed comes back as it is.

    Raises
    ------
    ComputationError : the mesher failed, a field did not converge, or the point was not found
    """
    depth, known, field, start = begin.depth, None, None, None
    for n in range(MOST_SOLVES):
        if not demand.allowed(depth):
            return FieldPoint(begin.point, n, depth)
        magnet = demand.magnet(depth)
        if field is None:
            mesh, order = magnet_mesh(magnet, gap, accuracy), LEVELS[accuracy].order
            field = MagnetField(magnet, mesh, folder=folder, order=order, end_effects=end_effects)
            current = begin.point.ampere_turns / magnet.turns
        else:
            field = field.of(magnet, end_effects=end_effects)
        solution = field.solve(current, gap, start=start)
        reading, by_current = _mean_along_current(field, solution)
        off = demand.flux_density / reading.value - 1
        following = current * min(max(1 + off * reading.value / (reading.current_slope * current), 0.5), 2.0)
        quantities = field.quantities(solution)
        force = quantities.force + quantities.force_current_slope * (following - current)
        if known is not None and depth != known[1]:
            slope = (force - known[0]) / (depth - known[1])
        next_depth = demand.on_grid(depth + (demand.force - force) / slope)
        if abs(off) <= NEAR[accuracy] and abs(next_depth - depth) <= SAME_DEPTH[accuracy] * depth:
            point = _per_metre(quantities, magnet, following, (reading.place, demand.flux_density))
            force_there = (force + slope * (next_depth - depth)) / next_depth
            return FieldPoint(replace(point, force=force_there), n + 1, next_depth)
        known, start = (force, depth), solution.potential + by_current * (following - current)
        current, depth = following, next_depth
    raise NotConverged(
        f"the depth of a stack with {demand.flux_density:g} T and {demand.force:g} N was not found in {MOST_SOLVES} "
        f"field solutions; last: {depth:.6g} m at {current:.6g} A; look at the iron's B-H curve"
    )


def _mean_along_current(field: MagnetField, solution: FieldSolution) -> tuple[LevelReading, Array]:
    """The criterion `mean` with its slopes, and dA/di."""
    response = field_response(field.model, solution)
    potentials = Potentials(solution.potential, response.by_current, response.by_gap)
    return reader_of(field, Criterion("mean"))(field.model, potentials), response.by_current


def most_loaded(quantities: FieldQuantities) -> tuple[str, float]:
    """The section with the largest mean flux density in the iron, and that flux density: the map's criterion `mean`."""
    section = max(quantities.flux_density, key=lambda name: quantities.flux_density[name].mean)
    return section, quantities.flux_density[section].mean


def _next_current(known: list[tuple[float, float]], wanted: float) -> float:
    """By the secant through the last two points, or the origin; steps of at most a factor of two."""
    current, mean = known[-1]
    before, mean_before = known[-2] if len(known) > 1 else (0.0, 0.0)
    following = current + (wanted - mean) * (current - before) / (mean - mean_before)
    return min(max(following, current / 2), current * 2)


def _per_metre(
    quantities: FieldQuantities, magnet: MagnetKind, current: float, loaded: tuple[str, float]
) -> SectionPoint:
    """The point of one turn, 1 m deep where there is a depth."""
    section, mean = loaded
    depth = magnet.section(magnet.half_width).depth
    turns = magnet.turns
    return SectionPoint(
        ampere_turns=current * turns,
        force=quantities.force / depth,
        force_slope=quantities.force_current_slope / depth / turns,
        inductance=quantities.incremental_inductance / depth / turns**2,
        flux_density=mean,
        section=section,
        flux_densities={name: found.mean for name, found in quantities.flux_density.items()},
    )
