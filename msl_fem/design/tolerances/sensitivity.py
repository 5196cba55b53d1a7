"""How force, flux linkage and the currents of the levels depend on each dimension and property: central differences.

One manufactured magnet is a row of a job: currents of the levels over the gap, force and flux linkage at a point.
"""

import time
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.jobs import Executor, Progress, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache
from msl_fem.design.tolerances.made_tables import MadeTables, Nodes, nodes_of
from msl_fem.design.tolerances.manufactured import NAMES, FieldJob, ManufacturingTolerance, manufactured_field
from msl_fem.design.tolerances.nearby import NearbyMagnets, SectionRoot
from msl_fem.errors import ComputationError, NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.field_map.gap_levels import CurrentContinuation, LevelRoot
from msl_fem.magnetics.field_map.readings import reader_of
from msl_fem.magnetics.solver.postprocess import Cuts, Probes
from msl_fem.magnetics.sweep.reduced_rows import TOLERANCE
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow, field_key
from msl_fem.maps.level_currents import Criterion

METHOD_VERSION = 2
"""Raised when a change of the code changes the answers: kept rows of another version are not used."""
STEP = 0.01  # of the nominal value (of the smallest gap for the gap); halved once
QUANTITIES = ("force", "flux_linkage", "section_current")


@dataclass(frozen=True)
class Questions:
    """What is asked of every made magnet: currents (A, up to `most`) of levels (T) at gaps (m); force, flux at a point.

    A deviation of the gap adds to all of these gaps. `sections` are those of which one governs; where a deviation makes
    another one govern, the map's current has a kink, and that of each section by itself has none.
    """

    gaps: tuple[float, ...]
    levels: tuple[float, ...]
    sections: tuple[str, ...]
    most: float
    point_current: float
    point_gap: float


@dataclass(frozen=True)
class ManufacturedMagnet:
    """A made magnet: deviations in the order of `NAMES`; whether each section is asked for by itself."""

    deviation: tuple[float, ...]
    by_section: bool

    @property
    def cost(self) -> int:
        """About the number of section currents."""
        return 2 if self.by_section else 1


@dataclass(frozen=True)
class ManufacturingJob:
    """What a process needs to answer for made magnets.

    Attributes
    ----------
    limits : of the deviations by name, where magnets within them are asked for in a reduced field; None: all in full
    tables : whether whole tables are asked for
    """

    nominal: FieldJob
    questions: Questions
    limits: tuple[tuple[str, float], ...] | None = None
    tables: bool = False

    def solver(self) -> "ManufacturingSolver":
        """What answers the questions about magnets as made, in a process of its own if need be."""
        return ManufacturingSolver(self)

    @cached_property
    def key(self) -> str:
        """What determines the answers, as a name."""
        asked = {"questions": self.questions, "limits": self.limits, "tables": self.tables}
        return field_key(manufactured_field(self.nominal, {}), **asked, method=METHOD_VERSION)


