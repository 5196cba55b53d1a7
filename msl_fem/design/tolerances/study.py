"""The tolerance study of an actuator: sensitivities, and the band of its map under random deviations by Monte Carlo."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.row_cache import Arrays
from msl_fem.design.tolerances.manufactured import FieldJob, ManufacturingTolerance, manufactured_field, tolerances_of
from msl_fem.design.tolerances.sensitivity import (
    ManufacturingJob,
    Questions,
    RowRun,
    Sensitivity,
    answers,
    sensitivities,
)
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.field.accuracy import Accuracy
from msl_fem.magnetics.field.end_effects import EndEffects, EndFactors
from msl_fem.magnetics.field.magnet_field import (
    LARGEST_CURRENT_DENSITY,
    MagnetField,
    check_point,
    chosen_ends,
    degree_of,
    magnet_mesh,
)
from msl_fem.magnetics.field_map.gap_levels import CurrentContinuation
from msl_fem.magnetics.field_map.readings import reader_of
from msl_fem.maps import LEVELS as FLUX_DENSITIES
from msl_fem.maps.level_currents import Criterion

PERCENTILES = (5.0, 95.0)
MOST_MISSING = 0.05  # of the samples in which a level is not reached: the upper percentile is then unknown
BEYOND_DRIVE = 4.0  # times the drive's limit: where a level is still looked for
MOST_SAMPLES = 100_000
FEW = 16  # made magnets, below which their fields in full take less time than the making of a reduced one
LARGEST_LEVEL = 10.0  # T
NEARLY = 0.9  # of the governing section's flux density: what tolerances of a few per cent may make govern
Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Band:
    """Percentiles over the samples.

    Attributes
    ----------
    low, high : (n_level, n_gap) A, 5 and 95 % of the levels' currents; nan where too many samples miss the level
    force, flux_linkage : (low, high) at the point
    method : "direct" (field solutions) or "linearised"
    samples, seed : of the Monte Carlo
    checked : made magnets solved directly to check the linearised ones, 0 where all are
    linearisation_error : the largest difference of a current, linearised against solved, over the nominal one
    band_error : the largest of the same over half the band's width there
    table : of the whole table, where that was asked for
    """

    low: Array
    high: Array
    force: tuple[float, float]
    flux_linkage: tuple[float, float]
    method: str
    samples: int
    seed: int
    checked: int = 0
    linearisation_error: float = 0.0
    band_error: float = 0.0
    table: "TableBand | None" = None


@dataclass(frozen=True, eq=False)
class TableBand:
    """5 and 95 % of the samples at each node of a table.

    Attributes
    ----------
    current : (n_current,) A
    force, flux_linkage : (2, n_gap, n_current) N and Wb, low and high
    certified : samples whose reduced field's checks held; the others were solved in full
    error_estimate : of force and flux linkage of those, of full scale, the largest
    """

    current: Array
    force: Array
    flux_linkage: Array
    certified: int
    error_estimate: float


def draw(tolerances: Sequence[ManufacturingTolerance], samples: int, seed: int) -> list[dict[str, float]]:
    """Independent deviations, uniform between their limits.

    Where only limits are known, all values between them are equally likely (GUM, JCGM 100:2008, 4.3.7).
    """
    limits = np.array([t.limit for t in tolerances])
    uniform = np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, limits.size)) * limits
    return [{t.name: float(d) for t, d in zip(tolerances, row, strict=True)} for row in uniform]


def direct_band(
    job: ManufacturingJob, tolerances: Sequence[ManufacturingTolerance], running: RowRun, *, samples: int, seed: int
) -> Band:
    """The band of every sample's field, reduced where its checks hold; raises ComputationError."""
    rows = answers(by_children(job, tolerances, samples), draw(tolerances, samples, seed), running)
    stacked = {name: np.stack([row[name] for row in rows]) for name in ("current", "force", "flux_linkage")}
    band = _band(stacked, "direct", samples=samples, seed=seed)
    return replace(band, table=_table_band(rows)) if job.tables else band


