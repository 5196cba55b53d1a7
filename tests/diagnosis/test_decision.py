"""The rule that names: what is enough evidence, what must be left, what a believed parameter may do."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.calibration import Calibration
from msl_fem.diagnosis.decision import Rule, accepted, excess_power, finishes, quiet
from msl_fem.diagnosis.held_out import Followed, log_likelihood_gain


def stages(*gains: float | None) -> list[Any]:
    return [SimpleNamespace(best=None if g is None else SimpleNamespace(gain=g)) for g in gains]


QUIET, LOUD, LOUDER = {"x": 1.02, "i": 1.0}, {"x": 3.0, "i": 1.1}, {"x": 10.0, "i": 2.0}


def test_excess_is_what_is_above_the_noise_in_all_channels() -> None:
    assert excess_power({"x": 3.0, "i": 0.9}) == pytest.approx(8.0)
    assert excess_power({"x": 3.0, "i": 2.0}) == pytest.approx(11.0)
    assert quiet(QUIET)
    assert not quiet(LOUD)


def test_effects_are_taken_as_long_as_they_bring_enough() -> None:
    rule = Rule()
    assert accepted(stages(4.9), [QUIET], rule) == 0
    assert accepted(stages(5.1, 3.0), [QUIET, QUIET], rule) == 1
    assert accepted(stages(400.0, 13.0, None), [LOUD, QUIET, QUIET], rule) == 2
    assert accepted(stages(400.0, 11.0), [LOUD, QUIET], rule) == 1
    assert accepted(stages(9000.0, 20.0), [LOUD, QUIET], rule) == 1, "a fraction of what the first one brought"


def test_an_ornament_of_an_effect_that_fits_badly_is_not_taken() -> None:
    """The first leaves three times the noise; what then brings evidence but leaves it as loud is no cause."""
    rule = Rule()
    assert not finishes(LOUD, {"x": 2.9, "i": 1.0})
    assert finishes(LOUD, QUIET)
    assert accepted(stages(1000.0, 100.0), [LOUDER, LOUD, {"x": 2.9, "i": 1.0}], rule) == 1
    assert accepted(stages(1000.0, 900.0), [LOUDER, LOUD, QUIET], rule) == 2


def test_the_p_value_counts_clean_records_that_reach_a_statistic() -> None:
    clean = Calibration((6.0, 2.0, 1.0, -1.0), 1)
    assert clean.p_value(3.0) == pytest.approx(2 / 5)
    assert clean.p_value(100.0) == pytest.approx(1 / 5)
    assert clean.records == 4


def followed(rms: float) -> Followed:
    return Followed("sweep", "held-out", "position_m", rms, rms / 1e-5, 5e-8, 1000, 1e-5)


def test_the_gain_on_held_out_runs_counts_nothing_below_the_noise() -> None:
    assert log_likelihood_gain([followed(1e-7)], [followed(5e-8)]) == pytest.approx(1000 * np.log(2))
    assert log_likelihood_gain([followed(4.9e-8)], [followed(4e-8)]) == 0
    assert log_likelihood_gain([followed(1e-7)], [followed(np.inf)]) == -np.inf
