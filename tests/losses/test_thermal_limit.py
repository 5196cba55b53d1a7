"""The current a winding bears: self-consistent, duty aware, a curve over the gap."""

import math

import numpy as np
import pytest
from thermal_networks import ROOT, servo

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import InputError, MaterialError
from msl_fem.losses import (
    Cooling,
    Cycle,
    Heating,
    ThermalLimit,
    continuous_current,
    end_turn_surface,
    iron_loss,
    peak_rise,
    sine_operation,
    steady_rise,
    thermal_curve,
    thermal_curve_with_iron,
    thermal_network,
)
from msl_fem.losses.copper_loss import copper_loss
from msl_fem.table.magnetic_table import MagneticTable, read_table


@pytest.fixture(scope="module")
def table() -> MagneticTable:
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


def test_the_limit_is_where_the_temperature_reaches_it() -> None:
    """Two routes: the current from the limit, the temperature from the current."""
    for limit in (ThermalLimit(), ThermalLimit(40.0, 313.15), ThermalLimit(cooling=Cooling(thermal_resistance=2.0))):
        found = continuous_current(servo(), limit, core_loss=0.3)
        rise = steady_rise(found.network, Heating(1.0, limit.ambient, 0.3), found.continuous)
        assert rise[0] == pytest.approx(limit.temperature_rise, rel=1e-9)
        hot = copper_loss(servo(), found.continuous, temperature=limit.hottest)
        assert found.copper_loss == pytest.approx(hot.loss, rel=1e-9)
        assert found.continuous < found.runaway


def test_a_stated_resistance_by_hand() -> None:
    """80 K over 2 K/W: 40 W at 1.3144 ohm."""
    found = continuous_current(servo(), ThermalLimit(cooling=Cooling(thermal_resistance=2.0)))
    assert found.continuous == pytest.approx(math.sqrt(40 / 1.3144), rel=1e-4)
    assert found.on_phase == found.continuous


@pytest.mark.parametrize("period", [None, 1.0, 300.0, 1e5])
@pytest.mark.parametrize("duty", [0.1, 0.5, 0.95])
def test_the_on_phases_current(duty: float, period: float | None) -> None:
    """Its peak is the limit; it lies between the continuous current and that of the same RMS."""
    limit = ThermalLimit(cycle=Cycle(duty, period))
    found = continuous_current(servo(), limit)
    peak = peak_rise(found.network, Heating(1.0), found.on_phase, cycle=limit.cycle)
    assert peak == pytest.approx(80.0, rel=1e-6)
    assert found.continuous * (1 - 1e-9) <= found.on_phase <= found.continuous / math.sqrt(duty) * (1 + 1e-9)
    if period is None:
        assert found.on_phase == pytest.approx(found.continuous / math.sqrt(duty), rel=1e-9)


def test_what_helps_and_what_costs() -> None:
    plain = continuous_current(servo(), ThermalLimit()).continuous
    cooler = ThermalLimit(cooling=Cooling(heat_transfer_coefficient=50.0))
    assert continuous_current(servo(), cooler).continuous > 1.3 * plain
    assert continuous_current(servo(), ThermalLimit(ambient=313.15)).continuous < plain
    assert continuous_current(servo(), ThermalLimit(), core_loss=1.0).continuous < plain
    assert continuous_current(servo(), ThermalLimit(40.0)).continuous < plain


def test_the_networks_surfaces_and_capacities() -> None:
    """The reference actuator by hand: 40 mm by 26 mm E with two 10 mm by 20 mm windows, 20 mm deep."""
    magnet = servo().magnet
    assert magnet.core_surface == pytest.approx(2 * (40 * 26 - 400) * 1e-6 + (40 + 2 * 26) * 20e-6, rel=1e-12)
    turn = 2 * (20 + 10) + 2 * math.pi * 5
    assert end_turn_surface(magnet) == pytest.approx((turn - 40) * 1e-3 * 32e-3, rel=1e-12)
    network = thermal_network(servo(), Cooling())
    assert network.capacity[0] == pytest.approx(8890 * 385 * 0.5 * 128e-6 * turn * 1e-3, rel=1e-12)
    assert network.capacity[1] == pytest.approx(7650 * 460 * 640e-6 * 0.02 * 0.96, rel=1e-12)
    between = -network.conductance[0, 1]
    liner = 1e-3 / 0.2 / (2 * 30e-3 * 16e-3)
    assert liner < 1 / between < 3 * liner  # the liner, and the way within the winding beside it


