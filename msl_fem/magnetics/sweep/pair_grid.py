"""Where both sides are solved: default positions and currents, checks of given ones, the one-sided table's grid."""

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import CLOSEST
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.sweep.table_sweep import default_grid, drive_limit

DEFAULT_POSITIONS, DEFAULT_CURRENTS = 19, 16
"""Of the whole travel, and of one sign of a current, 0 included."""
_DENSER_ENDS, _PROBED, _TRIED = 0.4, 33, (0.0, 0.4, 0.8, 1.0)
_EVEN = 0.3


def default_pair_grid(actuator: Actuator) -> tuple[Array, Array]:
    """Positions (m), the same on both sides of the middle, and currents (A) of both signs.

    The positions leave the gaps of `default_grid` and are a little denser at the ends. The currents are denser where
    opposing ones saturate the armature, see `_about_the_knee`.

    Raises
    ------
    InputError : the actuator states no nominal gap, range or current limit
    """
    gaps, _ = default_grid(actuator)
    motion = actuator.motion
    assert motion is not None
    assert motion.nominal_gap is not None
    largest = min(motion.nominal_gap - gaps[0], gaps[-1] - motion.nominal_gap)
    share = np.linspace(-1, 1, DEFAULT_POSITIONS)
    positions = largest * share * (1 + _DENSER_ENDS * (1 - np.abs(share)))
    limit = drive_limit(actuator)
    assert limit is not None
    tried = largest * np.array(_TRIED)
    return positions, _about_the_knee(actuator, motion.nominal_gap, tried, limit)


@one_blas_thread
def _about_the_knee(actuator: Actuator, gap: float, positions: Array, limit: float) -> Array:
    """Currents from 0 to the limit (A), some evenly, most by the root of the flux linkage's curvature.

    That curvature is of equal opposing currents, its mean over the positions, from a few solutions on a coarse mesh:
    the interpolant's error is largest there. Rounded, so that a sweep that goes on finds its rows.
    """
    level = LEVELS["fast"]
    field = PairField(actuator, pair_mesh(pair_magnet(actuator), gap, "fast"), gap_sum=2 * gap, order=level.order)
    probe = limit * np.linspace(0.0, 1.0, _PROBED) ** 2
    density = np.full(_PROBED, _EVEN / limit)
    for position in positions:
        flux = _flux_of_opposing(field, float(position), probe)
        bend = np.sqrt(np.abs(np.gradient(np.gradient(flux, probe), probe)))
        density += bend / np.trapezoid(bend, probe) / len(positions)
    placed = np.r_[0.0, np.cumsum((density[1:] + density[:-1]) / 2 * np.diff(probe))]
    chosen = np.interp(np.linspace(0, placed[-1], DEFAULT_CURRENTS), placed, probe)
    return np.r_[0.0, np.round(chosen[1:-1] / limit, 3) * limit, limit]


def _flux_of_opposing(field: PairField, position: float, currents: Array) -> Array:
    """(n,) Wb of side 1 under equal opposing currents (n,) from 0 on, each field from the one before."""
    flux, potential = np.zeros(currents.size), None
    for n in range(1, currents.size):
        current = float(currents[n])
        solution = field.solve(position, current, -current, start=potential)
        flux[n] = field.scale * float(field.sources[0] @ solution.potential)
        responses, _ = field.responses(solution)
        step = currents[min(n + 1, currents.size - 1)] - current
        potential = solution.potential + (responses[1] - responses[2]) * step
    return flux


def half_of(values: ArrayLike) -> Array:
    """0 and the values without their signs, increasing; those that differ by rounding once."""
    sizes = np.unique(np.abs(np.r_[0.0, np.asarray(values, dtype=float)]))
    return sizes[np.r_[True, np.diff(sizes) > CLOSEST * sizes[-1]]]


def check_pair_grid(half_x: Array, half_i: Array, gap_sum: float) -> None:
    if not gap_sum > 0:
        raise InputError(f"both gaps together must be above 0, they are {gap_sum:g} m")
    bad = half_x[~(half_x < gap_sum / 2)]
    if bad.size:
        raise InputError(
            f"position {bad[0] * 1e3:g} mm leaves no gap; the armature moves less than half of both gaps together, "
            f"{gap_sum / 2 * 1e3:g} mm"
        )
    if half_x.size < 2 or half_i.size < 3:
        raise InputError(
            f"a table of a pair needs at least 1 position beside the middle and 2 currents beside 0; given are "
            f"{half_x.size - 1} and {half_i.size - 1}"
        )


def one_sided_grid(gaps: Array, half_i: Array) -> tuple[Array, Array]:
    """Gaps and currents of the one-sided table: the pair's own, and one or two between, as it carries the knee."""
    between = np.sqrt(gaps[1:] * gaps[:-1])
    root = np.sqrt(half_i)
    thirds = [(root[:-1] + share * np.diff(root)) ** 2 for share in (1 / 3, 2 / 3)]
    return np.unique(np.r_[gaps, between[: gaps.size // 2]]), np.unique(np.r_[half_i, *thirds])
