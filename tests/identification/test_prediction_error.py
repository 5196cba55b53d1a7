"""Predictor, gradient and objective against slow, obvious twins."""

from dataclasses import replace

import numpy as np
import pytest
from armax_plants import CASES

from msl_fem.identification import ArmaxOrders, regression
from msl_fem.identification.likelihood import (
    CoefficientPrior,
    EstimationProblem,
    evaluated,
    evaluated_reflected,
    objective_gradient,
)
from msl_fem.identification.prediction_error import (
    Polynomials,
    jacobian_factors,
    polynomials_of,
    prediction_errors,
    reflected,
)


@pytest.fixture
def problem():
    """Two short runs of the well damped plant and coefficients off the truth; an offset included."""
    case = CASES[0]
    orders = ArmaxOrders(2, (2, 3), 2, (1, 0), offset=True).for_inputs(2)
    rng = np.random.default_rng(7)
    runs = [case.run(n, rng)[0].signals for n in (300, 200)]
    vector = np.array([-1.1, 0.4, 0.9, 0.6, 0.1, 0.3, -0.6, 0.2, -0.5, 0.3])
    return runs, orders, vector


def objective_at(runs, orders, vector, belief=None):
    """Minus the log of the restricted likelihood, and of the likelihood."""
    found = evaluated(EstimationProblem(runs, orders, belief), polynomials_of(vector, orders))
    restricted = 0.5 * found.degrees_of_freedom * np.log(found.objective)
    return restricted, 0.5 * found.n_equations * np.log(found.likelihood_cost), found


def test_errors_satisfy_the_model_sample_by_sample(problem):
    """A y - B u - offset = C e with the estimated first errors as the past, by a plain loop."""
    runs, orders, vector = problem
    p = polynomials_of(vector, orders)
    signals, first = runs[0], orders.longest_lag
    e = prediction_errors(signals, p, orders).errors
    past = {first - orders.nc + i: value for i, value in enumerate(e)}
    y, u = signals[0], signals[1:-1]
    for t in range(first, signals.shape[1]):
        left = y[t] + p.a[1] * y[t - 1] + p.a[2] * y[t - 2] - p.offset
        for k, lags in enumerate(orders.input_lags):
            left -= sum(b * u[k, t - lag] for b, lag in zip(p.b[k], lags, strict=True))
        assert left == pytest.approx(past[t] + p.c[1] * past[t - 1] + p.c[2] * past[t - 2], abs=1e-10)


@pytest.mark.parametrize("believed", [False, True])
def test_gradient_passes_a_taylor_test(problem, believed):
    """The remainder of the first-order expansion of the log restricted likelihood is of second order."""
    runs, orders, vector = problem
    belief = CoefficientPrior(3.0 * np.eye(2, vector.size), np.array([-3.5, 1.4])) if believed else None
    value, _, evaluation = objective_at(runs, orders, vector, belief)
    gradient = objective_gradient(EstimationProblem(runs, orders, belief), evaluation)
    gradient = gradient * evaluation.degrees_of_freedom / evaluation.cost  # of the log likelihood
    direction = np.random.default_rng(1).standard_normal(vector.size)
    steps = 1e-3 * 0.5 ** np.arange(5)
    remainders = [
        abs(objective_at(runs, orders, vector + h * direction, belief)[0] - value - h * gradient @ direction)
        for h in steps
    ]
    orders_seen = np.diff(np.log(remainders)) / np.log(0.5)
    np.testing.assert_allclose(orders_seen, 2.0, atol=0.15)


def test_objective_is_the_exact_likelihood_of_a_moving_average():
    """cost and determinant against the dense covariance of C e: w'M^-1 w and log det M."""
    n, c = 60, np.array([1.0, -1.6, 0.9])
    orders = ArmaxOrders(0, 1, 2, 1).for_inputs(1)
    w = np.random.default_rng(3).standard_normal(n)
    signals = np.vstack([w, np.zeros(n), np.ones(n)])
    p = Polynomials(np.ones(1), (np.zeros(1),), c)
    found = prediction_errors(signals, p, orders)
    m = n - orders.longest_lag
    lags = np.correlate(c, c, mode="full")[2:]
    covariance = sum(lags[k] * (np.eye(m, k=k) + (np.eye(m, k=-k) if k else 0.0)) for k in range(3))
    w = w[orders.longest_lag :]
    assert found.cost == pytest.approx(w @ np.linalg.solve(covariance, w), rel=1e-10)
    assert found.log_determinant == pytest.approx(np.linalg.slogdet(covariance)[1], rel=1e-10)


