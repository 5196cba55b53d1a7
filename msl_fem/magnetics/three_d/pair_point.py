"""Two magnets with their end turns on either side of one armature, in three dimensions.

A quarter as of one magnet; the second magnet is the mirror image of the first about the armature's middle, at a gap of
its own. T_0 is the sum of both coils': H, force and flux linkages follow as with one coil.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.magnetics.field.accuracy import Accuracy, iron_notes, irons_of, level_of
from msl_fem.magnetics.field.magnet_field import check_point
from msl_fem.magnetics.field.pair_field import pair_magnet
from msl_fem.magnetics.three_d.boxes import Box, BoxModel, Interval, Racetrack, TwoRacetracks
from msl_fem.magnetics.three_d.forces import between_layers, virtual_work
from msl_fem.magnetics.three_d.hexahedra import integration_points
from msl_fem.magnetics.three_d.magnet_boxes import magnet_boxes
from msl_fem.magnetics.three_d.magnet_point import (
    RATE,
    REFINEMENT,
    START_TOLERANCE,
    TOLERANCE,
    ShareOfWork,
)
from msl_fem.magnetics.three_d.scalar_potential import (
    PotentialProblem,
    PotentialSolution,
    apply_tangent,
    solve_potential,
)
from msl_fem.magnetics.three_d.tensor_grid import SizeNear

Pair = tuple[float, float]


@dataclass(frozen=True)
class SolidPairPoint:
    """Numbers of two magnets with their end turns, in SI units; equal signs of currents aid.

    Attributes
    ----------
    net_force : N on the armature, towards side 1, by virtual work
    flux_linkage : Wb, of sides 1 and 2
    coenergy : J of both
    incremental_inductance : H, of sides 1 and 2
    mutual_inductance : H, d2W'/(di_1 di_2)
    net_force_error : N; flux_error : Wb, of the worse flux linkage; mutual_error : relative, see `solve_solid_pair`
    """

    currents: Pair
    gaps: Pair
    net_force: float
    flux_linkage: Pair
    coenergy: float
    incremental_inductance: Pair
    mutual_inductance: float
    net_force_error: float
    flux_error: float
    mutual_error: float
    unknowns: int
    newton_iterations: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PairBoxes:
    """Both magnets as boxes.

    Attributes
    ----------
    model : all boxes, with the coil of side 1
    coil_2 : of side 2
    gaps : of sides 1 and 2 in m
    thickness : of the armature in m, which lies below y = 0
    """

    model: BoxModel
    coil_2: Racetrack
    gaps: Pair
    thickness: float

    def sources(self, refinement: float) -> tuple[PotentialProblem, tuple[Array, Array]]:
        """The problem on the grid of a refinement, and T_0 in y of each coil at 1 A in 1/m, (n_cell, n_point)."""
        problem = self.model.problem(refinement)
        points = problem.grid.points(integration_points(problem.grid.order)[0])
        return problem, (problem.source, self.coil_2.current_potential(*points))

    def driven(self, currents: Pair) -> BoxModel:
        """All boxes with both coils at currents in A, for a solution at a current of 1."""
        coil = self.model.coil
        both = TwoRacetracks(
            coil.x, coil.z, coil.clearance, coil.width, coil.height, coil.turns, other=self.coil_2, currents=currents
        )
        return replace(self.model, coil=both)


def pair_boxes(actuator: Actuator, gaps: Pair, *, ends: bool = True) -> PairBoxes:
    """A quarter of both magnets; without `ends` the plane section in one layer of boxes.

    Raises
    ------
    ActuatorError : the magnets share no armature
    InputError : chamfered poles
    MaterialError : an iron that cannot be read
    """
    magnet = pair_magnet(actuator)
    upper, lower = (magnet_boxes(magnet, gap, actuator.folder, ends=ends) for gap in gaps)
    thick = magnet.armature_thickness

    def image(interval: Interval) -> Interval:
        return -thick - interval[1], -thick - interval[0]

    coil = replace(lower.coil, height=image(lower.coil.height))
    near_y = [SizeNear(-thick - near.coordinate, near.size) for near in lower.near[1] if near.coordinate >= 0]
    x, y, z = upper.air
    model = replace(
        upper,
        boxes=(*upper.boxes, *(Box(box.iron, box.x, image(box.y), box.z) for box in lower.boxes)),
        air=(x, (image(lower.air[1])[0], y[1]), z),
        breaks=((), (0.0, gaps[0], -thick, -thick - gaps[1], *coil.height), ()),
        near=(
            (*upper.near[0], *lower.near[0]),
            (*(near for near in upper.near[1] if near.coordinate >= 0), *near_y),
            (*upper.near[2], *lower.near[2]),
        ),
    )
    return PairBoxes(model, coil, gaps, thick)


@one_blas_thread
def solve_solid_pair(
    actuator: Actuator,
    currents: Pair,
    gaps: Pair,
    *,
    accuracy: Accuracy = "normal",
    ends: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[SolidPairPoint, BoxModel, PotentialSolution]:
    """Net force, flux linkages and mutual inductance of two magnets with their end turns at currents (A) and gaps (m).

    Beside the numbers stand the boxes with both coils at their currents, and the field, whose own current is 1. The
    errors are those of `solve_solid`: what a coarser grid differs by. `progress` as there.

    Raises
    ------
    ActuatorError : the magnets share no armature
    InputError : a point out of range, chamfered poles, pyamg missing
    ComputationError : an iteration did not converge
    """
    level_of(accuracy)
    for current, gap in zip(currents, gaps, strict=True):
        check_point(actuator, current, gap)
    boxes = pair_boxes(actuator, gaps, ends=ends)
    steps = REFINEMENT[accuracy]
    found, solution = _on_two_grids(boxes, currents, steps, progress)
    left = max(1.0, 1 / ((steps[1] / steps[0]) ** RATE - 1))
    irons = irons_of(actuator.magnet_kind().section(gaps[0]).iron, actuator.folder)
    point = replace(_with_errors(found[0], found[1], left), notes=iron_notes(irons))
    return point, boxes.driven(currents), solution


def _on_two_grids(
    boxes: PairBoxes, currents: Pair, steps: Pair, progress: Callable[[int, int], None] | None
) -> tuple[list[SolidPairPoint], PotentialSolution]:
    """The numbers on the coarse and the fine grid, their errors not known, and the field on the fine one."""
    found: list[SolidPairPoint] = []
    start: PotentialSolution | None = None
    for step, share, tolerance in zip(steps, ((0, 10), (10, 90)), (START_TOLERANCE, TOLERANCE), strict=True):
        problem, sources = boxes.sources(step)
        both = replace(problem, source=currents[0] * sources[0] + currents[1] * sources[1])
        first = None if start is None else start.problem.grid.interpolation(both.grid)(start.potential)
        shown = ShareOfWork(progress, *share, tolerance)
        start = solve_potential(both, 1.0, start=first, tolerance=tolerance, progress=shown)
        found.append(_read(boxes, start, sources, currents))
    if progress is not None:
        progress(100, 100)
    assert start is not None
    return found, start


def _read(
    boxes: PairBoxes, solution: PotentialSolution, sources: tuple[Array, Array], currents: Pair
) -> SolidPairPoint:
    """The numbers of a solution; its errors are not known (nan)."""
    problem, state, copies, thick = solution.problem, solution.state, boxes.model.copies, boxes.thickness
    weight = between_layers(problem.grid, (-thick - boxes.gaps[1], -thick), (0.0, boxes.gaps[0]))
    one, two = (replace(solution, problem=replace(problem, source=source)).by_current for source in sources)
    answer = apply_tangent(state.tangent, one)

    def curvature(by: Array, other: Array) -> float:
        return copies * problem.integral(np.einsum("cqk,cqk->cq", by, other))

    linked = [copies * problem.integral(state.flux_density[..., 1] * source) for source in sources]
    return SolidPairPoint(
        currents=currents,
        gaps=boxes.gaps,
        net_force=copies * virtual_work(solution, weight),
        flux_linkage=(linked[0], linked[1]),
        coenergy=copies * solution.coenergy,
        incremental_inductance=(curvature(answer, one), curvature(apply_tangent(state.tangent, two), two)),
        mutual_inductance=curvature(answer, two),
        net_force_error=math.nan,
        flux_error=math.nan,
        mutual_error=math.nan,
        unknowns=problem.grid.n_nodes,
        newton_iterations=len(solution.trail),
    )


def _with_errors(coarse: SolidPairPoint, point: SolidPairPoint, left: float) -> SolidPairPoint:
    """The point with `left` of the coarse one's differences."""
    mutual = abs(coarse.mutual_inductance / point.mutual_inductance - 1) if point.mutual_inductance else math.nan
    flux = [abs(a - b) for a, b in zip(coarse.flux_linkage, point.flux_linkage, strict=True)]
    return replace(
        point,
        net_force_error=left * abs(coarse.net_force - point.net_force),
        flux_error=left * max(flux),
        mutual_error=left * mutual,
        newton_iterations=coarse.newton_iterations + point.newton_iterations,
    )
