"""H(B) of irons as plain arrays for compiled code: cubics between points, and the saturation tail."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import AnalyticIron, Iron

NO_FIELD = 1e-12  # T: below it H is taken as linear in B
HIGHEST, SPACING, BEYOND = 6.0, 2.5e-3, 1e4  # T: points of an analytic curve, and how far its last slope is held
Indices = NDArray[np.int64]


class Curves(NamedTuple):
    """The curves of several irons, one after the other.

    Attributes
    ----------
    start : (n_iron + 1,) where each iron's points begin
    b, h, slope : (n_point,) T, A/m and A/(m T); between two points H is the cubic of these values and slopes
    tail : (n_iron, 4) B, H, dJ/dH and J_s where the points end, see `Iron`
    """

    start: Indices
    b: Array
    h: Array
    slope: Array
    tail: Array


def curves_of(irons: "Sequence[Iron | AnalyticIron]") -> Curves:
    """The irons' curves: those of points exactly, analytic ones to 1e-9 of H."""
    points = [_points(iron) for iron in irons]
    start = np.cumsum([0, *(b.size for b, _, _ in points)])
    b, h, slope = (np.concatenate([one[k] for one in points]) for k in range(3))
    last = start[1:] - 1
    susceptibility = np.maximum(1 / slope[last] - MU_0, 0.0)
    saturation = b[last] - MU_0 * h[last] + susceptibility * h[last]
    return Curves(start, b, h, slope, np.column_stack([b[last], h[last], susceptibility, saturation]))


@lru_cache(maxsize=32)
def _points(iron: "Iron | AnalyticIron") -> tuple[Array, Array, Array]:
    """B, H and dH/dB at the points of a curve."""
    if isinstance(iron, Iron):
        return (iron.flux_density, *iron.magnetise(iron.flux_density))
    b = np.arange(0.0, HIGHEST + SPACING / 2, SPACING)
    h, slope = iron.magnetise(b)
    h, slope = np.array(h), np.array(slope)
    end = h[-1] + slope[-1] * (BEYOND - b[-1])
    return np.r_[b, BEYOND], np.r_[h, end], np.r_[slope, slope[-1]]


@compiled
def magnetise_at(
    b: float, iron: int, start: Indices, points: Array, values: Array, slopes: Array, tail: Array
) -> tuple[float, float]:
    """H and dH/dB of an iron at |B|, as `Iron.magnetise`; the arrays are those of `Curves`."""
    if b > tail[iron, 0]:
        half = (b - tail[iron, 3]) / (2 * MU_0)
        pull = tail[iron, 2] * tail[iron, 1] ** 2
        h = half + np.sqrt(half**2 + pull / MU_0)
        return h, 1.0 / (MU_0 + pull / h**2)
    low, high = start[iron], start[iron + 1] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if points[middle] <= b:
            low = middle
        else:
            high = middle
    width = points[high] - points[low]
    t = (b - points[low]) / width
    rise = (values[high] - values[low]) / width
    # Hermite's cubic: value and slope at both ends
    bend = 3 * rise - 2 * slopes[low] - slopes[high]
    twist = slopes[low] + slopes[high] - 2 * rise
    h = values[low] + width * t * (slopes[low] + t * (bend + t * twist))
    return h, slopes[low] + t * (2 * bend + 3 * t * twist)