def test_objective_is_the_restricted_likelihood_of_dense_algebra(problem):
    """Sum over two runs of log det V and the quadratic form, and log det of X'V^-1X, with V and X written out."""
    runs, orders, vector = problem
    p = polynomials_of(vector, orders)
    first, form, log_volume, normal = orders.longest_lag, 0.0, 0.0, np.zeros((orders.n_linear, orders.n_linear))
    for signals in runs:
        n = signals.shape[1]
        m = n - first
        moving = sum(c * np.eye(m, m + orders.nc, k=orders.nc - i) for i, c in enumerate(p.c))
        covariance = moving @ moving.T
        columns = [signals[0, first - i : n - i] for i in (1, 2)]
        columns += [-signals[1 + k, first - i : n - i] for k, lags in enumerate(orders.input_lags) for i in lags]
        x = np.column_stack([*columns, -np.ones(m)])
        w = signals[0, first:] + x @ vector[: orders.n_linear]
        form += w @ np.linalg.solve(covariance, w)
        log_volume += np.linalg.slogdet(covariance)[1]
        normal += x.T @ np.linalg.solve(covariance, x)
    restricted, plain, found = objective_at(runs, orders, vector)
    freedom = found.degrees_of_freedom
    assert freedom == sum(signals.shape[1] - first for signals in runs) - orders.n_linear
    expected = 0.5 * (freedom * np.log(form) + log_volume + np.linalg.slogdet(normal)[1] - found.reference)
    assert restricted == pytest.approx(expected, rel=1e-10)
    assert plain == pytest.approx(0.5 * ((freedom + orders.n_linear) * np.log(form) + log_volume), rel=1e-10)


def test_units_do_not_change_the_objective(problem):
    """An input in mA instead of A, its coefficients a thousand times smaller."""
    runs, orders, vector = problem
    scale = np.array([1.0, 1e3, 1.0, 1.0])
    moved = vector.copy()
    moved[2:4] /= 1e3
    assert objective_at([scale[:, None] * signals for signals in runs], orders, moved)[0] == pytest.approx(
        objective_at(runs, orders, vector)[0], rel=1e-12
    )


def test_a_column_that_depends_on_the_others_carries_no_determinant(problem):
    """Two equal inputs: the objective stays finite and its gradient too."""
    runs, orders, vector = problem
    orders = replace(orders, nb=(2, 2), nk=(1, 1)).for_inputs(2)
    twins = [np.vstack([signals[:2], signals[1], signals[3]]) for signals in runs]
    found = evaluated_reflected(
        EstimationProblem(twins, orders), polynomials_of(vector[[0, 1, 2, 3, 5, 6, 7, 8, 9]], orders)
    )
    assert np.isfinite(found.objective)
    assert np.isfinite(objective_gradient(EstimationProblem(twins, orders), found)).all()


def test_mirrored_zeros_of_c_do_not_change_the_objective(problem):
    """C with a zero outside the unit circle and its mirror image explain the data equally well."""
    runs, orders, vector = problem
    runs = [signals[:, :100] for signals in runs]
    inside, outside = vector.copy(), vector.copy()
    inside[-2:] = np.poly([0.9, 0.5])[1:]
    outside[-2:] = np.poly([1 / 0.9, 0.5])[1:]
    values = [objective_at(runs, orders, v) for v in (inside, outside)]
    # The mirror scales the innovations, so the bare cost differs while the objectives do not.
    assert values[0][0] == pytest.approx(values[1][0], abs=1e-6)
    assert values[0][1] == pytest.approx(values[1][1], abs=1e-6)
    assert values[0][2].cost > 1.2 * values[1][2].cost


