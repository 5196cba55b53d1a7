"""Output error and Box-Jenkins: the bound, the multiplied-out model, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from armax_plants import CASES, mode_polynomial
from scipy.signal import lfilter

from msl_fem.errors import InputError
from msl_fem.identification import BoxJenkinsOrders, SampledRun, fit_box_jenkins
from msl_fem.identification.box_jenkins import _Product

F, C, D = mode_polynomial(0.05, 0.1, 1.0), np.array([1.0, 0.5]), np.array([1.0, -0.9])
B = (np.array([1.0, 0.5]), np.array([0.4, -0.7]))


def coloured(seed, n_samples=4_000):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((2, n_samples))
    y = sum(lfilter(np.r_[0.0, b], F, row) for b, row in zip(B, u, strict=True))
    return SampledRun(y + lfilter(C, D, rng.standard_normal(n_samples)), {"u": u[0], "v": u[1]}, 1.0)


def test_output_error_is_efficient_under_white_sensor_noise():
    """An oversampled lightly damped mode: squared error over the model's covariance, and intervals."""
    case = replace(CASES[3], c=CASES[3].a)
    ratios, inside = [], []
    for seed in range(6):
        run, _ = case.run(20_000, np.random.default_rng(seed))
        model = fit_box_jenkins([run], BoxJenkinsOrders(2, 2))
        error = model.parameters - case.theta[:10]
        ratios.append(error @ np.linalg.solve(model.covariance, error) / error.size)
        inside.append(np.abs(error) < 1.96 * model.standard_errors)
        np.testing.assert_allclose(model.armax.polynomials.c, model.armax.polynomials.a)
    assert 0.4 < np.mean(ratios) < 1.5, ratios
    assert np.mean(inside) > 0.85


def test_box_jenkins_finds_plant_and_noise():
    truth, scores = np.concatenate([F[1:], *B, C[1:], D[1:]]), []
    for seed in range(6):
        model = fit_box_jenkins([coloured(seed)], BoxJenkinsOrders(2, 2, 1, 1))
        assert model.armax.convergence.converged
        scores.append((model.parameters - truth) / model.standard_errors)
    assert 0.5 < np.mean(np.square(scores)) < 1.8, scores


def test_the_multiplied_model_is_the_product():
    model = fit_box_jenkins([coloured(0)], BoxJenkinsOrders(2, 2, 1, 1))
    polynomials = model.armax.polynomials
    np.testing.assert_allclose(polynomials.a, np.convolve(model.f, model.d))
    np.testing.assert_allclose(polynomials.c, np.convolve(model.f, model.c))
    np.testing.assert_allclose(polynomials.b[1], np.convolve(model.d, model.b[1]))
    assert model.armax.predict(coloured(0)).shape == (4_000,)


def test_the_chain_rule_passes_a_difference_test():
    orders = BoxJenkinsOrders(2, (2, 3), 1, 2, (1, 0), offset=True)
    product = _Product(orders, 2)
    vector = np.random.default_rng(0).standard_normal(2 + 5 + 1 + 1 + 2)
    found = product.jacobian(vector)
    for i in range(vector.size):
        step = np.zeros(vector.size)
        step[i] = 1e-6
        ahead, behind = (product.polynomials(vector + s).vector(product.multiplied) for s in (step, -step))
        np.testing.assert_allclose(found[:, i], (ahead - behind) / 2e-6, atol=1e-8)


def test_orders_that_cannot_be():
    with pytest.raises(InputError, match="nd = -1"):
        fit_box_jenkins([coloured(0)], BoxJenkinsOrders(2, 2, 0, -1))
