"""A (gap, current) grid of field solutions to a MagneticTable with its errors stated."""

import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Executor, Progress, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache
from msl_fem.errors import ComputationError, InputError
from msl_fem.magnetics.field.accuracy import LEVELS, Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.magnet_field import (
    MagnetField,
    check_grid,
    check_point,
    chosen_ends,
    degree_of,
    magnet_mesh,
    with_margin,
)
from msl_fem.magnetics.reduced.reduction import Certificate
from msl_fem.magnetics.sweep.expected_fields import expected_fields
from msl_fem.magnetics.sweep.reduced_rows import ReducedRows, reduced_rows
from msl_fem.magnetics.sweep.rows import SweepJob, SweepRow, field_key, field_provenance
from msl_fem.table.magnetic_table import EXTRAS, NODES, SECTION, MagneticTable

DEFAULT_GAPS, DEFAULT_CURRENTS = 14, 34


@dataclass(frozen=True)
class SweepSettings:
    """How a sweep runs.

    Attributes
    ----------
    accuracy : level of the mesh
    workers : processes; 1 solves in this process
    cache : folder of finished rows; None keeps none
    resume : take finished rows from the cache
    scheduler : address of a dask.distributed scheduler whose workers solve, in place of processes here
    end_effects : correct for the flux that bulges out of gap and window at the stack's ends, by the kind's factors
        (True) or others; None: as the actuator's file says, corrected where it says nothing and the kind has ends
    full : solve every point in full, instead of by a reduced field where its certificate holds
    """

    accuracy: Accuracy = "normal"
    workers: int = 1
    cache: Path | None = None
    resume: bool = False
    scheduler: str | None = None
    end_effects: EndEffects = None
    full: bool = False


@dataclass(frozen=True)
class SweepReport:
    """What a sweep took and how exact it is; field names as in the command line's JSON.

    `solutions` are those of the base model in full; `certificate` is None where all points were.
    """

    points: int
    failed: int
    unknowns: int
    newton_iterations: int
    mesh_error: float
    interpolation_error: float
    reciprocity_error: float
    cpu_seconds: float
    reused_rows: int
    notes: tuple[str, ...]
    certificate: Certificate | None = None
    solutions: int = 0


def drive_limit(actuator: Actuator) -> float | None:
    """The drive's current limit for one magnet's coil, in A; None where none is stated."""
    drive = actuator.drive
    sides = actuator.sides
    if drive is None or not drive.current_limit:
        return None
    parallel = sides.magnets_per_side if sides is not None and sides.connection == "parallel" else 1
    return float(drive.current_limit) / parallel


PAST_STOP = 0.03
"""Of the gap at an end stop: how much farther a default table reaches, for effects that change the gap."""


def default_grid(actuator: Actuator) -> tuple[Array, Array]:
    """Gaps (m) and currents (A) that cover an actuator's ranges with a margin.

    Gaps run from half the smallest to a sixth of the nominal gap beyond the largest, and past both end stops where they
    are stated, or as far as the magnet's mesh follows, in a geometric series; currents from 0 to the drive's limit for
    one magnet, denser at small currents, where small gaps saturate.

    Raises
    ------
    InputError : the actuator states no nominal gap, range or current limit
    """
    motion = actuator.motion
    limit = drive_limit(actuator)
    if motion is None or motion.nominal_gap is None or motion.range is None or limit is None:
        raise InputError(
            f"{actuator.name} states no motion.nominal_gap, motion.range or drive.current_limit to choose a grid from; "
            'give one, like --gaps "0.1,0.2,0.5 mm" --currents "1,2,5 A"'
        )
    travel = motion.nominal_gap - motion.range, motion.nominal_gap + motion.range
    margin = (travel[0] / 2, travel[1] + motion.nominal_gap / 6)
    if motion.end_stop is not None:
        stops = (motion.nominal_gap - motion.end_stop, motion.nominal_gap + motion.end_stop)
        margin = (min(margin[0], stops[0] * (1 - PAST_STOP)), max(margin[1], stops[1] * (1 + PAST_STOP)))
    ends = with_margin(actuator, travel, margin)
    gaps = np.geomspace(*ends, DEFAULT_GAPS)
    share = np.arange(DEFAULT_CURRENTS) / (DEFAULT_CURRENTS - 1)
    return gaps, limit * share**2


