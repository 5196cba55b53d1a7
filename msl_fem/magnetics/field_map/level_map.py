"""The operating map of an actuator's magnet by root finding on field solutions."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Arrays, Executor, Progress, RowCache, failures, run_jobs
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field_map.chords import chord_allowance, neighbours_counted
from msl_fem.magnetics.field_map.gap_levels import GapRow, GapSolver, LevelJob, level_mesh, level_order, level_safety
from msl_fem.magnetics.field_map.ranges import checked_gaps, default_gaps, drive_limit, largest_current
from msl_fem.magnetics.kinds.accuracy import LEVELS as ACCURACIES
from msl_fem.magnetics.kinds.accuracy import Accuracy
from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.sweep.rows import field_key, field_provenance
from msl_fem.maps import LEVELS, MEAN, OperatingMap, parse_criterion
from msl_fem.maps.level_currents import checked_levels, monotone_or_why_not

METHOD_VERSION = 1
"""Raised when a change of this package changes its answers: cached gaps of another version are not used."""
END_MARGIN = 1.05  # the map ends so far beyond its largest current, where no drive says otherwise
_ROUNDING = 2e-6  # of a current: what is left when its search ends


@dataclass(frozen=True)
class FieldMapSettings:
    """How a map is made.

    Attributes
    ----------
    accuracy : level of the mesh
    workers : processes; 1 solves in this process
    cache : folder of finished gaps; None keeps none
    resume : take finished gaps from the cache
    end_effects : correct for the flux that bulges out of gap and window at the stack's ends
    current_max : A, the largest current at which levels are looked for and the end of the map; None: as far as the
        levels or the drive need, at most 100 A/mm2 in the copper
    """

    accuracy: Accuracy = "normal"
    workers: int = 1
    cache: Path | None = None
    resume: bool = False
    end_effects: bool = False
    current_max: float | None = None


def field_map(
    actuator: Actuator,
    gap: ArrayLike | None = None,
    *,
    levels: Sequence[float] = LEVELS,
    criterion: str = MEAN,
    settings: FieldMapSettings | None = None,
    progress: Progress | None = None,
) -> OperatingMap:
    """The currents of one magnet that bring each level, found on field solutions at each gap.

    Each current solves criterion(A(i, gap)) = level by Newton's iteration with the exact derivative dA/di. Its error is
    the sum of what one polynomial degree more on the same mesh changes (times the accuracy's safety, and not less,
    relative to the current, than at the neighbouring gaps) and of what other curves through the B-H points change.

    Parameters
    ----------
    gap : (n_gap,) m, at least 2; by default `default_gaps`
    levels : flux densities in the iron in T, increasing
    criterion : where in the iron they are read, see `parse_criterion`
    progress : called with the numbers of finished and of all gaps

    Raises
    ------
    InputError : levels, gaps, a criterion or a largest current that are not allowed
    ComputationError : field solutions or the search failed at some gap; with a cache, the others are kept
    """
    settings = settings or FieldMapSettings()
    if settings.accuracy not in ACCURACIES:
        raise InputError(f"accuracy '{settings.accuracy}' is unknown; choose one of {', '.join(ACCURACIES)}")
    wanted, where = checked_levels(levels), parse_criterion(criterion)
    gaps = checked_gaps(actuator, default_gaps(actuator) if gap is None else gap)
    most = largest_current(actuator, gaps, settings.current_max)
    magnet, accuracy = actuator.e_core(), settings.accuracy
    job = LevelJob(
        magnet,
        level_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])), accuracy, where),
        actuator.folder,
        level_order(accuracy, where),
        settings.end_effects,
        criterion=where,
        safety=level_safety(accuracy, where),
    )
    field = GapSolver(job).field
    rows = [GapRow(float(g), tuple(wanted.tolist()), most) for g in gaps]
    cache = RowCache(settings.cache) if settings.cache is not None else None
    if cache is not None:
        cache.check_writable()
    done = run_jobs(
        job,
        rows,
        executor=Executor(settings.workers),
        cache=cache,
        key=field_key(field, criterion=[repr(where), job.safety], method=METHOD_VERSION),
        resume=settings.resume,
        progress=progress,
    )
    failed = failures(done)
    if failed:
        raise ComputationError(f"{len(failed)} of {len(rows)} gaps failed; first: {failed[0]}")
    return _assembled(actuator, job, field, rows=rows, done=done, criterion=criterion.strip(), settings=settings)


def _assembled(
    actuator: Actuator,
    job: LevelJob,
    field: MagnetField,
    *,
    rows: list[GapRow],
    done: list[Arrays],
    criterion: str,
    settings: FieldMapSettings,
) -> OperatingMap:
    gap, levels = np.array([row.gap for row in rows]), np.array(rows[0].levels)
    current, slope, mesh_error, bh_error = (
        np.stack([found[name] for found in done], axis=1) for name in ("current", "gap_slope", "mesh_error", "bh_error")
    )
    mesh_error, bh_error = neighbours_counted(current, mesh_error), neighbours_counted(current, bh_error)
    error = mesh_error + bh_error + _ROUNDING * np.nan_to_num(current)
    section, on_tail = (_names(done, name) for name in ("section", "tail"))
    limit = drive_limit(actuator)
    end = rows[0].most
    if settings.current_max is None and not np.isnan(current).any():
        end = max(limit or 0.0, _rounded_up(END_MARGIN * float(current.max())))
    notes = [iron.note for iron in field.irons.values() if iron.note]
    if limit is not None:
        notes += _beyond_drive(levels, gap, current, limit)
    return OperatingMap(
        levels=levels,
        gap=gap,
        current=current,
        section=section,
        error=error,
        allowance=chord_allowance(gap, np.where(np.isnan(current), end, current), slope, error=error, section=section),
        current_max=end,
        criterion=criterion,
        actuator=actuator.name,
        digest=actuator.digest,
        warnings=(
            *monotone_or_why_not(
                levels, gap, current, error=error, section=section, cause="look at the flux densities around there"
            ),
            *_beyond_data(levels, gap, current, on_tail=on_tail, field=field),
        ),
        mesh_error=mesh_error,
        bh_error=bh_error,
        gap_slope=slope,
        on_tail=on_tail,
        provenance=_provenance(job, field, settings=settings, limit=limit, notes=tuple(dict.fromkeys(notes))),
    )


def _rounded_up(value: float) -> float:
    """To two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / unit) * unit


