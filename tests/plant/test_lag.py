"""The exact first-order lag."""

import numpy as np
import pytest
from scipy.integrate import quad

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import rows_of
from msl_fem.plant.drive import lag_weights


@compiled
def weigh(z: float, weights: np.ndarray) -> None:
    lag_weights(z, 1.0, rows_of(weights), 0, 0)


def response(z: float, x: np.polynomial.Polynomial, *, start: float) -> float:
    """y(1) of y' = z (x(s) - y), y(0) = start, from the weights."""
    weights = np.empty(5)
    weigh(z, weights)
    slope = x.deriv()
    return float(weights @ [start, x(0.0), slope(0.0), x(1.0), slope(1.0)])


@pytest.mark.parametrize("z", [1e-9, 1e-3, 0.3, 0.999, 1.001, 4.0, 80.0])
def test_a_cubic_comes_through_exactly(z: float) -> None:
    x = np.polynomial.Polynomial([0.3, -1.1, 0.7, 2.3])
    convolved = quad(lambda s: z * np.exp(-z * (1 - s)) * x(s), 0, 1, epsabs=1e-14, epsrel=1e-13)[0]
    assert response(z, x, start=0.9) == pytest.approx(0.9 * np.exp(-z) + convolved, rel=1e-12, abs=1e-15)


def test_an_infinite_bandwidth_shows_the_input_itself() -> None:
    assert response(np.inf, np.polynomial.Polynomial([1.0, 2.0, -3.0, 4.0]), start=7.0) == 4.0
