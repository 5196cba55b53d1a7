"""Leakage and mutual flux of the sides, gains and zeros of what drives them: closed forms, reciprocity, energy."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from coupled_twin import kernel_run as run
from effect_sets import ALL_EFFECTS, rough

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.layout import OUT_FLUX_1, OUT_I1, OUT_VOLTAGE_1, OUT_X
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.table.magnetic_table import MagneticTable

L_0 = 2 * 1.08e-5 / 6.3e-4
NUISANCES = {"leakage_1": 0.03 * L_0, "leakage_2": -0.02 * L_0, "mutual": 0.05 * L_0}
DRIVES = [{"bandwidth": None}, {"bandwidth": 1e3}, {"bandwidth": 2e4}, {"kind": "voltage", "bandwidth": None}]


def test_two_locked_coils_with_mutual_flux_have_a_closed_form(servo: Actuator) -> None:
    """Equal sides: the sum of the currents rises with (L + l + M)/R, their difference with (L + l - M)/R."""
    bench = changed(locked(servo), drive={"kind": "voltage", "bandwidth": None})
    inputs = Inputs(np.full((200, 2), [10.0, 4.0]), 1e3)
    out = run(bench, linear_table(), inputs, leakage_1=0.03 * L_0, leakage_2=0.03 * L_0, mutual=0.05 * L_0)[0]
    both = out[:, OUT_I1 : OUT_I1 + 2]
    for sign, volts, inductance in ((1, 14.0, 1.08 * L_0), (-1, 6.0, 0.98 * L_0)):
        exact = volts / 2 * (1 - np.exp(-inputs.time * 2 / inductance))
        assert both[:, 0] + sign * both[:, 1] == pytest.approx(exact, rel=1e-8, abs=1e-12)
    flux = out[:, OUT_FLUX_1 : OUT_FLUX_1 + 2]
    assert flux[:, 0] == pytest.approx(1.03 * L_0 * both[:, 0] + 0.05 * L_0 * both[:, 1], rel=1e-9)


@pytest.mark.parametrize("drive", DRIVES, ids=["ideal", "loop", "fast loop", "voltage"])
@pytest.mark.parametrize("effects", [None, EffectValues({"cross_coupling": {"share": 0.03}})])
def test_the_energy_ledger_closes_and_flux_follows_the_voltage(
    servo: Actuator, table: MagneticTable, drive: dict[str, object], effects: EffectValues | None
) -> None:
    bench, inputs = changed(servo, drive=drive | {"voltage_limit": None}), rough(300)
    out, imbalance, plant = run(bench, table, inputs, effects, **NUISANCES)
    assert abs(imbalance) < 1e-6
    current, flux = out[:, OUT_I1 : OUT_I1 + 2], out[:, OUT_FLUX_1 : OUT_FLUX_1 + 2]
    if drive["bandwidth"] == 1e3 or "kind" in drive:  # currents of the others jump at the samples
        mean = (current[1:] + current[:-1]) / 2
        induced = out[:-1, OUT_VOLTAGE_1 : OUT_VOLTAGE_1 + 2] - np.diff(flux, axis=0) * inputs.rate
        assert induced == pytest.approx(plant.resistance * mean, abs=0.2 * np.abs(np.diff(current, axis=0)).max())
    plain = run(bench, table, inputs, effects)[0]
    assert np.abs(plain - out)[:, OUT_FLUX_1].max() > 1e-3 * np.abs(plain[:, OUT_FLUX_1]).max()


def test_hysteresis_and_eddy_currents_bear_mutual_flux(servo: Actuator, table: MagneticTable) -> None:
    imbalance = run(servo, table, rough(100), ALL_EFFECTS, 160, **NUISANCES)[1]
    assert abs(imbalance) < 1e-6


@pytest.mark.parametrize("drive", DRIVES, ids=["ideal", "loop", "fast loop", "voltage"])
def test_lanes_change_no_bit_and_neutral_effects_nothing(
    servo: Actuator, table: MagneticTable, drive: dict[str, object]
) -> None:
    numbers = NUISANCES | {"input_gain_1": 1.01, "input_gain_2": 0.98, "input_zero_1": 0.01, "input_zero_2": -0.02}
    bench, inputs = changed(servo, drive=drive), rough(60)
    out, _, plant = run(bench, table, inputs, steps=5, **numbers)
    neutral = run(bench, table, inputs, EffectValues(), steps=5, **numbers)[0]
    lanes = run_lanes(surface_of(table), [plant, plant_parameters(bench)], inputs, substeps=5, settings=LaneSettings())
    assert neutral[:, OUT_VOLTAGE_1] == pytest.approx(out[:, OUT_VOLTAGE_1], rel=1e-9)
    for column in (OUT_X, OUT_I1, OUT_I1 + 1, OUT_FLUX_1, OUT_VOLTAGE_1):
        assert np.allclose(out[:, column], neutral[:, column], rtol=1e-11, atol=1e-20)
        assert np.array_equal(out[:, column], lanes.rows(0)[:, column])


def test_lanes_that_differ_in_readings_alone_are_run_once(servo: Actuator, table: MagneticTable) -> None:
    """Ten lanes, of which the kernel sees three: each reads as it does alone."""
    rows = [{}, {"current_sensor_error": {"gain_1": 0.01}}, {"position_sensor_nonlinearity": {"cubic": 1e5}}] * 3
    effects = np.array([EffectValues(row).vector() for row in [*rows, {"coulomb_friction": {"force": 0.01}}]])
    plants = [plant_parameters(servo)] * 9 + [plant_parameters(servo)._replace(mass=0.2)]
    plants[4] = plants[9]
    alone = [
        run_lanes(surface_of(table), [plant], rough(60), substeps=5, settings=LaneSettings(effects=row[None]))
        for plant, row in zip(plants, effects, strict=True)
    ]
    found = run_lanes(surface_of(table), plants, rough(60), substeps=5, settings=LaneSettings(effects=effects))
    assert len(np.unique(found.place)) == 3
    for n, one in enumerate(alone):
        assert np.allclose(found.position[n], one.position[0], rtol=1e-12, atol=1e-18)
        assert np.allclose(found.current[n], one.current[0], rtol=1e-12, atol=1e-15)


def test_gains_and_zeros_of_the_input_are_other_commands(servo: Actuator, table: MagneticTable) -> None:
    inputs = rough(60)
    gains, zeros = np.array([1.02, 0.97]), np.array([0.01, -0.02])
    out = run(servo, table, inputs, input_gain_1=1.02, input_gain_2=0.97, input_zero_1=0.01, input_zero_2=-0.02)[0]
    other = run(servo, table, Inputs(gains * inputs.commands + zeros, inputs.rate, inputs.disturbance))[0]
    assert np.array_equal(out, other)
