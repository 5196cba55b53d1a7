"""The guard: judges a pair (current, gap) by the operating map, never milder than the curves themselves."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.compiled import compiled
from msl_fem.operating_map.level_currents import OperatingMap
from msl_fem.quantity import format_quantity

Array = NDArray[np.float64]
PREFERRED, DISCOURAGED, UNACCEPTABLE = 0, 1, 2
REGIONS = ("preferred", "discouraged", "unacceptable")
"""Names of the regions by their number: below the first level, between, above the last or outside the map."""


class GuardArrays(NamedTuple):
    """What the compiled guard needs: gap (n_gap,) m and limit (n_level, n_gap) A of a magnet."""

    gap: Array
    limit: Array


@compiled
def limit_at(guard: GuardArrays, level: int, gap: float) -> float:
    """The current in A up to which a level is not reached at the gap; nan outside the map."""
    nodes = guard.gap
    last = nodes.size - 1
    if not nodes[0] <= gap <= nodes[last]:
        return np.nan
    m = min(max(int(np.searchsorted(nodes, gap)) - 1, 0), last - 1)
    t = (gap - nodes[m]) / (nodes[m + 1] - nodes[m])
    limit = guard.limit[level]
    return float((1.0 - t) * limit[m] + t * limit[m + 1])


@compiled
def region_of(guard: GuardArrays, current: float, gap: float) -> int:
    """PREFERRED, DISCOURAGED or UNACCEPTABLE; the last also for nan and outside the map."""
    size = abs(current)
    if not size <= limit_at(guard, guard.limit.shape[0] - 1, gap):
        return UNACCEPTABLE
    return PREFERRED if size <= limit_at(guard, 0, gap) else DISCOURAGED


@compiled
def _regions(guard: GuardArrays, current: Array, gap: Array, out: NDArray[np.int8]) -> None:
    for n in range(out.size):
        out[n] = region_of(guard, current[n], gap[n])


@compiled
def _limits(guard: GuardArrays, gap: Array, out: Array) -> None:
    for k in range(guard.limit.shape[0]):
        for n in range(gap.size):
            out[k, n] = limit_at(guard, k, gap[n])


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

    A limit runs straight between the map's gaps, through the currents less the map's allowance, which covers how far
    the curve sags below its chords and the error of the currents: between the nodes it is never above the curve. Where
    a level is not reached, the end of the map's currents is the limit. Negative currents count by their size.
    """

    operating_map: OperatingMap

    @cached_property
    def arrays(self) -> GuardArrays:
        """The arrays of the compiled functions `region_of` and `limit_at`."""
        m = self.operating_map
        curve = np.where(np.isnan(m.current), m.current_max, m.current) - m.allowance
        ordered = np.minimum.accumulate(np.maximum(curve, 0.0)[::-1], axis=0)[::-1]  # no level's limit above the next's
        return GuardArrays(m.gap.copy(), np.ascontiguousarray(ordered))

    def regions(self, current: ArrayLike, gap: ArrayLike) -> NDArray[np.int8]:
        """Numbers of the regions, an index into `REGIONS`, for currents and gaps broadcast together."""
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        out = np.empty(i.size, dtype=np.int8)
        _regions(self.arrays, i.ravel(), g.ravel(), out)
        return out.reshape(i.shape)

    @overload
    def classify(self, current: float, gap: float) -> str: ...
    @overload
    def classify(self, current: ArrayLike, gap: ArrayLike) -> str | NDArray[np.str_]: ...
    def classify(self, current: ArrayLike, gap: ArrayLike) -> str | NDArray[np.str_]:
        """The region's name, or an array of names; unacceptable outside the map and for what is not a number."""
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
        return np.asarray(self.limit(gap)[-1] - np.abs(np.asarray(current, dtype=float)))

    def judge(self, current: float, gap: float) -> Judgement:
        """Region, limits, margin and a sentence why, for one command."""
        region, limits, margin = self.classify(current, gap), self.limit(gap), float(self.margin(current, gap))
        inside = not np.isnan(limits).any()
        return Judgement(
            region=region,
            limits=tuple(limits.tolist()) if inside else None,
            margin=margin if math.isfinite(margin) else None,
            reason=self._reason(current, gap, region),
        )

    def _reason(self, current: float, gap: float, region: str) -> str:
        m = self.operating_map
        if math.isnan(current) or math.isnan(gap):
            return f"{'the current' if math.isnan(current) else 'the gap'} is not a number"
        ends = f"{m.gap[0] * 1e3:.4g} ... {m.gap[-1] * 1e3:.4g} mm"
        if not m.gap[0] <= gap <= m.gap[-1]:
            return f"gap {format_quantity(gap, 'm')} lies outside the map's {ends}"
        if abs(current) > m.current_max:
            return f"{abs(current):.6g} A is beyond the map's end at {m.current_max:g} A"
        where = f"at gap {format_quantity(gap, 'm')}"
        limits = self.limit(gap)
        if region == REGIONS[PREFERRED]:
            return f"below the {limits[0]:.4g} A {self._meaning(0, gap)} {where}"
        if region == REGIONS[DISCOURAGED]:
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
