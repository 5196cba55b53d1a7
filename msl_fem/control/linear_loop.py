"""The closed loop near a frozen position, as linear sampled systems: sensitivity, stability, response to a reference.

Near a position x_0 that the magnets hold, a current's force grows by kappa = dF/dx with the position. The input
transformation takes this off again, but late, by way of the measured position: with u the linear law's force

    f = H (u - kappa x_used) + kappa x,      H: delay, hold and lag of the drive

so the loop is closed around m x'' + c x' + (k - kappa) x. It is opened at the command, where the plant has its input.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace, states_over_inputs
from msl_fem.control.controller import NO_SHAPE
from msl_fem.control.design_model import MIDDLE, AtPosition
from msl_fem.control.gap_to_come import position_after
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import LqrGains, ReducedOrderFilter

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class LinearLaw:
    """The linear part of the controller.

    Attributes
    ----------
    plant : what it believes
    gains, estimator : regulator and filter
    model_gains : state feedback of the model that the loop follows
    gap_lead : s, how far ahead the input transformation looks for its gap
    feedforward : whether the reference acts by feedforward and model following, or by integral and `reference_gain`
    preview : whether the feedforward knows the reference ahead, or carries it on from its derivatives
    shape : (5,) second-order section on what is fed back
    reference_gain : (3,) of the reference's position, velocity and acceleration
    """

    plant: LinearPlant
    gains: LqrGains
    model_gains: LqrGains
    estimator: ReducedOrderFilter
    gap_lead: float
    feedforward: bool = True
    shape: tuple[float, ...] = NO_SHAPE
    reference_gain: Array = field(default_factory=lambda: np.zeros(3))
    preview: bool = True

    def by_integral_alone(self) -> "LinearLaw":
        """The law to which the reference comes by the integral alone; what is fed back is the same."""
        alone = replace(self, feedforward=False, reference_gain=np.zeros(3))
        alone.__dict__["_controller"] = self._controller
        return alone

    def controller(self) -> StateSpace:
        """Inputs: measured position, a force added before and one behind the section, what the integral is to hold.

        Outputs: the law's force, and the position that the inverse uses.
        """
        return self._controller

    @cached_property
    def _controller(self) -> StateSpace:
        k = self.gains.state
        f = self.estimator.prediction
        gain = self.estimator.gain
        model = self.plant.sampled()
        (b0, b1, b2, a1, a2) = self.shape
        known = k.size - 2
        # predicted position, velocity, disturbance; known states; integral; the section's memory; the inputs
        rows = np.eye(3 + known + 3 + 4)
        rest = rows[3 : 3 + known]
        (integral, first, second) = rows[3 + known : 6 + known]
        y, before, behind, held = rows[-4:]
        innovation = y - rows[0]
        velocity = rows[1] + gain[0] * innovation
        disturbance = rows[2] + gain[1] * innovation
        fed_back = before - self.gains.integral * integral - k[0] * y - k[1] * velocity - k[2:] @ rest
        shaped = b0 * fed_back + first
        force = shaped + behind
        now = np.vstack([y, velocity, disturbance, rest, force])
        following = model.A[2:, 2:] @ rest + np.outer(model.B[2:, 0], force)
        memory = [b1 * fed_back - a1 * shaped + second, b2 * fed_back - a2 * shaped]
        moved = np.vstack([f @ now, following, integral + y - held, *memory])
        shown = np.vstack([force, position_after(self.plant, self.gap_lead) @ now])
        return StateSpace(moved[:, :-4], moved[:, -4:], shown[:, :-4], shown[:, -4:], self.plant.period)

    def loop_transfer(self, frequency: ArrayLike, at: AtPosition = MIDDLE) -> Complex:
        """(n_frequency,) open-loop transfer at the plant's input, negative feedback taken out: S = 1/(1 + L)."""
        plant = self.plant.driven(magnet_stiffness=at.magnet_stiffness).response(frequency)[:, 0, 0]
        return np.asarray(-plant * self.feedback(frequency, at))

    def feedback(self, frequency: ArrayLike, at: AtPosition = MIDDLE) -> Complex:
        """(n_frequency,) force that comes back for a measured position."""
        law = self.controller().response(frequency)[:, :, 0]
        return np.asarray(at.gain * (law[:, 0] - at.taken_off * law[:, 1]))

    def spectral_radius(self, at: AtPosition = MIDDLE, *, plant: StateSpace | None = None) -> float:
        """Largest closed-loop pole by size; below 1 where the loop is stable.

        `plant` is position over force where it is not the believed one (with the magnet stiffness in it).
        """
        plant = plant or self.plant.driven(magnet_stiffness=at.magnet_stiffness)
        law = self.controller()
        c = at.gain * (law.C[0] - at.taken_off * law.C[1])
        d = at.gain * (law.D[0, 0] - at.taken_off * law.D[1, 0])
        n = len(plant.A)
        a = np.empty((n + len(law.A),) * 2)  # a search asks often, and np.block takes half as long as the eigenvalues
        a[:n, :n], a[:n, n:] = plant.A + d * plant.B @ plant.C, plant.B @ c[None, :]
        a[n:, :n], a[n:, n:] = law.B[:, :1] @ plant.C, law.A
        return float(np.abs(np.linalg.eigvals(a)).max())

    def peak_sensitivity(self, at: AtPosition = MIDDLE, *, frequency: Array | None = None) -> float:
        """max |S| up to half the loop rate; inf where the loop is unstable."""
        if self.spectral_radius(at) >= 1:
            return float("inf")
        f = grid(self.plant.period) if frequency is None else frequency
        return float(np.max(1 / np.abs(1 + self.loop_transfer(f, at))))

    def reference_response(self, frequency: ArrayLike) -> Complex:
        """(n_frequency,) position over reference on the believed plant, for a sine with its derivatives."""
        f = np.atleast_1d(np.asarray(frequency, dtype=float))
        z = np.exp(2j * np.pi * f * self.plant.period)
        jw = 2j * np.pi * f
        plant = self.plant.driven().response(f)[:, 0, 0]
        by_position, by_fed_back, by_force, by_held = self.controller().response(f)[:, 0].T
        if not self.feedforward:
            ahead = self.reference_gain @ np.stack([np.ones_like(jw), jw, jw**2])
            return np.asarray(plant * (by_held + by_force * ahead) / (1 - plant * by_position))
        command = self._feedforward(jw, z)
        states = self._states(z)  # of the believed plant, over its command
        promised = command / (1 + self.model_gains.state @ states)
        followed = by_force * promised + by_fed_back * (self.gains.state @ states) * promised
        return np.asarray(plant * (followed + by_held * states[0] * promised) / (1 - plant * by_position))

    def _feedforward(self, jw: Complex, z: Complex) -> Complex:
        """u_ff + K_model xi_ref for a reference of amplitude 1."""
        p = self.plant
        k = self.model_gains.state
        lead = self.plant.lead
        if self.preview:
            ahead = (p.stiffness + p.damping * jw + p.mass * jw**2) * np.exp(lead * jw)
        else:
            carried = 1 + lead * jw + 0.5 * (lead * jw) ** 2
            ahead = p.stiffness * carried + p.damping * (jw + lead * jw**2) + p.mass * jw**2
        total = ahead + k[0] + k[1] * jw
        n_lag = k.size - 2 - p.delay
        if n_lag:
            total = total + k[2] * (p.stiffness + jw * p.damping + jw**2 * p.mass)
        for j in range(p.delay):
            total = total + k[2 + n_lag + j] * ahead * z ** (j - p.delay)
        return np.asarray(total)

    def _states(self, z: Complex) -> Complex:
        """(n_state, n_frequency) states of the believed plant over its command."""
        model = self.plant.sampled()
        return states_over_inputs(model.A, model.B, z)[:, :, 0].T


