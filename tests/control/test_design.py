"""Designs keep their wishes or say what was got."""

import dataclasses
import json
from importlib import import_module

import numpy as np
import pytest
from servo_controllers import TABLE, servo, servo_belief, servo_design, servo_map

from msl_fem.control import design_controller, lqr_design, with_measured_gap
from msl_fem.control.design import Wish
from msl_fem.errors import ActuatorError, InputError


def test_the_default_keeps_its_wishes():
    found = servo_design()
    assert found.feedback_bandwidth >= 59.8
    assert found.peak_sensitivity <= 2.0
    assert found.flat_band >= 60.0
    assert found.reach == (-0.5e-3, 0.5e-3)


def test_the_working_range_is_stable_and_above_the_bound():
    for frozen in servo_design().frozen:
        assert frozen.bound <= frozen.peak_sensitivity < (3.5 if abs(frozen.position) < 0.41e-3 else 10.0)
    middle = servo_design().frozen[10]
    assert middle.position == 0.0
    assert middle.magnet_stiffness == 0.0
    assert middle.peak_sensitivity == servo_design().peak_sensitivity


def test_the_frozen_loops_mirror_one_another():
    peaks = [f.peak_sensitivity for f in servo_design().frozen]
    np.testing.assert_allclose(peaks, peaks[::-1], rtol=1e-9)


def test_a_lower_bound_is_kept_and_costs_elsewhere():
    calm = design_controller(servo(), TABLE, servo_map(), peak_sensitivity=1.6)
    assert calm.peak_sensitivity <= 1.6 * 1.002
    assert calm.feedback_bandwidth >= 59.8
    worst = max(f.peak_sensitivity for f in calm.frozen[1:-1])
    assert worst > 1.01 * max(f.peak_sensitivity for f in servo_design().frozen[1:-1])


def test_clashing_wishes_say_what_was_got():
    with pytest.raises(InputError, match=r"bandwidth of 200 Hz and a peak sensitivity of 1\.3; the nearest got .* Hz"):
        design_controller(servo(), TABLE, servo_map(), bandwidth=200.0, peak_sensitivity=1.3)


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        ({"bandwidth": 0.0}, "out of range: 0.00025 ... 250 Hz"),
        ({"bandwidth": 400.0}, "out of range"),
        ({"bandwidth": np.nan}, "out of range"),
        ({"peak_sensitivity": 0.9}, "above 1 for any loop"),
    ],
)
def test_impossible_wishes_are_refused(wish, said):
    with pytest.raises(InputError, match=said):
        design_controller(servo(), TABLE, servo_map(), **wish)


def test_a_guard_that_forbids_the_operating_point_is_refused():
    """Gravity asks for a force in the middle that the guard's last level does not allow."""
    heavy = servo(motion={"constant_force": -300.0})
    with pytest.raises(InputError, match="cannot hold the middle"):
        design_controller(heavy, TABLE, servo_map(levels=(0.3, 0.5)))


def test_a_weak_magnet_shortens_the_reach():
    weak = design_controller(servo(drive={"current_limit": 0.68}), TABLE, servo_map())
    assert 0.1e-3 < weak.reach[1] < 0.5e-3
    assert weak.reach[0] == -weak.reach[1]
    limit = weak.law.plant.stiffness * (weak.reach[1] + 0.01e-3)
    assert limit > 2 * float(TABLE.force(0.68, 0.6e-3 - weak.reach[1] - 0.01e-3))


def test_without_a_suspension_the_reach_ends_where_a_gap_leaves_the_map():
    free = design_controller(servo(motion={"stiffness": 0.0, "range": 0.59e-3}), TABLE, servo_map())
    assert free.reach[1] == -free.reach[0] == pytest.approx(0.55e-3, abs=0.006e-3)
    assert {f.magnet_stiffness for f in free.frozen} == {0.0}


def test_one_side_holds_one_half():
    one = design_controller(servo(sides={"count": 1}), TABLE, servo_map())
    assert one.reach == (0.0, 0.5e-3)


def test_the_measured_gap_is_the_same_law_without_the_lead():
    plain = with_measured_gap(servo_design())
    assert plain.law.gap_lead == 0.0
    assert plain.parameters.gap_row.tolist() == [1.0] + [0.0] * (plain.parameters.gap_row.size - 1)
    assert plain.law.gains is servo_design().law.gains
    assert np.isinf(plain.frozen[-1].peak_sensitivity)
    assert plain.peak_sensitivity == servo_design().peak_sensitivity


def test_the_json_is_json_and_names_the_law():
    plain = with_measured_gap(servo_design())
    json.dumps(plain.to_json(), allow_nan=False)
    assert plain.to_json()["peak_sensitivity"] == servo_design().peak_sensitivity
    content = plain.law_to_json()
    json.dumps(content, allow_nan=False)
    assert content["frozen"][-1]["peak_sensitivity"] is None
    assert content["law"]["states"] == ["position", "velocity", "force", "queue_1"]
    assert len(content["law"]["gain"]) == 4


def test_without_the_feedforward_the_feedback_is_the_same():
    bare = design_controller(servo(), TABLE, servo_map(), feedforward=False)
    np.testing.assert_array_equal(bare.law.gains.state, servo_design().law.gains.state)
    assert not bare.parameters.feedforward
    assert bare.bandwidth == bare.feedback_bandwidth == servo_design().feedback_bandwidth
    assert bare.flat_band < servo_design().flat_band


def test_a_missing_section_is_named():
    with pytest.raises(ActuatorError, match=r"\[controller\]"):
        design_controller(servo().model_copy(update={"controller": None}), TABLE, servo_map())


def test_a_sensor_without_noise_still_gets_a_filter():
    ideal = design_controller(servo(position_sensor={"noise": 0.0}), TABLE, servo_map())
    assert np.isfinite(ideal.peak_sensitivity)
    assert dataclasses.is_dataclass(ideal)


def test_equal_beliefs_and_wishes_search_their_weights_once(monkeypatch):
    lqr_design(servo_belief())  # the search may have been forgotten since the fixture's

    def searched(*_):
        raise AssertionError("searched")

    monkeypatch.setattr(import_module("msl_fem.control.lqr_design"), "_badness", searched)
    assert lqr_design(servo_belief()).weights == servo_design().weights
    heavier = servo_belief(motion={"moving_mass": 0.7})
    noisier = servo_belief(position_sensor={"noise": 1e-5})
    for belief, wish in ((heavier, Wish(60.0, 2.0)), (noisier, Wish(60.0, 2.0)), (servo_belief(), Wish(50.0, 2.0))):
        with pytest.raises(AssertionError, match="searched"):
            lqr_design(belief, wish)
