"""The guard of a pair: judges two currents and a position by the map of both sides, never milder than it."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled, for_few
from msl_fem.files.quantity import format_quantity
from msl_fem.maps.guard import DISCOURAGED, FEW, PREFERRED, REGIONS, UNACCEPTABLE
from msl_fem.maps.pair_limits import RELATIONS, PairMap

_ROUNDING = 16 * np.finfo(float).eps  # of the largest limit: the few roundings of an evaluation, and some to spare


class PairGuardArrays(NamedTuple):
    """What the compiled functions need.

    Attributes
    ----------
    position, other : where the equal steps begin, m and A
    position_end, other_end : where they end
    per_position, per_other : steps a metre, steps an ampere
    limit : (2, n_level, n_x, n_j) A of one magnet: opposing currents, then aiding ones
    """

    position: float
    other: float
    position_end: float
    other_end: float
    per_position: float
    per_other: float
    limit: Array


@compiled
def _cell(steps: float, nodes: int) -> int:
    """The interval that holds a place counted in steps from the first node."""
    m = int(steps)
    return m if m < nodes - 2 else nodes - 2


@compiled
def _bilinear(limit: Array, relation: int, level: int, m: int, n: int, t: float, s: float) -> float:
    """The limit at the shares t and s of a cell."""
    low = limit[relation, level, m, n] + (limit[relation, level, m, n + 1] - limit[relation, level, m, n]) * s
    high = limit[relation, level, m + 1, n]
    high = high + (limit[relation, level, m + 1, n + 1] - limit[relation, level, m + 1, n]) * s
    return float(low + (high - low) * t)


@compiled
def pair_limit_at(guard: PairGuardArrays, relation: int, level: int, position: float, other: float) -> float:
    """The current (A) of side 1 up to which a level is not reached; below 0 where the other side alone reaches it.

    Bilinear between the map's nodes; nan outside the map. Of side 2 it is the limit at the opposite position.
    """
    if not (guard.position <= position <= guard.position_end and guard.other <= other <= guard.other_end):
        return np.nan
    limit = guard.limit
    t, s = (position - guard.position) * guard.per_position, (other - guard.other) * guard.per_other
    m, n = _cell(t, limit.shape[2]), _cell(s, limit.shape[3])
    return _bilinear(limit, relation, level, m, n, t - m, s - n)


@compiled
def _bears(guard: PairGuardArrays, relation: int, position: float, size: float, other: float) -> int:
    """The region of side 1 at a size of its current; inside the map."""
    limit = guard.limit
    t, s = (position - guard.position) * guard.per_position, (other - guard.other) * guard.per_other
    m, n = _cell(t, limit.shape[2]), _cell(s, limit.shape[3])
    if not size <= _bilinear(limit, relation, limit.shape[1] - 1, m, n, t - m, s - n):
        return UNACCEPTABLE
    return PREFERRED if size <= _bilinear(limit, relation, 0, m, n, t - m, s - n) else DISCOURAGED


@compiled
def pair_region_of(guard: PairGuardArrays, current_1: float, current_2: float, position: float) -> int:
    """PREFERRED, DISCOURAGED or UNACCEPTABLE, the worse of both sides; the last also for nan and outside the map."""
    size_1, size_2 = abs(current_1), abs(current_2)
    within = size_1 <= guard.other_end and size_2 <= guard.other_end
    if not (within and guard.position <= position <= guard.position_end):
        return UNACCEPTABLE
    relation = 1 if current_1 * current_2 > 0.0 else 0
    one = _bears(guard, relation, position, size_1, size_2)
    if one == UNACCEPTABLE:
        return UNACCEPTABLE
    two = _bears(guard, relation, -position, size_2, size_1)
    return two if two > one else one


@compiled
def _pair_regions(
    guard: PairGuardArrays, current_1: Array, current_2: Array, position: Array, out: NDArray[np.int8]
) -> None:
    for n in range(out.size):
        out[n] = pair_region_of(guard, current_1[n], current_2[n], position[n])


@dataclass(frozen=True)
class PairJudgement:
    """What the guard of a pair says of one command.

    Attributes
    ----------
    region : a name of `maps.REGIONS`
    limits_1, limits_2 : A, one a level, of either side at the other one's current; None outside the map
    margin : A, the smaller one left below both sides' last limits, negative beyond; None where there is no limit
    reason : one sentence
    """

    region: str
    limits_1: tuple[float, ...] | None
    limits_2: tuple[float, ...] | None
    margin: float | None
    reason: str

    def to_json(self) -> dict[str, Any]:
        """The JSON object: region, limits_A (of side 1), limits_2_A, margin_A, reason."""
        limits = [None if values is None else list(values) for values in (self.limits_1, self.limits_2)]
        return {
            "region": self.region,
            "limits_A": limits[0],
            "limits_2_A": limits[1],
            "margin_A": self.margin,
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class PairGuard:
    """The regions of a pair's map. Currents are those of one magnet a side; equal signs aid, different ones oppose.

    Both sides are judged, each by its limit at the other one's current. What is not a number, infinite or outside the
    map is unacceptable.
    """

    pair_map: PairMap

    @cached_property
    def arrays(self) -> PairGuardArrays:
        """The arrays of the compiled functions `pair_region_of` and `pair_limit_at`."""
        m = self.pair_map
        reduced = m.current - m.allowance
        ordered = np.minimum.accumulate(reduced[:, ::-1], axis=1)[:, ::-1]  # no level's limit above the next's
        limit = np.ascontiguousarray(ordered - _ROUNDING * float(np.abs(ordered).max()))
        reach, end = float(m.position[-1]), m.current_max
        per_position, per_other = (m.position.size - 1) / (2 * reach), (m.other.size - 1) / end
        return PairGuardArrays(-reach, 0.0, reach, end, per_position, per_other, limit)

    def regions(self, current_1: ArrayLike, current_2: ArrayLike, position: ArrayLike) -> NDArray[np.int8]:
        """Numbers of the regions, an index into `maps.REGIONS`, for commands broadcast together."""
        given = np.broadcast_arrays(*(np.asarray(v, dtype=float) for v in (current_1, current_2, position)))
        out = np.empty(given[0].size, dtype=np.int8)
        judged = for_few(_pair_regions) if out.size <= FEW else _pair_regions
        i, j, x = (np.array(v).ravel() for v in given)
        judged(self.arrays, i, j, x, out)
        return out.reshape(given[0].shape)

    def judge(self, current_1: float, current_2: float, position: float) -> PairJudgement:
        """Region, limits, margin and a sentence why, for one command."""
        i, j, x = float(current_1), float(current_2), float(position)
        region = int(self.regions(i, j, x))
        if not self._inside(i, j, x):
            return PairJudgement(REGIONS[region], None, None, None, self._outside(i, j, x))
        relation = 1 if i * j > 0 else 0
        limits_1, limits_2 = self._limits(relation, x, abs(j)), self._limits(relation, -x, abs(i))
        margin = min(limits_1[-1] - abs(i), limits_2[-1] - abs(j))
        reason = self._sentence(region, (abs(i), abs(j)), (limits_1, limits_2), relation if i and j else None)
        return PairJudgement(REGIONS[region], limits_1, limits_2, margin, reason)

    def _limits(self, relation: int, position: float, other: float) -> tuple[float, ...]:
        """A, one a level."""
        levels = range(self.pair_map.levels.size)
        return tuple(for_few(pair_limit_at)(self.arrays, relation, k, position, other) for k in levels)

    def _inside(self, i: float, j: float, x: float) -> bool:
        m = self.pair_map
        return bool(abs(i) <= m.current_max and abs(j) <= m.current_max and abs(x) <= m.position[-1])

    def _outside(self, i: float, j: float, x: float) -> str:
        m = self.pair_map
        if any(map(math.isnan, (i, j, x))):
            return "a current or the position is not a number"
        if abs(x) > m.position[-1]:
            ends = f"{m.position[0] * 1e3:.4g} ... {m.position[-1] * 1e3:.4g} mm"
            return f"position {format_quantity(x, 'm')} lies outside the map's {ends}"
        return f"{max(abs(i), abs(j)):.6g} A is beyond the map's end at {m.current_max:g} A"

    def _sentence(
        self, region: int, sizes: tuple[float, float], limits: tuple[tuple[float, ...], ...], relation: int | None
    ) -> str:
        how = "one side on" if relation is None else f"both sides on, {RELATIONS[relation]}"
        level = 0 if region != UNACCEPTABLE else -1
        side = int(np.argmax([size - bears[level] for size, bears in zip(sizes, limits, strict=True)]))
        bears = limits[side][level]
        where = f"{self.pair_map.levels[level]:g} T in its iron or the armature"
        if region == PREFERRED:
            return f"{how}: side {side + 1} bears {bears:.4g} A below {where}"
        if bears < 0:
            return f"{how}: the current of side {2 - side} alone may bring {where.replace('its iron or ', '')}"
        return f"{how}: above the {bears:.4g} A that side {side + 1} bears below {where}"
