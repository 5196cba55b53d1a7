"""The operating map: for each gap the coil currents that bring given flux densities in the iron.

Gutierrez and Ro (IEEE Trans. Magnetics 34(5), 1998, Fig. 2) draw two curves over the gap, the currents that bring 1.2 T
(the end of the B-H curve's straight part) and 1.6 T (where more current brings little force): below the first is where
to work, above the last is where not to. The criterion says at which point of the iron the flux density is read.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError, OutOfTable, QuantityError, TableError
from msl_fem.files.quantity import format_quantity, parse_quantity
from msl_fem.files.shown import Tabular
from msl_fem.table.magnetic_table import SECTION, MagneticTable

LEVELS = (1.2, 1.6)
"""Default flux densities in T: the source paper's."""
MOST_LEVELS, SMALLEST_LEVEL, LARGEST_LEVEL = 100, 1e-3, 10.0  # T; no iron is driven further
LARGEST_CURRENT, LARGEST_GAP = 1e6, 10.0  # A, m
_THINNING_GAIN = 3.0  # a cubic spline's error grows 16-fold on nodes twice as far apart; count on 3
_DEFECT_MARGIN = 1.25  # the largest departure from a chord over the largest of those at three inner points
_INNER = (0.25, 0.5, 0.75)
_BERNSTEIN = np.array([[0, 0, 0, 3], [0, 0, 1, 3], [0, 1, 2, 3], [3, 3, 3, 3]]) / 3  # of powers, highest first
MEAN, PERCENTILE, MAX = "mean", "percentile", "max"
CORNER_RADIUS = 0.5e-3
"""m: the default radius around the iron's corners that the criterion `max` leaves out."""
WAY_OUT = "choose mean, percentile=95 (per cent of the iron's area) or max=0.5mm (radius left out at corners)"


@dataclass(frozen=True)
class Criterion:
    """A criterion: `percent` of the area for a percentile, `radius` in m around the corners for the largest value."""

    kind: Literal["mean", "percentile", "max"]
    percent: float = math.nan
    radius: float = math.nan

    @property
    def meaning(self) -> str:
        """What is read, in words; |B| always in the iron itself, not averaged over a stack's sheets."""
        if self.kind == MEAN:
            return (
                "mean of |B| in the iron over the most loaded section: legs at mid-window height, yoke and armature at "
                "mid-window width"
            )
        if self.kind == PERCENTILE:
            return f"|B| in the iron that {self.percent:g} % of the iron's area, core and armature, does not exceed"
        return f"largest |B| in the iron farther than {format_quantity(self.radius, 'm')} from its corners"


def parse_criterion(text: str) -> Criterion:
    """The criterion of a text: `mean`, `percentile=95`, `max` or `max=0.5mm`.

    Raises
    ------
    InputError : another text, a percentile that is not between 0 and 100, a radius that is not positive
    """
    kind, given, value = (part.strip() for part in text.partition("="))
    if kind == MEAN and not given:
        return Criterion("mean")
    try:
        if kind == MAX:
            return _largest(text, parse_quantity(value, "m") if given else CORNER_RADIUS)
        if kind == PERCENTILE and given:
            return _percentile(text, parse_quantity(value.removesuffix("%"), ""))
    except QuantityError as err:
        raise InputError(f"criterion '{text[:80]}': {err}") from err
    raise InputError(f"criterion '{text[:80]}' is unknown; {WAY_OUT}")


def _largest(text: str, radius: float) -> Criterion:
    if not radius > 0:
        raise InputError(f"criterion '{text}': the radius must be positive, {format_quantity(radius, 'm')} is not")
    return Criterion("max", radius=radius)


def _percentile(text: str, percent: float) -> Criterion:
    if not 0 < percent < 100:
        raise InputError(f"criterion '{text}': the percentile must lie between 0 and 100, {percent:g} does not")
    return Criterion("percentile", percent=percent)


