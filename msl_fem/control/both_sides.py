"""What the map of a pair allows a controller: both sides' currents together, at the armature's position."""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.maps.guard import UNACCEPTABLE
from msl_fem.maps.pair_guard import PairGuard, PairGuardArrays, pair_limit_at, pair_region_of
from msl_fem.maps.pair_limits import RELATIONS

_APART = -1
_ROUNDING = 1.0 - 1e-12  # what is cut to a limit stays below it after divisions by a share, at a rounded position


class BothSides(NamedTuple):
    """The guard of a pair as the compiled controller needs it.

    Attributes
    ----------
    guard : its arrays; limits are of one magnet
    relation : how positive currents of the sides meet, an index into `pair_limits.RELATIONS`; -1 where no map of a
        pair is known and each side is judged alone
    """

    guard: PairGuardArrays
    relation: int


JUDGED_APART = BothSides(PairGuardArrays(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.zeros((1, 1, 1, 1))), _APART)


def both_sides_of(guard: PairGuard | None, *, sides: int, levels: Array) -> BothSides:
    """What a controller takes of the guard of a pair, beside the map of each side with these levels (n_level,) in T.

    Raises
    ------
    InputError : an actuator with one side; a pair's map of other levels
    """
    if guard is None:
        return JUDGED_APART
    record = guard.pair_map
    if sides < 2:
        raise InputError("the map of a pair judges two sides and the actuator has one; give the map of its magnet")
    if not np.array_equal(record.levels, levels):
        stated = [", ".join(f"{level:g}" for level in one) for one in (record.levels, levels)]
        raise InputError(
            f"the pair's map has the levels {stated[0]} T and the map of one side {stated[1]} T; make both with the "
            "same --levels"
        )
    return BothSides(guard.arrays, RELATIONS.index(record.polarity))


@compiled
def limit_alone(both: BothSides, level: int, toward: float) -> float:
    """The current (A) of a magnet whose side is on alone, the armature `toward` it in m; inf where no pair is known.

    Below 0 where there is none, nan outside the map.
    """
    if both.relation < 0:
        return np.inf
    return float(_ROUNDING * pair_limit_at(both.guard, both.relation, level, toward, 0.0))


@compiled
def judged_together(both: BothSides, now: float, coming: float, magnet: Array) -> int:
    """The region of both magnets' currents (2,) in A, which are cut where the last level forbids them: UNACCEPTABLE.

    Judged at the armature's position now and at the one to come, in m; at the first alone where the map ends before
    the other. First the larger current is cut to what its side bears at the other one's, then the other one; where
    that does not do, the smaller one is switched off.
    """
    if not both.guard.position <= now <= both.guard.position_end:
        magnet[0] = magnet[1] = 0.0
        return UNACCEPTABLE
    if not both.guard.position <= coming <= both.guard.position_end:
        coming = now
    region = _worse(both, now, coming, magnet)
    if region != UNACCEPTABLE:
        return region
    larger = 0 if magnet[0] >= magnet[1] else 1
    for k in range(2):
        side = larger if k == 0 else 1 - larger
        magnet[side] = min(magnet[side], _ROUNDING * _borne(both, now, coming, side, magnet[1 - side]))
    if _worse(both, now, coming, magnet) == UNACCEPTABLE:
        magnet[1 - larger] = 0.0
        magnet[larger] = min(magnet[larger], _ROUNDING * _borne(both, now, coming, larger, 0.0))
        if _worse(both, now, coming, magnet) == UNACCEPTABLE:
            magnet[larger] = 0.0
    return UNACCEPTABLE


@compiled
def _borne(both: BothSides, now: float, coming: float, side: int, other: float) -> float:
    """The current of a magnet up to which the last level is not reached at either position; 0 where there is none."""
    last = both.guard.limit.shape[1] - 1
    sign = 1.0 if side == 0 else -1.0
    bears = pair_limit_at(both.guard, both.relation, last, sign * now, other)
    later = pair_limit_at(both.guard, both.relation, last, sign * coming, other)
    if not (bears > 0.0 and later > 0.0):
        return 0.0
    return float(min(bears, later))


@compiled
def _worse(both: BothSides, now: float, coming: float, magnet: Array) -> int:
    """The worse region of both positions."""
    other = magnet[1] if both.relation == 1 else -magnet[1]
    region = pair_region_of(both.guard, magnet[0], other, now)
    later = pair_region_of(both.guard, magnet[0], other, coming)
    return later if later > region else region