def by_children(
    job: ManufacturingJob, tolerances: Sequence[ManufacturingTolerance], samples: int = FEW
) -> ManufacturingJob:
    """The job for magnets within tolerances, by a reduced field where it holds; for few of them in full."""
    return job if samples < FEW else replace(job, limits=tuple((t.name, t.limit) for t in tolerances))


def _table_band(rows: Sequence[Arrays]) -> TableBand:
    force, flux = (
        np.percentile([row[f"table_{name}"] for row in rows], PERCENTILES, axis=0) for name in ("force", "flux_linkage")
    )
    errors = [float(row["table_error"]) for row in rows if "table_error" in row]
    return TableBand(rows[0]["table_current"], force, flux, len(errors), max(errors, default=0.0))


def linearised_answers(
    nominal: Arrays, found: Sequence[Sensitivity], deviations: Sequence[dict[str, float]], *, gap: float
) -> Arrays:
    """Answers of made magnets, stacked, each section's current linear in the deviations; `gap` is the point's."""
    off = np.array([[d[s.tolerance.name] for s in found] for d in deviations])  # (sample, tolerance)
    slopes = np.stack([s.current_slope for s in found])
    at = {
        name: np.array([getattr(s, name) * nominal[name] / (s.tolerance.nominal or gap) for s in found])
        for name in ("force", "flux_linkage")
    }
    linear: Arrays = {name: nominal[name] + off @ slope for name, slope in at.items()}
    of_section = nominal["section_current"] + np.tensordot(off, slopes, axes=1)
    return linear | {"current": governing(of_section, axis=1)}


def governing(section_current: Array, *, axis: int) -> Array:
    """The smallest current of any section; nan where no section reaches the level."""
    least = np.where(np.isnan(section_current), np.inf, section_current).min(axis=axis)
    return np.where(np.isfinite(least), least, np.nan)


def linearised_band(
    nominal: Arrays,
    found: Sequence[Sensitivity],
    *,
    gap: float,
    samples: int,
    seed: int,
) -> Band:
    """The band of the linearised map."""
    deviations = draw([s.tolerance for s in found], samples, seed)
    return _band(linearised_answers(nominal, found, deviations, gap=gap), "linearised", samples=samples, seed=seed)


def _band(stacked: Arrays, method: str, *, samples: int, seed: int) -> Band:
    current = stacked["current"]
    missing = np.isnan(current).mean(axis=0)
    filled = np.where(np.isnan(current), np.inf, current)
    low, high = np.percentile(filled, PERCENTILES, axis=0, method="inverted_cdf")
    high = np.where(missing > MOST_MISSING, np.nan, high)
    low = np.where(np.isfinite(low), low, np.nan)
    force, flux = (tuple(map(float, np.percentile(stacked[name], PERCENTILES))) for name in ("force", "flux_linkage"))
    return Band(low, high, (force[0], force[1]), (flux[0], flux[1]), method, samples, seed)


@dataclass(frozen=True)
class ToleranceSettings:
    """What is studied and how.

    Attributes
    ----------
    tolerances : limits that go before the file's and the defaults
    gaps : m; by default five over the travel, the nominal one in the middle
    levels : T
    point : (current A, gap m) of force and flux linkage; by default the first level's current at the nominal gap
    samples, seed : of the Monte Carlo
    direct : solve the fields of all samples, instead of the linearised map of all and the fields of `checks`
    tables : as `direct`, with the whole table of each
    end_effects : as of `SweepSettings`
    """

    tolerances: Mapping[str, float] = field(default_factory=dict)
    gaps: tuple[float, ...] | None = None
    levels: tuple[float, ...] = FLUX_DENSITIES
    point: Point | None = None
    samples: int = 2000
    seed: int = 1
    direct: bool = False
    tables: bool = False
    checks: int = 24
    accuracy: Accuracy = "fast"
    end_effects: EndEffects = None


