"""The currents of all levels at one gap, by Newton's iteration on field solutions, with what they may be wrong by.

Errors are those of the mesh, told by one polynomial degree more, and of the B-H curve, told by other curves through its
points. A gap is a row of a job.
"""

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.interpolate import PchipInterpolator

from msl_fem.actuator import MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.row_cache import Arrays
from msl_fem.errors import NotConverged
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.magnet_field import MagnetField, degree_of, section_mesh, size_of
from msl_fem.magnetics.field_map.readings import LevelReading, Potentials, Reader, reader_of
from msl_fem.magnetics.solver.magnetostatics import (
    FieldModel,
    FieldSolution,
    NewtonSettings,
    field_response,
    solve_field,
)
from msl_fem.magnetics.solver.postprocess import irons_on_tail
from msl_fem.magnetics.sweep.rows import FieldJob
from msl_fem.magnetics.triangles import TriangleMesh
from msl_fem.maps.level_currents import MAX, Criterion
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron

TOLERANCE = 1e-5
"""Of the current: the last Newton step, whose error is about its square; or the width of the bracket."""
MOST_SOLUTIONS = 60
FIRST_SHARE = 0.5  # of the current that drives the first level across both gaps, without iron
LARGEST_RISE = 2.0  # of the current, in a step into the unknown
PIECES = 8  # an interval between two points
FEWEST = 9  # points that may be thinned
THINNED_SHARE = 1 / 3
"""What half the points change, of that all points leave open: a smooth curve's error grows 16-fold, a kink's 4-fold."""
ENOUGH = 1e-5  # tolerance of a solution that serves an error's estimate
CIRCLE_SIZE = 0.1  # of the radius of the criterion `max`: elements at the iron's corners
CIRCLE_GROWTH: dict[str, float] = {"fast": 0.4, "normal": 0.25, "fine": 0.15}  # of these elements, at most
DEGREE_SAFETY = 2.0  # see `Discretisation`
CIRCLE_ORDER = 3  # at least: |B| itself, near where it is singular, needs more than a force does


@dataclass(frozen=True, eq=False)
class LevelPoint:
    """A field solution at a gap, its derivative dA/di, and what the criterion reads there."""

    solution: FieldSolution
    by_current: Array
    reading: LevelReading

    @property
    def current(self) -> float:
        return self.solution.current


class LevelRoot(NamedTuple):
    """The current of a level and the point next to it; nan where the level is not reached, with the last point."""

    current: float
    point: LevelPoint


class CurrentContinuation:
    """The field of one gap along the current; every solution starts from the tangent of the nearest one known.

    The criterion rises with the current, and mostly ever slower as the iron saturates: Newton's iteration on the
    current, with the criterion's exact derivative, then comes from below and never passes the root. What does not
    behave so is bracketed.
    """

    def __init__(self, field: MagnetField, reader: Reader, gap: float) -> None:
        self.field = field
        self.gap = gap
        self._reader = reader
        self.known: list[LevelPoint] = []
        self.newton_iterations = 0

    def at(self, current: float) -> LevelPoint:
        """The field at a current; raises NotConverged."""
        solution = self._solve(current)
        response = field_response(self.field.model, solution)
        potentials = Potentials(solution.potential, response.by_current, response.by_gap)
        point = LevelPoint(solution, response.by_current, self._reader(self.field.model, potentials))
        self.known.append(point)
        self.newton_iterations += len(solution.trail)
        return point

    def _solve(self, current: float) -> FieldSolution:
        if self.known:
            near = min(self.known, key=lambda point: abs(point.current - current))
            start = near.solution.potential + near.by_current * (current - near.current)
            try:
                return self.field.solve(current, self.gap, start=start)
            except NotConverged:
                pass
        return self.field.solve(current, self.gap)

    def root(self, level: float, most: float) -> LevelRoot:
        """The smallest current up to `most` at which the criterion takes the level.

        Where the criterion passes a level several times within one step along the current, which needs a section that
        unloads as the current rises, it may be a later one.

        Raises
        ------
        NotConverged : a field solution, or the search itself
        """
        low, high = self._bracket(level)
        guess = self._first(level) if low is None and high is None else self._next(level, low, high)
        last_step = np.inf
        for _ in range(MOST_SOLUTIONS):
            if high is None and guess >= most:
                if low is not None and low.current >= most:
                    return LevelRoot(np.nan, low)
                guess = most
            point = self.at(guess)
            left = level - point.reading.value
            low, high = (point, high) if left > 0 else (low, point)
            step = left / point.reading.current_slope if point.reading.current_slope > 0 else np.inf
            if abs(step) <= TOLERANCE * point.current and point.current + step <= most:
                return LevelRoot(point.current + step, point)
            if low is not None and high is not None and high.current - low.current <= TOLERANCE * high.current:
                return LevelRoot(_between(low, high, level), point)
            guess = point.current + step
            slow = abs(step) > 0.5 * last_step
            last_step = abs(step)
            if not _inside(guess, low, high) or (slow and high is not None):
                guess = self._next(level, low, high)
                last_step = np.inf
            elif high is None:
                guess = min(guess, LARGEST_RISE * point.current)
        raise NotConverged(
            f"no current that brings {level:g} T was found at gap {self.gap * 1e3:g} mm in {MOST_SOLUTIONS} field "
            "solutions; leave the gap or the level out, or choose another criterion"
        )

    def _bracket(self, level: float) -> tuple[LevelPoint | None, LevelPoint | None]:
        """The neighbours of the level's first crossing among the points known."""
        points = sorted(self.known, key=lambda point: point.current)
        above = next((k for k, point in enumerate(points) if point.reading.value >= level), len(points))
        return (points[above - 1] if above else None), (points[above] if above < len(points) else None)

    def _first(self, level: float) -> float:
        return FIRST_SHARE * level * 2 * self.gap / (MU_0 * self.field.magnet.turns)

    def _next(self, level: float, low: LevelPoint | None, high: LevelPoint | None) -> float:
        """A current inside the bracket, by regula falsi kept off its ends, or beyond the last point known."""
        if high is None:
            assert low is not None, "a point is known"
            slope = low.reading.current_slope
            step = (level - low.reading.value) / slope if slope > 0 else np.inf
            return low.current + min(step, (LARGEST_RISE - 1) * low.current)
        start, value = (low.current, low.reading.value) if low is not None else (0.0, 0.0)
        share = (level - value) / max(high.reading.value - value, 1e-300)
        return start + min(max(share, 0.1), 0.9) * (high.current - start)