@dataclass(frozen=True, eq=False, repr=False)
class OperatingMap(Tabular):
    """The currents of one magnet that bring each level of flux density, over the gap.

    Attributes
    ----------
    levels : (n_level,) T, increasing
    gap : (n_gap,) m, increasing
    current : (n_level, n_gap) A; nan where the level is not reached below `current_max`
    section : for each level and gap the section that reaches the level first (or is the most loaded, where none does);
        for another criterion than `mean` the part of the iron where it occurs
    error : (n_level, n_gap) A, one-sided bound of the error of `current`: of a table that of its interpolation, else
        the sum of the parts below
    allowance : (n_level, n_gap) A, what a guard takes off so that straight lines between the gaps stay below the curve
    current_max : A, the largest current that the map judges
    criterion : where in the iron the flux density is read, see `parse_criterion`
    actuator, digest : the actuator's name and the hash of its content; empty where not known
    warnings : texts, for instance that a curve is not monotone in the gap
    mesh_error, bh_error : (n_level, n_gap) A, parts of `error`: from the discretisation, and from the course of the B-H
        curve between its points; None where not estimated
    gap_slope : (n_level, n_gap) A/m, derivative of `current`; None where not known
    on_tail : for each level and gap the irons, joined by " and ", of which more than 1 % lies beyond the last B-H point
    provenance : how the map was made, as in a table's
    decoupling : JSON object of the two sides' decoupling over the map
    """

    levels: Array
    gap: Array
    current: Array
    section: tuple[tuple[str, ...], ...]
    error: Array
    allowance: Array
    current_max: float
    criterion: str = MEAN
    actuator: str = ""
    digest: str = ""
    warnings: tuple[str, ...] = ()
    mesh_error: Array | None = None
    bh_error: Array | None = None
    gap_slope: Array | None = None
    on_tail: tuple[tuple[str, ...], ...] = ()
    provenance: Mapping[str, object] | None = None
    decoupling: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        _check(self)

    def __repr__(self) -> str:
        levels = ", ".join(f"{level:g}" for level in self.levels)
        ends = f"{self.gap[0] * 1e3:.4g} ... {self.gap[-1] * 1e3:.4g} mm"
        named = f" of {self.actuator}" if self.actuator else ""
        judged = f"{self.gap.size} gaps {ends}, up to {self.current_max:.4g} A"
        return f"OperatingMap({levels} T{named}, {judged}, {self.criterion})"

    def facts(self) -> dict[str, str]:
        """Levels, range and the largest stated error."""
        return {
            "actuator": self.actuator or "not known",
            "levels": ", ".join(f"{level:g} T" for level in self.levels),
            "gaps": f"{self.gap.size}, {self.gap[0] * 1e3:.4g} ... {self.gap[-1] * 1e3:.4g} mm",
            "largest current": f"{self.current_max:.4g} A",
            "criterion": self.criterion,
            "error": f"at most {format_quantity(float(self.error.max()), 'A', digits=2)}",
        }

    def frame_columns(self) -> dict[str, Array]:
        """gap_m, and for each level its current and that current's error: current_1.2_T_A, error_1.2_T_A."""
        columns = {"gap_m": self.gap}
        for level, current, error in zip(self.levels, self.current, self.error, strict=True):
            columns |= {f"current_{level:g}_T_A": current, f"error_{level:g}_T_A": error}
        return columns

    def not_reached(self) -> tuple[str, ...]:
        """One sentence for each level and gap whose current lies beyond the map's largest."""
        return tuple(
            f"{self.levels[k]:g} T is not reached below {self.current_max:g} A "
            f"at gap {format_quantity(self.gap[m], 'm')}"
            for k, m in np.argwhere(np.isnan(self.current))
        )


