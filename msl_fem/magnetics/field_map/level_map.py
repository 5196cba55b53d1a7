"""The operating map of an actuator's magnet by root finding on field solutions."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.jobs import Executor, Progress, failures, run_jobs
from msl_fem.computing.row_cache import Arrays, RowCache
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy, level_of
from msl_fem.magnetics.field.end_effects import EndEffects
from msl_fem.magnetics.field.magnet_field import MagnetField, check_grid, check_point, chosen_ends, with_margin
from msl_fem.magnetics.field_map.gap_levels import GapRow, GapSolver, LevelJob, level_mesh, level_order, level_safety
from msl_fem.magnetics.sweep.rows import field_key, field_provenance
from msl_fem.magnetics.sweep.table_sweep import drive_limit
from msl_fem.maps import LEVELS, MEAN, OperatingMap, parse_criterion
from msl_fem.maps.level_currents import checked_levels, monotone_or_why_not

LARGEST_DENSITY = 1e8  # A/m2 in the copper: to there a level is looked for, unless the drive reaches farther
PREFERRED_NUMBERS = (
    1.0, 1.12, 1.25, 1.4, 1.6, 1.8, 2.0, 2.24, 2.5, 2.8, 3.15, 3.55, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0,
)  # fmt: skip
"""The series R20 of ISO 3, twenty a decade: a curve is within 0.1 % of the chords between."""
NO_RANGE = 1 / 200, 1 / 16  # default gaps of a magnet without a range, of the core's half width
ERROR_REACH = 1  # gaps on either side whose relative errors count, as a difference of two meshes may pass through zero
METHOD_VERSION = 1
"""Raised when a change of this package changes its answers: cached gaps of another version are not used."""
END_MARGIN = 1.05  # the map ends so far beyond its largest current, where no drive says otherwise
_ROUNDING = 2e-6  # of a current: what is left when its search ends


def default_gaps(actuator: Actuator) -> Array:
    """Gaps (m) over an actuator's range with a margin: both ends, the nominal gap, and preferred numbers between.

    From half the smallest gap to a sixth of the nominal gap beyond the largest, as a table's and as far as a mesh
    follows; for a magnet without a
    range from a two hundredth to a sixteenth of the core's half width.
    """
    motion = actuator.motion
    ends: list[float]
    if motion is None or motion.nominal_gap is None or motion.range is None:
        half = actuator.magnet_kind().half_width
        ends = [half * share for share in NO_RANGE]
        wanted = []
    else:
        travel = motion.nominal_gap - motion.range, motion.nominal_gap + motion.range
        ends = [*with_margin(actuator, travel, (travel[0] / 2, travel[1] + motion.nominal_gap / 6))]
        wanted = [motion.nominal_gap]
    decades = range(math.floor(math.log10(ends[0])), math.ceil(math.log10(ends[1])))
    inner = [number * 10.0**decade for decade in decades for number in PREFERRED_NUMBERS]
    near = 1.05  # two gaps closer than this are one
    apart = [g for g in inner if all(not 1 / near < g / w < near for w in wanted)]
    kept = [g for g in apart if ends[0] * near < g < ends[1] / near]
    return np.array(sorted({*ends, *wanted, *(float(f"{g:.6g}") for g in kept)}))


def checked_gaps(actuator: Actuator, gap: ArrayLike) -> Array:
    """The gaps (m), increasing; InputError unless they are at least two, allowed, and apart."""
    gaps = np.unique(np.asarray(gap, dtype=float))
    for g in gaps:
        check_point(actuator, 0.0, float(g))
    if gaps.size < 2:
        raise InputError(f"a map needs at least 2 different gaps, {gaps.size} given")
    check_grid(actuator, gaps.tolist(), [])
    return gaps


def largest_current(actuator: Actuator, gaps: Array, asked: float | None) -> float:
    """The current in A up to which levels are looked for; InputError where the one asked for is not allowed."""
    if asked is not None:
        if not asked > 0:
            raise InputError(f"the largest current must be positive, {asked:g} A is not")
        check_point(actuator, asked, float(gaps[0]))
        return asked
    magnet = actuator.magnet_kind()
    copper = LARGEST_DENSITY * magnet.copper_area / magnet.turns
    return max(copper, drive_limit(actuator) or 0.0)


def neighbours_counted(current: Array, error: Array) -> Array:
    """(n_level, n_gap) A: each error, of the current, at least as large as that of the neighbouring gaps."""
    relative = np.where(np.isnan(current), 0.0, error / np.where(np.isnan(current), 1.0, current))
    padded = np.pad(relative, ((0, 0), (ERROR_REACH, ERROR_REACH)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * ERROR_REACH + 1, axis=1)
    return np.asarray(windows.max(axis=2) * np.nan_to_num(current))


def chord_allowance(
    gap: Array, current: Array, slope: Array, *, error: Array, section: tuple[tuple[str, ...], ...]
) -> Array:
    """(n_level, n_gap) A: the errors of the currents, and how far the curve may sag below its chords.

    A chord's slope exceeds the curve's at its left end by a, and lies below that at its right end by b. A convex curve
    stays above both its tangents, so below the chord by at most h a b/(a + b) <= h max(a, b)/2, h the interval; a
    concave one above the chord; of a cubic with one turning point it is 4/27 h max(a, b). Where the loading section
    changes within, twice that. A node takes the larger allowance of its two intervals.
    """
    h = np.diff(gap)
    chord = np.diff(current, axis=1) / h
    # a node without a slope lies beyond the map's end, where the curve is cut: that only lowers chords
    left = np.nan_to_num(chord - slope[:, :-1], nan=0.0)
    right = np.nan_to_num(slope[:, 1:] - chord, nan=0.0)
    names = np.array(section)
    share = np.where(names[:, 1:] == names[:, :-1], 0.5, 1.0)
    sag = share * h * np.maximum(np.maximum(left, right), 0.0) + np.maximum(error[:, :-1], error[:, 1:])
    return np.asarray(np.maximum(np.pad(sag, ((0, 0), (1, 0))), np.pad(sag, ((0, 0), (0, 1)))))


@dataclass(frozen=True)
class FieldMapSettings:
    """How a map is made.

    Attributes
    ----------
    accuracy : level of the mesh
    workers : processes; 1 solves in this process
    cache : folder of finished gaps; None keeps none
    resume : take finished gaps from the cache
    end_effects : as of `SweepSettings`
    current_max : A, the largest current at which levels are looked for and the end of the map; None: as far as the
        levels or the drive need, at most 100 A/mm2 in the copper
    """

    accuracy: Accuracy = "normal"
    workers: int = 1
    cache: Path | None = None
    resume: bool = False
    end_effects: EndEffects = None
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
    level_of(settings.accuracy)
    wanted = checked_levels(levels)
    where = parse_criterion(criterion)
    gaps = checked_gaps(actuator, default_gaps(actuator) if gap is None else gap)
    most = largest_current(actuator, gaps, settings.current_max)
    magnet = actuator.magnet_kind()
    accuracy = settings.accuracy
    job = LevelJob(
        magnet,
        level_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])), accuracy, where),
        actuator.folder,
        level_order(magnet, accuracy, where),
        chosen_ends(actuator, settings.end_effects),
        accuracy,
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
    gap = np.array([row.gap for row in rows])
    levels = np.array(rows[0].levels)
    current = _stacked(done, "current")
    slope = _stacked(done, "gap_slope")
    mesh_error = neighbours_counted(current, _stacked(done, "mesh_error"))
    bh_error = neighbours_counted(current, _stacked(done, "bh_error"))
    error = mesh_error + bh_error + _ROUNDING * np.nan_to_num(current)
    section = _names(done, "section")
    on_tail = _names(done, "tail")
    limit = drive_limit(actuator)
    end = rows[0].most
    if settings.current_max is None and not np.isnan(current).any():
        end = max(limit or 0.0, _rounded_up(END_MARGIN * float(current.max())))
    notes = list(field.notes)
    if limit is not None:
        notes += _beyond_drive(levels, gap, current, limit)
    known = np.where(np.isnan(current), end, current)
    cause = "look at the flux densities around there"
    return OperatingMap(
        levels=levels,
        gap=gap,
        current=current,
        section=section,
        error=error,
        allowance=chord_allowance(gap, known, slope, error=error, section=section),
        current_max=end,
        criterion=criterion,
        actuator=actuator.name,
        digest=actuator.digest,
        warnings=(
            *monotone_or_why_not(levels, gap, current, error=error, section=section, cause=cause),
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


def _stacked(done: list[Arrays], name: str) -> Array:
    """(n_level, n_gap)."""
    return np.stack([row[name] for row in done], axis=1)


def _names(done: list[Arrays], name: str) -> tuple[tuple[str, ...], ...]:
    return tuple(zip(*([str(text) for text in row[name]] for row in done), strict=True))


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
