"""The residual tests fail white residuals as often as they say, and see what is not white."""

from dataclasses import replace

import numpy as np
import pytest
from armax_plants import CASES
from scipy.signal import lfilter
from scipy.stats import binom

from msl_fem.errors import InputError
from msl_fem.identification import ArmaxOrders, SampledRun, fit_armax, residual_tests, whiteness_test


def within_binomial(count, trials, alpha=0.01):
    """Whether a count is inside the central 99.8 % of the binomial law."""
    return binom.ppf(0.001, trials, alpha) <= count <= binom.ppf(0.999, trials, alpha)


def test_white_noise_fails_one_per_cent_of_the_time():
    tests = [whiteness_test(np.random.default_rng(seed).standard_normal(1_000)) for seed in range(500)]
    assert within_binomial(sum(not test.inside_band for test in tests), 500)
    assert within_binomial(sum(test.p_value < 0.01 for test in tests), 500)
    assert tests[0].degrees_of_freedom == 25


def test_the_band_follows_alpha():
    tests = [whiteness_test(np.random.default_rng(seed).standard_normal(500), alpha=0.2) for seed in range(300)]
    assert within_binomial(sum(not test.inside_band for test in tests), 300, 0.2)


def test_residuals_of_a_fit_fail_one_per_cent_of_the_time():
    """Whiteness and both inputs, after six coefficients and C were fitted to the same data."""
    failures = np.zeros((3, 2), dtype=int)
    for seed in range(60):
        run, _ = CASES[0].run(1_000, np.random.default_rng(seed))
        for row, test in enumerate(residual_tests(fit_armax([run], CASES[0].orders), run)):
            failures[row] += [not test.inside_band, test.p_value < 0.01]
    assert all(within_binomial(count, 60) for count in failures.ravel()), failures


def test_smooth_inputs_count_as_few():
    """A 200 Hz input at 10 kHz has few distinct lags; independent residuals stay in the band 99 % of the time."""
    run, _ = CASES[3].run(6_000, np.random.default_rng(1))
    model = fit_armax([run], CASES[3].orders)
    tests = residual_tests(model, run)
    assert len(tests) == 5
    assert all(test.degrees_of_freedom < 15 for test in tests[1:])
    assert all(test.inside_band and test.p_value > 0.01 for test in tests)


def test_coloured_noise_is_seen():
    e = np.random.default_rng(0).standard_normal(2_000)
    test = whiteness_test(lfilter([1.0, 0.3], [1.0], e))
    assert not test.inside_band
    assert test.p_value < 1e-6
    assert test.correlation[0] == pytest.approx(0.3 / 1.09, abs=0.06)
    assert abs(test.correlation[0]) > test.band[0]
    assert test.band[0] == pytest.approx(3.5 / np.sqrt(2_000), rel=0.05)


def test_a_missing_input_lag_is_seen_in_that_input_alone():
    """On another run, input 2 acts once more at delay 4, which the model does not know."""
    case = CASES[0]
    run, _ = case.run(20_000, np.random.default_rng(4))
    other, _ = case.run(5_000, np.random.default_rng(5))
    late = lfilter([0, 0, 0, 0, 0.05], case.a, other.inputs["u2"])
    model = fit_armax([run], case.orders)
    whiteness, first, second = residual_tests(model, replace(other, output=other.output + late), fitted=False)
    assert [test.name for test in (whiteness, first, second)] == ["residuals", "u1", "u2"]
    assert first.inside_band
    assert not second.inside_band
    assert second.lags[int(np.argmax(np.abs(second.correlation)))] == 4


def test_feedback_does_not_count_against_the_inputs():
    run, _ = CASES[2].run(10_000, np.random.default_rng(5))
    tests = residual_tests(fit_armax([run], CASES[2].orders), run)
    assert all(test.inside_band for test in tests)
    assert tests[1].lags[0] == 1


def test_a_held_out_run_is_asked_for_wrong_coefficients():
    """Coefficients off by five standard errors show only when they are not projected out."""
    case = CASES[0]
    run, _ = case.run(20_000, np.random.default_rng(6))
    model = fit_armax([run], case.orders)
    b = (model.polynomials.b[0] + [0.05, 0.0], model.polynomials.b[1])
    wrong = replace(model, polynomials=replace(model.polynomials, b=b))
    assert not residual_tests(wrong, run, fitted=False)[1].inside_band
    assert residual_tests(wrong, run)[1].inside_band
    assert all(test.inside_band for test in residual_tests(model, run, fitted=False))


def test_settings_that_cannot_be():
    with pytest.raises(InputError, match="lags = 100"):
        whiteness_test(np.ones(200), lags=100)
    with pytest.raises(InputError, match="alpha"):
        whiteness_test(np.ones(2_000), alpha=0.0)


def test_direct_term_lets_lag_zero_be_tested():
    rng = np.random.default_rng(9)
    u, e = rng.standard_normal((2, 3_000))
    run = SampledRun(0.4 * u + e, {"u": u}, 1.0)
    model = fit_armax([run], ArmaxOrders(1, 2, 0, 0))
    assert residual_tests(model, run)[1].lags[0] == 0
