"""The guard: judges a pair (current, gap) by the operating map, never milder than the curves themselves."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled, for_few
from msl_fem.computing.splines import akima_slopes, cubic_slopes, monotone_slopes
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.table.magnetic_table import LARGEST_GAP, LARGEST_VALUE, SMALLEST_GAP

PREFERRED, DISCOURAGED, UNACCEPTABLE = 0, 1, 2
REGIONS = ("preferred", "discouraged", "unacceptable")
"""Names of the regions by their number: below the first level, between, above the last or outside the map."""
FEW = 100  # commands that Python judges sooner than it loads the compiler
BELOW_FIRST, BETWEEN, ABOVE_LAST, BEYOND_MAP, GAP_OUTSIDE, GAP_NAN, CURRENT_NAN = range(7)
REASONS = (
    "below the first level",
    "between the first and the last level",
    "above the last level",
    "current beyond the end of the map",
    "gap outside the map",
    "gap is not a number",
    "current is not a number",
)
"""Why, by number; a region's number is that of its reason, at most `UNACCEPTABLE`."""
CURVES: dict[str, Callable[[Array, Array], Array]] = {
    "monotone cubic (Fritsch and Carlson)": monotone_slopes,
    "cubic spline, not-a-knot": lambda gap, current: cubic_slopes(gap, current, natural=False),
    "cubic spline, natural": lambda gap, current: cubic_slopes(gap, current, natural=True),
    "cubic, slopes of parabolas (Bessel)": lambda gap, current: np.gradient(current, gap),
    "Akima": lambda gap, current: akima_slopes(gap, current, modified=False),
    "Akima, modified": lambda gap, current: akima_slopes(gap, current, modified=True),
}
"""The slopes of the cubics that a reader of a map may draw between the gaps; chords besides, and known slopes."""
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


@compiled
def _interval(guard: GuardArrays, gap: float) -> int:
    """The interval of a gap inside the map: gap[m] <= gap < gap[m + 1], the last one closed."""
    nodes = guard.gap
    m = int(guard.start[int((gap - nodes[0]) * guard.buckets)])
    while m < nodes.size - 2 and gap >= nodes[m + 1]:
        m += 1
    return m


@compiled
def _line(guard: GuardArrays, level: int, m: int, gap: float) -> float:
    limit = guard.limit[level, m] + guard.slope[level, m] * (gap - guard.gap[m])
    return limit if limit > 0.0 else 0.0


@compiled
def limit_at(guard: GuardArrays, level: int, gap: float) -> float:
    """The current in A up to which a level is not reached at the gap; nan outside the map."""
    if not guard.gap[0] <= gap <= guard.gap[-1]:
        return np.nan
    return float(_line(guard, level, _interval(guard, gap), gap))


@compiled
def region_of(guard: GuardArrays, current: float, gap: float) -> int:
    """PREFERRED, DISCOURAGED or UNACCEPTABLE; the last also for nan and outside the map."""
    if not guard.gap[0] <= gap <= guard.gap[-1]:
        return UNACCEPTABLE
    size, m = abs(current), _interval(guard, gap)
    if not size <= _line(guard, guard.limit.shape[0] - 1, m, gap):
        return UNACCEPTABLE
    return PREFERRED if size <= _line(guard, 0, m, gap) else DISCOURAGED


@compiled
def margin_of(guard: GuardArrays, current: float, gap: float) -> float:
    """A left below the last level's limit, negative beyond; nan outside the map's gaps or not a number."""
    if not guard.gap[0] <= gap <= guard.gap[-1]:
        return np.nan
    return float(_line(guard, guard.limit.shape[0] - 1, _interval(guard, gap), gap) - abs(current))


@compiled
def reason_of(guard: GuardArrays, current: float, gap: float) -> int:
    """The number of the reason, an index into `REASONS`."""
    if current != current:
        return CURRENT_NAN
    if gap != gap:
        return GAP_NAN
    if not guard.gap[0] <= gap <= guard.gap[-1]:
        return GAP_OUTSIDE
    if abs(current) > guard.current_max:
        return BEYOND_MAP
    return region_of(guard, current, gap)


