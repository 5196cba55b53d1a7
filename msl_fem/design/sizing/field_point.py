"""The working point of a section by field solutions: few of them, warm-started, on a mesh of its own."""

from dataclasses import dataclass
from pathlib import Path

from msl_fem.actuator import ECore
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.design.sizing.performance import PlanePoint
from msl_fem.errors import NotConverged
from msl_fem.magnetics.kinds.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.kinds.e_core import MagnetField, magnet_mesh
from msl_fem.magnetics.solver.postprocess import FieldQuantities

TOLERANCE = 3e-4
"""Relative, on the flux density that is aimed at."""
MOST_SOLVES = 12


@dataclass(frozen=True)
class FieldPoint:
    """A working point, and the number of field solutions that it took."""

    point: PlanePoint
    solves: int


@one_blas_thread
def field_point(
    magnet: ECore, gap: float, flux_density: float, *, guess: float, folder: Path, accuracy: Accuracy = "fast"
) -> FieldPoint:
    """The point at which the most loaded section's mean flux density in the iron is the one given.

    Parameters
    ----------
    magnet : of one turn, so that its current is the magnetomotive force; of any depth
    guess : ampere turns to begin with, from the closed equations

    Below the knee the flux density is nearly proportional to the magnetomotive force, so the first step is the rule of
    three, the next are secants; each field starts from the tangent prediction of the one before.

    Raises
    ------
    ComputationError : the mesher failed, a field did not converge, or the flux density was not reached
    """
    field = MagnetField(magnet, magnet_mesh(magnet, gap, accuracy), folder=folder, order=LEVELS[accuracy].order)
    current, start = guess, None
    known: list[tuple[float, float]] = []
    for n in range(1, MOST_SOLVES + 1):
        solution = field.solve(current, gap, start=start)
        quantities = field.quantities(solution)
        section, mean = most_loaded(quantities)
        if abs(mean / flux_density - 1) <= TOLERANCE:
            return FieldPoint(_per_metre(quantities, magnet.stack_depth, current, (section, mean)), n)
        known.append((current, mean))
        following = _next_current(known, flux_density)
        start = solution.potential + field.slope(solution) * (following - current)
        current = following
    raise NotConverged(
        f"the flux density {flux_density:g} T was not reached in {MOST_SOLVES} field solutions; last: "
        f"{known[-1][1]:.6g} T at {known[-1][0]:.6g} ampere turns; look at the iron's B-H curve"
    )


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


def _per_metre(quantities: FieldQuantities, depth: float, current: float, loaded: tuple[str, float]) -> PlanePoint:
    section, mean = loaded
    return PlanePoint(
        ampere_turns=current,
        force=quantities.force / depth,
        force_slope=quantities.force_current_slope / depth,
        inductance=quantities.incremental_inductance / depth,
        flux_density=mean,
        section=section,
    )