def _check(record: OperatingMap) -> None:
    levels, gap = record.levels, record.gap
    shape = (levels.size, gap.size)
    checked_levels(levels)
    if gap.ndim != 1 or gap.size < 2 or not (np.diff(gap) > 0).all() or not gap[0] > 0:
        raise InputError("a map needs at least two gaps, positive and increasing")
    if not (0 < record.current_max <= LARGEST_CURRENT and gap[-1] <= LARGEST_GAP):
        raise InputError(
            f"the map's largest current is {record.current_max:g} A, its largest gap {gap[-1]:g} m; allowed are 0 ... "
            f"{LARGEST_CURRENT:g} A and {LARGEST_GAP:g} m, beyond which there is no machine: look at the units"
        )
    for name in ("current", "error", "allowance", "mesh_error", "bh_error", "gap_slope"):
        values = getattr(record, name)
        if values is not None and values.shape != shape:
            raise InputError(f"{name} has shape {values.shape}, expected (level, gap) = {shape}")
    parse_criterion(record.criterion)
    for name in ("section", "on_tail"):
        rows = getattr(record, name)
        if [len(row) for row in rows] != [gap.size] * levels.size and (rows or name == "section"):
            raise InputError(f"{name} must hold one name for each level and gap, {shape}")
    reached = ~np.isnan(record.current)
    if not ((record.current[reached] > 0) & (record.current[reached] <= record.current_max)).all():
        raise InputError(f"currents must lie between 0 and the map's largest, {record.current_max:g} A")
    if not all((a >= 0).all() and np.isfinite(a).all() for a in (record.error, record.allowance)):
        raise InputError("errors and allowances must be finite and not negative")
    filled = np.where(reached, record.current, np.inf)
    if (filled[:-1] > filled[1:]).any():
        k, m = np.argwhere(filled[:-1] > filled[1:])[0]
        raise InputError(f"{levels[k + 1]:g} T must need more current than {levels[k]:g} T at gap {gap[m]:g} m")


class Roots(NamedTuple):
    """Currents (n_level, n_gap), their error, and the section that gives each."""

    current: Array
    error: Array
    section: tuple[tuple[str, ...], ...]


def checked_levels(levels: Sequence[float] | Array) -> Array:
    """The levels as an array; InputError unless they are positive, increasing and flux densities that iron can bear."""
    values = np.asarray(levels, dtype=float)
    if values.ndim != 1 or values.size == 0 or not (values > 0).all() or not (np.diff(values) > 0).all():
        raise InputError(f"levels must be positive and increasing, like 1.2, 1.6 T; these are {list(levels)} T")
    if values.size > MOST_LEVELS or values[-1] > LARGEST_LEVEL or values[0] < SMALLEST_LEVEL:
        raise InputError(
            f"{values.size} level(s) from {values[0]:g} to {values[-1]:g} T are not allowed; give at most "
            f"{MOST_LEVELS}, each {SMALLEST_LEVEL:g} ... {LARGEST_LEVEL:g} T, like 1.2, 1.6 T"
        )
    return values


def operating_map(
    table: MagneticTable,
    *,
    levels: Sequence[float] = LEVELS,
    gap: ArrayLike | None = None,
    actuator: str | None = None,
    digest: str | None = None,
) -> OperatingMap:
    """The operating map of a table by its criterion `mean`.

    Parameters
    ----------
    levels : flux densities in the iron in T, increasing
    gap : (n_gap,) m; the table's own by default, which need no interpolation along the gap
    actuator, digest : what the map is of; by default what the table's provenance says

    Along the current each section's mean flux density is an odd cubic spline through the table's nodes; the smallest
    current at which any section reaches the level counts. The error comes from leaving out every other node.

    Raises
    ------
    InputError : levels that are not positive and increasing, or fewer than two gaps
    OutOfTable : a gap outside the table
    TableError : the table has no section flux densities, or some are not finite
    """
    values = checked_levels(levels)
    gaps = np.array(table.gap if gap is None else gap, dtype=float)
    if gaps.ndim != 1 or gaps.size < 2 or not (np.diff(gaps) > 0).all():
        raise InputError("gaps must be increasing and at least two")
    current, error, section = roots = _roots(table, values, gaps)
    provenance = {} if table.provenance is None else dict(table.provenance)
    falls = monotone_or_why_not(
        values, gaps, current, error=error, section=section, cause="look for noise in the table's flux densities"
    )
    return OperatingMap(
        levels=values,
        gap=gaps,
        current=current,
        section=section,
        error=error,
        allowance=_allowance(table, values, gaps, roots),
        current_max=float(table.current[-1]),
        actuator=str(provenance.get("actuator", "")) if actuator is None else actuator,
        digest=str(provenance.get("actuator_sha256", "")) if digest is None else digest,
        warnings=falls,
        provenance={"method": "interpolated from a table", "table": provenance},
    )


