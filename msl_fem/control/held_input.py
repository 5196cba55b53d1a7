"""Sampled motions whose held input acts late: by a part of a sample, by whole ones."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace


def late_hold(a: Array, b: Array, period: float, late: float) -> StateSpace:
    """Position of a motion x' = a x + b u whose held input acts `late` s, less than a period, after its sample.

    Where it is late the last state is the input before (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed.,
    sec. 2.3).
    """
    n = a.shape[0]
    if not late:
        return StateSpace(a, b, np.eye(1, n), np.zeros((1, 1))).sampled(period)
    whole = StateSpace(a, b, np.eye(n), np.zeros((n, 1)))
    rest, begun = whole.sampled(period - late), whole.sampled(late)
    moved = np.block([[rest.A @ begun.A, rest.A @ begun.B], [np.zeros((1, n + 1))]])
    return StateSpace(moved, np.vstack([rest.B, [[1.0]]]), np.eye(1, n + 1), np.zeros((1, 1)), period)


def delayed_hold(a: Array, b: Array, period: float, late: float, delay: int) -> StateSpace:
    """`late_hold` of any `late` s, and `delay` samples more: whole periods are samples of the delay."""
    whole = int(late // period)
    return with_delay(late_hold(a, b, period, late - whole * period), delay + whole)


def with_delay(moving: StateSpace, delay: int) -> StateSpace:
    """A sampled motion whose input acts `delay` samples later: further states are the queue, the next to act first."""
    n = moving.A.shape[0]
    a = np.zeros((n + delay, n + delay))
    b = np.zeros((n + delay, 1))
    a[:n, :n] = moving.A
    if delay:
        a[:n, n : n + 1] = moving.B
        a[n : n + delay - 1, n + 1 :] = np.eye(delay - 1)
        b[-1] = 1.0
    else:
        b[:] = moving.B
    return StateSpace(a, b, np.eye(1, n + delay), np.zeros((1, 1)), moving.sampling_period)
