"""First-order poles solved exactly inside a step, whatever their bandwidth: sensor, drive, and the current loop.

y' = w (x - y) falls by exp(-w h) in a step h. Runge-Kutta, that sees three values of a signal in a step, would miss a
fall that is faster than the step; the values here stand for it: their sums are the signal's exact moments.

A current loop within its voltage limit makes the current a first-order lag of its target. Where the loop is fast
against the step (w h > `FAST`), the current is not integrated but known: u(s) = u_end(s) + f(s) (u(0) - u_end(0)), with
f(s) = exp(-z s), z = w h, or first a straight line where the limit acts, from which it goes over into the exponential.
Forces are nearly quadratic in the current. So the three values (b, m, e) of f have its integral, the integral of its
square, and that of (1 - s) f, which Runge-Kutta takes as (b + 4 m + e)/6, (b^2 + 4 m^2 + e^2)/6 and (b + 2 m)/6.

The loops of two coupled sides fall together, f' = -Z f, as the sum of two exponentials a side.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, Value, choose, exponential, larger, set_lane, square_root

FAST = 0.5
"""A step times a current loop's bandwidth above which its current is known and not integrated."""
_SMALL = 0.1  # below it moments by parts cancel, and a signal's values have them
_THIRD, _SIXTH = 1.0 / 3.0, 1.0 / 6.0
Four = tuple[Value, Value, Value, Value]


@compiled
def fall_rows(bandwidth: float, step: float, rows: Rows, start: int, lane: int) -> None:
    """Puts (begin, middle, end, last) of a fall exp(-w t) from 1 over a step into four rows from `start`.

    The first three have its integrals over 1, (1 - s) and (1 - s)^2 (`fall_stages`), of a slow fall they are its
    values; the last is what is left behind the step.
    """
    z = bandwidth * step
    last = np.exp(-z)
    begin, middle, end = 1.0, np.exp(-0.5 * z), last
    if z > _SMALL:
        m_0 = (1.0 - last) / z
        m_1 = (m_0 - last) / z
        m_2 = (2.0 * m_1 - last) / z
        begin, middle, end = 6.0 * (m_0 - 3.0 * m_1 + 2.0 * m_2), 6.0 * (m_1 - m_2), 6.0 * (2.0 * m_2 - m_1)
    set_lane(rows, start, lane, begin)
    set_lane(rows, start + 1, lane, middle)
    set_lane(rows, start + 2, lane, end)
    set_lane(rows, start + 3, lane, last)


@compiled
def lag_weights(bandwidth: float, step: float, rows: Rows, start: int, lane: int) -> None:
    """Puts the weights of (y0, x0, x0', x1, x1') in y1 of a lane into five rows from `start`.

    y' = w (x - y), x a cubic between: exact in time, so no bandwidth, however high, limits the integrator's step.
    With z = w step and I_k = z int_0^1 exp(-z (1 - s)) s^k ds: y1 = exp(-z) y0 + sum over Hermite's basis, whose
    powers of s give I_0 ... I_3. I_0 = 1 - exp(-z); by parts I_k = 1 - k I_(k-1)/z, run upwards for z > 1 and
    downwards from I_20 = 0 below, where the upward recursion cancels. An infinite bandwidth gives y1 = x1.
    """
    z = bandwidth * step
    decay = np.exp(-z)
    if z > 1.0:
        i_0 = 1.0 - decay
        i_1 = 1.0 - i_0 / z
        i_2 = 1.0 - 2.0 * i_1 / z
        i_3 = 1.0 - 3.0 * i_2 / z
    else:
        i_k = 0.0
        for k in range(20, 3, -1):
            i_k = z / k * (1.0 - i_k)
        i_3 = i_k
        i_2 = z / 3.0 * (1.0 - i_3)
        i_1 = z / 2.0 * (1.0 - i_2)
        i_0 = z * (1.0 - i_1)
    set_lane(rows, start, lane, decay)
    set_lane(rows, start + 1, lane, i_0 - 3.0 * i_2 + 2.0 * i_3)
    set_lane(rows, start + 2, lane, step * (i_1 - 2.0 * i_2 + i_3))
    set_lane(rows, start + 3, lane, 3.0 * i_2 - 2.0 * i_3)
    set_lane(rows, start + 4, lane, step * (i_3 - i_2))


@compiled
def mean_and_rise(begin: Value, middle: Value, end: Value) -> tuple[Value, Value]:
    """Of a signal over a step, by Simpson's rule."""
    return middle + (begin - 2.0 * middle + end) * _SIXTH, end - begin


