"""B(H), dB/dH and the coenergy density of irons and stacks of sheets, for compiled code.

A curve is H(B) as cubics between points with the saturation tail (`materials.curves`). It is inverted point
by point, and its energy is the cubics' own integral: coenergy, flux density and slope belong to one another to
rounding, so that a force can be the exact derivative of the coenergy.

A stack of sheets in planes of constant z fills a share s of its depth. In the plane of the sheets H is the same in
sheet and insulation, across them B_z is (e.g. Bergqvist and Engdahl, IEEE Trans. Magn. 36, 2000); with a and b for
H_z in sheet and insulation the coenergy density of the stack is

    w*(H) = min over s a + (1 - s) b = H_z of s w*_iron(H_x, H_y, a) + (1 - s) mu_0 (H_x^2 + H_y^2 + b^2)/2,

convex as the parts are.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.materials.constants import MU_0
from msl_fem.materials.curves import curves_of
from msl_fem.materials.material import AnalyticIron, Iron


class CoenergyCurves(NamedTuple):
    """Curves of several irons, one after the other.

    Attributes
    ----------
    start : (n_iron + 1,) where each iron's points begin
    b, h, slope, energy : (n_point,) T, A/m, A/(m T), J/m3
    tail : (n_iron, 2) dJ/dH at the last point and J_s, see `Iron`
    stacking : (n_iron,) share of iron over the stack's depth
    """

    start: NDArray[np.int64]
    b: Array
    h: Array
    slope: Array
    energy: Array
    tail: Array
    stacking: Array


def coenergy_curves(irons: Sequence[tuple[Iron | AnalyticIron, float]]) -> CoenergyCurves:
    """The curves of irons themselves (not of their stacks) with the stacking factor of each."""
    curves = curves_of([iron for iron, _ in irons])
    energy = []
    for begin, end in zip(curves.start[:-1], curves.start[1:], strict=True):
        b, h, slope = (values[begin:end] for values in (curves.b, curves.h, curves.slope))
        width = np.diff(b)
        rise = width * (h[1:] + h[:-1]) / 2 + width**2 * (slope[:-1] - slope[1:]) / 12
        energy.append(np.r_[0.0, np.cumsum(rise)])
    stacking = np.array([s for _, s in irons])
    tail = np.ascontiguousarray(curves.tail[:, 2:])
    return CoenergyCurves(curves.start, curves.b, curves.h, curves.slope, np.concatenate(energy), tail, stacking)


@compiled
def flux_density_at(h: float, iron: int, curves: CoenergyCurves) -> tuple[float, float, float]:
    """|B| in T, dB/dH in H/m and the coenergy density in J/m3 of an iron at |H| in A/m."""
    low, high = curves.start[iron], curves.start[iron + 1] - 1
    if h >= curves.h[high]:
        end, pull = curves.h[high], curves.tail[iron, 0] * curves.h[high] ** 2
        b = MU_0 * h + curves.tail[iron, 1] - pull / h
        more = MU_0 * (h * h - end * end) / 2 + curves.tail[iron, 1] * (h - end) - pull * np.log(h / end)
        return b, MU_0 + pull / h**2, end * curves.b[high] - curves.energy[high] + more
    while high - low > 1:
        middle = (low + high) // 2
        if curves.h[middle] <= h:
            low = middle
        else:
            high = middle
    width = curves.b[high] - curves.b[low]
    rise = (curves.h[high] - curves.h[low]) / width
    first = curves.slope[low]
    bend = 3 * rise - 2 * first - curves.slope[high]
    twist = first + curves.slope[high] - 2 * rise
    target = (h - curves.h[low]) / width
    least, most = 0.0, 1.0
    t = target / rise
    for _ in range(60):
        excess = t * (first + t * (bend + t * twist)) - target
        if excess > 0:
            most = t
        else:
            least = t
        step = excess / (first + t * (2 * bend + 3 * t * twist))
        t -= step
        if not least <= t <= most:
            t = (least + most) / 2
        elif abs(step) <= 1e-15:
            break
    b = curves.b[low] + width * t
    inside = curves.h[low] * t + width * t * t * (first / 2 + t * (bend / 3 + t * twist / 4))
    energy = curves.energy[low] + width * inside
    return b, 1.0 / (first + t * (2 * bend + 3 * t * twist)), h * b - energy


@compiled
def _across(h_plane: float, h_across: float, iron: int, curves: CoenergyCurves) -> float:
    """H_z >= 0 in the sheets where that of the stack is `h_across` >= 0, by safeguarded Newton."""
    share = curves.stacking[iron]
    least, most = 0.0, h_across
    b, slope, _ = flux_density_at(h_plane, iron, curves)
    secant = b / h_plane if h_plane > 0 else slope
    a = MU_0 * h_across / ((1 - share) * secant + share * MU_0)
    for _ in range(80):
        size = np.sqrt(h_plane**2 + a**2)
        if size == 0.0:
            break
        b, slope, _ = flux_density_at(size, iron, curves)
        secant = b / size
        excess = secant * a - MU_0 * (h_across - share * a) / (1 - share)
        if excess > 0:
            most = a
        else:
            least = a
        step = excess / (secant + (slope - secant) * (a / size) ** 2 + MU_0 * share / (1 - share))
        a -= step
        if not least <= a <= most:
            a = (least + most) / 2
        elif abs(step) <= 1e-14 * a:
            break
    return a


@compiled
def respond(field: Array, iron: int, curves: CoenergyCurves, flux: Array, tangent: Array) -> float:
    """Coenergy density in J/m3 at H (3,); B (3,) and dB/dH (xx, yy, zz, xy, xz, yz) are written into the last two.

    `iron` is -1 in air. Where H vanishes dB/dH is isotropic.
    """
    x, y, z = field[0], field[1], field[2]
    if iron < 0:
        for k in range(3):
            flux[k], tangent[k], tangent[3 + k] = MU_0 * field[k], MU_0, 0.0
        return MU_0 * (x * x + y * y + z * z) / 2
    share = curves.stacking[iron]
    a = z
    if share < 1.0 and z != 0.0:
        a = np.sign(z) * _across(np.sqrt(x * x + y * y), abs(z), iron, curves)
    size = np.sqrt(x * x + y * y + a * a)
    b, slope, coenergy = flux_density_at(size, iron, curves)
    secant = b / size if size > 0 else slope
    more = (slope - secant) / size**2 if size > 0 else 0.0
    flux[0], flux[1], flux[2] = secant * x, secant * y, secant * a
    tangent[0], tangent[1], tangent[2] = secant + more * x * x, secant + more * y * y, secant + more * a * a
    tangent[3], tangent[4], tangent[5] = more * x * y, more * x * a, more * y * a
    if share == 1.0:
        return coenergy
    rest = 1 - share
    stiff = tangent[2] + MU_0 * share / rest
    xx, yy, zz, xy, xz, yz = tangent[0], tangent[1], tangent[2], tangent[3], tangent[4], tangent[5]
    flux[0], flux[1] = share * flux[0] + rest * MU_0 * x, share * flux[1] + rest * MU_0 * y
    tangent[0] = share * (xx - xz * xz / stiff) + rest * MU_0
    tangent[1] = share * (yy - yz * yz / stiff) + rest * MU_0
    tangent[2] = zz * MU_0 / rest / stiff
    tangent[3] = share * (xy - xz * yz / stiff)
    tangent[4] = share * xz * MU_0 / rest / stiff
    tangent[5] = share * yz * MU_0 / rest / stiff
    gap = (z - share * a) / rest
    return share * coenergy + rest * MU_0 * (x * x + y * y + gap * gap) / 2