@dataclass(frozen=True, eq=False)
class ToleranceStudy:
    """Sensitivities at a point and over the map, and the map's band.

    Attributes
    ----------
    sections : those that govern somewhere, or nearly do
    point : (current A, gap m) of force and flux linkage
    nominal : section_current (n_section, n_level, n_gap) A, force N, flux_linkage Wb
    """

    levels: Array
    gap: Array
    sections: tuple[str, ...]
    point: Point
    nominal: Arrays
    sensitivities: tuple[Sensitivity, ...]
    band: Band

    @property
    def current(self) -> Array:
        """(n_level, n_gap) A, nan where a level is not reached."""
        return governing(self.nominal["section_current"], axis=0)

    @property
    def governing_section(self) -> NDArray[np.int64]:
        """(n_level, n_gap) index into `sections`."""
        found = self.nominal["section_current"]
        return np.asarray(np.argmin(np.where(np.isnan(found), np.inf, found), axis=0))

    @property
    def tolerances(self) -> tuple[ManufacturingTolerance, ...]:
        return tuple(s.tolerance for s in self.sensitivities)


def tolerance_study(
    actuator: Actuator, *, settings: ToleranceSettings | None = None, running: RowRun | None = None
) -> ToleranceStudy:
    """The tolerance study of an actuator's magnet.

    Raises
    ------
    InputError : gaps, levels, samples or tolerances that are not allowed
    ComputationError : a field did not converge; what is finished is kept
    """
    settings = settings or ToleranceSettings()
    running = running or RowRun()
    job, tolerances = study_job(actuator, settings)
    asked = job.questions
    at, found = sensitivities(job, tolerances, running)
    if settings.direct or settings.tables:
        band = direct_band(job, tolerances, running, samples=settings.samples, seed=settings.seed)
    else:
        band = linearised_band(at, found, gap=asked.point_gap, samples=settings.samples, seed=settings.seed)
        band = _checked(job, band, at, found, running=running, checks=settings.checks)
    point = asked.point_current, asked.point_gap
    return ToleranceStudy(np.array(asked.levels), np.array(asked.gaps), asked.sections, point, at, found, band)


def study_job(
    actuator: Actuator, settings: ToleranceSettings
) -> tuple[ManufacturingJob, tuple[ManufacturingTolerance, ...]]:
    """What a study asks of every made magnet, and the tolerances; raises as `tolerance_study`."""
    tolerances = tolerances_of(actuator, stated=settings.tolerances)
    _check(settings)
    gaps = _gaps(actuator, settings.gaps, tolerances)
    magnet = actuator.magnet_kind("a tolerance study")
    mesh = magnet_mesh(magnet, float(np.sqrt(gaps[0] * gaps[-1])), settings.accuracy)
    accuracy, ends = settings.accuracy, settings.end_effects
    if not isinstance(ends, EndFactors):
        ends = bool(chosen_ends(actuator, ends))  # a made magnet has the factors of its own dimensions
    nominal = FieldJob(magnet, mesh, actuator.folder, degree_of(magnet, accuracy), ends, accuracy)
    most = _most(actuator)
    nominal_field = manufactured_field(nominal, {})
    point = settings.point or _point(actuator, nominal_field, settings.levels[0], most=most, gaps=gaps)
    check_point(actuator, *point)
    sections = _sections(nominal_field, settings.levels, most=most, gaps=gaps)
    questions = Questions(gaps, settings.levels, sections, most, *point)
    return ManufacturingJob(nominal, questions, tables=settings.tables), tolerances


def _gaps(
    actuator: Actuator, given: tuple[float, ...] | None, tolerances: tuple[ManufacturingTolerance, ...]
) -> tuple[float, ...]:
    """The gaps of the map, increasing; InputError where one is no gap of this magnet with its tolerance."""
    motion = actuator.motion
    if given is None:
        if motion is None or motion.nominal_gap is None or motion.range is None:
            raise InputError(
                f'{actuator.name} states no motion.nominal_gap and motion.range; give --gaps, like "0.2,0.5,1 mm"'
            )
        middle = motion.nominal_gap
        low = np.geomspace(middle - motion.range, middle, 3)
        high = np.geomspace(middle, middle + motion.range, 3)
        given = (*low[:-1].tolist(), middle, *high[1:].tolist())
    gaps = tuple(sorted(set(given)))
    limit = next(t.limit for t in tolerances if t.name == "gap")
    for gap in gaps:
        check_point(actuator, 0.0, gap)
    if not limit < gaps[0] / 2:
        raise InputError(
            f"tolerance gap = {format_quantity(limit, 'm')} must be below half the smallest gap, "
            f"{format_quantity(gaps[0] / 2, 'm')}; leave out small gaps or tighten it"
        )
    return gaps