def test_what_is_refused() -> None:
    with pytest.raises(InputError, match="the iron loss of 50 W alone heats the winding"):
        continuous_current(servo(), ThermalLimit(), core_loss=50.0)
    with pytest.raises(InputError, match="an iron loss of -1 W"):
        continuous_current(servo(), ThermalLimit(), core_loss=-1.0)
    for rise, ambient in ((0.0, 293.15), (float("nan"), 293.15), (80.0, 20.0), (400.0, 293.15)):
        with pytest.raises(InputError, match="is not allowed"):
            ThermalLimit(rise, ambient)
    for wrong in (
        {"thermal_resistance": 0.0},
        {"heat_transfer_coefficient": -1.0},
        {"insulation_conductivity": math.nan},
    ):
        with pytest.raises(InputError, match="is not allowed; it must be"):
            Cooling(**wrong)


def test_a_magnet_without_dimensions_needs_a_thermal_resistance() -> None:
    other: Actuator = parse_actuator({
        "schema": 1, "name": "by table", "magnet": {"kind": "table", "table": "x.nc"},
        "motion": {"moving_mass": "1 kg", "nominal_gap": "1 mm"},
        "drive": {"kind": "current", "coil_resistance": "1 ohm"},
    })  # fmt: skip
    with pytest.raises(InputError, match='state it, like --thermal-resistance "2 K/W"'):
        continuous_current(other, ThermalLimit())
    limit = ThermalLimit(cycle=Cycle(0.5), cooling=Cooling(thermal_resistance=2.0))
    assert continuous_current(other, limit).on_phase == pytest.approx(math.sqrt(2 * 40 / 1.3144), rel=1e-4)
    with pytest.raises(InputError, match="heat capacity is not known"):
        continuous_current(other, ThermalLimit(cycle=Cycle(0.5, 10.0), cooling=Cooling(thermal_resistance=2.0)))


def test_the_curve_without_iron_is_flat() -> None:
    curve = thermal_curve(servo(), [2e-4, 6e-4, 1e-3], ThermalLimit())
    assert np.ptp(curve.continuous) == 0
    assert curve.to_json()["continuous_current_A"] == [curve.copper_only.continuous] * 3
    assert curve.to_json()["thermal"]["notes"]


def test_the_curve_with_iron_loss(table: MagneticTable) -> None:
    """At each gap copper and iron at that very current reach the limit; a small gap has more flux: less current."""
    gaps, frequency = [2e-4, 6e-4, 1e-3], 400.0
    curve = thermal_curve_with_iron(servo(), gaps, ThermalLimit(), table=table, frequency=frequency)
    assert (np.diff(curve.continuous) > 0).all()
    assert (curve.continuous < curve.copper_only.continuous).all()
    for gap, current in zip(gaps, curve.continuous, strict=True):
        wave = sine_operation(0.0, gap, frequency=frequency, amplitude=math.sqrt(2) * current)
        core = iron_loss(table, servo(), operation=wave).core_loss
        rise = steady_rise(curve.copper_only.network, Heating(1.0, core_loss=core or 0.0), current)
        assert rise[0] == pytest.approx(80.0, rel=1e-3)
    slow = thermal_curve_with_iron(servo(), gaps, ThermalLimit(), table=table, frequency=1e-3)
    assert slow.continuous == pytest.approx(curve.copper_only.continuous, rel=1e-4)


def test_where_the_iron_loss_ends_the_curve_is_not_known(table: MagneticTable) -> None:
    """Cooled so well that the table's currents end first: null, with a note; never the table's end as a limit."""
    limit = ThermalLimit(cooling=Cooling(thermal_resistance=0.05))
    curve = thermal_curve_with_iron(servo(), [6e-4], limit, table=table, frequency=50.0)
    assert np.isnan(curve.continuous).all()
    assert curve.to_json()["continuous_current_A"] == [None]
    assert any(note.startswith("null") for note in curve.notes)


def test_the_curve_with_iron_needs_the_irons_losses(table: MagneticTable) -> None:
    actuator = servo()
    magnet = actuator.magnet
    iron = magnet.iron.model_copy(update={"core": "m27"})
    other = actuator.model_copy(update={"magnet": magnet.model_copy(update={"iron": iron})})
    with pytest.raises(MaterialError, match="no loss data with a source for iron 'm27'"):
        thermal_curve_with_iron(other, [6e-4], ThermalLimit(), table=table, frequency=50.0)
    with pytest.raises(InputError, match="above the 400 Hz"):
        thermal_curve_with_iron(actuator, [6e-4], ThermalLimit(), table=table, frequency=5000.0)
