"""The linear loop against python-control and against known limits."""

import dataclasses

import control
import numpy as np
import pytest
from servo_controllers import servo_design

from msl_fem.control.design_model import AtPosition
from msl_fem.control.linear_loop import LinearLaw, bandwidth, flat_band, grid, sensitivity_bound
from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import LqrWeights, lqr_gains

KAPPA = (0.0, 1e5, 4e5)


def servo_law() -> LinearLaw:
    """The reference actuator's law; designed by the first test that asks, not where the tests are collected."""
    return servo_design().law


def systems(magnet_stiffness: float) -> tuple[control.StateSpace, control.StateSpace]:
    """Plant, and controller from position to the force that acts, as python-control has them."""
    plant, law = servo_law().plant.sampled(magnet_stiffness=magnet_stiffness), servo_law().controller()
    c = law.C[:1] - magnet_stiffness * law.C[1:]
    d = law.D[:1, :1] - magnet_stiffness * law.D[1:, :1]
    period = servo_law().plant.period
    return control.ss(plant.A, plant.B, plant.C, plant.D, period), control.ss(law.A, law.B[:, :1], c, d, period)


@pytest.mark.parametrize("kappa", KAPPA)
def test_sensitivity_and_poles_are_those_of_python_control(kappa):
    plant, law = systems(kappa)
    closed = control.feedback(control.ss([], [], [], [[1.0]], servo_law().plant.period), plant * law, sign=1)
    f = grid(servo_law().plant.period)
    size = np.abs(control.frequency_response(closed, 2 * np.pi * f).complex).ravel()
    assert servo_law().peak_sensitivity(AtPosition(kappa)) == pytest.approx(size.max(), rel=1e-6)
    assert servo_law().spectral_radius(AtPosition(kappa)) == pytest.approx(np.abs(closed.poles()).max(), rel=1e-6)


def test_an_unstable_loop_has_no_finite_sensitivity():
    slow = dataclasses.replace(servo_law(), gap_lead=0.0)
    assert slow.spectral_radius(AtPosition(1e6)) > 1
    assert slow.peak_sensitivity(AtPosition(1e6)) == np.inf


@pytest.mark.parametrize("feedforward", [True, False])
def test_the_response_to_a_reference_is_that_of_a_recursion(feedforward):
    """A sine through believed plant and law, sample by sample, with the law written out anew."""
    law = dataclasses.replace(servo_law(), feedforward=feedforward)
    p, model, f = law.plant, law.plant.sampled(), 25.0
    k, km, lead = law.gains.state, law.model_gains.state, law.plant.lead
    w = 2 * np.pi * f
    plant, followed, predicted, total, queue, known = np.zeros(4), np.zeros(4), np.zeros(3), 0.0, 0.0, np.zeros(2)
    n, last = 1000, 400
    track = np.empty(n)
    for j in range(n):
        t = j * p.period
        r, v, a = np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)
        y = track[j] = plant[0]
        hat = predicted[1:] + law.estimator.gain * (y - predicted[0])
        u = -law.gains.integral * total - k @ [y, hat[0], *known]
        total += y - (followed[0] if feedforward else r)
        if feedforward:
            later = w * (t + lead)
            ahead = (p.stiffness - p.mass * w**2) * np.sin(later) + p.damping * w * np.cos(later)
            wanted = np.array([r, v, p.stiffness * r + p.damping * v + p.mass * a, queue])
            promised = ahead + km @ (wanted - followed)
            u += promised + k @ followed
            followed, queue = model.A @ followed + model.B[:, 0] * promised, ahead
        predicted = law.estimator.prediction @ np.array([y, *hat, *known, u])
        known = (model.A @ np.array([0, 0, *known]) + model.B[:, 0] * u)[2:]
        plant = model.A @ plant + model.B[:, 0] * u
    turn = np.exp(-1j * w * p.period * np.arange(n - last, n))
    found = (track[-last:] @ turn) / (np.sin(w * p.period * np.arange(n - last, n)) @ turn)
    assert law.reference_response([f])[0] == pytest.approx(found, rel=1e-6)


def test_at_low_frequency_the_reference_is_followed():
    for feedforward in (True, False):
        law = dataclasses.replace(servo_law(), feedforward=feedforward)
        assert law.reference_response([1e-3])[0] == pytest.approx(1.0, abs=1e-3)


def test_no_loop_falls_below_the_bound():
    """Very different weights, one plant: the bound is the delay's and the unstable pole's, not the weights'."""
    bound = sensitivity_bound(servo_law().plant, magnet_stiffness=4.85e5)
    assert bound == pytest.approx(np.exp(2 * 4e-4 * 612.6), rel=1e-3)
    peaks = []
    for frequency, velocity, integral in ((300, 3, 1), (500, 2, 0.1), (700, 1, 0.01), (450, 3, 0.01), (900, 0.5, 1)):
        gains = lqr_gains(servo_law().plant, LqrWeights(frequency, velocity, integral))
        peaks.append(dataclasses.replace(servo_law(), gains=gains).peak_sensitivity(AtPosition(4.85e5)))
    assert min(peaks) > bound
    assert np.isfinite(peaks).sum() >= 3


def test_the_bound_grows_with_the_delay_and_is_1_for_a_stable_plant():
    plant = servo_law().plant
    assert sensitivity_bound(plant, magnet_stiffness=0.0) == 1.0
    late = dataclasses.replace(plant, delay=3)
    assert sensitivity_bound(late, magnet_stiffness=5e5) == pytest.approx(
        sensitivity_bound(plant, magnet_stiffness=5e5) ** 2
    )


def test_bandwidth_and_flat_band_of_a_first_order_lag():
    f = np.geomspace(0.1, 1e3, 2000)
    lag = 1 / (1 + 1j * f / 40.0)
    assert bandwidth(lag, f) == pytest.approx(40.0, rel=2e-3)
    assert flat_band(lag, f) == pytest.approx(40.0 * np.sqrt(10**0.1 - 1), rel=1e-2)
    assert np.isnan(bandwidth(np.ones(5), np.arange(1.0, 6.0)))
    assert flat_band(np.ones(5), np.arange(1.0, 6.0)) == 5.0
    assert flat_band(2 * np.ones(5), np.arange(1.0, 6.0)) == 0.0
    assert bandwidth(0.5 * np.ones(5), np.arange(1.0, 6.0)) == 1.0


def test_the_lead_of_the_gap_is_what_keeps_the_end_of_the_range_stable():
    plant = LinearPlant(0.9, 1.4e5, 12.0, 2 * np.pi * 1e3, 4e-4, 1)
    assert plant == servo_law().plant
    measured = dataclasses.replace(servo_law(), gap_lead=0.0)
    assert servo_law().spectral_radius(AtPosition(7e5)) < 1 < measured.spectral_radius(AtPosition(7e5))