def _check(settings: ToleranceSettings) -> None:
    levels = settings.levels
    if not levels or not all(0 < low < high for low, high in zip((1e-9, *levels), levels, strict=False)):
        raise InputError(f"levels must be positive and increasing, like 1.2, 1.6 T; these are {list(levels)} T")
    if levels[-1] > LARGEST_LEVEL:
        raise InputError(f"level {levels[-1]:g} T is not allowed; it must be at most {LARGEST_LEVEL:g} T")
    for name, value, least in (("samples", settings.samples, 20), ("checks", settings.checks, 0)):
        if not least <= value <= MOST_SAMPLES:
            raise InputError(f"{name} {value} is not allowed; it must be {least} ... {MOST_SAMPLES}")


def _most(actuator: Actuator) -> float:
    """The current of a magnet in A up to which a level is looked for."""
    if actuator.drive is not None and actuator.drive.current_limit is not None:
        return BEYOND_DRIVE * actuator.drive.current_limit
    magnet = actuator.magnet_kind("a tolerance study")
    return LARGEST_CURRENT_DENSITY * magnet.copper_area / magnet.turns


def _point(
    actuator: Actuator, nominal_field: MagnetField, level: float, *, most: float, gaps: tuple[float, ...]
) -> Point:
    """The current that brings the level at the nominal gap, or at the middle one where none is stated."""
    stated = actuator.motion.nominal_gap if actuator.motion is not None else None
    gap = stated if stated is not None else gaps[len(gaps) // 2]
    field = nominal_field.near(gap)
    current = CurrentContinuation(field, reader_of(field, Criterion("mean")), gap).root(level, most).current
    if np.isnan(current):
        raise InputError(
            f"{level:g} T is not reached at gap {format_quantity(gap, 'm')} below {most:g} A; give a lower level, or "
            "--current and --gap for force and flux linkage"
        )
    return current, gap


def _sections(
    nominal_field: MagnetField, levels: tuple[float, ...], *, most: float, gaps: tuple[float, ...]
) -> tuple[str, ...]:
    """The sections whose mean flux density comes near a level where another one's, or their own, takes it."""
    near: dict[str, None] = {}
    for gap in {gaps[0], gaps[len(gaps) // 2], gaps[-1]}:
        field = nominal_field.near(gap)
        continuation = CurrentContinuation(field, reader_of(field, Criterion("mean")), gap)
        for level in levels:
            potential = continuation.root(level, most).point.solution.potential
            means = {name: found.mean for name, found in field.probes.section_flux_density(potential).items()}
            near |= dict.fromkeys(name for name in means if means[name] >= NEARLY * max(means.values()))
    return tuple(name for name in nominal_field.probes.cuts if name in near)


def _checked(
    job: ManufacturingJob, band: Band, at: Arrays, found: tuple[Sensitivity, ...], *, running: RowRun, checks: int
) -> Band:
    """The linearised band with its error, told by solving the fields of its first samples."""
    if not checks:
        return band
    deviations = draw([s.tolerance for s in found], checks, band.seed)
    job = by_children(job, [s.tolerance for s in found], checks)
    solved = np.stack([row["current"] for row in answers(job, deviations, running)])
    off = np.abs(linearised_answers(at, found, deviations, gap=job.questions.point_gap)["current"] - solved)
    known = np.isfinite(off)
    half = np.where(known, (band.high - band.low) / 2, np.nan)
    return replace(
        band,
        checked=checks,
        linearisation_error=_largest(off / governing(at["section_current"], axis=0)),
        band_error=_largest(off / half) if (half[known] > 0).all() else 0.0,
    )


def _largest(values: Array) -> float:
    finite = values[np.isfinite(values)]
    return float(finite.max()) if finite.size else 0.0