def _allowance(table: MagneticTable, levels: Array, gap: Array, roots: Roots) -> Array:
    """(n_level, n_gap) A: the errors of the currents, and how far the curve sags below its chords.

    A chord lies above a convex curve. The sag is measured at three points inside each interval and enlarged by a
    quarter, which covers a cubic's largest sag; a node takes the larger allowance of its two intervals, so that the
    reduced curve is continuous.
    """

    def reached(current: Array) -> Array:
        return np.where(np.isnan(current), table.current[-1], current)

    t = np.array(_INNER)
    inner = _roots(table, levels, ((1 - t) * gap[:-1, None] + t * gap[1:, None]).ravel())
    nodes = reached(roots.current)[:, :, None]
    below = (1 - t) * nodes[:, :-1] + t * nodes[:, 1:] - reached(inner.current).reshape(levels.size, -1, t.size)
    error = np.maximum(roots.error[:, :-1], roots.error[:, 1:])
    error = np.maximum(error, inner.error.reshape(below.shape).max(axis=2))
    needed = _DEFECT_MARGIN * np.maximum(below.max(axis=2), 0.0) + error
    allowance = roots.error.copy()
    for interval in (np.s_[:, :-1], np.s_[:, 1:]):
        allowance[interval] = np.maximum(allowance[interval], needed)
    return allowance


def _roots(table: MagneticTable, levels: Array, gaps: Array) -> Roots:
    """The smallest current of any section for each level, at gaps of the table or between them."""
    names = table.sections
    if not names:
        raise TableError(
            "the table holds no flux_density_<section>, so no operating map can be made of it; "
            "make one with 'msl-fem table'"
        )
    curves = np.array([_along_current(table, name, gaps) for name in names])
    candidates = _crossings(table.current, curves[:, None], levels[:, None])
    best = np.argmin(np.where(np.isnan(candidates), np.inf, candidates), axis=0)
    current = np.take_along_axis(candidates, best[None], axis=0)[0]
    best = np.where(np.isnan(current), np.argmax(curves[:, :, -1], axis=0), best)
    error = _thinning_error(table, gaps, curves, levels=levels, best=best, current=current)
    return Roots(current, error, tuple(tuple(names[j] for j in row) for row in best))


def _thinning_error(
    table: MagneticTable, gaps: Array, curves: Array, *, levels: Array, best: NDArray[np.int64], current: Array
) -> Array:
    """(n_level, n_gap) A: how far the currents of the loading sections, those numbered `best`, move when every other
    node is left out, along the current and along the gap; 0 where the level is not reached."""

    def moved(curves: Array, at: NDArray[np.bool_], rows: NDArray[np.int64] | None = None) -> Array:
        loading = curves[best[:, at], np.arange(curves.shape[1])]
        crossings = _crossings(table.current, loading, levels[:, None], rows)
        return np.abs(np.where(np.isnan(crossings), table.current[-1], crossings) - current[:, at])

    anywhere, between = np.ones(gaps.size, dtype=bool), ~np.isin(gaps, table.gap)
    error = np.maximum(*(moved(curves, anywhere, _thinned(table.current.size, start)) for start in (1, 2)))
    if between.any():
        over = ([_along_current(table, name, gaps[between], thinning=n) for name in table.sections] for n in (1, 2))
        error[:, between] += np.maximum(*(moved(np.array(each), between) for each in over))
    return np.where(np.isnan(current), 0.0, error / _THINNING_GAIN)


def _thinned(size: int, start: int) -> NDArray[np.int64]:
    """Every other index, and both ends."""
    return np.unique(np.r_[0, np.arange(start, size, 2), size - 1])


def _along_current(table: MagneticTable, name: str, gaps: Array, thinning: int | None = None) -> Array:
    """(n_gap, n_current) mean flux density of a section, by a cubic spline over log(gap) where the gap is no node."""
    values = table.extras[SECTION + name]
    if not np.isfinite(values).all():
        m, n = np.argwhere(~np.isfinite(values))[0]
        raise TableError(
            f"{SECTION}{name} is not finite at gap {format_quantity(table.gap[m], 'm')}, current {table.current[n]:g} A"
        )
    outside = gaps[(gaps < table.gap[0]) | (gaps > table.gap[-1])]
    if outside.size:
        raise OutOfTable(
            f"gap {format_quantity(outside[0], 'm')} lies outside the table's {table.gap[0] * 1e3:.4g} ... "
            f"{table.gap[-1] * 1e3:.4g} mm; extend the sweep (--gaps) or ask for gaps inside"
        )
    found = np.empty((gaps.size, table.current.size))
    nodes = np.isin(gaps, table.gap) if thinning is None else np.zeros(gaps.size, dtype=bool)
    found[nodes] = values[np.searchsorted(table.gap, gaps[nodes])]
    if not nodes.all():
        found[~nodes] = _over_gap(table, name, thinning)(np.log(gaps[~nodes]))
    return found


