"""The reduced-order filter: its stated covariances are true, and no other gain has less velocity variance."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import FilterNoise, reduced_order_filter
from msl_fem.errors import InputError

PLANT = LinearPlant(0.9, 1.4e5, 12.0, 2 * np.pi * 1e3, 4e-4, 1)
NOISE = FilterNoise(position=2e-7, force=0.5, disturbance=0.2)
FILTER = reduced_order_filter(PLANT, NOISE)


def truth(seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(states (n, 5): position, velocity, force, queue, disturbance; commands (n,)) of the plant with its noises."""
    rng, model = np.random.default_rng(seed), PLANT.sampled()
    held = LinearPlant(0.9, 1.4e5, 12.0, np.inf, 4e-4, 0).sampled().B[:, 0]
    x, out, commands = np.zeros(5), np.empty((n, 5)), rng.normal(0, 10, n)
    for k in range(n):
        out[k] = x
        pushed = x[4] + NOISE.force * rng.standard_normal()
        following = model.A @ x[:4] + model.B[:, 0] * commands[k]
        following[:2] += held * pushed
        x = np.array([*following, x[4] + NOISE.disturbance * rng.standard_normal()])
        x[4] *= 0.9999  # keeps the random walk from wandering off
    return out, commands


def filtered(states: np.ndarray, commands: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """(errors (n, 2) of velocity and disturbance, innovations (n,)), by the equations of the docstring."""
    measured = states[:, 0] + NOISE.position * np.random.default_rng(seed).standard_normal(len(states))
    hat, errors, innovations = np.zeros(2), np.empty((len(states), 2)), np.empty(len(states))
    predicted = np.zeros(3)
    for k, y in enumerate(measured):
        innovations[k] = y - predicted[0]
        hat = predicted[1:] + FILTER.gain * innovations[k]
        errors[k] = states[k, [1, 4]] - hat
        predicted = FILTER.prediction @ np.array([y, *hat, *states[k, 2:4], commands[k]])
    return errors[200:], innovations[200:]


@pytest.fixture(scope="module")
def run() -> tuple[np.ndarray, np.ndarray]:
    return filtered(*truth(1, 40_000), seed=2)


def test_errors_are_as_large_as_stated(run):
    errors, _ = run
    np.testing.assert_allclose(np.var(errors, axis=0), np.diag(FILTER.covariance), rtol=0.05)
    correlation = np.corrcoef(errors.T)[0, 1]
    stated = FILTER.covariance[0, 1] / np.sqrt(np.prod(np.diag(FILTER.covariance)))
    assert correlation == pytest.approx(stated, abs=0.03)


def test_normalised_innovations_are_one_on_average(run):
    _, innovations = run
    assert np.mean(innovations**2) / FILTER.innovation_variance == pytest.approx(1.0, abs=0.03)
    assert np.mean(innovations) == pytest.approx(0.0, abs=0.02 * np.sqrt(FILTER.innovation_variance))


def error_covariance(gain: np.ndarray) -> np.ndarray:
    """By a slower route: errors and position noise as one state, no change of variables."""
    phi, column = FILTER.prediction[:, :3], gain[:, None]
    held = np.array([*LinearPlant(0.9, 1.4e5, 12.0, np.inf, 4e-4, 0).sampled().B[:, 0], 0.0])
    process = NOISE.force**2 * np.outer(held, held) + np.diag([0, 0, NOISE.disturbance**2])
    a = np.zeros((3, 3))
    a[:2, :2] = phi[1:, 1:] - column @ phi[:1, 1:]
    a[:2, 2:] = -(phi[1:, :1] - column @ phi[:1, :1])
    mix = np.zeros((3, 4))
    mix[:2, :3], mix[:2, 3:], mix[2, 3] = np.hstack([-column, np.eye(2)]), -column, 1.0
    noise = np.zeros((4, 4))
    noise[:3, :3], noise[3, 3] = process, NOISE.position**2
    driven = mix @ noise @ mix.T
    covariance = driven
    for _ in range(40):  # doubling: the sum over 2^40 samples
        covariance, a = covariance + a @ covariance @ a.T, a @ a
    return covariance[:2, :2]


def test_no_other_gain_has_less_velocity_variance():
    np.testing.assert_allclose(error_covariance(FILTER.gain), FILTER.covariance, rtol=1e-8)
    for change in ((1.02, 1.0), (0.98, 1.0), (1.0, 1.05), (1.0, 0.95), (1.02, 1.05), (0.98, 0.95)):
        other = error_covariance(FILTER.gain * np.array(change))
        assert other[0, 0] > FILTER.covariance[0, 0]


def test_it_comes_near_the_full_order_filter_and_not_below_it():
    phi = FILTER.prediction[:, :3]
    held = np.array([*LinearPlant(0.9, 1.4e5, 12.0, np.inf, 4e-4, 0).sampled().B[:, 0], 0.0])
    process = NOISE.force**2 * np.outer(held, held) + np.diag([0, 0, NOISE.disturbance**2])
    c, r = np.array([[1.0, 0.0, 0.0]]), np.array([[NOISE.position**2]])
    before = solve_discrete_are(phi.T, c.T, process, r)
    after = before - before @ c.T @ c @ before / (before[0, 0] + r)
    assert after[1, 1] <= FILTER.covariance[0, 0] <= 1.1 * after[1, 1]


def test_more_position_noise_means_a_smaller_gain():
    slow = reduced_order_filter(PLANT, FilterNoise(2e-6, 0.5, 0.2))
    assert 0 < slow.gain[0] < FILTER.gain[0]
    assert slow.covariance[0, 0] > FILTER.covariance[0, 0]


@pytest.mark.parametrize("bad", [{"position": 0.0}, {"force": -1.0}, {"disturbance": np.nan}])
def test_noise_must_be_positive(bad):
    with pytest.raises(InputError, match=f"{next(iter(bad))} noise"):
        reduced_order_filter(PLANT, FilterNoise(**{"position": 1e-7, "force": 1.0, "disturbance": 1.0, **bad}))
