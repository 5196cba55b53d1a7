"""Free functions of one variable: their forms, and the evidence of either."""

import numpy as np
import pytest

from msl_fem.diagnosis.outside import N_SPLINE, SIZES, _basis, _Form


def test_a_straight_line_is_a_sum_of_the_splines() -> None:
    z = np.linspace(-2e-3, 3e-3, 2001)
    basis, line, (points, shapes) = _basis(z)
    assert (len(basis), line.size) == (N_SPLINE, N_SPLINE)
    assert np.column_stack(basis).sum(axis=1) == pytest.approx(np.ones(z.size))
    low, high = np.quantile(z, (0.002, 0.998))
    straight = 2 * (np.clip(z, low, high) - low) / (high - low) - 1
    assert np.column_stack(basis) @ line == pytest.approx(straight, abs=1e-12)
    assert shapes @ line == pytest.approx(2 * (points - low) / (high - low) - 1, abs=1e-12)


def test_the_evidence_of_a_form_is_that_of_its_normal_amounts() -> None:
    """By the covariance of the data with and without it, at the best of the sizes."""
    chance = np.random.default_rng(4)
    columns, of = chance.standard_normal((60, 5)), chance.standard_normal((5, 2))
    data = columns @ of @ np.array([1.5, -2.0]) + chance.standard_normal(60)
    form = _Form(of, columns.T @ columns, columns.T @ data)
    own = columns @ of

    def nats(size: float) -> float:
        covariance = np.eye(60) + size**2 * own @ own.T
        return -(data @ np.linalg.solve(covariance, data) + np.linalg.slogdet(covariance)[1] - data @ data) / 2

    assert form.gain == pytest.approx(max(map(nats, SIZES)), rel=1e-9)
    size = max(SIZES, key=nats)
    matrix = own.T @ own + np.eye(2) / size**2
    assert form.coefficients == pytest.approx(of @ np.linalg.solve(matrix, own.T @ data))
    assert form.covariance == pytest.approx(of @ np.linalg.inv(matrix) @ of.T)


def test_a_line_is_worth_more_as_a_line_and_a_bend_as_splines() -> None:
    chance = np.random.default_rng(5)
    z = chance.uniform(-1, 1, 4000)
    basis, line, _ = _basis(z)
    columns, noise = np.column_stack(basis), chance.standard_normal(z.size)
    g = columns.T @ columns
    for signal, as_line in ((0.2 * z, True), (0.2 * np.cos(6 * z), False)):
        b = columns.T @ (signal + noise)
        straight, free = _Form(line[:, None], g, b), _Form(np.eye(N_SPLINE), g, b)
        assert (straight.gain > free.gain) is as_line
        assert max(straight.gain, free.gain) > 10
