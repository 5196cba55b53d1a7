"""Leakage, mutual inductance, remanent flux, the coils' field in the sensor and a drive's limit: closed forms."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table, locked
from coupled_twin import kernel_run as run
from effect_sets import effects, rough
from scipy.integrate import cumulative_trapezoid
from scipy.stats import logistic

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import OUT_FLUX_1, OUT_I1, OUT_VOLTAGE_1, OUT_X
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import simulate
from msl_fem.plant.static_map import static_map
from msl_fem.table.magnetic_table import MagneticTable

L_0 = 2 * 1.08e-5 / 6.3e-4
"""Inductance of a side of the linear table, H."""
VOLTAGE = {"kind": "voltage", "bandwidth": None}


@pytest.mark.parametrize("drive", [{"bandwidth": 1e3}, VOLTAGE], ids=["current", "voltage"])
def test_effects_of_stray_flux_are_the_plants_own_inductances(
    servo: Actuator, table: MagneticTable, drive: dict[str, object]
) -> None:
    """Two routes: shares of L_0 as effects, and the same inductances as numbers of the plant."""
    bench, inputs = changed(servo, drive=drive), rough(100)
    inductance = 2 * float(table.evaluate(0.0, plant_parameters(servo).nominal_gap)["incremental_inductance"])
    values = EffectValues({
        "leakage_inductance": {"share_1": 0.04, "share_2": -0.01},
        "mutual_inductance": {"share": -0.03},
    })  # fmt: skip
    numbers = {"leakage_1": 0.04 * inductance, "leakage_2": -0.01 * inductance, "mutual": -0.03 * inductance}
    by_effects, imbalance, _ = run(bench, table, inputs, values)
    by_numbers = run(bench, table, inputs, EffectValues(), **numbers)[0]
    plain = run(bench, table, inputs, EffectValues())[0]
    assert abs(imbalance) < 1e-6
    for column in (OUT_X, OUT_I1, OUT_I1 + 1, OUT_FLUX_1, OUT_VOLTAGE_1):
        full = np.abs(by_numbers[:, column]).max()
        assert np.abs(by_effects[:, column] - by_numbers[:, column]).max() < 1e-9 * full
    assert np.abs(by_effects - plain)[:, OUT_FLUX_1].max() > 1e-3 * np.abs(plain[:, OUT_FLUX_1]).max()


@pytest.mark.parametrize("current", [0.3, -1.2])
def test_leakage_through_iron_that_saturates_is_halved_at_its_current(servo: Actuator, current: float) -> None:
    """A locked magnet of a linear table carries L_0 u + share L_0 u/sqrt(1 + c (u/u_h)^2): flux linkage by a static map
    and at the end of a run, its slope half of share L_0 at u_h by differences."""
    c, share, halving = 2 ** (2 / 3) - 1, 0.2, 0.4
    values = effects("leakage_inductance", share_1=share, halving_current=halving)

    def expected(u: np.ndarray) -> np.ndarray:
        return L_0 * (u + share * u / np.sqrt(1 + c * (u / halving) ** 2))

    bench = changed(locked(servo), drive=VOLTAGE)
    plant, surface = plant_parameters(bench), surface_of(linear_table())
    at = np.array([current, halving - 1e-5, halving + 1e-5])
    _, flux = static_map(surface, plant, values, gap=np.full(3, plant.nominal_gap), current=at)
    assert 2 * flux == pytest.approx(expected(at), rel=1e-9), "of one of a side's two magnets"
    assert (flux[2] - flux[1]) / 1e-5 == pytest.approx(L_0 * (1 + share / 2), rel=1e-6)
    inputs = Inputs(np.tile([2.0 * current, 0.0], (4000, 1)), 1e3)
    driven, imbalance, _ = run(bench, linear_table(), inputs, values)
    assert driven[-1, OUT_FLUX_1] == pytest.approx(expected(np.array([current]))[0], rel=1e-6)
    assert abs(imbalance) < 1e-7


@pytest.mark.parametrize("drive", [{"bandwidth": 1e3}, VOLTAGE], ids=["current", "voltage"])
def test_leakage_that_saturates_creates_no_energy_and_goes_over_into_that_which_does_not(
    servo: Actuator, table: MagneticTable, drive: dict[str, object]
) -> None:
    """What it changes falls with the square of the current at which it is halved."""
    bench, inputs, shares = changed(servo, drive=drive), rough(300), {"share_1": 0.05, "share_2": 0.08}
    straight, bent, less = (
        run(bench, table, inputs, EffectValues({"leakage_inductance": {**shares, **shape}}))
        for shape in ({}, {"halving_current": 20.0}, {"halving_current": 40.0})
    )
    assert abs(bent[1]) < 1e-6
    columns = (OUT_FLUX_1, OUT_FLUX_1 + 1) if drive.get("bandwidth") else (OUT_I1, OUT_I1 + 1)
    change = [np.abs(one[0] - straight[0])[:, columns].max() for one in (bent, less)]
    assert change[0] > 1e-7
    assert change[0] / change[1] == pytest.approx(4.0, rel=0.05)


def test_remanent_flux_stays_without_current(servo: Actuator) -> None:
    """Locked, no voltage: no current, the flux of current_1 in side 1; under 2 V the current of a circuit R, L."""
    bench = changed(locked(servo), drive=VOLTAGE)
    values = effects("remanent_flux", current_1=0.3, current_2=-0.1)
    still = run(bench, linear_table(), Inputs(np.zeros((50, 2)), 1e3), values)[0]
    assert np.abs(still[:, OUT_I1 : OUT_I1 + 2]).max() < 1e-12
    assert still[:, OUT_FLUX_1] == pytest.approx(0.3 * L_0, rel=1e-9)
    assert still[:, OUT_FLUX_1 + 1] == pytest.approx(-0.1 * L_0, rel=1e-9)
    inputs = Inputs(np.full((200, 2), [2.0, 0.0]), 1e3)
    driven = run(bench, linear_table(), inputs, values)[0]
    exact = 1 - np.exp(-inputs.time * 2 / L_0)
    assert driven[:, OUT_I1] == pytest.approx(exact, rel=1e-7, abs=1e-12)
    assert driven[:, OUT_FLUX_1] == pytest.approx(L_0 * (exact + 0.3), rel=1e-7)


@pytest.mark.parametrize("current", [0.0, 0.4, -0.4])
def test_remanent_flux_fades_with_the_flux(servo: Actuator, current: float) -> None:
    """At rest: u = i + 0.3/(1 + (u/0.5)^2) in a run under R i volts and in a static map; flux L u, the larger root of
    a cubic."""
    values = effects("remanent_flux", current_1=0.3, current_2=-0.1, halving_current=0.5)
    roots = np.roots([4.0, -4.0 * current, 1.0, -current - 0.3])
    (u,) = roots[np.abs(roots.imag) < 1e-9].real
    inputs = Inputs(np.tile([2.0 * current, 0.0], (4000, 1)), 1e3)
    driven = run(changed(locked(servo), drive=VOLTAGE), linear_table(), inputs, values)[0]
    assert driven[-1, OUT_FLUX_1] == pytest.approx(L_0 * u, rel=1e-6)
    plant, surface = plant_parameters(changed(locked(servo), drive=VOLTAGE)), surface_of(linear_table())
    _, flux = static_map(surface, plant, values, gap=np.array([plant.nominal_gap]), current=np.array([current]))
    assert flux[0] == pytest.approx(L_0 * u / 2, rel=1e-9), "of one of a side's two magnets"


@pytest.mark.parametrize("drive", [{"bandwidth": 1e3}, VOLTAGE], ids=["current", "voltage"])
def test_remanent_flux_creates_no_energy(servo: Actuator, table: MagneticTable, drive: dict[str, object]) -> None:
    values = EffectValues(
        {
            "remanent_flux": {"current_1": 0.1, "current_2": -0.2, "halving_current": 1.0},
            "mutual_inductance": {"share": 0.03},
        }
    )
    assert abs(run(changed(servo, drive=drive), table, rough(300), values)[1]) < 1e-6


def test_a_magnet_at_rest_pulls_by_its_remanent_flux(servo: Actuator, table: MagneticTable) -> None:
    """Force and flux linkage at i are the table's at i + current_1, also of a reversed current."""
    gap, current = np.full(3, 5e-4), np.array([0.0, 2.0, -2.0])
    plant, surface = plant_parameters(servo), surface_of(table)
    force, flux = static_map(surface, plant, effects("remanent_flux", current_1=0.2), gap=gap, current=current)
    assert force == pytest.approx(table.force(np.abs(current + 0.2), gap), rel=1e-9)
    assert flux == pytest.approx(np.sign(current + 0.2) * table.flux_linkage(np.abs(current + 0.2), gap), rel=1e-9)
    assert force[1] > force[2]


