"""What a reference asks of the coils, and the overlap that keeps it within the drive's voltage."""

from dataclasses import replace

import numpy as np
import pytest
from servo_controllers import RATE, reference, servo_belief, sine

from msl_fem.control.asked_voltage import SHARE_OF_LIMIT, asked_voltage
from msl_fem.control.inverse import magnet_force

FAST = sine(1e-4, 200.0, 0.1)


def samples(track) -> np.ndarray:
    return np.stack([track.position, track.velocity, track.acceleration], axis=1)


def hand_over_voltage(overlap: float) -> float:
    """V at the crossing of zero force by the closed form, far from saturation, the mover in the middle."""
    model = servo_belief()
    p, side = model.plant, model.inverse
    w = 2 * np.pi * 200.0
    slope = abs(p.mass * w**2 - p.stiffness) * 1e-4 * w
    gap, current = model.coupled.nominal_gap, 0.05
    force = side.magnets * magnet_force(side.surface_1, current * side.current_share, gap)
    inductance = 2 * gap * force / current**2
    return 0.5 * 3**0.75 * slope * np.sqrt(inductance * gap / (8 * overlap))


def test_the_voltage_at_the_hand_over_is_that_of_the_closed_form() -> None:
    """But for what a sample's mean takes off the peak, for resistance and motion."""
    for overlap in (20.0, 40.0, 80.0):
        found = asked_voltage(servo_belief(), samples(FAST), overlap=overlap).largest
        assert found == pytest.approx(hand_over_voltage(overlap), rel=0.04)


def test_the_overlap_that_is_needed_keeps_the_voltage_and_is_the_least() -> None:
    model = servo_belief()
    hard = asked_voltage(model, samples(FAST), overlap=0.0)
    assert hard.largest > hard.limit
    assert asked_voltage(model, samples(FAST), overlap=hard.needed).largest <= SHARE_OF_LIMIT * hard.limit
    assert asked_voltage(model, samples(FAST), overlap=0.9 * hard.needed).largest > SHARE_OF_LIMIT * hard.limit
    assert hard.needed == float(f"{hard.needed:.2g}")


def test_slow_references_and_jumps_need_none_and_what_no_overlap_helps_says_so() -> None:
    model = servo_belief()
    jump = reference(np.where(np.arange(250) < 50, 0.0, 2e-4), np.zeros(250), np.zeros(250))
    for track in (sine(4e-4, 2.0, 0.5), sine(1e-4, 60.0, 0.2), jump):
        assert asked_voltage(model, samples(track), overlap=0.0).needed == 0.0
    beyond = asked_voltage(model, samples(sine(1e-4, 350.0, 0.1)), overlap=0.0)
    assert np.isnan(beyond.needed)
    assert beyond.to_json()["needed_overlap_N"] is None
    unlimited = replace(model, coupled=model.coupled._replace(voltage_limit=np.inf))
    assert asked_voltage(unlimited, samples(FAST), overlap=0.0).needed == 0.0
    assert 1 / model.plant.period == RATE
