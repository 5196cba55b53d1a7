"""A side's flux linkage, pull and slopes at a magnetising current and a gap, from the coenergy surface."""

import numpy as np

from msl_fem.bench.plant import IRON_NODES, Array, Magnets, SeriesIron, Surface
from msl_fem.computing.compiled import compiled

N = 6  # coefficients a direction of a cell


@compiled
def _below(nodes: Array, value: float) -> int:
    """The cell of a value between the nodes."""
    low, high = 0, nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if value < nodes[middle]:
            high = middle
        else:
            low = middle
    return low


@compiled
def side_magnet(t: Surface, m: Magnets, current: float, gap: float) -> tuple[bool, float, float, float, float]:
    """(inside the table, flux linkage Wb, pull N, dlambda/di H, dlambda/dgap Wb/m) of a side.

    The side's n magnets carry `share` of its current each: lambda = n share W'_i, F = -n W'_g, with W' the coenergy of
    one magnet; the slope of the flux over the gap is minus that of the pull over the current.
    """
    size = abs(m.share * current)
    if not (t.gap[0] <= gap <= t.gap[-1] and size <= t.current[-1]):
        return False, np.nan, np.nan, np.nan, np.nan
    a, b = _below(t.gap, gap), _below(t.current, size)
    y, x = gap - t.gap[a], size - t.current[b]
    w_i = w_ii = w_g = w_ig = w = 0.0
    for p in range(N - 1, -1, -1):
        c = t.coefficients[a, b, p]
        along = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
        along_i = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))
        along_ii = 2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))
        w_g = w_g * y + w
        w = w * y + along
        w_ig = w_ig * y + w_i
        w_i = w_i * y + along_i
        w_ii = w_ii * y + along_ii
    linked = m.per_side * m.share
    sign = -1.0 if current < 0 else 1.0
    return True, sign * linked * w_i, -m.per_side * w_g, linked * m.share * w_ii, sign * linked * w_ig


@compiled
def side_coenergy(t: Surface, m: Magnets, current: float, gap: float) -> float:
    """Coenergy of a side's magnets in J; the point lies inside the table."""
    size = abs(m.share * current)
    a, b = _below(t.gap, gap), _below(t.current, size)
    y, x = gap - t.gap[a], size - t.current[b]
    w = 0.0
    for p in range(N - 1, -1, -1):
        along = 0.0
        for q in range(N - 1, -1, -1):
            along = along * x + t.coefficients[a, b, p, q]
        w = w * y + along
    return m.per_side * w


@compiled
def series_current(iron: SeriesIron, flux: float) -> float:
    """Current in A that the iron takes beyond the table's at a flux linkage (Wb); straight on beyond the nodes.

    It stands in series with the table's magnet: at given flux the pull is that of the table, and the energy stored in
    the iron is the integral of this current over the flux, whatever the gap.
    """
    size = abs(flux)
    sign = -1.0 if flux < 0 else 1.0
    n = int(size / iron.step)
    if n >= IRON_NODES - 1:
        return sign * (iron.value[-1] + iron.slope[-1] * (size - iron.step * (IRON_NODES - 1)))
    s = size / iron.step - n
    v0, v1, d0, d1 = iron.value[n], iron.value[n + 1], iron.step * iron.slope[n], iron.step * iron.slope[n + 1]
    third, second = d0 + d1 - 2.0 * (v1 - v0), 3.0 * (v1 - v0) - 2.0 * d0 - d1
    return sign * (v0 + s * (d0 + s * (second + s * third)))