def _inside(current: float, low: LevelPoint | None, high: LevelPoint | None) -> bool:
    start = low.current if low is not None else 0.0
    return start < current and (high is None or current < high.current)


def _between(low: LevelPoint, high: LevelPoint, level: float) -> float:
    share = (level - low.reading.value) / (high.reading.value - low.reading.value)
    return low.current + share * (high.current - low.current)


def prolongation(coarse: FieldModel, fine: FieldModel) -> sparse.csr_matrix:
    """The matrix (n_dof of `fine`, n_dof of `coarse`) that reproduces a potential exactly; both on one mesh.

    Degrees of freedom are values at points, so a row holds the coarse element's functions at the fine one's point.
    """
    dofs = fine.basis.element_dofs  # (local, element)
    place = np.full(fine.n_dof, -1)
    place[dofs.ravel()] = np.arange(dofs.size)
    element = place % dofs.shape[1]
    mapping = coarse.basis.mapping
    at = mapping.invF(fine.basis.doflocs[:, :, None], tind=element)
    n = np.arange(fine.n_dof)
    values = []
    columns = []
    for k in range(coarse.basis.Nbfun):
        values.append(np.asarray(coarse.basis.elem.gbasis(mapping, at, k, tind=element)[0])[:, 0])
        columns.append(coarse.basis.element_dofs[k, element])
    rows = np.tile(n, len(values))
    return sparse.csr_matrix(
        (np.concatenate(values), (rows, np.concatenate(columns))), shape=(fine.n_dof, coarse.n_dof)
    )


class OtherCurve(NamedTuple):
    """An iron that might as well be the one given, and the share of its difference that counts as error."""

    iron: Iron
    share: float


def other_curves(iron: Iron | AnalyticIron) -> tuple[OtherCurve, ...]:
    """Irons whose curves take other courses through the same points, or through half of them; none for a formula.

    The monotone cubics (Fritsch and Butland 1984) of H over B and of B over H, each continued as an odd function and
    sampled so densely that how the samples are joined no longer matters; and the iron's own course through every other
    point, which tells what the points' spacing is worth where all courses through all points are alike.
    """
    if isinstance(iron, AnalyticIron):
        return ()
    b = iron.flux_density
    h = iron.field_strength
    fine_b = _subdivided(b)
    fine_h = _subdivided(h)
    found = [
        OtherCurve(replace(iron, flux_density=fine_b, field_strength=_odd_monotone(b, h, fine_b)), 1.0),
        OtherCurve(replace(iron, flux_density=_odd_monotone(h, b, fine_h), field_strength=fine_h), 1.0),
    ]
    if b.size >= FEWEST:
        for start in (1, 2):
            kept = np.unique(np.r_[0, np.arange(start, b.size, 2), b.size - 1])
            found.append(OtherCurve(replace(iron, flux_density=b[kept], field_strength=h[kept]), THINNED_SHARE))
    return tuple(found)