@pytest.mark.parametrize("lag", [0.0, 4e-3])
def test_the_sensor_sees_the_coils_field_behind_its_lag(servo: Actuator, lag: float) -> None:
    """Locked mover under 2 V: i = 1 - e^(-t/T) A, seen as the answer of a lag, with the sensor's own pole behind."""
    sensor = 2e3
    bench = changed(locked(servo), drive=VOLTAGE, position_sensor={"bandwidth": sensor / (2 * np.pi), "noise": 0.0})
    inputs, seen = Inputs(np.full((300, 2), [2.0, 0.0]), 1e4), 1e-6
    values = effects("position_sensor_crosstalk", per_current_1=seen, per_current_2=-5e-7, lag=lag)
    found = simulate(bench, linear_table(), inputs, effects=values).measured_position
    poles = np.array([2 / L_0, sensor] + ([1 / lag] if lag else []))
    residues = [np.prod([q / (q - p) for q in poles if q != p]) for p in poles]
    exact = seen * (1 - np.exp(-np.outer(inputs.time, poles)) @ residues)
    assert np.abs(found - exact).max() < 1e-6 * seen


def test_a_limited_drive_is_one_with_clipped_commands(servo: Actuator, table: MagneticTable) -> None:
    inputs = rough(200)
    clipped = Inputs(np.clip(inputs.commands, -0.4, 0.4), inputs.rate, inputs.disturbance)
    half = Inputs(0.5 * (inputs.commands + clipped.commands), inputs.rate, inputs.disturbance)
    assert np.abs(inputs.commands).max() > 0.45
    for lost, other in ((1.0, clipped), (0.5, half)):
        limited = simulate(servo, table, inputs, effects=effects("drive_limit", lost_share=lost, limit=0.4))
        assert limited.current == pytest.approx(simulate(servo, table, other).current, rel=1e-9, abs=1e-12)


