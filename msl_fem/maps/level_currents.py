"""The operating map: for each gap the coil currents that bring given flux densities in the iron.

Gutierrez and Ro (IEEE Trans. Magnetics 34(5), 1998, Fig. 2) draw two curves over the gap, the currents that bring 1.2 T
(the end of the B-H curve's straight part) and 1.6 T (where more current brings little force): below the first is where
to work, above the last is where not to. The criterion says at which point of the iron the flux density is read.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, make_interp_spline

from msl_fem.errors import InputError, OutOfTable, TableError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.criterion import MEAN, parse_criterion
from msl_fem.maps.monotone import monotone_or_why_not
from msl_fem.table.magnetic_table import SECTION, MagneticTable

Array = NDArray[np.float64]

LEVELS = (1.2, 1.6)
"""Default flux densities in T: the source paper's."""
MOST_LEVELS, SMALLEST_LEVEL, LARGEST_LEVEL = 100, 1e-3, 10.0  # T; no iron is driven further
_THINNING_GAIN = 3.0  # a cubic spline's error grows 16-fold on nodes twice as far apart; count on 3
_DEFECT_MARGIN = 1.25  # the largest departure from a chord over the largest of those at three inner points
_INNER = (0.25, 0.5, 0.75)


@dataclass(frozen=True, eq=False)
class OperatingMap:
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
    if levels.ndim != 1 or levels.size == 0 or not (np.diff(levels) > 0).all() or not levels[0] > 0:
        raise InputError(f"levels must be positive and increasing flux densities, these are {levels.tolist()} T")
    if gap.ndim != 1 or gap.size < 2 or not (np.diff(gap) > 0).all() or not gap[0] > 0:
        raise InputError("a map needs at least two gaps, positive and increasing")
    if not (math.isfinite(record.current_max) and record.current_max > 0):
        raise InputError(f"the map's largest current must be positive, it is {record.current_max:g} A")
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
    """Currents (n_level,) of one gap, their error, and the section that gives each."""

    current: Array
    error: Array
    section: tuple[str, ...]


def checked_levels(levels: Sequence[float]) -> Array:
    """The levels as an array; InputError unless they are positive, increasing and flux densities that iron can bear."""
    wanted = np.asarray(levels, dtype=float)
    if wanted.ndim != 1 or wanted.size == 0 or not (wanted > 0).all() or not (np.diff(wanted) > 0).all():
        raise InputError(f"levels must be positive and increasing, like 1.2, 1.6 T; these are {list(levels)} T")
    if wanted.size > MOST_LEVELS or wanted[-1] > LARGEST_LEVEL or wanted[0] < SMALLEST_LEVEL:
        raise InputError(
            f"{wanted.size} level(s) from {wanted[0]:g} to {wanted[-1]:g} T are not allowed; give at most "
            f"{MOST_LEVELS}, each {SMALLEST_LEVEL:g} ... {LARGEST_LEVEL:g} T, like 1.2, 1.6 T"
        )
    return wanted


def operating_map(
    table: MagneticTable, *, levels: Sequence[float] = LEVELS, gap: ArrayLike | None = None,
    actuator: str | None = None, digest: str | None = None,
) -> OperatingMap:  # fmt: skip
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
    wanted = checked_levels(levels)
    gaps = np.array(table.gap if gap is None else gap, dtype=float)
    if gaps.ndim != 1 or gaps.size < 2 or not (np.diff(gaps) > 0).all():
        raise InputError("gaps must be increasing and at least two")
    roots = [_roots(table, wanted, float(g)) for g in gaps]
    current = np.stack([r.current for r in roots], axis=1)
    error = np.stack([r.error for r in roots], axis=1)
    section = tuple(zip(*(r.section for r in roots), strict=True))
    provenance = {} if table.provenance is None else dict(table.provenance)
    return OperatingMap(
        levels=wanted,
        gap=gaps,
        current=current,
        section=section,
        error=error,
        allowance=_allowance(table, wanted, gaps, roots),
        current_max=float(table.current[-1]),
        actuator=str(provenance.get("actuator", "")) if actuator is None else actuator,
        digest=str(provenance.get("actuator_sha256", "")) if digest is None else digest,
        warnings=monotone_or_why_not(
            wanted, gaps, current, error=error, section=section, cause="look for noise in the table's flux densities"
        ),
        provenance={"method": "interpolated from a table", "table": provenance},
    )


