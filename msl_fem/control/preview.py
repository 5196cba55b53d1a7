"""The reference as the feedforward needs it: what is wanted now, and what is wanted when the command acts.

A command acts a lead later: delay, half the hold, lag of the drive. A reference that is known ahead is read there, from
its samples; the force m r'' + c r' + k r taken as a whole at the lead passes the drive without a peak (preview control:
Tomizuka, ASME J. Dynamic Systems 97, 1975). Without preview the reference is carried on from its derivatives of now,
r + lead r' + lead^2 r''/2, and r'' stays behind: above the natural frequency the response then rises.
"""

import numpy as np

from msl_fem.computing.arrays import Array

_JUMP = 0.02  # of half the reference's span: what a smooth interval's position may miss
_KINK = 0.25  # of its largest speed


def known_ahead(samples: Array, *, period: float, lead: float) -> Array:
    """(n, 3) position, velocity, acceleration a lead (s) after each of the samples (n, 3), `period` s apart.

    Between samples they follow the polynomial of fifth order through both ends' values (Hermite). An interval whose
    ends do not fit together holds a jump: the values before it are carried on, so that it comes with its sample. So
    are the last ones behind the end.
    """
    n = samples.shape[0]
    node = np.minimum(np.arange(n) + int(lead / period * (1 + 1e-12)), n - 1)
    late = (np.arange(n) - node) * period + lead
    out = carried_on(samples[node], late)
    between = np.flatnonzero((node < n - 1) & np.append(smooth_intervals(samples, period), False)[node])
    start = samples[node[between]]
    end = samples[node[between] + 1]
    out[between] = _hermite(start, end, late[between] / period, period)
    return out


def carried_on(samples: Array, lead: float | Array) -> Array:
    """(n, 3) position, velocity, acceleration a lead (s) later, where the acceleration stays."""
    r, v, a = samples.T
    return np.stack([r + lead * (v + 0.5 * lead * a), v + lead * a, a], axis=1)


def smooth_intervals(samples: Array, period: float) -> Array:
    """(n - 1,) whether the intervals' ends fit together by the corrected trapezoidal rule."""
    r, v, a = samples.T
    by_speed = 0.5 * period * (v[1:] + v[:-1]) - period**2 / 12 * np.diff(a)
    missed = np.abs(np.diff(r) - by_speed)
    missed_speed = np.abs(np.diff(v) - 0.5 * period * (a[1:] + a[:-1]))
    whole = missed <= _JUMP * 0.5 * np.ptp(r)
    return np.asarray(whole & (missed_speed <= _KINK * np.abs(v).max()))


def _hermite(start: Array, end: Array, share: Array, period: float) -> Array:
    """(m, 3) of the polynomials of fifth order at shares (m,) of their intervals."""
    s = share[:, None]
    scale = np.array([1.0, period, period**2])
    first, last = start * scale, end * scale
    constant = first * [1.0, 1.0, 0.5]
    rest = last - np.stack([constant.sum(1), constant[:, 1] + 2 * constant[:, 2], 2 * constant[:, 2]], axis=1)
    # s^3, s^4, s^5 with value, slope and curvature `rest` at s = 1
    high = rest @ np.array([[10.0, -15.0, 6.0], [-4.0, 7.0, -3.0], [0.5, -1.0, 0.5]])
    c = np.hstack([constant, high])
    powers = np.arange(6)
    values = [(c * s**powers).sum(1)]
    values.append((c[:, 1:] * powers[1:] * s ** powers[:-1]).sum(1))
    values.append((c[:, 2:] * (powers[2:] * powers[1:-1]) * s ** powers[:-2]).sum(1))
    return np.stack(values, axis=1) / scale
