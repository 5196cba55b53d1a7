"""Rows of both sides' field: a position and a current of side 1 over currents of side 2, solved wherever a job runs."""

import time
from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.row_cache import Arrays, content_key
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.pair_field import COMMON, PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.solver.magnetostatics import FieldSolution, NewtonSettings
from msl_fem.magnetics.sweep.predictor import RowPredictor
from msl_fem.magnetics.sweep.rows import SOLVER_VERSION
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.table.magnetic_table import SECTION
from msl_fem.table.pair_table import PAIR_NODES

STEPS = NewtonSettings(tolerance=1e-5)
"""Forces come within 2e-6 of the largest, slopes within 2e-5: far below what meshes and interpolation leave."""


@dataclass(frozen=True)
class PairSweepRow:
    """One position (m), one current of side 1 (A) and those of side 2.

    `refine` takes one polynomial degree more, `common` the coarse mesh of what both sides have in common.
    """

    position: float
    current_1: float
    currents_2: tuple[float, ...]
    refine: bool = False
    common: bool = False

    @property
    def cost(self) -> int:
        return len(self.currents_2) * (1 if self.common else 16 if self.refine else 5)


@dataclass(frozen=True)
class PairSweepJob:
    """What a process needs to make the field of both sides."""

    actuator: Actuator
    mesh: TriangleMesh
    common: TriangleMesh
    gap_sum: float
    order: int
    common_order: int
    end_effects: EndEffects = False

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

    def field(self, row: PairSweepRow) -> PairField:
        """The model that a row asks."""
        kind = row.refine, row.common
        if kind not in self._fields:
            self._fields[kind] = self.job.field(refine=row.refine, common=row.common)
        return self._fields[kind]

    @one_blas_thread
    def solve(self, row: PairSweepRow) -> Arrays:
        """Arrays (n_2,) of `PAIR_NODES` and the flux densities; a point that does not converge is named in `failed`.

        The row is walked from its smallest current outwards, each field from where those before it lead.
        """
        started = time.process_time()
        points: list[dict[str, float]] = [{} for _ in row.currents_2]
        failed: list[str] = []
        order = np.argsort(np.abs(row.currents_2), kind="stable")
        walker = {sign: _Walker(self.field(row), row) for sign in (1, -1)}
        for k in order:
            current = row.currents_2[k]
            try:
                points[k] = walker[1 if current >= 0 else -1].solve(current)
            except NotConverged:
                failed.append(f"{row.current_1:g} and {current:g} A at {row.position * 1e3:g} mm")
        names = dict.fromkeys(name for point in points for name in point)
        arrays = {name: np.array([point.get(name, np.nan) for point in points]) for name in names}
        arrays["cpu_seconds"] = np.array(time.process_time() - started)
        return arrays | ({"failed": np.array(failed)} if failed else {})


def pair_job(
    actuator: Actuator, gaps: Array, *, gap_sum: float, accuracy: Accuracy, end_effects: EndEffects = False
) -> PairSweepJob:
    """The job of both sides at an accuracy level, over gaps (n,) in m, increasing."""
    magnet = pair_magnet(actuator)
    gap, coarse = float(np.sqrt(gaps[0] * gaps[-1])), COMMON[accuracy]
    mesh, common = pair_mesh(magnet, gap, accuracy), pair_mesh(magnet, gap, size=coarse.size)
    return PairSweepJob(actuator, mesh, common, gap_sum, LEVELS[accuracy].order, coarse.order, end_effects)


class _Walker:
    """Goes along the currents of side 2 of one sign."""

    def __init__(self, field: PairField, row: PairSweepRow) -> None:
        self.field, self.row = field, row
        self.predictor = RowPredictor()

    def solve(self, current: float) -> dict[str, float]:
        """The numbers at a current; raises NotConverged where neither the neighbour nor zero is a start."""
        solution = self._field_at(current)
        responses = self.field.by_currents(solution)
        self.predictor.take(current, solution, responses[1])
        quantities = self.field.quantities(solution, (self.row.current_1, current), responses)
        numbers = {name: float(getattr(quantities, name)) for name in PAIR_NODES}
        numbers |= {SECTION + name: value.mean for name, value in self.field.flux_densities(solution).items()}
        return numbers | {"tail": float(self.field.on_tail(solution)), "newton_iterations": len(solution.trail)}

    def _field_at(self, current: float) -> FieldSolution:
        where = self.row.position, self.row.current_1, current
        start = self.predictor.at(current)
        if start is not None:
            try:
                return self.field.solve(*where, start=start, settings=STEPS)
            except NotConverged:
                self.predictor.forget()
        return self.field.solve(*where, settings=STEPS)


def job_key(job: PairSweepJob) -> str:
    """A name for all that determines the answers of a job."""
    probe = np.linspace(0.0, 3.0, 3001)
    field = job.field()
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
