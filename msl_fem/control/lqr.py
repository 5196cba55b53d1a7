"""The linear-quadratic regulator with the integral of the tracking error as an added state.

Discrete at the loop rate, with the drive's lag and the computation delay among the states (Franklin, Powell, Workman,
Digital Control of Dynamic Systems, 3rd ed., ch. 9: discrete LQR; ch. 8.5: integral control; Gutierrez and Ro 1998).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.control.believed_plant import BelievedPlant
from msl_fem.errors import ComputationError

Array = NDArray[np.float64]
_DOUBLINGS = 60


@dataclass(frozen=True)
class Weights:
    """Weights of the cost, made dimensionless: sum of x^2 + (v/w)^2 q_v^2 + (w int e dt)^2 q_i^2 + (u/(m w^2))^2.

    Attributes
    ----------
    frequency : w in rad/s, where inertia force and position weigh the same: the larger, the stiffer the loop
    velocity, integral : q_v and q_i; an integral weight of 0 leaves the integral out
    """

    frequency: float
    velocity: float
    integral: float


@dataclass(frozen=True, eq=False)
class LqrGains:
    """u = -state . xi - integral * z, with xi of `BelievedPlant.sampled` and z[k+1] = z[k] + position error.

    Attributes
    ----------
    state : (n_state,), N per unit of each state
    integral : N/m, of the sum of the errors over samples
    """

    state: Array
    integral: float


def lqr_gains(plant: BelievedPlant, weights: Weights) -> LqrGains:
    """The gains that minimise the cost of `Weights` on the believed plant.

    Raises
    ------
    ComputationError : the Riccati equation has no stabilising solution
    """
    model = plant.sampled()
    n, w = model.A.shape[0], weights.frequency
    size = n + 1 if weights.integral else n  # an integral without weight could not be seen by the cost
    a, b, cost = np.eye(size), np.zeros((size, 1)), np.zeros((size, size))
    a[:n, :n], b[:n] = model.A, model.B
    cost[0, 0], cost[1, 1] = 1.0, (weights.velocity / w) ** 2
    if weights.integral:
        a[n, 0] = 1.0
        cost[n, n] = (weights.integral * w * plant.period) ** 2
    effort = 1.0 / (plant.mass * w**2) ** 2
    p = riccati(a, b @ b.T, cost / effort)
    if p is None:
        raise ComputationError(
            f"the regulator's Riccati equation has no stabilising solution at {weights}; change the wish"
        )
    gain = np.linalg.solve(np.eye(1) + b.T @ p @ b, b.T @ p @ a)[0]
    return LqrGains(gain[:n], float(gain[n]) if weights.integral else 0.0)


def riccati(a: Array, g: Array, h: Array) -> Array | None:
    """The stabilising X = A' X (I + G X)^-1 A + H of a discrete Riccati equation, G = B R^-1 B'; None without it.

    The structure-preserving doubling algorithm (Chu, Fan, Lin, Wang, Int. J. Control 77, 2004) converges quadratically
    and takes a singular A, which delays bring. SciPy's general solver may start threads for matrices of this size in
    its triangular solve, which is most of the time of a search that calls it hundreds of times.
    """
    one = np.eye(a.shape[0])
    with np.errstate(all="ignore"):
        for _ in range(_DOUBLINGS):
            try:
                w = np.linalg.solve(one + g @ h, np.hstack([a, g]))
            except np.linalg.LinAlgError:
                return None
            wa, wg = w[:, : a.shape[0]], w[:, a.shape[0] :]
            step = a.T @ h @ wa
            a, g, h = a @ wa, g + a @ wg @ a.T, h + 0.5 * (step + step.T)
            if not np.isfinite(h).all():
                return None
            if np.abs(step).max() <= 1e-14 * np.abs(h).max():
                return h
    return None
