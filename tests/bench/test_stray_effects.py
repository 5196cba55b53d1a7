"""Stray flux, remanence, the coils' field in the sensor and a rail on the bench: closed forms of its own pieces."""

import numpy as np
import pytest
from bench_rigs import setting_in

from msl_fem.bench.catalogue import INSIDE
from msl_fem.bench.equations import leakage_slope, mutual_slope, railed, remanent_current
from msl_fem.bench.instruments import coil_field, readings
from msl_fem.bench.plant import Stray
from msl_fem.bench.rig import InstrumentErrors


def test_a_rail_is_reached_softly_and_never_left() -> None:
    """Half the rail within 1e-5, the rail itself at 2^(-1/14) of it, ten times the rail: the rail; odd."""
    assert railed(2.0, 1.0) == pytest.approx(1.0, rel=1e-5)
    assert railed(2.0, 2.0) == pytest.approx(2.0 * 2 ** (-1 / 14), rel=1e-12)
    assert railed(2.0, 20.0) == pytest.approx(2.0, rel=1e-12)
    assert railed(2.0, -3.0) == -railed(2.0, 3.0)


def test_stray_flux_bends_and_has_a_slope() -> None:
    stray = Stray(leakage_1=1e-3, leakage_bend=4.0, mutual=2e-4, mutual_curve=1e5, remanent_2=0.3, remanent_flux=0.05)
    assert leakage_slope(stray, 0, 4.0) == pytest.approx(0.5e-3)
    assert leakage_slope(stray, 1, 4.0) == 0.0
    assert remanent_current(stray, 1, 0.05) == pytest.approx(0.15)
    step = 1e-7
    change = 2e-4 * 1e5 * ((3e-4 + step) ** 2 - (3e-4 - step) ** 2)
    assert mutual_slope(stray, 3e-4) == pytest.approx(change / (2 * step), rel=1e-6)


def test_the_coils_field_is_seen_behind_two_lags() -> None:
    """A ramp of the current, settled: late by the sum of the lags, at any rate."""
    errors = InstrumentErrors(coil_reading=(2e-7, -1e-7), coil_reading_lag=1e-3)
    time = np.arange(400) / 1e4
    current = np.column_stack([3.0 * time, np.zeros(400)])
    seen = coil_field(errors, current, rate=1e4)
    assert seen[300:] == pytest.approx(2e-7 * 3.0 * (time[300:] - 1e-3), rel=1e-9)
    still = coil_field(errors, np.full((50, 2), 2.0), rate=1e4)
    assert still == pytest.approx(2e-7, rel=1e-12)


@pytest.mark.parametrize("name", ["mutual_inductance", "position_sensor_crosstalk", "drive_limit"])
def test_what_is_hidden_shows_where_it_acts(name: str) -> None:
    """Mutual flux in the currents, the coils' field in the position alone, a rail in the currents."""
    it = setting_in("voltage")
    effect = INSIDE[name]
    rig, parameters = effect.hide(it, it.rig, 2 * effect.start(it))
    plain = readings(it.rig, it.responses[0])
    if name == "position_sensor_crosstalk":
        changed = readings(rig, it.responses[0])
        assert np.array_equal(changed["current_1_A"], plain["current_1_A"])
        assert np.abs(changed["position_m"] - plain["position_m"]).max() > 0.01 * np.abs(plain["position_m"]).max()
    elif name == "drive_limit":
        assert 0 < parameters["rail"] < parameters["largest"]
    else:
        assert rig.plant.stray.mutual == pytest.approx(parameters["share"] * _nominal(it), rel=1e-9)
        assert parameters["share"] < 0  # opposing sides


def _nominal(it) -> float:
    magnets = it.rig.plant.magnets
    magnet = it.table.evaluate(0.0, it.actuator.motion.nominal_gap)
    return magnets.per_side * magnets.share**2 * float(magnet["incremental_inductance"])