def test_unstable_zeros_of_c_are_reflected_and_stable_ones_untouched(problem):
    runs, orders, vector = problem
    np.testing.assert_allclose(reflected(np.poly([2.0, 0.3])), np.poly([0.5, 0.3]), rtol=1e-12)
    z = 1.25 * np.exp(0.4j)
    np.testing.assert_allclose(
        reflected(np.real(np.poly([z, z.conj()]))), np.real(np.poly([z / 1.25**2, z.conj() / 1.25**2])), rtol=1e-12
    )
    stable = np.poly([0.99, -0.5])
    assert reflected(stable) is stable
    vector[-2:] = np.poly([2.0, 0.3])[1:]
    unstable_a = np.poly([1.1, 0.5])
    vector[:2] = unstable_a[1:]
    evaluation = evaluated_reflected(EstimationProblem(runs, orders), polynomials_of(vector, orders))
    np.testing.assert_allclose(evaluation.polynomials.c, np.poly([0.5, 0.3]), rtol=1e-12)
    np.testing.assert_allclose(evaluation.polynomials.a, unstable_a)


def test_blocks_of_any_length_give_the_same_factor(problem, monkeypatch):
    """Accumulated block by block or at once: R'R is the Gram matrix of the whole."""
    runs, orders, vector = problem
    p = polynomials_of(vector, orders)
    errors = [prediction_errors(signals, p, orders).errors for signals in runs]
    whole = jacobian_factors(runs, p, orders, errors=errors).total
    monkeypatch.setattr(regression, "BLOCK_ROWS", 7)
    pieces = jacobian_factors(runs, p, orders, errors=errors).total
    np.testing.assert_allclose(pieces.T @ pieces, whole.T @ whole, rtol=1e-9, atol=1e-9)


def test_jacobian_is_the_derivative_of_the_errors(problem):
    """R'R against central differences of the errors, the first errors of each run held free."""
    runs, orders, vector = problem
    p = polynomials_of(vector, orders)
    found = jacobian_factors(runs, p, orders, errors=[prediction_errors(s, p, orders).errors for s in runs]).total
    expected = np.zeros((vector.size, vector.size))
    for signals in runs:
        start = prediction_errors(signals, p, orders).errors[: orders.nc]
        columns = []
        for i in range(vector.size):
            step = np.zeros(vector.size)
            step[i] = 1e-6
            columns.append(
                (
                    plain_errors(signals, vector + step, orders, start)
                    - plain_errors(signals, vector - step, orders, start)
                )
                / 2e-6
            )
        free = [
            plain_errors(signals, vector, orders, start + unit) - plain_errors(signals, vector, orders, start)
            for unit in np.eye(orders.nc)
        ]
        jacobian, nuisance = np.array(columns).T, np.array(free).T
        q, _ = np.linalg.qr(nuisance)
        jacobian = jacobian - q @ (q.T @ jacobian)
        expected += jacobian.T @ jacobian
    gram = (found.T @ found)[:-1, :-1]
    np.testing.assert_allclose(gram, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def plain_errors(signals, vector, orders, start):
    """Errors by the recursion, sample by sample, with given first errors."""
    p = polynomials_of(vector, orders)
    first = orders.longest_lag
    e = list(start)
    for t in range(first, signals.shape[1]):
        value = sum(a * signals[0, t - i] for i, a in enumerate(p.a)) - p.offset
        for row, lags in enumerate(orders.input_lags, start=1):
            value -= sum(b * signals[row, t - lag] for b, lag in zip(p.b[row - 1], lags, strict=True))
        e.append(value - sum(c * e[-i] for i, c in enumerate(p.c) if i))
    return np.array(e)


def test_orders_per_input_and_names():
    orders = ArmaxOrders(1, (1, 2), 1, (0, 3), offset=True).for_inputs(2)
    assert orders.longest_lag == 4
    assert orders.parameter_names(["u", "v"]) == ("a1", "b[u][0]", "b[v][3]", "b[v][4]", "offset", "c1")
    assert orders.n_parameters == 6
    round_trip = polynomials_of(np.arange(6.0), orders)
    np.testing.assert_array_equal(round_trip.vector(orders), np.arange(6.0))
    assert replace(orders).for_inputs(2) == orders