def _names(done: list[Arrays], name: str) -> tuple[tuple[str, ...], ...]:
    return tuple(zip(*([str(text) for text in found[name]] for found in done), strict=True))


def _beyond_drive(levels: Array, gap: Array, current: Array, limit: float) -> Iterable[str]:
    for level, row in zip(levels, current, strict=True):
        beyond = np.flatnonzero(~(row <= limit))
        if beyond.size:
            yield (
                f"{level:g} T needs more than the drive's {limit:g} A from gap "
                f"{format_quantity(gap[beyond[0]], 'm')} on"
            )


def _beyond_data(
    levels: Array, gap: Array, current: Array, *, on_tail: tuple[tuple[str, ...], ...], field: MagnetField
) -> Iterable[str]:
    """Where a level's current rests on the B-H curve's saturation tail, not on its points."""
    ends = {
        name: float(iron.iron_flux_density(np.array([iron.tail_from]))[0])
        for name, iron in field.irons.items()
        if math.isfinite(iron.tail_from)
    }
    for level, row, tails in zip(levels, current, on_tail, strict=True):
        for name, end in ends.items():
            if level > end:
                yield (
                    f"{level:g} T lies beyond the last B-H point of the {name}'s iron at {end:.4g} T: the currents "
                    "rest on the saturation tail"
                )
        there = [m for m, text in enumerate(tails) if text and not np.isnan(row[m])]
        if there:
            irons = " and ".join(dict.fromkeys(name for m in there for name in tails[m].split(" and ")))
            yield (
                f"at {level:g} T and {len(there)} of {row.size} gaps ({format_quantity(gap[there[0]], 'm')} ... "
                f"{format_quantity(gap[there[-1]], 'm')}) more than 1 % of the {irons} lies beyond the last B-H point, "
                "on the saturation tail"
            )


def _provenance(
    job: LevelJob, field: MagnetField, *, settings: FieldMapSettings, limit: float | None, notes: tuple[str, ...]
) -> dict[str, object]:
    return {
        "method": "root finding on field solutions: Newton's iteration on the current with dA/di",
        "mesh_error": f"change with one polynomial degree more, times a safety of {job.safety:g}",
        "bh_interpolation_error": "largest change with the monotone cubics of H over B and of B over H through the "
        "same points, or a third of that with every other point",
        "drive_limit_A": limit,
        "notes": list(notes),
    } | field_provenance(field, settings.accuracy)