def test_a_limit_may_set_in_over_a_corner(servo: Actuator, table: MagneticTable) -> None:
    """The slope falls as a logistic function does, whose spread is that of an even density over both sides of the
    limit."""
    spread = 0.1 / np.sqrt(3)
    falls = logistic(0.35, spread * np.sqrt(3) / np.pi)
    assert falls.std() == pytest.approx(spread)

    def given(asked: np.ndarray) -> np.ndarray:
        grid = np.linspace(0, 0.8, 200001)
        lost = cumulative_trapezoid(falls.cdf(grid) + falls.cdf(-grid), grid, initial=0)
        return asked - 0.7 * np.sign(asked) * np.interp(np.abs(asked), grid, lost)

    inputs = rough(200)
    assert np.abs(inputs.commands).max() > 0.45
    values = effects("drive_limit", lost_share=0.7, limit=0.35, corner=0.1)
    limited = simulate(servo, table, inputs, effects=values)
    other = simulate(servo, table, Inputs(given(inputs.commands), inputs.rate, inputs.disturbance))
    assert limited.current == pytest.approx(other.current, rel=1e-9, abs=1e-12)
    sharp = simulate(servo, table, inputs, effects=effects("drive_limit", lost_share=0.7, limit=0.35))
    assert np.abs(sharp.current - limited.current).max() > 1e-3
