"""Loss figures show what they were given, and say what is not known."""

from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import MaterialError
from msl_fem.losses import Cycle, ThermalLimit, iron_loss, sine_operation, thermal_curve
from msl_fem.losses.copper_loss import copper_loss
from msl_fem.maps import operating_map
from msl_fem.materials.core_loss_data import loss_sheets, read_loss_points, sheet_of
from msl_fem.materials.material import LIBRARY
from msl_fem.report.figures import add_thermal_limit, losses_by_section, measured_and_fitted_losses, operating_regions
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def servo() -> Actuator:
    return load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")


@pytest.fixture(scope="module")
def servo_table() -> MagneticTable:
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


def test_bars_add_up_to_the_losses(servo: Actuator, servo_table: MagneticTable) -> None:
    iron = iron_loss(servo_table, servo, operation=sine_operation(1.0, 6e-4, frequency=100.0, amplitude=0.5))
    made = losses_by_section(iron, copper_loss(servo, 1.2))
    bars = {trace.name: trace.y for trace in made.data}
    assert sum(sum(bars[term]) for term in ("hysteresis", "eddy", "excess")) == pytest.approx(iron.loss)
    assert bars["copper"] == (pytest.approx(1.44),)
    assert not made.layout.annotations


def test_a_loss_that_is_not_known_has_no_bar(servo: Actuator, servo_table: MagneticTable) -> None:
    operation = sine_operation(1.0, 6e-4, frequency=100.0, amplitude=0.5)
    iron = iron_loss(servo_table, servo, operation=operation, thickness=0.5e-3)
    made = losses_by_section(iron, copper_loss(servo, 1.2))
    assert set(made.data[0].y) == {None}
    assert [a.text for a in made.layout.annotations] == ["not known"] * 4


def test_the_limit_joins_the_map(servo: Actuator, servo_table: MagneticTable) -> None:
    curve = thermal_curve(servo, servo_table.gap, ThermalLimit(cycle=Cycle(0.5)))
    made = add_thermal_limit(operating_regions(operating_map(servo_table)), curve)
    assert [trace.name for trace in made.data][-2:] == ["continuous, 80 K", "for 50% of the time"]
    np.testing.assert_allclose(made.data[-2].y, curve.continuous)
    np.testing.assert_allclose(made.data[-1].y, curve.on_phase)


def test_the_fit_beside_its_data() -> None:
    """Line and points of one colour are of one frequency: within the fit's largest error."""
    sheet = sheet_of("m19", thickness=0.36e-3)
    points = read_loss_points(LIBRARY / loss_sheets()["m19_29ga"]["data"])
    made = measured_and_fitted_losses(points, sheet)
    assert sheet.coefficients is not None
    for fitted, measured in zip(made.data[::2], made.data[1::2], strict=True):
        there = np.interp(measured.x, fitted.x, fitted.y)
        assert np.abs(there / measured.y - 1).max() < sheet.coefficients.largest_error + 0.01
    with pytest.raises(MaterialError, match="no loss data"):
        measured_and_fitted_losses(points, sheet_of("m27"))