def sweep(
    actuator: Actuator,
    gaps: ArrayLike,
    currents: ArrayLike,
    *,
    settings: SweepSettings | None = None,
    progress: Progress | None = None,
) -> tuple[MagneticTable, SweepReport]:
    """The table over the grid, and what it took. The column i = 0 is added where it is missing.

    Beside the grid's points it solves at points between the nodes (interpolation error) and at a few nodes with one
    polynomial degree more (mesh error).

    Parameters
    ----------
    gaps : (n_gap,) m, at least 2
    currents : (n_current,) A, at least 2 beside 0
    progress : called with the numbers of finished and of all rows

    Raises
    ------
    InputError : a grid that is too small or has values out of range; a scheduler that cannot be reached
    ComputationError : workers died, or points of the grid or of the checks failed; with a cache, rows without failures
        are kept
    """
    settings = settings or SweepSettings()
    gap, current = _checked_grid(actuator, gaps, currents)
    started = time.process_time()
    magnet = actuator.magnet_kind()
    level = LEVELS[settings.accuracy]
    mesh = magnet_mesh(magnet, float(np.sqrt(gap[0] * gap[-1])), settings.accuracy)
    ends = chosen_ends(actuator, settings.end_effects)
    job = SweepJob(magnet, mesh, actuator.folder, degree_of(magnet, settings.accuracy), ends, settings.accuracy)
    field = job.field()
    nodes = [SweepRow(float(g), tuple(current.tolist())) for g in gap]
    between = _between_nodes(gap, current)
    refined = _corners(gap, current)
    cache = RowCache(settings.cache) if settings.cache is not None else None
    if cache is not None:
        cache.check_writable()
    reduced = None if settings.full else reduced_rows(field, [*nodes, *between], settings.accuracy)
    easy = [] if reduced is None else reduced.answers
    if reduced is not None:
        asked = ((row.gap, current) for row in refined for current in row.currents)
        job = replace(job, expected=expected_fields(reduced.model, asked))
    hard = [*nodes, *between, *refined][len(easy) :]
    done = easy + run_jobs(
        job,
        hard,
        executor=Executor(settings.workers, settings.scheduler),
        cache=cache,
        key=field_key(field),
        resume=settings.resume,
        progress=after(len(easy), progress),
    )
    refuse_failures(done)
    grid = done[: len(nodes)]
    table = _table(gap, current, grid)
    mesh_error = level.safety * _mesh_error(table, refined, done[-len(refined) :])
    if reduced is not None:
        mesh_error += reduced.certificate.error_estimate
    interpolation_error, reciprocity_error = _interpolation_error(table, between, done[len(nodes) : -len(refined)])
    notes = _notes(field, grid, gap, current)
    unknown = "axisymmetric A_phi" if field.section.axisymmetric else "plane A_z"
    table = replace(
        table,
        mesh_error=mesh_error,
        interpolation_error=interpolation_error,
        reciprocity_error=reciprocity_error,
        provenance={
            "actuator": actuator.name,
            "actuator_sha256": actuator.digest,
            "solver": f"{unknown}, damped Newton with exact tangent, virtual work",
            "notes": list(notes),
            **stated_certificate(reduced),
        }
        | field_provenance(field, settings.accuracy),
    )
    elsewhere = settings.workers > 1 or settings.scheduler is not None
    in_workers = sum(float(row["cpu_seconds"]) for row in done if "reused" not in row) if elsewhere else 0.0
    report = SweepReport(
        points=gap.size * (current.size - 1),
        failed=0,
        unknowns=field.model.free.size,
        newton_iterations=int(sum(row["newton_iterations"].sum() for row in grid)),
        mesh_error=mesh_error,
        interpolation_error=interpolation_error,
        reciprocity_error=reciprocity_error,
        cpu_seconds=time.process_time() - started + in_workers,
        reused_rows=sum("reused" in row for row in done),
        notes=notes,
        certificate=None if reduced is None else reduced.certificate,
        solutions=sum(len(row.currents) for row in [*nodes, *between]) if reduced is None else reduced.solutions,
    )
    return table, report


def after(finished: int, progress: Progress | None) -> Progress | None:
    """A progress of rows that come after finished ones."""
    if progress is None or finished == 0:
        return progress
    return lambda done, total: progress(finished + done, finished + total)


def stated_certificate(reduced: ReducedRows | None) -> dict[str, object]:
    """What a table states of the reduced field it comes from."""
    if reduced is None:
        return {}
    return {"certificate": asdict(reduced.certificate), "solutions": reduced.solutions}