@compiled
def fall_moments(z: Value, line: Value, corner: Value) -> Four:
    """(integral of f, of f^2, of s f over a step, f behind it) of a fall that is straight until s = `line`, where
    f = `corner`, and exponential from there; `line` 0 and `corner` 1 without a limit."""
    rest, per = 1.0 - line, 1.0 / z
    kept = exponential(0.0 - z * rest)
    m_0 = 0.5 * line * (1.0 + corner) + corner * (1.0 - kept) * per
    square = line * (1.0 + corner + corner * corner) * _THIRD + corner * corner * (1.0 - kept * kept) * (0.5 * per)
    straight = line * line * (1.0 + 2.0 * corner) * (0.5 * _THIRD)
    tail = line * (1.0 - kept) * per + (1.0 - kept * (1.0 + z * rest)) * (per * per)
    return m_0, square, straight + corner * tail, corner * kept


@compiled
def falls_together(z: Four, away_1: Value, away_2: Value) -> tuple[Value, Value, Four]:
    """(faster, slower rate, (p_1, q_1, p_2, q_2)) of f' = -Z f from (away_1, away_2), Z's rows (z_11, z_12) and (z_21,
    z_22): f_j = p_j exp(-faster s) + q_j exp(-slower s). Halves of the same where both rates are equal."""
    z_11, z_12, z_21, z_22 = z
    mean, half = 0.5 * (z_11 + z_22), 0.5 * (z_11 - z_22)
    apart = square_root(larger(half * half + z_12 * z_21, 0.0))
    over = choose(apart > 0.0, apart, 1.0)
    turned_1, turned_2 = (half * away_1 + z_12 * away_2) / over, (z_21 * away_1 - half * away_2) / over
    parts = 0.5 * (away_1 + turned_1), 0.5 * (away_1 - turned_1), 0.5 * (away_2 + turned_2), 0.5 * (away_2 - turned_2)
    return mean + apart, mean - apart, parts


@compiled
def moments_together(fast: Four, slow: Four, between: Value, p: Value, q: Value) -> Four:
    """Moments as of `fall_moments` of p times one fall and q times another, the integral of whose product is
    `between`."""
    square = p * p * fast[1] + q * q * slow[1] + 2.0 * p * q * between
    return p * fast[0] + q * slow[0], square, p * fast[2] + q * slow[2], p * fast[3] + q * slow[3]


@compiled
def fall_for_squares(m_0: Value, square: Value, m_s: Value, ends: Value) -> tuple[Value, Value, Value]:
    """(b, m, e) with the integrals of f, f^2 and (1 - s) f: m solves 12 m^2 - 24 m_0 m + ... = 0. `ends`, f(0) + f(1),
    says to which side f bends."""
    early = m_0 - m_s
    spread = m_0 * m_0 - 3.0 * (early * early + m_s * m_s) + 0.5 * square
    root = square_root(larger(spread, 0.0))
    middle = m_0 - choose(ends < 2.0 * m_0, 0.0 - root, root)
    return 6.0 * early - 2.0 * middle, middle, 6.0 * m_s - 2.0 * middle


@compiled
def slopes_of_fall(start: Value, m_0: Value, m_s: Value, last: Value) -> tuple[Value, Value, Value]:
    """(b, m, e) that stand for -f' over a step from f = `start`: its integrals over 1, (1 - s) and (1 - s)^2, by
    parts."""
    early = m_0 - m_s
    begin, middle = 6.0 * start + 6.0 * m_0 - 24.0 * early, 12.0 * early - 6.0 * m_0
    return begin, middle, 6.0 * (start - last) - begin - 4.0 * middle


@compiled
def answers_to_ends(z: Value, off: tuple[Value, Value]) -> tuple[Value, Value]:
    """(begin, end) of what a loop of z a step makes of a signal that is `off` at begin and end, without mean and first
    moment, but for what falls as exp(-z s): x - x'/z + x''/z^2 - x\'\'\'/z^3 of x = a P_2 + b P_3 over the step, with
    the polynomials of Legendre."""
    a, b, per = 0.5 * (off[0] + off[1]), 0.5 * (off[1] - off[0]), 1.0 / z
    even = per * per * (12.0 * a - 120.0 * b * per) - 12.0 * b * per
    odd = 6.0 * a * per - 60.0 * b * per * per
    return off[0] + even + odd, off[1] + even - odd


@compiled
def limited_line(way: Value, moved: Value, at_end: Value, z: Value) -> tuple[Value, Value]:
    """(share of the step in which the limit acts, what is left of `way` at its end) where a limited slope moves by
    `moved` in a whole step, and where it ceases to act by `at_end`; 2 where the limit acts all along, or drives the
    other way."""
    toward = 0.0 - moved / way  # share of the way in a whole step
    corner = 0.0 - at_end / (way * z)
    line = (1.0 - corner) / toward
    ends = (toward > 0.0) & (line < 1.0)
    return choose(ends, larger(line, 0.0), 2.0), choose(ends & (corner < 1.0), corner, 1.0)