class ManufacturingSolver:
    """Answers for one made magnet after the other."""

    def __init__(self, job: ManufacturingJob) -> None:
        self.job = job
        self._nominal = manufactured_field(job.nominal, {})

    @cached_property
    def _nodes(self) -> Nodes:
        """Those of tables."""
        asked = self.job.questions
        return nodes_of(
            self._nominal,
            sorted({*asked.gaps, asked.point_gap}),
            asked.levels,
            most=asked.most,
            current=asked.point_current,
        )

    @cached_property
    def _tables(self) -> MadeTables | None:
        """The family of made magnets; None where all are asked for in full."""
        if self.job.limits is None or not isinstance(self._nominal.probes, Probes):
            return None
        asked = self.job.questions
        return MadeTables(
            self._made,
            dict(self.job.limits),
            self._nodes,
            most=asked.most,
            point=(asked.point_current, asked.point_gap),
            tolerance=TOLERANCE[self.job.nominal.accuracy],
        )

    def _made(self, deviation: Mapping[str, float]) -> MagnetField:
        return manufactured_field(self.job.nominal, deviation, self._nominal)

    @one_blas_thread
    def solve(self, row: ManufacturedMagnet) -> Arrays:
        """force N, flux_linkage Wb and currents in A, nan where a level is not reached.

        Currents are `current` (n_level, n_gap) of the section that governs, or with `by_section` those of each,
        `section_current` (n_section, n_level, n_gap). Whole tables are `table_force` and `table_flux_linkage`
        (n_gap, n_current). Raises ComputationError, which names the magnet.
        """
        started = time.process_time()
        deviation = dict(zip(NAMES, row.deviation, strict=True))
        try:
            found = self._by_adjoints(deviation) if row.by_section else self._reduced(deviation)
            if found is None:
                found = self._in_full(deviation, row.by_section)
        except (NotConverged, ComputationError, ValueError) as err:
            raise ComputationError(
                f"the magnet with {_told(row)} failed: {err}; make the tolerances smaller, or leave out the level or "
                "gap; finished magnets are kept for --resume"
            ) from err
        return found | {"cpu_seconds": np.array(time.process_time() - started)}

    def _reduced(self, deviation: Mapping[str, float]) -> Arrays | None:
        """The answers by the reduced field; None where it does not hold."""
        if self._tables is None:
            return None
        found = self._tables.answer(deviation)
        if found is None:
            return None
        asked = [self._nodes.gaps.index(gap) for gap in self.job.questions.gaps]
        names = ("table_force", "table_flux_linkage") if self.job.tables else ()
        tables = {name: found[name][asked] for name in names} | self._table_currents()
        rest = {name: found[name] for name in ("force", "flux_linkage", "table_error", "section_error")}
        return rest | {"current": found["current"][:, asked]} | tables

    def _by_adjoints(self, deviation: Mapping[str, float]) -> Arrays | None:
        """Each section's answers from the nominal magnet's fields; None where its mesh is not moved with dimensions."""
        return None if self._nearby is None else self._nearby.answer(self._made(deviation), deviation["gap"])

    @cached_property
    def _nearby(self) -> NearbyMagnets | None:
        """The nominal magnet's fields at the roots and at the point, with their adjoints."""
        nominal, asked = self._nominal, self.job.questions
        if not isinstance(nominal.probes, Probes) or self.job.nominal.mesh.motion is not None:
            return None
        roots: dict[tuple[int, int, int], SectionRoot | None] = {}
        for s, section in enumerate(asked.sections):
            for g, at_gap in enumerate(self._roots(nominal, section, 0.0)):
                for k, (level, root) in enumerate(zip(asked.levels, at_gap, strict=True)):
                    slope = root.point.reading.current_slope
                    near = SectionRoot(root.point.solution, section, level, slope)
                    roots[s, k, g] = None if np.isnan(root.current) else near
        return NearbyMagnets(nominal, roots, nominal.solve(asked.point_current, asked.point_gap))

    def _in_full(self, deviation: Mapping[str, float], by_section: bool) -> Arrays:
        asked, off = self.job.questions, deviation["gap"]
        field = self._made(deviation)
        if by_section:
            found = {"section_current": np.stack([self._currents(field, name, off) for name in asked.sections])}
        else:
            found = {"current": self._currents(field, None, off)}
        there = field.near(asked.point_gap)
        at = there.quantities(there.solve(asked.point_current, asked.point_gap + off))
        found |= {"force": np.array(at.force), "flux_linkage": np.array(at.flux_linkage)}
        if not self.job.tables or by_section:
            return found
        solver = RowSolver(SweepJob(**vars(replace(self.job.nominal, magnet=field.magnet))), field)
        rows = [solver.solve(SweepRow(gap + off, self._nodes.currents)) for gap in asked.gaps]
        names = ("force", "flux_linkage")
        tables = {f"table_{name}": np.stack([row[name] for row in rows]) for name in names}
        return found | tables | self._table_currents()

    def _table_currents(self) -> Arrays:
        return {"table_current": np.array(self._nodes.currents)} if self.job.tables else {}

    def _currents(self, field: MagnetField, section: str | None, off: float) -> Array:
        """(n_level, n_gap) A, read on a section, or on the one that governs."""
        return np.array([[root.current for root in at_gap] for at_gap in self._roots(field, section, off)]).T

    def _roots(self, field: MagnetField, section: str | None, off: float) -> list[list[LevelRoot]]:
        """By gap and level, where the level is reached."""
        asked, found = self.job.questions, []
        for gap in asked.gaps:
            near = field.near(gap)
            reader = reader_of(near if section is None else only(near, section), Criterion("mean"))
            continuation = CurrentContinuation(near, reader, gap + off)
            found.append([continuation.root(level, asked.most) for level in asked.levels])
        return found


def only(field: MagnetField, section: str) -> MagnetField:
    """The same field, probed on one section."""
    view = copy(field)
    view.probes = copy(field.probes)
    view.probes.cuts = Cuts({section: field.probes.cuts[section]})
    return view


@dataclass(frozen=True)
class RowRun:
    """How rows are solved: by what, the folder of finished rows (None keeps none), whether they are taken from it."""

    executor: Executor = Executor()  # noqa: RUF009 - frozen
    cache: RowCache | None = None
    resume: bool = False
    progress: Progress | None = None