@functools.lru_cache(maxsize=32)
def _over_gap(table: MagneticTable, name: str, thinning: int | None) -> Callable[[Array], Array]:
    """The cubic spline over log(gap) of a section's mean flux densities, (n_current,) at each gap."""
    from scipy.interpolate import make_interp_spline

    values = table.extras[SECTION + name]
    rows = np.arange(table.gap.size) if thinning is None else _thinned(table.gap.size, thinning)
    spline: Callable[[Array], Array] = make_interp_spline(
        np.log(table.gap[rows]), values[rows], k=min(3, rows.size - 1)
    )
    return spline


def _crossings(current: Array, flux_density: Array, level: Array, rows: NDArray[np.int64] | None = None) -> Array:
    """The smallest positive current at which the odd spline through the chosen nodes of each curve, flux_density
    (..., n_current), takes its level, which has the curves' shape or is broadcast with it.

    A cubic lies between the smallest and the largest of its Bernstein coefficients: pieces whose coefficients are all
    below or all above the level are passed over.
    """
    from scipy.interpolate import CubicSpline, PPoly

    i = current if rows is None else current[rows]
    b = flux_density.reshape(-1, current.size)[:, slice(None) if rows is None else rows]
    fitted = CubicSpline(np.r_[-i[:0:-1], i], np.concatenate([-b[:, :0:-1], b], axis=1), axis=1)
    x, c = fitted.x[i.size - 1 :], fitted.c[:, i.size - 1 :]
    bernstein = np.einsum("pq,qnj->pnj", _BERNSTEIN, c * np.diff(x)[:, None] ** np.arange(3, -1, -1)[:, None, None])
    slack = 1e-9 * np.abs(b).max()
    lowest, highest = bernstein.min(axis=0) - slack, bernstein.max(axis=0) + slack
    curve, wanted = np.broadcast_arrays(np.arange(len(b)).reshape(flux_density.shape[:-1]), level)
    crossings = np.full(curve.shape, np.nan)
    for place, j in np.ndenumerate(curve):
        for n in np.flatnonzero((lowest[:, j] <= wanted[place]) & (wanted[place] <= highest[:, j])):
            two = PPoly.construct_fast(np.ascontiguousarray(c[:, n : n + 2, j]), x[n : n + 3])
            roots = two.solve(wanted[place], extrapolate=False)
            positive = roots[roots > 0]
            if positive.size:
                crossings[place] = positive.min()
                break
    return crossings


def monotone_or_why_not(
    levels: Array, gap: Array, current: Array, *, error: Array, section: tuple[tuple[str, ...], ...], cause: str
) -> tuple[str, ...]:
    """One sentence for each two gaps between which a curve falls; a larger gap should need more current.

    A level that is reached at a gap and was not at a smaller one counts as falling. `cause` says where to look if
    neither the currents' error nor a change of the loading section explains it.
    """
    falls = []
    for k, level in enumerate(levels):
        filled = np.where(np.isnan(current[k]), np.inf, current[k])
        for m in np.flatnonzero(filled[1:] < filled[:-1]):
            before, after = (section[k][j].replace("_", " ") for j in (m, m + 1))
            if not np.isfinite(filled[m]):
                why = "the level is not reached at the smaller gap"
            elif filled[m] - filled[m + 1] <= error[k, m] + error[k, m + 1]:
                why = "the fall lies within the stated error of the currents"
            elif before != after:
                why = f"the loading section changes from {before} to {after}"
            else:
                why = f"a larger gap should need more current; {cause}"
            falls.append(
                f"the {level:g} T curve falls between gaps {format_quantity(gap[m], 'm')} and "
                f"{format_quantity(gap[m + 1], 'm')} ({filled[m]:.4g} to {filled[m + 1]:.4g} A): {why}"
            )
    return tuple(falls)
