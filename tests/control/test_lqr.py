"""The regulator against python-control and against its own cost."""

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from msl_fem.control.linear_plant import LinearPlant
from msl_fem.control.lqg import LqrWeights, lqr_gains, riccati
from msl_fem.errors import ComputationError

PLANT = LinearPlant(0.9, 1.4e5, 12.0, 2 * np.pi * 1e3, 4e-4, 1)
WEIGHTS = LqrWeights(frequency=400.0, velocity=1.5, integral=0.8)


def augmented(plant: LinearPlant) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B, Q, R of the plant with the sum of the errors, with the cost as `LqrWeights` states it."""
    model = plant.sampled()
    n = model.A.shape[0]
    a, b = np.zeros((n + 1, n + 1)), np.vstack([model.B, [[0.0]]])
    a[:n, :n], a[n, 0], a[n, n] = model.A, 1.0, 1.0
    q = np.diag([1.0, (1.5 / 400.0) ** 2, *np.zeros(n - 2), (0.8 * 400.0 * plant.period) ** 2])
    return a, b, q, np.array([[(plant.mass * 400.0**2) ** -2.0]])


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("lag", [2 * np.pi * 1e3, np.inf])
def test_gains_are_those_of_python_control(delay, lag):
    plant = LinearPlant(0.9, 1.4e5, 12.0, lag, 4e-4, delay)
    a, b, q, r = augmented(plant)
    expected, _, _ = control.dlqr(a, b, q / r, np.eye(1))
    found = lqr_gains(plant, WEIGHTS)
    np.testing.assert_allclose([*found.state, found.integral], expected[0], rtol=1e-6)


def test_any_other_gain_costs_more():
    a, b, q, r = augmented(PLANT)
    best = lqr_gains(PLANT, WEIGHTS)
    k = np.array([*best.state, best.integral])

    def cost(gain: np.ndarray) -> float:
        """Summed along the trajectories from a deviation of each state."""
        closed, x, total = a - b @ gain[None, :], np.diag([1e-3, 1.0, 100.0, 100.0, 1e-3]), 0.0
        for _ in range(3000):
            total += np.sum(x * (q @ x)) + r[0, 0] * np.sum((gain @ x) ** 2)
            x = closed @ x
        return total

    rng = np.random.default_rng(0)
    for _ in range(10):
        assert cost(k * (1 + 0.03 * rng.standard_normal(k.size))) > cost(k)


def test_without_integral_weight_there_is_no_integral():
    found = lqr_gains(PLANT, LqrWeights(400.0, 1.5, 0.0))
    model = PLANT.sampled()
    expected, _, _ = control.dlqr(
        model.A, model.B, np.diag([1.0, (1.5 / 400.0) ** 2, 0.0, 0.0]) * (0.9 * 400.0**2) ** 2, np.eye(1)
    )
    assert found.integral == 0.0
    np.testing.assert_allclose(found.state, expected[0], rtol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_riccati_solution_is_scipys(seed):
    rng = np.random.default_rng(seed)
    a, b, c = 1.2 * rng.standard_normal((5, 5)), rng.standard_normal((5, 2)), rng.standard_normal((3, 5))
    a[:, 0] = 0.0  # singular, as with delays
    np.testing.assert_allclose(riccati(a, b @ b.T, c.T @ c), solve_discrete_are(a, b, c.T @ c, np.eye(2)), rtol=1e-7)


def test_a_riccati_equation_without_stabilising_solution_has_none():
    assert riccati(np.diag([2.0, 0.5]), np.diag([0.0, 1.0]), np.eye(2)) is None
    assert riccati(np.eye(1), np.zeros((1, 1)), np.eye(1)) is None


def test_no_stabilising_solution_is_an_error_with_the_weights():
    with pytest.raises(ComputationError, match="frequency=nan"):
        lqr_gains(PLANT, LqrWeights(np.nan, 1.0, 1.0))
