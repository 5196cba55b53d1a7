"""The working point of a section by field solutions: the ampere turns that bring a flux density in the iron."""

from dataclasses import dataclass
from pathlib import Path

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.design.sizing.design import SectionPoint
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.solver.postprocess import FieldQuantities
from msl_fem.magnetics.triangles import TriangleMesh

TOLERANCE = 3e-4
"""Relative, on the flux density that is aimed at."""
MOST_SOLVES = 12


@dataclass(frozen=True)
class FieldPoint:
    """A working point, and the number of field solutions that it took.

    Attributes
    ----------
    depth : m, of the stack that was solved with its ends; 0 where the point is that of any depth
    mesh, potential : what another depth of the same section can begin with
    """

    point: SectionPoint
    solves: int
    depth: float = 0.0
    mesh: TriangleMesh | None = None
    potential: Array | None = None


@one_blas_thread
def field_point(
    magnet: MagnetKind, gap: float, flux_density: float, *, guess: float, folder: Path, accuracy: Accuracy = "fast",
    end_effects: EndEffects = False, begin: FieldPoint | None = None,
) -> FieldPoint:  # fmt: skip
    """The point at which the most loaded section's mean flux density in the iron is the one given.

    Parameters
    ----------
    magnet : of any turns, and without end effects of any depth
    guess : ampere turns to begin with, from the closed equations or another depth
    begin : of the same section at another depth, whose mesh and potential serve

    Below the knee the flux density is nearly proportional to the magnetomotive force, so the first step is the rule of
    three, the next are secants; each field starts from the tangent prediction of the one before.

    Raises
    ------
    ComputationError : the mesher failed, a field did not converge, or the flux density was not reached
    """
    mesh, start = (begin.mesh, begin.potential) if begin is not None else (None, None)
    mesh = mesh or magnet_mesh(magnet, gap, accuracy)
    field = MagnetField(magnet, mesh, folder=folder, order=LEVELS[accuracy].order, end_effects=end_effects)
    depth = magnet.section(magnet.half_width).depth if field.ends else 0.0
    current = guess / magnet.turns
    known: list[tuple[float, float]] = []
    for n in range(1, MOST_SOLVES + 1):
        solution = field.solve(current, gap, start=start)
        quantities = field.quantities(solution)
        section, mean = most_loaded(quantities)
        if abs(mean / flux_density - 1) <= TOLERANCE:
            point = _per_metre(quantities, magnet, current, (section, mean))
            return FieldPoint(point, n, depth, mesh, solution.potential)
        known.append((current, mean))
        following = _next_current(known, flux_density)
        start = solution.potential + field.slope(solution) * (following - current)
        current = following
    raise NotConverged(
        f"the flux density {flux_density:g} T was not reached in {MOST_SOLVES} field solutions; last: "
        f"{known[-1][1]:.6g} T at {known[-1][0] * magnet.turns:.6g} ampere turns; look at the iron's B-H curve"
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
    )
