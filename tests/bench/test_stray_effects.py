"""Stray flux, remanence, the coils' field in the sensor and a rail on the bench: closed forms of its own pieces."""

import numpy as np
import pytest
from bench_rigs import RATE, plain_rig, setting_in

from msl_fem.bench.catalogue import INSIDE
from msl_fem.bench.equations import leakage_slope, mutual_slope, railed, remanent_current
from msl_fem.bench.instruments import coil_field, readings
from msl_fem.bench.plant import ENERGY_COPPER, ENERGY_ELECTRICAL, IRON_NODES, SeriesIron, Stray
from msl_fem.bench.rig import InstrumentErrors
from msl_fem.bench.running import run_rig


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


@pytest.mark.parametrize("ahead", [1, -1], ids=["side 1 ahead", "side 2 ahead"])
def test_iron_gives_back_what_leakage_and_mutual_flux_bring_into_it(ahead: int) -> None:
    """Iron in series stores: in a run from nothing to nothing the coils take what their copper loses, whichever side
    leads. Did it follow a side's own flux alone, the sides' mutual flux would bring energy in one sense and take it in
    the other."""
    plain = plain_rig("voltage")
    table = plain.table
    assert table is not None
    inductance = 2 * float(table.evaluate(0.0, plain.plant.magnets.nominal_gap)["incremental_inductance"])
    nodes = np.linspace(0.0, 1.0, IRON_NODES)
    step = 1.2 * inductance / (IRON_NODES - 1)  # of 1.2 A, which take 0.4 A more in the iron there
    iron = SeriesIron(step, 0.4 * nodes**5, 2.0 * nodes**4 / (step * (IRON_NODES - 1)))
    stray = Stray(leakage_1=0.1 * inductance, leakage_bend=2.0, mutual=0.2 * inductance)
    held = plain.with_parts(motion=plain.plant.motion._replace(mass=1e12), series_iron=iron, stray=stray)
    time = np.arange(3000) / RATE
    turn = 2 * np.pi * 20 * time
    rises = np.sin(np.pi * np.minimum(time / 0.2, 1.0)) ** 2
    commands = 8.0 * rises[:, None] * np.column_stack([np.cos(turn), np.cos(turn - ahead * np.pi / 2)])
    run = run_rig(held, commands, rate=RATE)
    taken, lost = run.end_state[ENERGY_ELECTRICAL], run.end_state[ENERGY_COPPER]
    assert np.abs(run.current).max() > 0.7
    assert abs(run.current[-1]).max() < 1e-3
    assert taken == pytest.approx(lost, rel=2e-6)


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
