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
BUCKETS = round(HIGHEST / SPACING)  # of an analytic curve each is one piece
Indices = NDArray[np.int64]


class Curves(NamedTuple):
    """The curves of several irons, one after the other.

    Attributes
    ----------
    start : (n_iron + 1,) where each iron's points begin
    b, h, slope : (n_point,) T, A/m and A/(m T); between two points H is the cubic of these values and slopes
    tail : (n_iron, 4) B, H, dJ/dH and J_s where the points end, see `Iron`
    bucket : (n_iron, BUCKETS) the last point at or below each of as many equal parts of the curve's range
    per_tesla : (n_iron,) such parts
    """

    start: Indices
    b: Array
    h: Array
    slope: Array
    tail: Array
    bucket: Indices
    per_tesla: Array


def curves_of(irons: "Sequence[Iron | AnalyticIron]") -> Curves:
    """The irons' curves: those of points exactly, analytic ones to 1e-9 of H."""
    points = [_points(iron) for iron in irons]
    start = np.cumsum([0, *(b.size for b, _, _ in points)])
    b, h, slope = (np.concatenate([one[k] for one in points]) for k in range(3))
    last = start[1:] - 1
    susceptibility = np.maximum(1 / slope[last] - MU_0, 0.0)
    saturation = b[last] - MU_0 * h[last] + susceptibility * h[last]
    tail = np.column_stack([b[last], h[last], susceptibility, saturation])
    per_tesla = BUCKETS / np.minimum(b[last], HIGHEST)
    bucket = [
        first + np.searchsorted(one[0], np.arange(BUCKETS) / each, side="right") - 1
        for first, one, each in zip(start, points, per_tesla, strict=False)
    ]
    return Curves(start, b, h, slope, tail, np.stack(bucket), per_tesla)


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
def magnetise_all(b: Array, iron: Indices, curves: Curves, h: Array, slope: Array) -> None:
    """H and dH/dB (n,) of irons (n,) at |B| (n,), as `Iron.magnetise`, written.

    A loop in one function: a call at every point would count references to the curves' arrays there.
    """
    start, points, values, slopes, tail = curves.start, curves.b, curves.h, curves.slope, curves.tail
    bucket, per_tesla = curves.bucket, curves.per_tesla
    for n in range(b.size):
        k, x = iron[n], b[n]
        if x > tail[k, 0]:
            half = (x - tail[k, 3]) / (2 * MU_0)
            pull = tail[k, 2] * tail[k, 1] ** 2
            h[n] = half + np.sqrt(half**2 + pull / MU_0)
            slope[n] = 1.0 / (MU_0 + pull / h[n] ** 2)
            continue
        low = bucket[k, min(int(x * per_tesla[k]), BUCKETS - 1)]
        while low < start[k + 1] - 2 and points[low + 1] <= x:
            low += 1
        width = points[low + 1] - points[low]
        t = (x - points[low]) / width
        rise = (values[low + 1] - values[low]) / width
        # Hermite's cubic: value and slope at both ends
        bend = 3 * rise - 2 * slopes[low] - slopes[low + 1]
        twist = slopes[low] + slopes[low + 1] - 2 * rise
        h[n] = values[low] + width * t * (slopes[low] + t * (bend + t * twist))
        slope[n] = slopes[low] + t * (2 * bend + 3 * t * twist)
