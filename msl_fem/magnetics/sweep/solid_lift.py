"""A table from plane fields whose end effects are set by a few solutions in three dimensions.

The section's correction deepens the air (`magnetics.field.end_effects`); how much is known in part. Four numbers are
fitted to force and flux linkage of the solutions: what the depths of the gap, of the window and of the outer air are
to be multiplied by, and the inductance of the flux that the end turns enclose beside the iron. The plane table with
these factors is then solved as any other: its fields are those of one variational problem, so that force and flux
linkage remain derivatives of one coenergy. Solutions at points of their own state what the fit has missed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Executor, Progress, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache, content_key
from msl_fem.errors import InputError, NotConverged
from msl_fem.magnetics.field.accuracy import Accuracy, irons_of
from msl_fem.magnetics.field.magnet_field import MagnetField, check_grid, degree_of, magnet_mesh
from msl_fem.magnetics.kinds.ends import EndFactors
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, refuse_failures, sweep
from msl_fem.magnetics.three_d.magnet_boxes import magnet_boxes
from msl_fem.magnetics.three_d.magnet_point import REFINEMENT, solve_solid
from msl_fem.table.magnetic_table import MagneticTable

N_GAPS = 3
SHARES = (0.15, 0.5, 1.0)  # of the table's largest current
CHECKS = ((0, 0), (1, 1), (1, 0))  # cells of these gaps and currents, in whose middle a point is solved as a check
MOST_EVALUATIONS = 8
MILLI = 1e-3
KEPT = ("force", "flux_linkage", "force_error", "flux_error", "unknowns")
SOLVER_VERSION = 1
"""Raised when a change of the solver in three dimensions changes its answers."""


@dataclass(frozen=True)
class SolidRow:
    """One point: gap in m, current in A."""

    gap: float
    current: float

    @property
    def cost(self) -> int:
        """All points are alike."""
        return 1


@dataclass(frozen=True)
class SolidJob:
    """Solves points of an actuator's magnet in three dimensions."""

    actuator: Actuator
    accuracy: Accuracy

    def solver(self) -> "SolidJob":
        """Itself: nothing is kept between points."""
        return self

    def solve(self, row: SolidRow) -> Arrays:
        """The numbers of a point; `failed` names one that did not converge."""
        try:
            point, _, _ = solve_solid(self.actuator, row.current, row.gap, accuracy=self.accuracy)
        except NotConverged:
            return {"failed": np.array([f"{row.current:g} A at {row.gap * 1e3:g} mm in three dimensions"])}
        return {name: np.array(getattr(point, name)) for name in KEPT}

    @property
    def key(self) -> str:
        """A name for all that determines the answers."""
        magnet = self.actuator.magnet_kind()
        probe = np.linspace(0.0, 3.0, 3001)
        irons = irons_of(magnet.section(magnet.half_width).iron, self.actuator.folder)
        content = {
            "magnet": magnet.model_dump(),
            "irons": {name: iron.magnetise(probe)[0].tolist() for name, iron in irons.items()},
            "refinement": REFINEMENT[self.accuracy],
            "solver": SOLVER_VERSION,
        }
        return content_key(content)


@dataclass(frozen=True)
class LiftReport:
    """What a lift took and how exact it is; relative errors, field names as in the command line's JSON.

    Attributes
    ----------
    solutions : in three dimensions, those of the checks included
    solution_error : largest stated error of force or flux linkage of a solution
    fit_error, check_error : largest difference of force or flux linkage, of its own value, at the fitted points and
        at the others
    """

    factors: EndFactors
    solutions: int
    unknowns: int
    solution_error: float
    fit_error: float
    check_error: float


def lift_points(gaps: ArrayLike, currents: ArrayLike) -> tuple[list[SolidRow], list[SolidRow]]:
    """Points to fit, over a table's gaps (m) and up to its largest current (A), and points to check."""
    gap = np.geomspace(np.min(gaps), np.max(gaps), N_GAPS)
    current = np.array(SHARES) * np.max(currents)
    fitted = [SolidRow(float(g), float(i)) for g in gap for i in current]
    cells = [(m, n) for m, n in CHECKS if m + 1 < gap.size and n + 1 < current.size]
    checks = [SolidRow(float(np.sqrt(gap[m] * gap[m + 1])), float(current[n : n + 2].mean())) for m, n in cells]
    return fitted, checks


class SectionPoints:
    """Force and flux linkage of a magnet's corrected section at points, as factors change; each gap has its mesh."""

    def __init__(self, actuator: Actuator, rows: Sequence[SolidRow], accuracy: Accuracy) -> None:
        self.actuator, self.rows = actuator, rows
        magnet = actuator.magnet_kind()
        self.degree = degree_of(magnet, accuracy)
        self.meshes = {row.gap: magnet_mesh(magnet, row.gap, accuracy) for row in rows}
        self._last: dict[SolidRow, Array] = {}

    def __call__(self, factors: EndFactors) -> Array:
        """(n_row, 2) N and Wb; raises NotConverged."""
        magnet, folder = self.actuator.magnet_kind(), self.actuator.folder
        fields = {
            gap: MagnetField(magnet, mesh, folder=folder, order=self.degree, end_effects=factors)
            for gap, mesh in self.meshes.items()
        }
        values = []
        for row in self.rows:
            field = fields[row.gap]
            solution = field.solve(row.current, row.gap, start=self._last.get(row))
            self._last[row] = solution.potential
            quantities = field.quantities(solution)
            values.append((quantities.force, quantities.flux_linkage))
        return np.array(values)