@lru_cache(maxsize=16)
def grid(period: float, n: int = 400) -> Array:
    """(n,) Hz from 1/2000 of the loop rate up to its half, spaced evenly in their logarithm; read-only."""
    frequencies = np.geomspace(5e-4 / period, 0.499 / period, n)
    frequencies.flags.writeable = False
    return frequencies


def bandwidth(response: Complex, frequency: Array) -> float:
    """The lowest frequency at which |response| falls below -3 dB, interpolated; nan where it never does."""
    size = np.abs(response)
    below = np.flatnonzero(size < np.sqrt(0.5))
    if not below.size:
        return float("nan")
    n = int(below[0])
    if n == 0:
        return float(frequency[0])
    t = (size[n - 1] - np.sqrt(0.5)) / (size[n - 1] - size[n])
    return float(frequency[n - 1] + t * (frequency[n] - frequency[n - 1]))


def flat_band(response: Complex, frequency: Array, *, decibel: float = 1.0) -> float:
    """The frequency up to which |response| stays within +- `decibel` of 0 dB; 0 where it starts outside."""
    outside = np.flatnonzero(np.abs(20 * np.log10(np.abs(response))) > decibel)
    if not outside.size:
        return float(frequency[-1])
    return 0.0 if outside[0] == 0 else float(frequency[outside[0] - 1])


def feedback_bandwidth(law: LinearLaw, n_grid: int = 400) -> float:
    """-3 dB in Hz from reference to position by the integral alone, on the believed plant."""
    f = grid(law.plant.period, n_grid)
    return bandwidth(law.by_integral_alone().reference_response(f), f)


def sensitivity_bound(plant: LinearPlant, *, magnet_stiffness: float) -> float:
    """The least peak sensitivity that any linear controller can reach: exp(p T (delay + 1)), or 1 without such a pole.

    p is the unstable pole of m x'' + c x' + (k - kappa) x. In powers of q = 1/z, S is analytic in the unit disc; it is
    1 + O(q^(delay + 1)) at q = 0, because a command shows in the position delay + 1 samples later at the earliest; and
    it is 0 at q_p = exp(-p T). With gamma = max |S|, (S/gamma - 1/gamma)/(1 - S/gamma^2) maps the disc into itself and
    has a zero of order delay + 1 at 0, so Schwarz's lemma at q_p gives 1/gamma <= q_p^(delay + 1).
    """
    k = plant.stiffness - magnet_stiffness
    c = plant.damping
    m = plant.mass
    pole = float(np.max(np.roots([m, c, k]).real))
    return float(np.exp(pole * plant.period * (plant.delay + 1))) if k < 0 else 1.0
