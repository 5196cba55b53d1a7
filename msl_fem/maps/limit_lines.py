"""The guard's limits as straight lines over the gap, below every curve that the map's currents may stand for."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator, CubicHermiteSpline, CubicSpline, PchipInterpolator, PPoly

from msl_fem.errors import InputError
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.table.magnetic_table import LARGEST_GAP, LARGEST_VALUE, SMALLEST_GAP

Array = NDArray[np.float64]
Curve = Callable[[Array, Array], Any]
CURVES: dict[str, Curve] = {
    "monotone cubic (Fritsch and Carlson)": PchipInterpolator,
    "cubic spline, not-a-knot": CubicSpline,
    "cubic spline, natural": lambda gap, current: CubicSpline(gap, current, bc_type="natural"),
    "cubic, slopes of parabolas (Bessel)": lambda gap, current: CubicHermiteSpline(
        gap, current, np.gradient(current, gap)
    ),
    "Akima": Akima1DInterpolator,
    "Akima, modified": lambda gap, current: Akima1DInterpolator(gap, current, method="makima"),
}
"""How a reader of a map may draw its curves between the gaps; chords besides, and Hermite cubics of known slopes."""
_ROUNDING = 16 * np.finfo(float).eps  # of the largest limit: the few roundings of an evaluation, and some to spare
_SAG_ROUNDING = 1 + 1e-9
_MOST_BUCKETS = 1024


class GuardArrays(NamedTuple):
    """What the guard's compiled functions need; they and the exported C read the same numbers.

    Attributes
    ----------
    gap : (n_gap,) m, increasing
    limit : (n_level, n_gap) A at the gaps, of one magnet; an evaluation takes 0 where a line is negative
    slope : (n_level, n_gap - 1) A/m
    start : (n_bucket,) the interval at or before the one that holds a gap of the bucket int((gap - gap[0]) * buckets)
    buckets : 1/m, buckets a metre
    current_max : A, the end of the map
    """

    gap: Array
    limit: Array
    slope: Array
    start: NDArray[np.int64]
    buckets: float
    current_max: float


def limit_lines(operating_map: OperatingMap) -> GuardArrays:
    """The lines through the map's currents less what covers sag, error and rounding.

    A chord lies above a curve that sags below it. At each gap the larger of two allowances comes off: the map's, which
    knows the table, and the largest sag of the curves in `CURVES` through the map's currents in the two intervals
    beside it. Where a level is not reached, the end of the map's currents stands for its current.

    Raises
    ------
    InputError : gaps, currents or allowances of a size that no magnet has
    """
    m = operating_map
    if not (m.gap[0] >= SMALLEST_GAP and m.gap[-1] <= LARGEST_GAP):
        raise InputError(
            f"the map's gaps of {m.gap[0]:g} ... {m.gap[-1]:g} m are not a magnet's, allowed are "
            f"{SMALLEST_GAP:g} ... {LARGEST_GAP:g} m; look at the unit"
        )
    if not max(m.current_max, m.allowance.max()) < LARGEST_VALUE:
        raise InputError(f"currents or allowances beyond {LARGEST_VALUE:g} A are not a magnet's; look at the unit")
    filled = np.where(np.isnan(m.current), m.current_max, m.current)
    slopes = np.full_like(filled, np.nan) if m.gap_slope is None else m.gap_slope
    sag = [_sag_beside(m.gap, *rows) for rows in zip(filled, m.current, slopes, strict=True)]
    reduced = filled - np.maximum(m.allowance, sag)
    ordered = np.minimum.accumulate(reduced[::-1], axis=0)[::-1]  # no level's limit above the next's
    limit = ordered - _ROUNDING * max(float(np.abs(ordered).max()), m.current_max)
    slope = np.diff(limit, axis=1) / np.diff(m.gap)
    if not np.isfinite(slope).all():
        raise InputError("the map's gaps are too close together to judge between them; make the map anew")
    start, buckets = _buckets(m.gap)
    return GuardArrays(m.gap.copy(), np.ascontiguousarray(limit), slope, start, buckets, float(m.current_max))


def _sag_beside(gap: Array, filled: Array, current: Array, slope: Array) -> Array:
    """(n_gap,) A: the larger sag of the two intervals beside each gap.

    The curves go through all nodes, and through each run of those reached alone; a Hermite cubic through each run whose
    slopes are known.
    """
    sag = _sag(gap, *(curve(gap, filled) for curve in CURVES.values()))
    for run in _runs(~np.isnan(current)):
        sag[run[:-1]] = np.maximum(sag[run[:-1]], _sag(gap[run], *(c(gap[run], current[run]) for c in CURVES.values())))
    for run in _runs(np.isfinite(slope) & ~np.isnan(current)):
        hermite = CubicHermiteSpline(gap[run], current[run], slope[run])
        sag[run[:-1]] = np.maximum(sag[run[:-1]], _sag(gap[run], hermite))
    return np.maximum(np.r_[sag, 0.0], np.r_[0.0, sag])


def _runs(chosen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """The runs of at least two neighbours among the chosen, as indices."""
    found = np.flatnonzero(chosen)
    return [run for run in np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if run.size >= 2]


def _sag(gap: Array, *curves: PPoly) -> Array:
    """(n_gap - 1,) A: how far the lowest of the curves falls below the chord, from the extremes of the cubics."""
    width = np.diff(gap)
    deepest = np.zeros(width.size)
    for curve in curves:
        a, b, c, d = curve.c[-4:]
        end = np.r_[d[1:], curve(gap[-1])]
        c = c - (end - d) / width  # the cubic less the chord is a x^3 + b x^2 + c x
        with np.errstate(all="ignore"):  # no extreme gives nan, which counts for nothing below
            root = np.sqrt(b * b - 3 * a * c)
            straight = -c / (2 * b)  # where a vanishes
            for x in ((-b + root) / (3 * a), (-b - root) / (3 * a), straight):
                depth = -((a * x + b) * x + c) * x
                deepest = np.fmax(deepest, np.where((x > 0) & (x < width), depth, 0.0))
    return deepest * _SAG_ROUNDING


def _buckets(gap: Array) -> tuple[NDArray[np.int64], float]:
    """(`start`, `buckets`): as many buckets as keep the nodes apart, at most a thousand or so.

    Rounding is monotone, so a gap in a bucket lies beyond all nodes of the buckets before it: the search forward from
    `start` ends in the right interval whatever the rounding.
    """
    span = float(gap[-1] - gap[0])
    count = min(int(np.ceil(min(span / float(np.diff(gap).min()), _MOST_BUCKETS))), _MOST_BUCKETS)
    scale = count / span
    own = ((gap - gap[0]) * scale).astype(np.int64)
    start = np.searchsorted(own, np.arange(own[-1] + 1), side="left") - 1
    return np.clip(start, 0, gap.size - 2).astype(np.int64), scale
