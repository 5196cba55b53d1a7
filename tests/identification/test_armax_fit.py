"""The prediction-error estimate is at the statistical limit, and its standard errors and trail can be trusted."""

from dataclasses import replace

import numpy as np
import pytest
from armax_plants import CASES, Case, efficiency, fisher_information, mode_polynomial

from msl_fem.identification import ArmaxOrders, EstimationSettings, OscillatorPrior, SampledRun, armax, fit_armax
from msl_fem.identification.likelihood import EstimationProblem
from msl_fem.identification.prediction_error import polynomials_of
from msl_fem.identification.search import FirstGuess, excerpts

SENSOR_NOISE = replace(CASES[3], name="oversampled, white sensor noise", c=CASES[3].a)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_parameter_error_is_at_the_cramer_rao_bound(case):
    """Squared parameter error over the bound, mean of six seeds: 1 when efficient, at most 1.5."""
    ratios = []
    for seed in range(6):
        run, innovations = case.run(8_000, np.random.default_rng(seed))
        model = fit_armax([run], case.orders)
        assert model.convergence.converged, model.convergence.reason
        ratios.append(efficiency(case, model.parameters, fisher_information(case, run, innovations)))
    assert 0.4 < np.mean(ratios) <= 1.5, ratios


def test_intervals_of_c_are_calibrated_next_to_the_unit_circle():
    """38 memories long: mean square of C's errors over standard errors; from the information at the point, over 2."""
    case, scores = CASES[3], []
    for seed in range(8):
        run, _ = case.run(20_000, np.random.default_rng(7_000 + seed))
        model = fit_armax([run], case.orders)
        assert model.convergence.converged, model.convergence.reason
        assert np.max(np.abs(np.roots(model.polynomials.c))) < 0.9995  # the plain one: 4 of 30 on the circle
        scores.append((model.parameters - case.theta)[-2:] / model.standard_errors[-2:])
    assert 0.5 < np.mean(np.square(scores)) < 1.8


def test_long_memory_does_not_stop_the_search():
    """White sensor noise, the record seven memories of 1/C long: every search converges and says what it must."""
    for seed in range(2):
        run, _ = SENSOR_NOISE.run(20_000, np.random.default_rng(seed))
        model = fit_armax([run], SENSOR_NOISE.orders)
        assert model.convergence.converged, model.convergence.reason
        assert np.max(np.abs(model.parameters[:10] - SENSOR_NOISE.theta[:10]) / model.standard_errors[:10]) < 5.0


def test_intervals_cover_the_truth():
    """Over 60 fits, errors over standard errors have unit variance, and 95 % intervals cover 90 to 98 %."""
    case, scores = CASES[0], []
    for seed in range(60):
        run, _ = case.run(2_000, np.random.default_rng(1_000 + seed))
        model = fit_armax([run], case.orders)
        scores.append((model.parameters - case.theta) / model.standard_errors)
    assert 0.87 < np.mean(np.square(scores)) < 1.15
    assert 0.90 < np.mean(np.abs(scores) < 1.96) < 0.98


def test_of_several_ends_the_lowest_is_taken():
    """A local minimum that converged does not win over a lower point on the way."""
    case = CASES[3]
    run, _ = case.run(3_000, np.random.default_rng(2))
    orders = case.orders.for_inputs(4)
    good = polynomials_of(case.theta * (1 + 1e-5), orders)
    poor = replace(good, a=np.array([1.0, -1.5, 0.6]))
    starts = [FirstGuess("poor", poor), FirstGuess("good", good)]
    settings = EstimationSettings(max_iterations=0)
    for order in (starts, starts[::-1]):
        found = armax.best_search(EstimationProblem([run.signals], orders), starts=order, settings=settings)
        assert not found.convergence.converged
        assert found.convergence.start == "good"


def test_noise_variance_is_that_of_the_innovations():
    run, innovations = CASES[1].run(20_000, np.random.default_rng(3))
    model = fit_armax([run], CASES[1].orders)
    assert model.noise_variance == pytest.approx(innovations.var(), rel=0.03)


def test_unstable_pole_is_kept():
    """Under feedback the open-loop pole at 1.04 is found outside the unit circle; C's zeros are inside."""
    case = CASES[2]
    run, _ = case.run(20_000, np.random.default_rng(0))
    model = fit_armax([run], case.orders)
    assert np.max(np.abs(np.roots(model.polynomials.a))) == pytest.approx(1.04, abs=0.02)
    assert np.max(np.abs(np.roots(model.polynomials.c))) < 1.0


def test_runs_of_one_fit_keep_their_own_start():
    """Two runs in one fit are as good as one of their length, although they do not join."""
    case, ratios = CASES[3], []
    for seed in range(5):
        rng = np.random.default_rng(50 + seed)
        parts = [case.run(4_000, rng), case.run(6_000, rng)]
        model = fit_armax([run for run, _ in parts], case.orders)
        information = sum(fisher_information(case, *part) for part in parts)
        ratios.append(efficiency(case, model.parameters, information))
    assert np.mean(ratios) < 1.6, ratios


