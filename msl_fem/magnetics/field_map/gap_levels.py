"""The currents of all levels at one gap, with what they may be wrong by: a job's rows for the processes of a sweep."""

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from msl_fem.actuator import ECore
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Arrays
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field_map.level_roots import Climb, Point, Root
from msl_fem.magnetics.field_map.other_curves import other_curves
from msl_fem.magnetics.field_map.prolongation import prolongation
from msl_fem.magnetics.field_map.readings import Potentials, Reader, reader_of
from msl_fem.magnetics.kinds.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.kinds.e_core import MagnetField, e_core_section
from msl_fem.magnetics.solver.magnetostatics import FieldModel, NewtonSettings, solve_field
from msl_fem.magnetics.solver.mesh import TriangleMesh, triangulate
from msl_fem.magnetics.solver.postprocess import irons_on_tail
from msl_fem.magnetics.sweep.rows import FieldJob
from msl_fem.maps.level_currents import MAX, Criterion

ENOUGH = 1e-5  # tolerance of a solution that serves an error's estimate
CIRCLE_SIZE = 0.1  # of the radius of the criterion `max`: elements at the iron's corners
CIRCLE_GROWTH: dict[str, float] = {"fast": 0.4, "normal": 0.25, "fine": 0.15}  # of these elements, at most
DEGREE_SAFETY = 2.0  # see `Discretisation`
CIRCLE_ORDER = 3  # at least: |B| itself, near where it is singular, needs more than a force does


@dataclass(frozen=True)
class LevelJob(FieldJob):
    """What a process needs to find the currents of levels: a field's job, the criterion, the mesh error's safety."""

    criterion: Criterion = Criterion("mean")  # noqa: RUF009 - frozen
    safety: float = 2.0

    def solver(self) -> "GapSolver":
        """The solver of the job's gaps."""
        return GapSolver(self)


@dataclass(frozen=True)
class GapRow:
    """One gap (m), the levels (T) and the largest current (A) to look for them."""

    gap: float
    levels: tuple[float, ...]
    most: float

    @property
    def cost(self) -> int:
        """All gaps are about the same work."""
        return len(self.levels)


def level_mesh(magnet: ECore, gap: float, accuracy: Accuracy, criterion: Criterion) -> TriangleMesh:
    """The accuracy level's mesh; for the criterion `max` as fine around the iron's corners as its circles need."""
    section, size = e_core_section(magnet, gap), LEVELS[accuracy].size
    if criterion.kind == MAX:
        strength = (size.corner * gap / (CIRCLE_SIZE * criterion.radius)) ** (2 / 3)
        section = replace(section, corners=tuple((x, y, max(s, strength)) for x, y, s in section.corners))
        size = replace(size, growth=min(size.growth, CIRCLE_GROWTH[accuracy]))
    return triangulate(section, size)


def level_order(accuracy: Accuracy, criterion: Criterion) -> int:
    """The accuracy level's polynomial degree; for the criterion `max` at least 3."""
    order = LEVELS[accuracy].order
    return max(order, CIRCLE_ORDER) if criterion.kind == MAX else order


def level_safety(accuracy: Accuracy, criterion: Criterion) -> float:
    """The factor of the mesh error's estimate: the accuracy level's; for the criterion `max` that of degree 3."""
    return DEGREE_SAFETY if criterion.kind == MAX else LEVELS[accuracy].safety


class GapSolver:
    """Finds the currents of a job's gaps; the models are made once."""

    def __init__(self, job: LevelJob) -> None:
        self.job = job
        self.field = job.field()
        self._reader = reader_of(self.field, job.criterion)

    @cached_property
    def _finer(self) -> MagnetField:
        return self.field.refined()

    @cached_property
    def _finer_reader(self) -> Reader:
        return reader_of(self._finer, self.job.criterion, finer=2)

    @cached_property
    def _to_finer(self) -> sparse.csr_matrix:
        return prolongation(self.field.model, self._finer.model)

    @cached_property
    def _other_models(self) -> list[tuple[FieldModel, float]]:
        """The model with each of the other curves that an iron's points allow, and the share that counts as error."""
        irons = self.field.irons
        curves = {name: other_curves(iron) for name, iron in irons.items()}
        models = []
        for k in range(max(map(len, curves.values()))):
            used = {name: found[k] for name, found in curves.items() if k < len(found)}
            others = {name: used[name].iron if name in used else iron for name, iron in irons.items()}
            models.append((self.field.model.with_irons(others), max(curve.share for curve in used.values())))
        return models

    @one_blas_thread
    def solve(self, row: GapRow) -> Arrays:
        """Arrays (n_level,): current, gap_slope, mesh_error, bh_error, section, tail; or `failed`, which says why."""
        started = time.process_time()
        climb = Climb(self.field, self._reader, row.gap)
        try:
            roots, errors = [], []
            for level in row.levels:  # the errors at once, while the field's factors are the root's
                roots.append(climb.root(level, row.most))
                errors.append(self._errors(roots[-1]))
        except NotConverged as err:
            return {"failed": np.array(str(err))}
        slopes = [_gap_slope(root) for root in roots]
        return {
            "current": np.array([root.current for root in roots]),
            "gap_slope": np.array(slopes),
            "mesh_error": np.array([mesh for mesh, _ in errors]),
            "bh_error": np.array([curve for _, curve in errors]),
            "section": np.array([root.point.reading.place for root in roots]),
            "tail": np.array(
                [" and ".join(irons_on_tail(self.field.model, root.point.solution.potential)) for root in roots]
            ),
            "newton_iterations": np.array(climb.newton_iterations),
            "cpu_seconds": np.array(time.process_time() - started),
        }

    def _errors(self, root: Root) -> tuple[float, float]:
        """A: what one degree more, and what other curves through the B-H points, move the current; 0 if not reached.

        At the root's current, the criterion's change over its slope.
        """
        point, slope = root.point, root.point.reading.current_slope
        if np.isnan(root.current) or not slope > 0:
            return 0.0, 0.0
        value = point.reading.value
        changes = [share * abs(self._with_other_irons(model, point) - value) for model, share in self._other_models]
        return self.job.safety * abs(self._finer_value(point) - value) / slope, max(changes, default=0.0) / slope

    def _finer_value(self, point: Point) -> float:
        """What the criterion reads with one degree more at a point's current."""
        start = self._to_finer @ point.solution.potential
        found = solve_field(
            self._finer.model, point.current, point.solution.gap, start=start, settings=NewtonSettings(ENOUGH)
        )
        return _value(self._finer_reader, self._finer.model, found.potential)

    def _with_other_irons(self, model: FieldModel, point: Point) -> float:
        """What the criterion reads with other irons: one Newton step from the point, with the tangent of its own irons.

        The step leaves an error of the order of the curves' difference squared.
        """
        solution = point.solution
        residual = model.assemble(solution.potential, solution.gap)[0] - solution.current * model.source
        change = self.field.model.tangent.refined_substitute(residual, solution.tangent)
        return _value(self._reader, model, solution.potential - change)


def _value(reader: Reader, model: FieldModel, potential: Array) -> float:
    nothing = np.zeros_like(potential)
    return reader(model, Potentials(potential, nothing, nothing)).value


def _gap_slope(root: Root) -> float:
    """di/dgap along the level, -(dB/dgap)/(dB/di), in A/m; nan where it is not reached, 0 where that says nothing."""
    reading = root.point.reading
    if np.isnan(root.current):
        return float("nan")
    return -reading.gap_slope / reading.current_slope if reading.current_slope > 0 else 0.0
