"""The linear-quadratic regulator and the reduced-order Kalman filter.

The regulator has the integral of the tracking error as an added state. Discrete at the loop rate, with the drive's lag
and the computation delay among the states (Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., ch.
9: discrete LQR; ch. 8.5: integral control; Gutierrez and Ro 1998).

The filter estimates velocity and disturbance force from the measured position. The position is taken as measured, only
what is not measured is estimated (Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 8.2.3):
with b = (velocity, disturbance) and known inputs s,

    x-[k+1] = Phi_xx y[k] + Phi_xb b[k] + Gamma_x s,     b-[k+1] = Phi_bx y[k] + Phi_bb b[k] + Gamma_b s
    nu[k+1] = y[k+1] - x-[k+1],                          b[k+1] = b-[k+1] + L nu[k+1]

The position noise n enters twice, in y[k+1] and in y[k], so nu is not white and the gain of the Riccati equation with
white noise is not the best. The error covariance is known exactly for any L: with e' = b - b_hat + L n,

    e'[k+1] = A_L e'[k] - (A_L L + Phi_bx - L Phi_xx) n[k] + (w_b - L w_x),    A_L = Phi_bb - L Phi_xb

has white noises alone. L is the gain of least velocity variance among all filters of this order (optimal reduced-order
estimation: Bernstein and Hyland, IEEE Trans. Automatic Control 30, 1985), found from the Riccati gain downhill.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.errors import ComputationError, InputError

_DOUBLINGS = 60


@dataclass(frozen=True)
class LqrWeights:
    """LqrWeights of the cost, made dimensionless: sum of x^2 + (v/w)^2 q_v^2 + (w int e dt)^2 q_i^2 + (u/(m w^2))^2.

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
    """u = -state . xi - integral * z, with xi of `LinearPlant.sampled` and z[k+1] = z[k] + position error.

    Attributes
    ----------
    state : (n_state,), N per unit of each state
    integral : N/m, of the sum of the errors over samples
    """

    state: Array
    integral: float


def lqr_gains(plant: LinearPlant, weights: LqrWeights) -> LqrGains:
    """The gains that minimise the cost of `LqrWeights` on the believed plant.

    Raises
    ------
    ComputationError : the Riccati equation has no stabilising solution
    """
    model = plant.sampled()
    n, w = model.A.shape[0], weights.frequency
    size = n + 1 if weights.integral else n  # an integral without weight could not be seen by the cost
    a = np.eye(size)
    b = np.zeros((size, 1))
    cost = np.zeros((size, size))
    a[:n, :n], b[:n] = model.A, model.B
    cost[0, 0] = 1.0
    cost[1, 1] = (weights.velocity / w) ** 2
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


_X = slice(0, 1)
_B = slice(1, 3)


@dataclass(frozen=True)
class FilterNoise:
    """One-sigma levels that the filter expects.

    Attributes
    ----------
    position : m, of a measurement
    force : N, error of the force over one sample, white
    disturbance : N, change of the disturbance force from one sample to the next
    """

    position: float
    force: float
    disturbance: float


@dataclass(frozen=True, eq=False)
class ReducedOrderFilter:
    """The filter of a believed plant.

    Attributes
    ----------
    prediction : (3, n) position, velocity and disturbance at the next sample, over (position, velocity, disturbance,
        then the states of the believed plant from the third on, then the command)
    gain : (2,) 1/s and N/m, of the innovation on velocity and disturbance
    covariance : (2, 2) of the errors of velocity and disturbance, stationary
    innovation_variance : m^2
    """

    prediction: Array
    gain: Array
    covariance: Array
    innovation_variance: float


class _FilterTask(NamedTuple):
    """The filter's matrices in units in which position, velocity and disturbance all count in m/s."""

    prediction: Array
    unit: Array  # (3,)
    phi: Array  # (3, 3)
    process: Array  # (3, 3)
    position_variance: float


def reduced_order_filter(plant: LinearPlant, noise: FilterNoise) -> ReducedOrderFilter:
    """The stationary filter of least velocity variance for the noise levels.

    Raises
    ------
    InputError : a noise level is not positive
    ComputationError : the Riccati equation of the first guess has no solution
    """
    from scipy.optimize import minimize  # scipy is imported where it is needed: that takes longer than a look-up

    task = _task(plant, noise)

    def logarithm_of_velocity_variance(gain: Array) -> float:
        stationary = _stationary(task.phi, gain, task.process, task.position_variance)
        return 1e9 if stationary is None else float(np.log(stationary[0][0, 0]))

    first = _riccati_gain(task.phi, task.process, task.position_variance)
    best = minimize(logarithm_of_velocity_variance, first, method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-9})
    return _filter(task, best.x, noise)


