"""The measured frequency response against the linear loop: two routes to one answer."""

import numpy as np
import pytest
from servo_controllers import TABLE, believed, delayed, delayed_design, servo, servo_design, servo_map

from msl_fem.control import PlantUnderTest, Wish, closed_loop_response, design_model_of, lqr_design
from msl_fem.errors import InputError

FREQUENCIES = (2.0, 5.0, 11.0, 23.0, 37.0, 50.0, 61.0, 80.0, 110.0)


@pytest.fixture(scope="module")
def measured():
    return closed_loop_response(servo_design(), plant=believed(), frequencies=FREQUENCIES)


def test_measured_and_predicted_agree(measured):
    ratio = measured.response / measured.predicted
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.1
    assert np.abs(np.degrees(np.angle(ratio))).max() < 1.0


def test_the_0_db_band_reaches_60_hz(measured):
    assert measured.flat_band >= 60.0
    assert np.abs(measured.gain[measured.frequency < 61]).max() < 1.0
    assert np.abs(measured.phase[measured.frequency < 61]).max() < 5.0


def test_the_plain_law_agrees_with_its_prediction_too():
    """Smaller agreement than with feedforward: near zero force the side that takes over lags more than its drive."""
    found = closed_loop_response(servo_design(feedforward=False), plant=believed(), frequencies=(2.0, 10.0, 30.0, 90.0))
    ratio = found.response / found.predicted
    assert np.abs(20 * np.log10(np.abs(ratio))).max() < 0.5
    assert np.abs(np.degrees(np.angle(ratio))).max() < 5.0
    assert found.gain[-1] < -3.0
    assert 30.0 < found.bandwidth < 90.0


@pytest.mark.parametrize("delay", [0, 2])
def test_measured_and_predicted_agree_for_other_delays(delay):
    plant = PlantUnderTest(delayed(delay), TABLE)
    found = closed_loop_response(delayed_design(delay), plant=plant, frequencies=(10.0, 50.0, 90.0))
    assert np.abs(found.response / found.predicted - 1).max() < 0.03


def test_about_another_position():
    found = closed_loop_response(servo_design(), plant=believed(), frequencies=(5.0, 40.0), position=0.3e-3)
    ratio = found.response / found.predicted
    assert np.abs(np.abs(ratio) - 1).max() < 0.05


def test_the_grid_by_default_spans_the_band_and_realises_whole_periods(measured):
    found = closed_loop_response(servo_design(), plant=believed())
    assert found.frequency[0] == pytest.approx(2.0, rel=0.01)
    assert found.frequency[-1] <= 505.0
    assert (np.diff(found.frequency) > 0).all()
    assert 100.0 < found.bandwidth < 1250.0
    np.testing.assert_allclose(measured.frequency, FREQUENCIES, rtol=0.02)


def test_the_grid_of_a_fast_loop_ends_where_the_magnets_could_not_follow():
    """At 10 kHz a fifth of the rate is 2 kHz, where 20 um take 2.8 kN."""
    fast = servo(controller={"rate": 10e3})
    found = closed_loop_response(
        lqr_design(design_model_of(fast, TABLE, servo_map())), plant=PlantUnderTest(fast, TABLE)
    )
    force = 0.9 * (2 * np.pi * found.frequency[-1]) ** 2 * found.amplitude
    assert 100.0 < force < 250.0
    assert found.flat_band > 60.0


@pytest.mark.parametrize("bad", [(), (5.0, 2.0), (0.0, 5.0), (5.0, 1250.0)])
def test_frequencies_out_of_range_are_refused(bad):
    with pytest.raises(InputError, match="half the loop rate"):
        closed_loop_response(servo_design(), plant=believed(), frequencies=bad)


def test_sines_beyond_the_reach_are_refused():
    with pytest.raises(InputError, match="beyond the"):
        closed_loop_response(servo_design(), plant=believed(), frequencies=(5.0,), position=0.49e-3)


def test_a_load_under_one_side_is_swung_within_its_weight():
    """Down, a mover under one magnet has its weight alone: sines that would need a push were asked for here once."""
    one = servo(sides={"count": 1}, motion={"constant_force": -8.0, "stiffness": 0.0})
    design = lqr_design(design_model_of(one, TABLE, servo_map()), Wish(20.0, None))
    found = closed_loop_response(design, plant=PlantUnderTest(one, TABLE), frequencies=None)
    inertia = found.amplitude * (2 * np.pi * found.frequency[-1]) ** 2 * one.motion.moving_mass
    assert 2.0 < inertia < 8.0
    assert np.abs(20 * np.log10(np.abs(found.response / found.predicted)))[found.frequency < 40].max() < 0.5
