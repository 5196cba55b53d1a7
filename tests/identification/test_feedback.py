"""Feedback is seen where it is, and as often as stated where it is not."""

import numpy as np
from armax_plants import CASES
from scipy.stats import binom

from msl_fem.identification import feedback_note, feedback_tests, fit_armax


def test_feedback_is_seen():
    run, _ = CASES[2].run(3_000, np.random.default_rng(3))
    tests = feedback_tests(fit_armax([run], CASES[2].orders), run, list(run.inputs))
    assert not tests[0].inside_band
    assert max(tests[0].lags) == -1
    assert "is sound when" in feedback_note(tests, known=False)


def test_open_loop_is_taken_for_feedback_five_per_cent_of_the_time():
    outside = 0
    for seed in range(60):
        run, _ = CASES[0].run(1_000, np.random.default_rng(seed))
        tests = feedback_tests(fit_armax([run], CASES[0].orders), run, ["u1"], alpha=0.05)
        outside += not tests[0].inside_band
    assert binom.ppf(0.001, 60, 0.05) <= outside <= binom.ppf(0.999, 60, 0.05)


def test_a_note_only_where_there_is_a_loop():
    run, _ = CASES[0].run(3_000, np.random.default_rng(3))
    tests = feedback_tests(fit_armax([run], CASES[0].orders), run, list(run.inputs))
    assert feedback_note(tests, known=False) is None
    assert "recorded under feedback" in feedback_note(tests, known=True)