@compiled
def _regions(guard: GuardArrays, current: Array, gap: Array, out: NDArray[np.int8]) -> None:
    for n in range(out.size):
        out[n] = region_of(guard, current[n], gap[n])


@compiled
def _limits(guard: GuardArrays, gap: Array, out: Array) -> None:
    for k in range(guard.limit.shape[0]):
        for n in range(gap.size):
            out[k, n] = limit_at(guard, k, gap[n])


@compiled
def _margins(guard: GuardArrays, current: Array, gap: Array, out: Array) -> None:
    for n in range(out.size):
        out[n] = margin_of(guard, current[n], gap[n])


@compiled
def _reasons(guard: GuardArrays, current: Array, gap: Array, out: NDArray[np.int8]) -> None:
    for n in range(out.size):
        out[n] = reason_of(guard, current[n], gap[n])


@dataclass(frozen=True)
class Judgement:
    """What the guard says of one command.

    Attributes
    ----------
    region : a name of `REGIONS`
    limits : A, one a level; None outside the map's gaps
    margin : A left below the last limit, negative beyond it; None where there is no limit or no current
    reason : one sentence
    """

    region: str
    limits: tuple[float, ...] | None
    margin: float | None
    reason: str

    def to_json(self) -> dict[str, Any]:
        """The JSON object: region, limits_A, margin_A, reason."""
        limits = None if self.limits is None else list(self.limits)
        return {"region": self.region, "limits_A": limits, "margin_A": self.margin, "reason": self.reason}


