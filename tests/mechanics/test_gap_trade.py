"""The trade of the nominal gap: a magnet whose trade is known in closed form, and the reference actuator."""

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.mechanics.gap_trade import TradeSettings, gap_trade
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parents[2]
INDUCTANCE_GAP = 1e-5  # H m: L = 1e-5/g
LEVEL_OVER = 400e-6  # T m/A: B = 4e-4 i/g


def linear_table() -> MagneticTable:
    """W' = a i^2/(2 g): F = a i^2/(2 g^2), B = b i/g, so that at a level of B the force is the same at every gap."""
    gap, current = np.geomspace(5e-5, 1.2e-3, 40), np.linspace(0.0, 12.0, 25)
    i, g = np.meshgrid(current, gap)
    a = INDUCTANCE_GAP
    nodes = {
        "coenergy": a * i**2 / (2 * g),
        "flux_linkage": a * i / g,
        "force": a * i**2 / (2 * g**2),
        "incremental_inductance": a / g,
        "force_current_slope": a * i / g**2,
        "force_gap_slope": -a * i**2 / g**3,
    }
    return MagneticTable(gap, current, nodes, {"flux_density_centre_leg": LEVEL_OVER * i / g})


def linear_actuator(**motion: Any) -> Actuator:
    stated = {"moving_mass": "1 kg", "stiffness": "1e4 N/m", "nominal_gap": "0.5 mm", "range": "0.4 mm"} | motion
    return parse_actuator(
        {
            "schema": 1,
            "name": "closed form",
            "magnet": {"kind": "table", "table": "none.nc"},
            "sides": {"count": 2, "magnets_per_side": 2},
            "motion": stated,
            "drive": {"kind": "current", "current_limit": "12 A"},
        }
    )


def test_the_trade_of_a_linear_magnet_in_closed_form() -> None:
    """At 1.2 T a side gives F = 2 a (1.2/b)^2/2 at every gap: (k + F/X)/m is the bandwidth's square, i ~ g."""
    trade = gap_trade(linear_actuator(), linear_table())
    force = INDUCTANCE_GAP * (1.2 / LEVEL_OVER) ** 2
    assert trade.clearance == pytest.approx(0.1e-3)
    assert trade.range == pytest.approx(trade.nominal_gap - 0.1e-3)
    exact = np.sqrt(1e4 + force / trade.range) / (2 * math.pi)
    assert trade.bandwidth_full == pytest.approx(exact, rel=2e-3)  # from interpolated currents and sampled phases
    assert trade.level_current == pytest.approx(1.2 * trade.nominal_gap / LEVEL_OVER, rel=2e-3)
    assert trade.force == pytest.approx(4.0)
    wanted = trade.nominal_gap * math.sqrt(4.0 / INDUCTANCE_GAP)
    assert trade.force_current == pytest.approx(wanted, rel=1e-4)
    assert trade.nominal_gap[-1] == pytest.approx((1.2e-3 + 0.1e-3) / 2), "no further than the table covers"


def test_a_drives_limit_bounds_force_and_current() -> None:
    """From where the level would take more than the limit, the limit counts, and the force falls with the gap."""
    content = linear_actuator().model_dump(by_alias=True, exclude_none=True)
    content["drive"]["current_limit"] = 1.2
    limited, free = (
        gap_trade(Actuator.model_validate(content), linear_table()),
        gap_trade(linear_actuator(), linear_table()),
    )
    far = free.level_current > 1.2
    assert far.any()
    assert not far.all()
    assert limited.level_current[far] == pytest.approx(1.2)
    assert limited.level_current[~far] == pytest.approx(free.level_current[~far], rel=5e-3)
    assert (limited.bandwidth_full[far] < free.bandwidth_full[far]).all()


def test_parallel_magnets_take_twice_the_side_current() -> None:
    content = linear_actuator().model_dump(by_alias=True, exclude_none=True)
    content["drive"]["current_limit"] = 24.0
    content["sides"]["connection"] = "parallel"
    parallel, series = (
        gap_trade(Actuator.model_validate(content), linear_table()),
        gap_trade(linear_actuator(), linear_table()),
    )
    assert parallel.level_current == pytest.approx(2 * series.level_current)
    assert parallel.force_current == pytest.approx(2 * series.force_current)
    assert parallel.bandwidth_full == pytest.approx(series.bandwidth_full)


def test_a_range_that_cannot_be_held_has_no_bandwidth() -> None:
    """k X beyond the force of a side: 90 N at 1.2 T."""
    trade = gap_trade(linear_actuator(stiffness="1e6 N/m"), linear_table())
    held = trade.range < INDUCTANCE_GAP * (1.2 / LEVEL_OVER) ** 2 / 1e6
    assert held.any()
    assert (trade.bandwidth_full[held] > 0).all()
    assert (trade.bandwidth_full[~held] == 0).all()


def test_the_reference_actuator_pays_for_range_with_bandwidth_and_current(servo: Actuator) -> None:
    trade = gap_trade(servo, read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc"))
    assert (np.diff(trade.range) > 0).all()
    assert (np.diff(trade.bandwidth_full) < 0).all()
    assert (np.diff(trade.bandwidth_fixed[np.isfinite(trade.bandwidth_fixed)]) < 0).all()
    assert (np.diff(trade.level_current) > 0).all()
    assert (np.diff(trade.force_current) > 0).all()
    at = int(np.argmin(np.abs(trade.nominal_gap - 0.6e-3)))
    assert 110 < trade.bandwidth_full[at] < 120
    assert trade.level_current[at] == pytest.approx(3.9, abs=0.1)


def test_the_leaves_cubic_term_counts() -> None:
    """It pushes back at the ends of the travel, where the sides pull against the inertia: a little more bandwidth."""
    content = tomllib.loads((ROOT / "geometries" / "fast_tool_servo_flexure.toml").read_text(encoding="utf-8"))
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    stretched = gap_trade(parse_actuator(content), table)
    content["motion"]["flexure"]["arrangement"] = "one-sided"
    free = gap_trade(parse_actuator(content), table)
    assert stretched.bandwidth_full[-1] > 1.02 * free.bandwidth_full[-1]


def test_refusals(servo: Actuator) -> None:
    table = linear_table()
    with pytest.raises(InputError, match=r"clearance 10 µm must lie within the table's gaps, 0\.05 \.\.\. 1\.2 mm"):
        gap_trade(servo, table, settings=TradeSettings(clearance=10e-6))
    with pytest.raises(InputError, match="amplitude 0 is not allowed"):
        gap_trade(servo, table, settings=TradeSettings(amplitude=0.0))
    with pytest.raises(ActuatorError, match="states no motion"):
        gap_trade(parse_actuator({"schema": 1, "name": "cart", "motion": {"moving_mass": "1 kg"}}), table)
    lone = servo.model_copy(update={"sides": servo.sides.model_copy(update={"count": 1})})  # type: ignore[union-attr]
    with pytest.raises(ActuatorError, match="has one side"):
        gap_trade(lone, table)
