"""One point of a magnet in three dimensions: on a coarse grid, from there on a fine one, with its errors estimated."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.field.accuracy import DOUBTFUL, Accuracy, iron_notes, irons_of, level_of
from msl_fem.magnetics.field.magnet_field import check_point
from msl_fem.magnetics.section import Section
from msl_fem.magnetics.solver.postprocess import SectionFluxDensity
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.forces import below, force_by_current, stress_on_plane, virtual_work
from msl_fem.magnetics.three_d.magnet_boxes import magnet_boxes
from msl_fem.magnetics.three_d.readings import flux_density_over_cuts, irons_on_saturation_tail
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution, apply_tangent, solve_potential

REFINEMENT = {"fast": (0.35, 0.5), "normal": (0.5, 1.0), "fine": (0.7, 1.4)}
"""Of the grid of the start and of the answer's, in boxes along an axis."""
RATE = 4 / 3
"""The power of the boxes' size with which the error falls at a right-angled edge of iron (Babuska and Suri 1987)."""
TOLERANCE = 1e-9  # of the coenergy
START_TOLERANCE = 1e-6


@dataclass(frozen=True)
class SolidPoint:
    """Numbers of a magnet with its end turns at one current and gap; of the whole magnet.

    Attributes
    ----------
    force, force_stress : N, attraction, by virtual work and by the stress on a plane in the gap
    flux_linkage : Wb
    coenergy : J
    incremental_inductance, force_current_slope : H and N/A, from the tangent
    flux_density : of the section's cuts by name, over the stack's depth
    force_error, flux_error : relative, see `solve_solid`
    """

    current: float
    gap: float
    force: float
    force_stress: float
    flux_linkage: float
    coenergy: float
    incremental_inductance: float
    force_current_slope: float
    force_error: float
    flux_error: float
    unknowns: int
    newton_iterations: int
    flux_density: dict[str, SectionFluxDensity] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def attraction(model: BoxModel, solution: PotentialSolution, gap: float) -> float:
    """N of the whole magnet, by virtual work of the gap's layer."""
    return model.copies * virtual_work(solution, below(solution.problem.grid, (0.0, gap)))


def flux_linkage(model: BoxModel, solution: PotentialSolution) -> float:
    """Wb of the whole magnet: the integral of B . T_0 at 1 A, dW'/di."""
    problem = solution.problem
    return model.copies * problem.integral(solution.state.flux_density[..., 1] * problem.source)


def read_point(model: BoxModel, solution: PotentialSolution, gap: float) -> SolidPoint:
    """The numbers of a solution; its errors are not known (nan)."""
    problem, state, change = solution.problem, solution.state, solution.by_current
    weight, copies = below(problem.grid, (0.0, gap)), model.copies
    stiffness = np.einsum("cqk,cqk->cq", apply_tangent(state.tangent, change), change)
    return SolidPoint(
        current=solution.current,
        gap=gap,
        force=attraction(model, solution, gap),
        force_stress=copies * stress_on_plane(solution, (0.0, gap)),
        flux_linkage=flux_linkage(model, solution),
        coenergy=copies * solution.coenergy,
        incremental_inductance=copies * problem.integral(stiffness),
        force_current_slope=copies * force_by_current(solution, weight),
        force_error=math.nan,
        flux_error=math.nan,
        unknowns=problem.grid.n_nodes,
        newton_iterations=len(solution.trail),
    )


@one_blas_thread
def solve_solid(
    actuator: Actuator,
    current: float,
    gap: float,
    *,
    accuracy: Accuracy = "normal",
    ends: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SolidPoint, BoxModel, PotentialSolution]:
    """The field of a magnet with its end turns, its numbers and their errors.

    A coarse grid gives the start. What its numbers differ by is stated as the error of the fine grid's, or more where
    the grids are close: at the edges of the poles the error falls with the power 4/3 of the size, so that behind a
    grid twice as fine two thirds of the difference are left. `progress` is called with the share of the work that is
    done, in hundredths, and 100.

    Raises
    ------
    InputError : a point out of range, a magnet that `magnet_boxes` refuses, pyamg missing
    ComputationError : an iteration did not converge
    """
    level_of(accuracy)
    check_point(actuator, current, gap)
    magnet = actuator.magnet_kind()
    model = magnet_boxes(magnet, gap, actuator.folder, ends=ends)
    shares = [ShareOfWork(progress, 0, 10, START_TOLERANCE), ShareOfWork(progress, 10, 90, TOLERANCE)]
    steps = REFINEMENT[accuracy]
    coarse, problem = (model.problem(refinement) for refinement in steps)
    first = solve_potential(coarse, current, tolerance=START_TOLERANCE, progress=shares[0])
    start = coarse.grid.interpolation(problem.grid)(first.potential)
    solution = solve_potential(problem, current, start=start, tolerance=TOLERANCE, progress=shares[1])
    ratio = steps[1] / steps[0]
    point = _with_errors(read_point(model, solution, gap), model, first, max(1.0, 1 / (ratio**RATE - 1)))
    section = magnet.section(gap)
    point = replace(
        point,
        newton_iterations=len(first.trail) + len(solution.trail),
        flux_density=flux_density_over_cuts(model, solution, section),
        notes=_notes(actuator, section, model, solution, point),
    )
    if progress is not None:
        progress(100, 100)
    return point, model, solution


def _with_errors(point: SolidPoint, model: BoxModel, coarse: PotentialSolution, left: float) -> SolidPoint:
    """The point with `left` of the coarse solution's differences, and what both routes of the force differ by."""
    force = left * _relative(attraction(model, coarse, point.gap), point.force)
    flux = left * _relative(flux_linkage(model, coarse), point.flux_linkage)
    return replace(point, force_error=max(_relative(point.force_stress, point.force), force), flux_error=flux)


def _notes(
    actuator: Actuator, section: Section, model: BoxModel, solution: PotentialSolution, point: SolidPoint
) -> tuple[str, ...]:
    notes = iron_notes(irons_of(section.iron, actuator.folder))
    if _relative(point.force_stress, point.force) > DOUBTFUL:
        notes += (
            f"the force by virtual work, {point.force:.4g} N, and by the stress on a plane, {point.force_stress:.4g} "
            "N, are far apart: the grid cannot tell this force",
        )
    tail = [list(section.iron)[k] for k in irons_on_saturation_tail(model, solution)]
    if tail:
        notes += (f"more than 1 % of the {' and '.join(tail)} lies beyond the B-H curve's last point, on its tail",)
    return notes


def _relative(other: float, value: float) -> float:
    return abs(other - value) / abs(value) if value else 0.0


class ShareOfWork:
    """Reports the decrements of an iteration as a share of all work, in hundredths: `size` from `begin` on."""

    def __init__(self, report: Callable[[int, int], None] | None, begin: int, size: int, tolerance: float) -> None:
        self.report, self.begin, self.size = report, begin, size
        self.goal = math.log(tolerance)
        self.done = 0.0

    def __call__(self, decrement: float) -> None:
        if self.report is not None and decrement > 0:
            self.done = max(self.done, min(0.99, math.log(min(decrement, 1.0)) / self.goal))
            self.report(self.begin + int(self.size * self.done), 100)