def test_a_long_record_ends_where_its_excerpt_does_not(monkeypatch):
    """The search on an excerpt only saves time: the end is that of all data."""
    case = CASES[3]
    run, _ = case.run(20_000, np.random.default_rng(8))
    whole = fit_armax([run], case.orders)
    monkeypatch.setattr(armax, "EXCERPT_SAMPLES", 6_000)
    by_excerpt = fit_armax([run], case.orders)
    assert by_excerpt.convergence.start.endswith("on an excerpt")
    assert len(by_excerpt.convergence.costs) <= 8
    assert by_excerpt.n_samples == whole.n_samples
    assert np.max(np.abs(by_excerpt.parameters - whole.parameters) / whole.standard_errors) < 0.01


def test_excerpts_are_spread_over_every_run():
    runs = [np.arange(2 * n, dtype=float).reshape(2, n) for n in (1_000, 3_000)]
    assert excerpts(runs, 4_000, longest_lag=2) is runs
    pieces = excerpts(runs, 400, longest_lag=2)
    assert [piece.shape for piece in pieces] == [(2, 40)] * 4 + [(2, 75)] * 4
    assert pieces[0][0, 0] == 0
    assert pieces[3][0, -1] == 999
    assert pieces[7][0, -1] == 2_999


def test_offset_is_estimated():
    run, _ = CASES[0].run(20_000, np.random.default_rng(1))
    shifted = replace(run, output=run.output + 3.0)
    model = fit_armax([shifted], ArmaxOrders(2, 2, 2, 1, offset=True))
    truth = 3.0 * CASES[0].a.sum()
    error = model.standard_errors[model.parameter_names.index("offset")]
    assert abs(model.polynomials.offset - truth) < 4.0 * error
    assert error < 0.1 * truth


def test_direct_term_is_estimated():
    """nk = 0: the coefficient of the present input."""
    rng = np.random.default_rng(5)
    u, e = rng.standard_normal((2, 20_000))
    y = np.zeros_like(u)
    for t in range(1, u.size):
        y[t] = 0.8 * y[t - 1] + 0.5 * u[t] - 0.2 * u[t - 1] + 0.1 * (e[t] + 0.5 * e[t - 1])
    model = fit_armax([SampledRun(y, {"u": u}, 1.0)], ArmaxOrders(1, 2, 1, 0))
    assert model.parameter_names == ("a1", "b[u][0]", "b[u][1]", "c1")
    error = model.parameters - [-0.8, 0.5, -0.2, 0.5]
    assert np.all(np.abs(error) < 4.0 * model.standard_errors)
    assert np.all(model.standard_errors < 0.02)


def test_arx_is_one_step():
    """Without C the problem is linear: the least-squares start is the answer."""
    case = CASES[0]
    run, _ = replace(case, c=np.array([1.0, 0.0, 0.0])).run(5_000, np.random.default_rng(2))
    model = fit_armax([run], ArmaxOrders(2, 2, 0, 1))
    assert model.convergence.converged
    assert len(model.convergence.costs) == 1
    y, u = run.output, np.vstack(list(run.inputs.values()))
    regressors = np.column_stack([-y[1:-1], -y[:-2], u[0, 1:-1], u[0, :-2], u[1, 1:-1], u[1, :-2]])
    solution, *_ = np.linalg.lstsq(regressors, y[2:], rcond=None)
    np.testing.assert_allclose(model.parameters, solution, rtol=1e-8, atol=1e-10)


def test_noise_free_data_end_at_rounding():
    run, _ = replace(CASES[1], noise_ratio=0.0).run(4_000, np.random.default_rng(2))
    model = fit_armax([run], CASES[1].orders)
    assert model.convergence.converged
    np.testing.assert_allclose(model.polynomials.a, CASES[1].a, atol=1e-8)
    np.testing.assert_allclose(np.vstack(model.polynomials.b), CASES[1].b, atol=1e-8)


def test_prior_mass_and_stiffness_win_on_a_short_noisy_record():
    """Under noise of three times the motion, the other starts end in a local minimum; the believed oscillator not."""
    mass, damping, stiffness = 0.9, 8.0, 1.2e5
    period = 1e-4
    natural = np.sqrt(stiffness / mass)
    a = mode_polynomial(natural / (2 * np.pi), damping / (2 * np.sqrt(stiffness * mass)), period)
    case = Case(
        "short",
        a=a,
        b=np.full((1, 2), a.sum() / stiffness / 2),
        c=a,
        sampling_period=period,
        bandwidth=200.0,
        noise_ratio=3.0,
    )
    run, _ = case.run(2_000, np.random.default_rng(0))
    model = fit_armax([run], case.orders, prior=OscillatorPrior(mass, damping, stiffness))
    assert model.convergence.start == "prior, white sensor noise"
    assert model.convergence.converged
    assert model.convergence.costs[-1] < 0.98 * fit_armax([run], case.orders).convergence.costs[-1]
    assert np.max(np.abs(model.parameters[:2] - a[1:])) < 0.002


def test_a_search_that_is_cut_short_says_so():
    run, _ = CASES[3].run(5_000, np.random.default_rng(0))
    model = fit_armax([run], CASES[3].orders, settings=EstimationSettings(max_iterations=1))
    assert not model.convergence.converged
    assert "1 steps were taken" in model.convergence.reason
    assert any("did not converge" in note for note in model.notes)
    assert len(model.convergence.costs) == 2
    assert model.convergence.costs[1] < model.convergence.costs[0]