def filter_of_gain(plant: LinearPlant, gain: Array, noise: FilterNoise) -> ReducedOrderFilter:
    """The filter with a gain (2,) in 1/s and N/m, and what its errors are under the noise levels.

    Raises
    ------
    InputError : a noise level is not positive
    ComputationError : the filter is not stable
    """
    task = _task(plant, noise)
    return _filter(task, np.asarray(gain) * task.unit[0] / task.unit[1:], noise)


def _task(plant: LinearPlant, noise: FilterNoise) -> _FilterTask:
    for name in ("position", "force", "disturbance"):
        if not getattr(noise, name) > 0:
            raise InputError(f"the filter's {name} noise is {getattr(noise, name):g}; it must be positive")
    prediction = _prediction(plant)
    push = _held_force(plant)
    process = noise.force**2 * np.outer(push, push)
    process[2, 2] += noise.disturbance**2
    unit = np.array([plant.period, 1.0, plant.mass / plant.period])
    phi = prediction[:, :3] * unit / unit[:, None]
    process = process / np.outer(unit, unit)
    return _FilterTask(prediction, unit, phi, process, (noise.position / unit[0]) ** 2)


def _filter(task: _FilterTask, gain: Array, noise: FilterNoise) -> ReducedOrderFilter:
    stationary = _stationary(task.phi, gain, task.process, task.position_variance)
    if stationary is None:
        raise ComputationError(f"no stable filter for {noise}; raise the force noise or lower the position noise")
    unit = task.unit
    return ReducedOrderFilter(
        prediction=task.prediction,
        gain=gain * unit[1:] / unit[0],
        covariance=stationary[0] * np.outer(unit[1:], unit[1:]),
        innovation_variance=stationary[1] * unit[0] ** 2,
    )


def _prediction(plant: LinearPlant) -> Array:
    """Rows position, velocity, disturbance of the sampled plant with a constant disturbance force added."""
    model = plant.sampled()
    push = _held_force(plant)
    n = model.A.shape[0]
    rows = np.zeros((3, n + 2))
    rows[:2, :2], rows[:, 2] = model.A[:2, :2], push
    rows[2, 2] = 1.0
    rows[:2, 3 : n + 1] = model.A[:2, 2:]
    rows[:2, n + 1] = model.B[:2, 0]
    return rows


def _held_force(plant: LinearPlant) -> Array:
    """(3,) what a unit force on the mass, held over a sample, adds to position and velocity; the third entry is 0."""
    a, _ = plant.motion()
    b = np.array([[0.0], [1.0 / plant.mass]])
    held = StateSpace(a[:2, :2], b, np.eye(2), np.zeros((2, 1))).sampled(plant.period)
    return np.array([*held.B[:, 0], 0.0])


def _riccati_gain(phi: Array, process: Array, position_variance: float) -> Array:
    """The gain where the differenced noise is taken as white, of twice the variance and independent."""
    from scipy.linalg import solve_discrete_are

    r = np.array([[process[0, 0] + 2 * position_variance]])
    try:
        p = solve_discrete_are(phi[_B, _B].T, phi[_X, _B].T, process[_B, _B], r, s=process[_B, _X])
    except (np.linalg.LinAlgError, ValueError) as err:
        raise ComputationError(f"the filter's Riccati equation has no solution ({err})") from err
    gain = (phi[_B, _B] @ p @ phi[_X, _B].T + process[_B, _X]) / (phi[_X, _B] @ p @ phi[_X, _B].T + r)
    return np.asarray(gain[:, 0])


def _stationary(phi: Array, gain: Array, process: Array, position_variance: float) -> tuple[Array, float] | None:
    """Error covariance (2, 2) and innovation variance of the filter with a gain; None where it is not stable."""
    from scipy.linalg import solve_discrete_lyapunov

    column, r = gain[:, None], position_variance
    a = phi[_B, _B] - column @ phi[_X, _B]
    if np.abs(np.linalg.eigvals(a)).max() >= 1 - 1e-9:
        return None
    by_noise = a @ column + phi[_B, _X] - column @ phi[_X, _X]
    mix = np.hstack([-column, np.eye(2)])
    inner = solve_discrete_lyapunov(a, r * by_noise @ by_noise.T + mix @ process @ mix.T)
    innovation = phi[_X, _B] @ inner @ phi[_X, _B].T + process[0, 0] + r
    innovation += r * (phi[_X, _B] @ column + phi[_X, _X]) ** 2
    return inner + r * column @ column.T, float(innovation[0, 0])
