"""One point of a magnet in three dimensions: on a coarse grid, from there on a fine one, with its errors estimated."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.field.accuracy import Accuracy, level_of
from msl_fem.magnetics.field.magnet_field import check_point
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.forces import below, force_by_current, stress_on_plane, virtual_work
from msl_fem.magnetics.three_d.magnet_boxes import magnet_boxes
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution, apply_tangent, solve_potential

REFINEMENT = {"fast": 0.5, "normal": 1.0, "fine": 1.4}
COARSER = 0.5
"""The grid of the start over that of the answer, in elements along an axis."""
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


def read_point(model: BoxModel, solution: PotentialSolution, gap: float) -> SolidPoint:
    """The numbers of a solution; its errors are not known (nan)."""
    problem, state, change = solution.problem, solution.state, solution.by_current
    weight, copies = below(problem.grid, (0.0, gap)), model.copies
    stiffness = np.einsum("cqk,cqk->cq", apply_tangent(state.tangent, change), change)
    return SolidPoint(
        current=solution.current,
        gap=gap,
        force=copies * virtual_work(solution, weight),
        force_stress=copies * stress_on_plane(solution, (0.0, gap)),
        flux_linkage=copies * problem.integral(state.flux_density[..., 1] * problem.source),
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

    A grid of half as many boxes along each axis gives the start, and what its numbers differ by is stated as the
    error of the fine grid's: at the edges of the poles the error of force and coenergy falls at least like the size
    (like its power 4/3 where iron is not saturated), so that what is left is less than the difference. `progress` is
    called with the share of the work that is done, in hundredths, and 100.

    Raises
    ------
    InputError : a point out of range, a magnet that is no stack of sheets or has chamfered poles, pyamg missing
    ComputationError : an iteration did not converge
    """
    level_of(accuracy)
    check_point(actuator, current, gap)
    model = magnet_boxes(actuator.magnet_kind(), gap, actuator.folder, ends=ends)
    shares = [_Share(progress, 0, 10, START_TOLERANCE), _Share(progress, 10, 90, TOLERANCE)]
    fine = REFINEMENT[accuracy]
    coarse = model.problem(COARSER * fine)
    first = solve_potential(coarse, current, tolerance=START_TOLERANCE, progress=shares[0])
    problem = model.problem(fine)
    start = coarse.grid.interpolation(problem.grid)(first.potential)
    solution = solve_potential(problem, current, start=start, tolerance=TOLERANCE, progress=shares[1])
    before, point = read_point(model, first, gap), read_point(model, solution, gap)
    apart = _relative(point.force_stress, point.force)
    point = replace(
        point,
        force_error=max(apart, _relative(before.force, point.force)),
        flux_error=_relative(before.flux_linkage, point.flux_linkage),
        newton_iterations=len(first.trail) + len(solution.trail),
    )
    if progress is not None:
        progress(100, 100)
    return point, model, solution


def _relative(other: float, value: float) -> float:
    return abs(other - value) / abs(value) if value else 0.0


class _Share:
    """Decrements of an iteration as a share of all work, in hundredths."""

    def __init__(self, report: Callable[[int, int], None] | None, begin: int, size: int, tolerance: float) -> None:
        self.report, self.begin, self.size = report, begin, size
        self.goal = math.log(tolerance)
        self.done = 0.0

    def __call__(self, decrement: float) -> None:
        if self.report is not None and decrement > 0:
            self.done = max(self.done, min(0.99, math.log(min(decrement, 1.0)) / self.goal))
            self.report(self.begin + int(self.size * self.done), 100)
