"""Other curves through an iron's points: what the points leave open between them."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from msl_fem.materials.material import AnalyticIron, Iron

Array = NDArray[np.float64]
PIECES = 8  # an interval between two points
FEWEST = 9  # points that may be thinned
THINNED_SHARE = 1 / 3
"""What half the points change, of that all points leave open: a smooth curve's error grows 16-fold, a kink's 4-fold."""


class OtherCurve(NamedTuple):
    """An iron that might as well be the one given, and the share of its difference that counts as error."""

    iron: Iron
    share: float


def other_curves(iron: Iron | AnalyticIron) -> tuple[OtherCurve, ...]:
    """Irons whose curves take other courses through the same points, or through half of them; none for a formula.

    The monotone cubics (Fritsch and Butland 1984) of H over B and of B over H, each continued as an odd function and
    sampled so densely that how the samples are joined no longer matters; and the iron's own course through every other
    point, which tells what the points' spacing is worth where all courses through all points are alike.
    """
    if isinstance(iron, AnalyticIron):
        return ()
    b, h = iron.flux_density, iron.field_strength
    fine_b, fine_h = _subdivided(b), _subdivided(h)
    found = [
        OtherCurve(replace(iron, flux_density=fine_b, field_strength=_odd_monotone(b, h, fine_b)), 1.0),
        OtherCurve(replace(iron, flux_density=_odd_monotone(h, b, fine_h), field_strength=fine_h), 1.0),
    ]
    if b.size >= FEWEST:
        for start in (1, 2):
            kept = np.unique(np.r_[0, np.arange(start, b.size, 2), b.size - 1])
            found.append(OtherCurve(replace(iron, flux_density=b[kept], field_strength=h[kept]), THINNED_SHARE))
    return tuple(found)


def _subdivided(points: Array) -> Array:
    share = np.arange(PIECES) / PIECES
    inner = points[:-1, None] + np.diff(points)[:, None] * share
    return np.r_[inner.ravel(), points[-1]]


def _odd_monotone(x: Array, y: Array, at: Array) -> Array:
    return np.asarray(PchipInterpolator(np.r_[-x[:0:-1], x], np.r_[-y[:0:-1], y])(at))