def _checked_grid(actuator: Actuator, gaps: ArrayLike, currents: ArrayLike) -> tuple[Array, Array]:
    gap = np.unique(np.asarray(gaps, dtype=float))
    current = np.unique(np.r_[0.0, np.asarray(currents, dtype=float)])
    for g in gap:
        check_point(actuator, 0.0, float(g))
    bad = current[~(np.isfinite(current) & (current >= 0))]
    if bad.size:
        raise InputError(
            f"current {bad[0]:g} A is not allowed in a table; give currents of 0 or more (negative ones follow by "
            "symmetry)"
        )
    if gap.size < 2 or current.size < 3:
        raise InputError(
            f"a table needs at least 2 different gaps and 2 currents beside 0; given are {gap.size} and "
            f"{current.size - 1}"
        )
    check_grid(actuator, gap.tolist(), current.tolist())
    return gap, current


def _between_nodes(gap: Array, current: Array) -> list[SweepRow]:
    """Rows midway between the gaps, each at every other midpoint of the currents, staggered."""
    middle = (current[:-1] + current[1:]) / 2
    return [
        SweepRow(float(np.sqrt(a * b)), tuple(middle[m % 2 :: 2].tolist() or middle.tolist()))
        for m, (a, b) in enumerate(zip(gap[:-1], gap[1:], strict=True))
    ]


def _corners(gap: Array, current: Array) -> list[SweepRow]:
    """Refined rows at the smallest, a middle and the largest gap: a middle current and the largest one."""
    currents = (float(current[(current.size - 1) // 2]), float(current[-1]))
    return [SweepRow(float(gap[m]), currents, refine=True) for m in sorted({0, gap.size // 2, gap.size - 1})]


def _table(gap: Array, current: Array, grid: list[Arrays]) -> MagneticTable:
    """The table of the nodes' rows."""
    stored = [name for name in grid[0] if name in NODES or name in EXTRAS or name.startswith(SECTION)]
    arrays = {name: np.stack([row[name] for row in grid]) for name in stored}
    nodes = {name: arrays[name] for name in NODES}
    return MagneticTable(gap, current, nodes, {name: arrays[name] for name in stored if name not in NODES})


def _mesh_error(table: MagneticTable, rows: list[SweepRow], refined: list[Arrays]) -> float:
    """Largest change of the force with one degree more, of the table's largest force."""
    change = 0.0
    for row, fine in zip(rows, refined, strict=True):
        m = int(np.argmin(np.abs(table.gap - row.gap)))
        coarse = np.interp(row.currents, table.current, table.nodes["force"][m])
        change = max(change, float(np.abs(fine["force"] - coarse).max()))
    return change / float(np.abs(table.nodes["force"]).max())


def _interpolation_error(table: MagneticTable, rows: list[SweepRow], checks: list[Arrays]) -> tuple[float, float]:
    """Largest difference of force, of full scale; and of force or flux linkage, each of its full scale."""
    error = {"force": 0.0, "flux_linkage": 0.0}
    for row, check in zip(rows, checks, strict=True):
        between = table.evaluate(row.currents, row.gap)
        for name in error:
            error[name] = max(error[name], float(np.abs(check[name] - between[name]).max()))
    relative = {name: value / float(np.abs(table.nodes[name]).max()) for name, value in error.items()}
    return relative["force"], max(relative.values())


def refuse_failures(done: list[Arrays]) -> None:
    """ComputationError that names the points that did not converge, where there are any."""
    failed = list(dict.fromkeys(str(point) for row in done if "failed" in row for point in row["failed"]))
    if failed:
        raise ComputationError(
            f"{len(failed)} points of the sweep did not converge ({', '.join(failed[:5])}"
            f"{', ...' if failed[5:] else ''}); leave them out of the grid, or check the B-H curve; "
            "finished rows are kept for --resume"
        )


def _notes(field: MagnetField, grid: list[Arrays], gap: Array, current: Array) -> tuple[str, ...]:
    notes = list(field.notes)
    tail = np.stack([row["tail"] for row in grid]) > 0
    if tail.any():
        m, n = np.argwhere(tail)[0]
        notes.append(
            f"{np.count_nonzero(tail)} of {tail.size} points have more than 1 % of an iron beyond its last B-H point "
            f"(first at {current[n]:.3g} A, gap {gap[m] * 1e3:.3g} mm); there the saturation tail is used"
        )
    return tuple(notes)