def fit_factors(points: SectionPoints, force: Array, flux_linkage: Array) -> EndFactors:
    """The factors that make the relative differences least to (n_row,) forces in N and flux linkages in Wb.

    The factors stay above 0, the depths being no less than the stack's.
    """
    from scipy.optimize import least_squares

    truth = np.column_stack([force, flux_linkage])

    def differences(unknown: Array) -> Array:
        values: Array = points(_factors(unknown)) / truth - 1
        return values.ravel()

    start, high = np.array([1.0, 1.0, 0.2, 0.2]), np.array([4.0, 4.0, 4.0, np.inf])
    inductance = float((flux_linkage / np.array([row.current for row in points.rows])).max())
    start[3] *= 0.1 * inductance / MILLI
    answer = least_squares(
        differences, start, bounds=(1e-3, high), diff_step=1e-2, xtol=1e-4, max_nfev=MOST_EVALUATIONS
    )
    return _factors(answer.x)


def _factors(unknown: Array) -> EndFactors:
    gap, window, outer, leakage = (float(value) for value in unknown)
    return EndFactors(gap, window, outer, leakage * MILLI)


def lifted_sweep(
    actuator: Actuator,
    gaps: ArrayLike,
    currents: ArrayLike,
    *,
    settings: SweepSettings,
    progress: Progress | None = None,
) -> tuple[MagneticTable, SweepReport, LiftReport]:
    """The table over the grid with end effects of three dimensions, and what it took; raises as `sweep`.

    The accuracy is that of both. `progress` counts the solutions in three dimensions, then the rows of the table.
    """
    check_grid(actuator, np.atleast_1d(gaps).tolist(), np.atleast_1d(currents).tolist())
    if actuator.magnet_kind().stack_ends is None:
        raise InputError("this magnet has no stack whose ends could be corrected; leave --end-effects out")
    magnet_boxes(actuator.magnet_kind(), float(np.min(gaps)), actuator.folder)  # what cannot be is refused first
    fitted, checks = lift_points(gaps, currents)
    job = SolidJob(actuator, settings.accuracy)
    answers = run_jobs(
        job,
        [*fitted, *checks],
        executor=Executor(settings.workers, settings.scheduler),
        cache=RowCache(settings.cache) if settings.cache is not None else None,
        key=job.key,
        resume=settings.resume,
        progress=progress,
    )
    refuse_failures(answers)
    solved = {name: np.array([float(answer[name]) for answer in answers]) for name in KEPT}
    n = len(fitted)
    factors = fit_factors(
        SectionPoints(actuator, fitted, settings.accuracy), solved["force"][:n], solved["flux_linkage"][:n]
    )
    lifted, report = sweep(actuator, gaps, currents, settings=replace(settings, end_effects=factors), progress=progress)
    lift = _lift_report(lifted, factors, [*fitted, *checks], solved, n)
    stated = _stated(lifted, lift, _points([*fitted, *checks], solved))
    return stated, replace(report, mesh_error=stated.mesh_error), lift


def _lift_report(
    table: MagneticTable, factors: EndFactors, rows: Sequence[SolidRow], solved: Mapping[str, Array], n: int
) -> LiftReport:
    """Against the solutions, of which the first n were fitted."""
    gap = np.clip([row.gap for row in rows], table.gap[0], table.gap[-1])  # a geometric series ends to rounding
    current = np.clip([row.current for row in rows], 0.0, table.current[-1])
    between = table.evaluate(current, gap)
    missed = np.max([np.abs(between[name] / solved[name] - 1) for name in ("force", "flux_linkage")], axis=0)
    return LiftReport(
        factors=factors,
        solutions=len(rows),
        unknowns=int(solved["unknowns"].max()),
        solution_error=float(max(solved["force_error"].max(), solved["flux_error"].max())),
        fit_error=float(missed[:n].max()),
        check_error=float(missed[n:].max(initial=0.0)),
    )


def _points(rows: Sequence[SolidRow], solved: Mapping[str, Array]) -> list[dict[str, float]]:
    """What was solved in three dimensions, in SI units; the errors are relative."""
    names = ("force", "flux_linkage", "force_error", "flux_error")
    return [asdict(row) | {name: float(solved[name][n]) for name in names} for n, row in enumerate(rows)]


def _stated(table: MagneticTable, lift: LiftReport, points: list[dict[str, float]]) -> MagneticTable:
    """The lifted table with its origin, and with what fit and solutions are wrong by among its errors."""
    error = max(lift.solution_error, lift.fit_error, lift.check_error)
    stated = {name: value for name, value in asdict(lift).items() if name != "factors"}
    method = f"three dimensions: {lift.solutions} solutions set the factors of the section's correction"
    origin = {"end_effects": method, "end_factors": asdict(lift.factors), "lift": stated, "lift_points": points}
    return replace(table, mesh_error=max(error, table.mesh_error), provenance={**table.provenance, **origin})