def _subdivided(points: Array) -> Array:
    share = np.arange(PIECES) / PIECES
    inner = points[:-1, None] + np.diff(points)[:, None] * share
    return np.r_[inner.ravel(), points[-1]]


def _odd_monotone(x: Array, y: Array, at: Array) -> Array:
    return np.asarray(PchipInterpolator(np.r_[-x[:0:-1], x], np.r_[-y[:0:-1], y])(at))


@dataclass(frozen=True)
class LevelJob(FieldJob):
    """What a process needs to find the currents of levels: a field's job, the criterion, the mesh error's safety."""

    criterion: Criterion = Criterion("mean")  # noqa: RUF009 - frozen
    safety: float = 2.0

    def mesh_at(self, gap: float) -> TriangleMesh:
        """The mesh of a gap, as `level_mesh`."""
        return level_mesh(self.magnet, gap, self.accuracy, self.criterion)

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


def level_mesh(magnet: MagnetKind, gap: float, accuracy: Accuracy, criterion: Criterion) -> TriangleMesh:
    """The accuracy level's mesh; for the criterion `max` as fine around the iron's corners as its circles need."""
    section = magnet.section(gap)
    size = size_of(magnet, accuracy)
    if criterion.kind == MAX:
        strength = (size.corner * section.size_gap / (CIRCLE_SIZE * criterion.radius)) ** (2 / 3)
        section = replace(section, corners=tuple((x, y, max(s, strength)) for x, y, s in section.corners))
        size = replace(size, growth=min(size.growth, CIRCLE_GROWTH[accuracy]))
    return section_mesh(magnet, section, size)


def level_order(magnet: MagnetKind, accuracy: Accuracy, criterion: Criterion) -> int:
    """The accuracy level's polynomial degree; for the criterion `max` at least 3."""
    order = degree_of(magnet, accuracy)
    return max(order, CIRCLE_ORDER) if criterion.kind == MAX else order


def level_safety(accuracy: Accuracy, criterion: Criterion) -> float:
    """The factor of the mesh error's estimate: the accuracy level's; for the criterion `max` that of degree 3."""
    return DEGREE_SAFETY if criterion.kind == MAX else LEVELS[accuracy].safety


class GapSolver:
    """Finds the currents of a job's gaps; the models are made once."""

    def __init__(self, job: LevelJob, field: MagnetField | None = None) -> None:
        self.job = job
        self.field = field or job.field()
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
        near = self.field.near(row.gap)
        if near is not self.field:
            return GapSolver(self.job, near).solve(row)
        continuation = CurrentContinuation(self.field, self._reader, row.gap)
        try:
            roots = []
            errors = []
            for level in row.levels:  # the errors at once, while the field's factors are the root's
                roots.append(continuation.root(level, row.most))
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
            "tail": np.array([self._on_tail(root.point) for root in roots]),
            "newton_iterations": np.array(continuation.newton_iterations),
            "cpu_seconds": np.array(time.process_time() - started),
        }

    def _on_tail(self, point: LevelPoint) -> str:
        """The irons that rest on their saturation tails."""
        return " and ".join(irons_on_tail(self.field.model, point.solution.potential))

    def _errors(self, root: LevelRoot) -> tuple[float, float]:
        """A: what one degree more, and what other curves through the B-H points, move the current; 0 if not reached.

        At the root's current, the criterion's change over its slope.
        """
        point = root.point
        slope = root.point.reading.current_slope
        if np.isnan(root.current) or not slope > 0:
            return 0.0, 0.0
        value = point.reading.value
        by_mesh = self.job.safety * abs(self._finer_value(point) - value)
        by_curve = 0.0
        for model, share in self._other_models:
            by_curve = max(by_curve, share * abs(self._with_other_irons(model, point) - value))
        return by_mesh / slope, by_curve / slope

    def _finer_value(self, point: LevelPoint) -> float:
        """What the criterion reads with one degree more at a point's current."""
        start = self._to_finer @ point.solution.potential
        model = self._finer.model
        enough = NewtonSettings(ENOUGH)
        solution = solve_field(model, point.current, point.solution.gap, start=start, settings=enough)
        return _value(self._finer_reader, model, solution.potential)

    def _with_other_irons(self, model: FieldModel, point: LevelPoint) -> float:
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


def _gap_slope(root: LevelRoot) -> float:
    """di/dgap along the level, -(dB/dgap)/(dB/di), in A/m; nan where it is not reached, 0 where that says nothing."""
    reading = root.point.reading
    if np.isnan(root.current):
        return float("nan")
    return -reading.gap_slope / reading.current_slope if reading.current_slope > 0 else 0.0
