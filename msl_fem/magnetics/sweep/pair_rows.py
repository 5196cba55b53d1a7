"""Rows of both sides' field: a position and a current of side 1 over currents of side 2, solved wherever a job runs."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from scipy import sparse

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.row_cache import Arrays, content_key
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.pair_field import COMMON, PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, NewtonSettings
from msl_fem.magnetics.solver.prolongation import prolongation_map
from msl_fem.magnetics.sweep.expected_fields import ExpectedFields
from msl_fem.magnetics.sweep.pair_starts import PairStarts
from msl_fem.magnetics.sweep.predictor import RowsPredictor
from msl_fem.magnetics.sweep.rows import SOLVER_VERSION
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.table.magnetic_table import SECTION

Found = dict[int, tuple[FieldSolution, Array]]
"""Solutions by the place of their current in the row, with the products of their responses."""
STEPS = NewtonSettings(tolerance=1e-5)
"""Forces come within 2e-6 of the largest, slopes within 2e-5: far below what meshes and interpolation leave."""
CHECK_STEPS = NewtonSettings(tolerance=1e-4, kept=4)
"""Of fields whose slopes nobody asks: forces and flux linkages within 2e-6, too (265 points of a default table)."""


@dataclass(frozen=True)
class PairSweepRow:
    """One position (m), one current of side 1 (A) and those of side 2.

    `common` is on the coarse mesh of what both sides have in common; `checked` asks for force and flux linkages alone,
    with `refine` of one polynomial degree more.
    """

    position: float
    current_1: float
    currents_2: tuple[float, ...]
    refine: bool = False
    common: bool = False
    checked: bool = False

    @property
    def cost(self) -> int:
        return len(self.currents_2) * (1 if self.common else 16 if self.refine else 5)


@dataclass(frozen=True)
class PairSweepJob:
    """What a process needs to make the field of both sides; `alone` tells starts, and no answers."""

    actuator: Actuator
    mesh: TriangleMesh
    common: TriangleMesh
    gap_sum: float
    order: int
    common_order: int
    end_effects: EndEffects = False
    alone: ExpectedFields | None = None

    def field(self, *, refine: bool = False, common: bool = False) -> PairField:
        mesh, order = (self.common, self.common_order) if common else (self.mesh, self.order + refine)
        return PairField(self.actuator, mesh, gap_sum=self.gap_sum, order=order, end_effects=self.end_effects)

    def solver(self) -> "PairSweepSolver":
        return PairSweepSolver(self)


class PairSweepSolver:
    """Solves rows of a job; each model that is needed is made once."""

    def __init__(self, job: PairSweepJob) -> None:
        self.job = job
        self._fields: dict[tuple[bool, bool], PairField] = {}
        self._last: tuple[float, bool, RowsPredictor] | None = None

    def field(self, *, refine: bool = False, common: bool = False) -> PairField:
        """The model that a row asks."""
        kind = refine, common
        if kind not in self._fields:
            self._fields[kind] = self.job.field(refine=refine, common=common)
        return self._fields[kind]

    @cached_property
    def _starts(self) -> PairStarts:
        return PairStarts(self.field(), self.field(common=True), self.job.alone)

    @cached_property
    def _raised(self) -> sparse.csr_matrix:
        """A potential with one polynomial degree more."""
        return prolongation_map(self.field().model, self.field(refine=True).model)

    @one_blas_thread
    def solve(self, row: PairSweepRow) -> Arrays:
        """Arrays (n_2,) of `PAIR_NODES` and the flux densities; points that do not converge are named in `failed`."""
        started = time.process_time()
        answer = self._check(row) if row.checked else self._walk(row)
        return answer | {"cpu_seconds": np.array(time.process_time() - started)}

    def _walk(self, row: PairSweepRow) -> Arrays:
        """The row from its smallest current outwards, each field from where those before it lead."""
        field, predictor = self.field(common=row.common), self._predictor(row)
        found: Found = {}
        for k in np.argsort(np.abs(row.currents_2), kind="stable").tolist():
            current = row.currents_2[k]
            try:
                solution = self._solve_from(predictor.at(current), field, row, current)
            except NotConverged:
                predictor.forget(current)
                continue
            responses, seconds = field.responses(solution)
            predictor.take(current, solution, (responses[1], responses[2]))
            found[k] = solution, seconds
        return _told(row, found, partial(_all_numbers, field))

    def _predictor(self, row: PairSweepRow) -> RowsPredictor:
        """That of the row before, where it was at the same position."""
        if self._last is None or self._last[:2] != (row.position, row.common):
            self._last = row.position, row.common, RowsPredictor()
        self._last[2].begin(row.current_1)
        return self._last[2]

    def _check(self, row: PairSweepRow) -> Arrays:
        """Force and flux linkages, from starts that a coarse mesh gives."""
        found: Found = {}
        field = self.field(refine=row.refine)
        for k, current in enumerate(row.currents_2):
            try:
                start = self._start(row, current)
                if row.refine:
                    start = self._raised @ self._solve_from(start, self.field(), row, current).potential
                found[k] = self._solve_from(start, field, row, current), np.empty(0)
            except NotConverged:
                continue
        return _told(row, found, partial(_first_numbers, field))

    def _start(self, row: PairSweepRow, current: float) -> Array | None:
        try:
            return self._starts.at(row.position, row.current_1, current)
        except NotConverged:
            return None

    def _solve_from(self, start: Array | None, field: PairField, row: PairSweepRow, current: float) -> FieldSolution:
        """The solution from a start, or else from zero."""
        where, settings = (row.position, row.current_1, current), CHECK_STEPS if row.checked else STEPS
        if start is not None:
            try:
                return field.solve(*where, start=start, settings=settings)
            except NotConverged:
                pass
        return field.solve(*where, settings=settings)


def _told(row: PairSweepRow, found: Found, numbers: Callable[[PairSweepRow, Found], Arrays]) -> Arrays:
    """The numbers of what was found at all currents, nan where nothing was, and what failed."""
    missing = [k for k in range(len(row.currents_2)) if k not in found]
    steps = np.zeros(len(row.currents_2))
    steps[list(found)] = [len(solution.trail) for solution, _ in found.values()]
    answer: Arrays = {"newton_iterations": steps}
    if found:
        for name, values in numbers(row, found).items():
            answer[name] = np.full(steps.size, np.nan)
            answer[name][list(found)] = values
    if missing:
        at = f"A at {row.position * 1e3:g} mm"
        answer["failed"] = np.array([f"{row.current_1:g} and {row.currents_2[k]:g} {at}" for k in missing])
    return answer


def _first_numbers(field: PairField, row: PairSweepRow, found: Found) -> Arrays:
    return field.first_quantities(row.position, *_of(row, found))


def _all_numbers(field: PairField, row: PairSweepRow, found: Found) -> Arrays:
    currents, potentials = _of(row, found)
    seconds = np.stack([products for _, products in found.values()])
    means = field.cuts.means(field.model, potentials)
    numbers = field.row_quantities(row.position, currents, potentials, seconds)
    return numbers | {SECTION + name: values for name, values in means.items()}


def _of(row: PairSweepRow, found: Found) -> tuple[Array, Array]:
    """The currents (n, 2) and potentials (n, n_dof) of what was found."""
    currents = np.array([(row.current_1, row.currents_2[k]) for k in found])
    return currents, np.stack([solution.potential for solution, _ in found.values()])


def pair_job(
    actuator: Actuator, gaps: Array, *, gap_sum: float, accuracy: Accuracy, end_effects: EndEffects = False
) -> PairSweepJob:
    """The job of both sides at an accuracy level, over gaps (n,) in m, increasing."""
    magnet = pair_magnet(actuator)
    gap, coarse = float(np.sqrt(gaps[0] * gaps[-1])), COMMON[accuracy]
    mesh, common = pair_mesh(magnet, gap, accuracy), pair_mesh(magnet, gap, size=coarse.size)
    return PairSweepJob(actuator, mesh, common, gap_sum, LEVELS[accuracy].order, coarse.order, end_effects)


def alone_of(rows: Sequence[PairSweepRow]) -> set[tuple[float, float]]:
    """Positions and currents of side 2 alone that the starts of rows ask; side 1 at x is side 2 at -x."""
    asked = {(row.position, current) for row in rows for current in row.currents_2}
    return asked | {(-row.position, row.current_1) for row in rows}


def job_key(job: PairSweepJob, field: PairField) -> str:
    """A name for all that determines the answers of a job, whose accurate field is given."""
    probe = np.linspace(0.0, 3.0, 3001)
    return content_key(
        {
            "magnet": field.magnet.model_dump(),
            "irons": {name: iron.magnetise(probe)[0].tolist() for name, iron in field.irons.items()},
            "mesh": [job.mesh.gap, job.mesh.points.shape, job.mesh.points.sum(), job.order],
            "common": [job.common.gap, job.common.points.shape, job.common.points.sum(), job.common_order],
            "gap_sum": job.gap_sum,
            "solver": SOLVER_VERSION,
            "sides": "both",
            "end_effects": str(field.ends or ""),
        }
    )