def _allowance(table: MagneticTable, levels: Array, gap: Array, roots: list[Roots]) -> Array:
    """(n_level, n_gap) A: the errors of the currents, and how far the curve sags below its chords.

    A chord lies above a convex curve. The sag is measured at three points inside each interval and enlarged by a
    quarter, which covers a cubic's largest sag; a node takes the larger allowance of its two intervals, so that the
    reduced curve is continuous.
    """
    end = table.current[-1]
    allowance = np.stack([r.error for r in roots], axis=1)
    for m in range(gap.size - 1):
        left, right = (np.where(np.isnan(roots[j].current), end, roots[j].current) for j in (m, m + 1))
        sag, error = np.zeros(levels.size), np.maximum(roots[m].error, roots[m + 1].error)
        for t in _INNER:
            inner = _roots(table, levels, float((1 - t) * gap[m] + t * gap[m + 1]))
            below = (1 - t) * left + t * right - np.where(np.isnan(inner.current), end, inner.current)
            sag, error = np.maximum(sag, below), np.maximum(error, inner.error)
        for j in (m, m + 1):
            allowance[:, j] = np.maximum(allowance[:, j], _DEFECT_MARGIN * sag + error)
    return allowance


def _roots(table: MagneticTable, levels: Array, gap: float) -> Roots:
    """The smallest current of any section for each level, at a gap of the table or between its gaps."""
    every, odd, even = slice(None), _thinned(table.current.size, 1), _thinned(table.current.size, 2)
    names = table.sections
    if not names:
        raise TableError(
            "the table holds no flux_density_<section>, so no operating map can be made of it; "
            "make one with 'msl-fem table'"
        )
    fine = {name: _along_current(table, name, gap) for name in names}
    candidates = np.array([_crossings(table.current, fine[name], levels, every) for name in names])
    best = np.argmin(np.where(np.isnan(candidates), np.inf, candidates), axis=0)
    current = candidates[best, np.arange(levels.size)]
    rows = [odd, even]
    error = np.zeros(levels.size)
    for k, level in enumerate(levels):
        if np.isnan(current[k]):
            best[k] = int(np.argmax([fine[name][-1] for name in names]))
            continue
        name = names[best[k]]
        others = [_crossings(table.current, fine[name], np.array([level]), row)[0] for row in rows]
        if gap not in table.gap:
            coarse = [_along_current(table, name, gap, thinning=j) for j in (1, 2)]
            others += [_crossings(table.current, b, np.array([level]), every)[0] for b in coarse]
        spread = [abs((table.current[-1] if np.isnan(i) else i) - current[k]) for i in others]
        error[k] = (max(spread[:2]) + max(spread[2:], default=0.0)) / _THINNING_GAIN
    return Roots(current, error, tuple(names[j] for j in best))


def _thinned(size: int, start: int) -> NDArray[np.int64]:
    """Every other index, and both ends."""
    return np.unique(np.r_[0, np.arange(start, size, 2), size - 1])


def _along_current(table: MagneticTable, name: str, gap: float, thinning: int | None = None) -> Array:
    """(n_current,) mean flux density of a section at a gap, by a cubic spline over log(gap) where it is no node."""
    values = table.extras[SECTION + name]
    if not np.isfinite(values).all():
        m, n = np.argwhere(~np.isfinite(values))[0]
        raise TableError(
            f"{SECTION}{name} is not finite at gap {format_quantity(table.gap[m], 'm')}, current {table.current[n]:g} A"
        )
    if not table.gap[0] <= gap <= table.gap[-1]:
        raise OutOfTable(
            f"gap {format_quantity(gap, 'm')} lies outside the table's {table.gap[0] * 1e3:.4g} ... "
            f"{table.gap[-1] * 1e3:.4g} mm; extend the sweep (--gaps) or ask for gaps inside"
        )
    if thinning is None and gap in table.gap:
        return np.asarray(values[np.searchsorted(table.gap, gap)])
    rows = np.arange(table.gap.size) if thinning is None else _thinned(table.gap.size, thinning)
    spline = make_interp_spline(np.log(table.gap[rows]), values[rows], k=min(3, rows.size - 1))
    return np.asarray(spline(math.log(gap)))


def _crossings(current: Array, flux_density: Array, levels: Array, rows: slice | NDArray[np.int64]) -> Array:
    """(n_level,) the smallest positive current at which the odd spline through the chosen nodes takes each level."""
    i, b = current[rows], flux_density[rows]
    spline = CubicSpline(np.r_[-i[:0:-1], i], np.r_[-b[:0:-1], b])
    found = np.full(levels.size, np.nan)
    for k, level in enumerate(levels):
        roots = spline.solve(level, extrapolate=False)
        positive = roots[roots > 0]
        if positive.size:
            found[k] = positive.min()
    return found