@dataclass(frozen=True, eq=False)
class Guard:
    """The three regions of a map: below the first level preferred, between discouraged, above the last unacceptable.

    A limit runs straight between the map's gaps, through the currents less an allowance for sag, errors and rounding
    (`limit_lines`): between the nodes it is never above the curve. Where a level is not reached, the end of the map's
    currents is the limit. Negative currents count by their size. What is not a number, infinite or outside the map is
    unacceptable.

    Raises
    ------
    InputError : a map whose sizes no magnet has
    """

    operating_map: OperatingMap

    def __post_init__(self) -> None:
        _ = self.arrays  # a map that cannot be judged by is refused here, not at the first command

    @cached_property
    def arrays(self) -> GuardArrays:
        """The arrays of the compiled functions `region_of`, `limit_at`, `margin_of` and `reason_of`."""
        return limit_lines(self.operating_map)

    def regions(self, current: ArrayLike, gap: ArrayLike) -> NDArray[np.int8]:
        """Numbers of the regions, an index into `REGIONS`, for currents and gaps broadcast together."""
        return self._judged(_regions, current, gap, np.int8)

    def reasons(self, current: ArrayLike, gap: ArrayLike) -> NDArray[np.int8]:
        """Numbers of the reasons, an index into `REASONS`."""
        return self._judged(_reasons, current, gap, np.int8)

    @overload
    def classify(self, current: float, gap: float) -> str: ...
    @overload
    def classify(self, current: ArrayLike, gap: ArrayLike) -> str | NDArray[np.str_]: ...
    def classify(self, current: ArrayLike, gap: ArrayLike) -> str | NDArray[np.str_]:
        """The region's name, or an array of names; unacceptable outside the map and for what is not a number."""
        if isinstance(current, float) and isinstance(gap, float):
            return REGIONS[for_few(region_of)(self.arrays, current, gap)]
        regions = self.regions(current, gap)
        return REGIONS[int(regions)] if regions.ndim == 0 else np.array(REGIONS)[regions]

    def limit(self, gap: ArrayLike) -> Array:
        """(n_level, ...) A: the limit of each level at the gap(s); nan outside the map."""
        g = np.asarray(gap, dtype=float)
        out = np.empty((self.arrays.limit.shape[0], g.size))
        (for_few(_limits) if g.size <= FEW else _limits)(self.arrays, g.flatten(), out)
        return out.reshape(-1, *g.shape)

    def margin(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """A left below the last level's limit, negative beyond; nan outside the map's gaps or not a number."""
        return self._judged(_margins, current, gap, np.float64)

    def _judged(self, compiled_loop: Callable[..., None], current: ArrayLike, gap: ArrayLike, kind: Any) -> Any:
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        out = np.empty(i.size, dtype=kind)
        (for_few(compiled_loop) if i.size <= FEW else compiled_loop)(self.arrays, i.flatten(), g.flatten(), out)
        return out.reshape(i.shape)

    def judge(self, current: float, gap: float) -> Judgement:
        """Region, limits, margin and a sentence why, for one command."""
        current, gap = float(current), float(gap)
        limits, margin = self.limit(gap), for_few(margin_of)(self.arrays, current, gap)
        inside = not np.isnan(limits).any()
        return Judgement(
            region=self.classify(current, gap),
            limits=tuple(limits.tolist()) if inside else None,
            margin=float(margin) if math.isfinite(margin) else None,
            reason=self._sentence(for_few(reason_of)(self.arrays, current, gap), current, gap),
        )

    def _sentence(self, reason: int, current: float, gap: float) -> str:
        m = self.operating_map
        if reason in (CURRENT_NAN, GAP_NAN):
            return REASONS[reason].replace("current", "the current").replace("gap", "the gap")
        if reason == GAP_OUTSIDE:
            ends = f"{m.gap[0] * 1e3:.4g} ... {m.gap[-1] * 1e3:.4g} mm"
            return f"gap {format_quantity(gap, 'm')} lies outside the map's {ends}"
        if reason == BEYOND_MAP:
            return f"{abs(current):.6g} A is beyond the map's end at {m.current_max:g} A"
        where, limits = f"at gap {format_quantity(gap, 'm')}", self.limit(gap)
        if reason == BELOW_FIRST:
            return f"below the {limits[0]:.4g} A {self._meaning(0, gap)} {where}"
        if reason == BETWEEN:
            return (
                f"above the {limits[0]:.4g} A {self._meaning(0, gap)}, below the {limits[-1]:.4g} A "
                f"{self._meaning(-1, gap)} {where}"
            )
        return f"above the {limits[-1]:.4g} A {self._meaning(-1, gap)} {where}"

    def _meaning(self, level: int, gap: float) -> str:
        """What a limit stands for, from the nearer node."""
        m = self.operating_map
        near = int(np.argmin(np.abs(m.gap - gap)))
        if np.isnan(m.current[level, near]):
            return f"where the map ends, {m.levels[level]:g} T not reached below {m.current_max:g} A"
        section = m.section[level][near].replace("_", " ")
        return f"that may bring {m.levels[level]:g} T ({m.criterion}, {section})"


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
    sag = _sag_of_curves(gap, filled)
    for run in _runs(~np.isnan(current)):
        sag[run[:-1]] = np.maximum(sag[run[:-1]], _sag_of_curves(gap[run], current[run]))
    for run in _runs(np.isfinite(slope) & ~np.isnan(current)):
        sag[run[:-1]] = np.maximum(sag[run[:-1]], _sag(gap[run], current[run], slope[run]))
    return np.maximum(np.r_[sag, 0.0], np.r_[0.0, sag])


def _runs(chosen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """The runs of at least two neighbours among the chosen, as indices."""
    indices = np.flatnonzero(chosen)
    runs = np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)
    return [run for run in runs if run.size >= 2]


def _sag_of_curves(gap: Array, current: Array) -> Array:
    """(n_gap - 1,) A: the largest sag of the curves in `CURVES`."""
    return np.max([_sag(gap, current, slopes(gap, current)) for slopes in CURVES.values()], axis=0)


def _sag(gap: Array, current: Array, slope: Array) -> Array:
    """(n_gap - 1,) A: how far a curve of cubics falls below the chord, from its extremes; `slope` in A/m."""
    width, chord = np.diff(gap), np.diff(current) / np.diff(gap)
    c = slope[:-1] - chord  # the cubic less the chord is a x^3 + b x^2 + c x
    bend = slope[:-1] + slope[1:] - 2 * chord
    a = bend / width**2
    b = -(c + bend) / width
    deepest = np.zeros(width.size)
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
