"""The thermal part of the guard: two nodes in closed form, currents over time, and a loop that would get too warm."""

from dataclasses import replace

import numpy as np
import pytest
from servo_controllers import servo, servo_design

from msl_fem.actuator import parse_actuator
from msl_fem.control.controller import (
    N_HEAT_LIMITED,
    N_VIOLATION,
    RISE_1,
    controller_state,
    controller_step,
)
from msl_fem.control.design import ControllerDesign, with_thermal_limit
from msl_fem.control.heat import UNGUARDED, ThermalGuard, bearable_now, thermal_guard, warm
from msl_fem.errors import InputError
from msl_fem.losses.thermal_limit import ThermalLimit, continuous_current
from msl_fem.losses.thermal_network import Cooling, Heating, steady_rise

PERIOD = 4e-4


def guard(limit: ThermalLimit | None = None, period: float = PERIOD) -> ThermalGuard:
    found = thermal_guard(servo(), period, limit)
    assert found is not None
    return found


def two_nodes(found: ThermalGuard, loss: float, time: float) -> np.ndarray:
    """Rises (winding, core) in K after a constant loss from cold, by the roots of the quadratic of two nodes."""
    (a, b), (_, d), (c_w, c_c) = *found.network.conductance, found.network.capacity
    half, product = 0.5 * (a / c_w + d / c_c), (a * d - b * b) / (c_w * c_c)
    fast, slow = half + np.sqrt(half**2 - product), half - np.sqrt(half**2 - product)
    end = loss * np.array([d, -b]) / (a * d - b * b)
    start = np.array([loss / c_w, 0.0])  # the slopes at the beginning
    slower = (start - end * fast) / (fast - slow)  # x = end + A e^(-fast t) + B e^(-slow t), A + B = -end
    return np.asarray(end - (end + slower) * np.exp(-fast * time) + slower * np.exp(-slow * time))


def test_the_rises_are_those_of_the_closed_form() -> None:
    found = guard(period=0.5)
    arrays = found.arrays._replace(growth=0.0)
    rises, current = np.zeros(2), 2.0
    for k in range(1, 1201):
        warm(arrays, rises, current)
        if k in (1, 40, 1200):
            expected = two_nodes(found, arrays.resistance * current**2, 0.5 * k)
            np.testing.assert_allclose(rises, expected, rtol=1e-9)


def test_with_a_resistance_that_grows_the_end_is_the_steady_rise() -> None:
    limit = ThermalLimit(ambient=303.15)
    found = guard(limit, period=20.0)
    rises = np.zeros(2)
    for _ in range(2000):
        warm(found.arrays, rises, 1.4)
    expected = steady_rise(found.network, Heating(servo().coil_resistance(), limit.ambient), 1.4)
    np.testing.assert_allclose(rises, expected, rtol=1e-9)


def test_what_is_left_at_the_limit_is_the_continuous_current() -> None:
    found, limit = guard(), ThermalLimit()
    continuous = continuous_current(servo(), limit).continuous
    assert found.continuous == pytest.approx(continuous)
    end = np.linalg.solve(found.network.conductance, [80.0 / found.network.resistance, 0.0])
    assert end[0] == pytest.approx(80.0)
    assert bearable_now(found.arrays, end) == pytest.approx(continuous)
    assert bearable_now(found.arrays, np.array([95.0, 95.0])) == 0.0
    assert bearable_now(UNGUARDED, np.array([1e3, 1e3])) == np.inf


@pytest.mark.parametrize("duration", [10.0, 60.0, 600.0])
def test_a_cold_winding_bears_its_peak_current_so_long(duration: float) -> None:
    found = guard(period=duration / 2000)
    arrays = found.arrays._replace(growth=0.0, resistance=found.arrays.resistance * (1 + 80.0 * found.arrays.growth))
    rises = np.zeros(2)
    for _ in range(2000):
        assert rises[0] < 80.0
        warm(arrays, rises, found.bearable(duration))
    assert rises[0] == pytest.approx(80.0, rel=1e-9)
    assert found.bearable(duration) > found.continuous


def test_the_most_that_is_borne_brings_the_winding_to_its_limit_and_not_beyond() -> None:
    found = guard(period=0.5)
    rises, warmest, currents = np.zeros(2), 0.0, []
    for _ in range(40_000):
        currents.append(min(bearable_now(found.arrays, rises), 6.0))
        warm(found.arrays, rises, currents[-1])
        warmest = max(warmest, float(rises[0]))
    assert 79.9 < warmest <= 80.0 + 1e-9
    assert currents[0] == 6.0
    assert np.diff(currents).max() < 1e-9
    assert currents[-1] == pytest.approx(found.continuous, rel=1e-3)


def hot(design: ControllerDesign, factor: float = 2000.0) -> ControllerDesign:
    """A design whose windings warm so many times faster."""
    found = thermal_guard(design.actuator, PERIOD * factor)
    assert found is not None
    return replace(design, thermal=found, parameters=design.parameters._replace(thermal=found.arrays))


def test_a_loop_that_would_get_too_warm_is_cut_and_says_so() -> None:
    """A hard push at a held position: the guard lets it pass, the heat does not."""
    design = hot(servo_design())
    state, command, wanted = controller_state(design.parameters), np.zeros(2), np.zeros(6)
    warmest, currents = 0.0, []
    for _ in range(2000):
        controller_step(design.parameters, state, wanted, -4e-4, command)
        warmest = max(warmest, state[RISE_1])
        currents.append(command[0])
    assert state[N_HEAT_LIMITED] > 500
    assert state[N_VIOLATION] == 0, "the map allows what the heat does not"
    assert warmest <= 80.0 + 1e-6
    assert currents[-1] < 0.6 * max(currents)
    warmer = with_thermal_limit(design, ThermalLimit(temperature_rise=120.0))
    assert warmer.thermal is not None
    assert warmer.thermal.continuous > design.thermal.continuous  # type: ignore[union-attr]


def test_a_winding_of_unknown_heat_is_not_guarded_or_refused() -> None:
    actuator = servo()
    table_magnet = parse_actuator({
        "schema": 1, "name": "measured", "magnet": {"kind": "table", "table": "measured.nc"},
        "motion": {"moving_mass": "1 kg", "nominal_gap": "1 mm"},
        "drive": {"kind": "current", "coil_resistance": "1 ohm"},
    })  # fmt: skip
    assert thermal_guard(table_magnet, PERIOD) is None
    with pytest.raises(InputError, match="the windings cannot be guarded"):
        thermal_guard(table_magnet, PERIOD, ThermalLimit())
    one = thermal_guard(actuator, PERIOD, ThermalLimit(cooling=Cooling(thermal_resistance=20.0)))
    assert one is not None
    rises = np.zeros(2)
    warm(one.arrays, rises, 3.0)
    assert rises[0] > 0.0
    assert rises[1] == 0.0
