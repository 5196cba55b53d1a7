"""Copper loss at a temperature, for direct and for periodic current."""

from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.losses import choose_wire, resistance_factor, slot_rows
from msl_fem.losses.copper_loss import copper_loss, copper_loss_of_period


@pytest.fixture(scope="module")
def servo() -> Actuator:
    return load_actuator(Path(__file__).parents[2] / "geometries" / "fast_tool_servo.toml")


def test_direct_current(servo: Actuator) -> None:
    assert copper_loss(servo, 3.0).loss == pytest.approx(9.0)
    assert copper_loss(servo, 3.0, temperature=373.15).loss == pytest.approx(9 * 1.3144, rel=1e-9)


def test_each_harmonic_has_its_own_resistance(servo: Actuator) -> None:
    """A bias, 100 Hz and 1 kHz: three terms; without frequency the direct current's loss."""
    winding = choose_wire(servo).winding
    t = np.arange(200) / 200
    current = 1.0 + 0.8 * np.sin(2 * np.pi * t) + 0.3 * np.cos(2 * np.pi * 10 * t)
    found = copper_loss_of_period(servo, current, frequency=100.0, winding=winding)
    factor = resistance_factor(slot_rows(winding, servo.magnet), [100.0, 1000.0])
    expected = 1.0 + 0.8**2 / 2 * factor[0] + 0.3**2 / 2 * factor[1]
    assert found.loss == pytest.approx(expected, rel=1e-12)
    assert found.alternating_share == pytest.approx(1 - (1 + 0.32 + 0.045) / expected, rel=1e-9)
    slow = copper_loss_of_period(servo, current, frequency=1e-6, winding=winding)
    assert slow.loss == pytest.approx(copper_loss(servo, float(np.sqrt(np.mean(current**2)))).loss, rel=1e-9)


def test_currents_that_are_none(servo: Actuator) -> None:
    with pytest.raises(InputError, match="RMS current of -1 A"):
        copper_loss(servo, -1.0)
    with pytest.raises(InputError, match="RMS current of nan A"):
        copper_loss(servo, float("nan"))
    with pytest.raises(InputError, match="one row of finite numbers"):
        copper_loss_of_period(servo, [1.0, np.nan], frequency=50.0, winding=choose_wire(servo).winding)
    with pytest.raises(InputError, match="degC is not allowed"):
        copper_loss(servo, 1.0, temperature=900.0)