def answers(
    job: ManufacturingJob, deviations: Sequence[dict[str, float]], running: RowRun, *, by_section: bool = False
) -> list[Arrays]:
    """The answers for manufactured magnets, in order; each is kept as soon as it is there.

    Raises
    ------
    ComputationError : a field did not converge, or a process died; what is finished is kept
    """
    return run_jobs(
        job,
        [ManufacturedMagnet(tuple(float(d.get(name, 0.0)) for name in NAMES), by_section) for d in deviations],
        executor=running.executor,
        cache=running.cache,
        key=job.key if running.cache is not None else "",
        resume=running.resume,
        progress=running.progress,
    )


def _told(row: ManufacturedMagnet) -> str:
    return (
        ", ".join(f"{name} off by {d:.3g}" for name, d in zip(NAMES, row.deviation, strict=True) if d) or "no deviation"
    )


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives with respect to one quantity, central differences with the smaller of two steps.

    Attributes
    ----------
    force, flux_linkage : elasticities d ln Q / d ln p at the point
    current_slope : (n_section, n_level, n_gap) A per unit of the quantity (m, or 1 for pure numbers)
    current : (n_section, n_level, n_gap) elasticities d ln i / d ln p of each section; for the gap, at each gap
    step : the smaller step, in the quantity's unit
    step_error : the largest change of any of these elasticities from twice the step to this one
    """

    tolerance: ManufacturingTolerance
    force: float
    flux_linkage: float
    current_slope: Array
    current: Array
    step: float
    step_error: float


def sensitivities(
    job: ManufacturingJob, tolerances: Sequence[ManufacturingTolerance], running: RowRun
) -> tuple[Arrays, tuple[Sensitivity, ...]]:
    """The nominal magnet's answers, and one sensitivity for each tolerance.

    A stacking factor of 1 cannot rise: its differences are one-sided, of second order.

    Raises
    ------
    ComputationError : a field did not converge
    """
    steps = [_step(job, t) for t in tolerances]
    shares = [_shares(t) for t in tolerances]
    asked: list[dict[str, float]] = [{}]
    for tolerance, step, share in zip(tolerances, steps, shares, strict=True):
        asked += [{tolerance.name: factor * step} for factor in share]
    nominal, *rest = answers(job, asked, running, by_section=True)
    found = []
    start = 0
    for tolerance, step, share in zip(tolerances, steps, shares, strict=True):
        rows = rest[start : start + len(share)]
        start += len(share)
        found.append(_from_rows(job, tolerance, step, nominal=nominal, rows=rows))
    return nominal, tuple(found)


def _step(job: ManufacturingJob, tolerance: ManufacturingTolerance) -> float:
    return STEP * (min(job.questions.gaps) if tolerance.nominal is None else tolerance.nominal)


def _shares(tolerance: ManufacturingTolerance) -> tuple[float, ...]:
    """Multiples of the step: for the differences with it, then with its half."""
    if _one_sided(tolerance):
        return (-1.0, -2.0, -0.5, -1.0)
    return (1.0, -1.0, 0.5, -0.5)


def _one_sided(tolerance: ManufacturingTolerance) -> bool:
    return tolerance.name == "stacking_factor" and tolerance.nominal is not None and tolerance.nominal > 1 - STEP


def _from_rows(
    job: ManufacturingJob, tolerance: ManufacturingTolerance, step: float, *, nominal: Arrays, rows: Sequence[Arrays]
) -> Sensitivity:
    coarse, fine = (
        {name: _slope(tolerance, name, h, nominal=nominal, pair=pair) for name in QUANTITIES}
        for h, pair in ((step, rows[:2]), (step / 2, rows[2:]))
    )
    point = np.array(job.questions.point_gap)
    at = {"force": point, "flux_linkage": point, "section_current": np.array(job.questions.gaps)}
    scale = {
        name: (at[name] if tolerance.nominal is None else np.array(tolerance.nominal)) / nominal[name]
        for name in QUANTITIES
    }
    changes = [np.abs((coarse[name] - fine[name]) * scale[name]) for name in QUANTITIES]
    return Sensitivity(
        tolerance=tolerance,
        force=float(fine["force"] * scale["force"]),
        flux_linkage=float(fine["flux_linkage"] * scale["flux_linkage"]),
        current_slope=np.asarray(fine["section_current"]),
        current=np.asarray(fine["section_current"] * scale["section_current"]),
        step=step / 2,
        step_error=float(max(np.nanmax(change) if np.isfinite(change).any() else 0.0 for change in changes)),
    )


def _slope(tolerance: ManufacturingTolerance, name: str, h: float, *, nominal: Arrays, pair: Sequence[Arrays]) -> Array:
    first, second = (row[name] for row in pair)
    if _one_sided(tolerance):  # at -h and -2 h
        return np.asarray((3 * nominal[name] - 4 * first + second) / (2 * h))
    return np.asarray((first - second) / (2 * h))
