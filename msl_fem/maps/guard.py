"""The guard: judges a pair (current, gap) by the operating map, never milder than the curves themselves."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.level_currents import OperatingMap
from msl_fem.maps.limit_lines import GuardArrays, limit_lines

Array = NDArray[np.float64]
PREFERRED, DISCOURAGED, UNACCEPTABLE = 0, 1, 2
REGIONS = ("preferred", "discouraged", "unacceptable")
"""Names of the regions by their number: below the first level, between, above the last or outside the map."""
BELOW_FIRST, BETWEEN, ABOVE_LAST, BEYOND_MAP, GAP_OUTSIDE, GAP_NAN, CURRENT_NAN = range(7)
REASONS = (
    "below the first level", "between the first and the last level", "above the last level",
    "current beyond the end of the map", "gap outside the map", "gap is not a number", "current is not a number",
)  # fmt: skip
"""Why, by number; a region's number is that of its reason, at most `UNACCEPTABLE`."""


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
            return REGIONS[region_of(self.arrays, current, gap)]
        regions = self.regions(current, gap)
        return REGIONS[int(regions)] if regions.ndim == 0 else np.array(REGIONS)[regions]

    def limit(self, gap: ArrayLike) -> Array:
        """(n_level, ...) A: the limit of each level at the gap(s); nan outside the map."""
        g = np.asarray(gap, dtype=float)
        out = np.empty((self.arrays.limit.shape[0], g.size))
        _limits(self.arrays, g.ravel(), out)
        return out.reshape(-1, *g.shape)

    def margin(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """A left below the last level's limit, negative beyond; nan outside the map's gaps or not a number."""
        return self._judged(_margins, current, gap, np.float64)

    def _judged(self, compiled_loop: Callable[..., None], current: ArrayLike, gap: ArrayLike, kind: Any) -> Any:
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        out = np.empty(i.size, dtype=kind)
        compiled_loop(self.arrays, i.ravel(), g.ravel(), out)
        return out.reshape(i.shape)

    def judge(self, current: float, gap: float) -> Judgement:
        """Region, limits, margin and a sentence why, for one command."""
        current, gap = float(current), float(gap)
        limits, margin = self.limit(gap), margin_of(self.arrays, current, gap)
        inside = not np.isnan(limits).any()
        return Judgement(
            region=self.classify(current, gap),
            limits=tuple(limits.tolist()) if inside else None,
            margin=margin if math.isfinite(margin) else None,
            reason=self._sentence(reason_of(self.arrays, current, gap), current, gap),
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
