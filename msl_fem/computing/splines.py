"""Splines by numpy alone: a look-up in a table or a map does not wait for scipy's interpolation to be imported.

The formulas and the conditions at the ends are those of scipy.interpolate, to rounding.
"""

import numpy as np

from msl_fem.computing.arrays import Array


def b_splines(knots: Array, degree: int, x: Array, derivative: int = 0) -> Array:
    """(n_x, n_knot - degree - 1) a derivative of the B-splines of the knots, by Cox and de Boor's recursion."""
    if derivative:
        lower = degree * b_splines(knots, degree - 1, x, derivative - 1)
        span = knots[degree:] - knots[:-degree]
        quotient = np.divide(lower, span, out=np.zeros_like(lower), where=span > 0)
        return quotient[:, :-1] - quotient[:, 1:]
    last = np.searchsorted(knots, knots[-1]) - 1  # the last interval of some width is closed
    cell = np.minimum(np.searchsorted(knots, x, side="right") - 1, last)
    values = (np.arange(knots.size - 1) == cell[:, None]).astype(float)
    for k in range(1, degree + 1):
        span = knots[k:] - knots[:-k]
        share = np.divide(x[:, None] - knots[:-k], span, out=np.zeros((x.size, span.size)), where=span > 0)
        values = share[:, :-1] * values[:, :-1] + np.where(span[1:] > 0, 1 - share[:, 1:], 0.0) * values[:, 1:]
    return values


def spline_derivative(x: Array, y: Array, at: Array, order: int = 1, *, degree: int) -> Array:
    """(n_at,) a derivative of the interpolating spline of a degree below n_x, not-a-knot."""
    inner = x if degree % 2 else (x[1:] + x[:-1]) / 2
    ends = (degree + 1) // 2
    knots = np.r_[np.full(degree + 1, x[0]), inner[ends:-ends], np.full(degree + 1, x[-1])]
    return b_splines(knots, degree, at, order) @ np.linalg.solve(b_splines(knots, degree, x), y)


def monotone_slopes(x: Array, y: Array) -> Array:
    """(n,) slopes of the monotone cubic of Fritsch and Carlson (SIAM J. Numer. Anal. 17 (1980) 238)."""
    h, chord = np.diff(x), np.diff(y) / np.diff(x)
    if x.size == 2:
        return np.repeat(chord, 2)
    slopes = np.zeros_like(y)
    before, after = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    same = chord[:-1] * chord[1:] > 0
    mean = before / np.where(same, chord[:-1], 1.0) + after / np.where(same, chord[1:], 1.0)
    slopes[1:-1] = np.where(same, (before + after) / np.where(same, mean, 1.0), 0.0)
    slopes[0] = _monotone_end(h[0], h[1], chord[0], chord[1])
    slopes[-1] = _monotone_end(h[-1], h[-2], chord[-1], chord[-2])
    return slopes


def _monotone_end(h0: float, h1: float, chord0: float, chord1: float) -> float:
    slope = ((2 * h0 + h1) * chord0 - h0 * chord1) / (h0 + h1)
    if np.sign(slope) != np.sign(chord0):
        return 0.0
    return 3 * chord0 if np.sign(chord0) != np.sign(chord1) and abs(slope) > 3 * abs(chord0) else float(slope)


def cubic_slopes(x: Array, y: Array, *, natural: bool) -> Array:
    """(n,) slopes of the cubic spline, natural or not-a-knot."""
    h, chord, n = np.diff(x), np.diff(y) / np.diff(x), x.size
    if n == 2:
        return np.repeat(chord, 2)
    if n == 3 and not natural:  # a parabola
        curvature = (chord[1] - chord[0]) / (x[2] - x[0])
        return chord[0] + curvature * (2 * x - x[0] - x[1])
    matrix, right = np.zeros((n, n)), np.zeros(n)
    k = np.arange(1, n - 1)
    matrix[k, k - 1], matrix[k, k], matrix[k, k + 1] = h[1:], 2 * (h[:-1] + h[1:]), h[:-1]
    right[k] = 3 * (h[1:] * chord[:-1] + h[:-1] * chord[1:])
    for end, near, (h0, h1), (c0, c1) in ((0, 1, h[:2], chord[:2]), (-1, -2, h[:-3:-1], chord[:-3:-1])):
        if natural:
            matrix[end, [end, near]], right[end] = (2.0, 1.0), 3 * c0
        else:
            matrix[end, [end, near]] = h1, h0 + h1
            right[end] = ((h0 + 2 * (h0 + h1)) * h1 * c0 + h0**2 * c1) / (h0 + h1)
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def akima_slopes(x: Array, y: Array, *, modified: bool) -> Array:
    """(n,) slopes of Akima's cubic (J. ACM 17 (1970) 589), or of the one modified against overshoot."""
    chord = np.diff(y) / np.diff(x)
    if x.size == 2:
        return np.repeat(chord, 2)
    m = np.r_[0.0, 0.0, chord, 0.0, 0.0]
    m[1] = 2 * m[2] - m[3]
    m[0] = 2 * m[1] - m[2]
    m[-2] = 2 * m[-3] - m[-4]
    m[-1] = 2 * m[-2] - m[-3]
    weight = np.abs(np.diff(m)) + (0.5 * np.abs(m[1:] + m[:-1]) if modified else 0.0)
    left, right = weight[2:], weight[:-2]
    known = left + right > 1e-9 * (left + right).max()
    total = np.where(known, left + right, 1.0)
    return np.where(known, (left * m[1:-2] + right * m[2:-1]) / total, 0.5 * (m[3:] + m[:-3]))


def hermite_cubic(ends: tuple[Array, Array], slopes: tuple[Array, Array], t: float | Array) -> Array:
    """The cubic through two values with their slopes, at t: 0 is the first one, 1 the second one.

    Parameters
    ----------
    ends, slopes : two arrays of one shape each; slopes per unit of t
    t : one, or an array that fits them
    """
    rise = t * t * (3.0 - 2.0 * t)
    first, second = t * (1.0 - t) ** 2, t * t * (t - 1.0)
    return np.asarray(ends[0] + (ends[1] - ends[0]) * rise + slopes[0] * first + slopes[1] * second)
