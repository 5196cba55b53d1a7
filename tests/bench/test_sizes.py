"""Every effect has the size asked for, is far above the integrator's error, and says so where it cannot be."""

import numpy as np
import pytest
from bench_rigs import RATE, setting_in

from msl_fem.bench.catalogue import INSIDE, OUTSIDE_BY_NAME
from msl_fem.bench.instruments import readings
from msl_fem.bench.integrate import bench_substeps
from msl_fem.bench.plant import arranged
from msl_fem.bench.running import run_rig
from msl_fem.bench.setting import BenchSetting, effect_of_size
from msl_fem.errors import InputError
from msl_fem.record import Tolerance

ALL = INSIDE | OUTSIDE_BY_NAME
RECORDS = {
    "gap_offset", "early_saturation", "fringing", "magnetic_hysteresis", "eddy_currents", "cross_coupling",
    "armature_tilt", "coil_heating", "amplifier_bandwidth", "current_sensor_error", "stiffness_nonlinearity",
    "coulomb_friction", "squeeze_film", "structural_mode", "flexure_relaxation", "force_offset", "support_compliance",
    "position_sensor_nonlinearity", "position_sensor_lag", "time_delay", "periodic_disturbance", "sensor_drift",
    "leakage_inductance", "mutual_inductance", "remanent_flux", "position_sensor_crosstalk", "drive_limit",
    "thermal_history",
}  # fmt: skip
SETTINGS: dict[str, BenchSetting] = {}


def setting(drive: str) -> BenchSetting:
    if drive not in SETTINGS:
        SETTINGS[drive] = setting_in(drive, duration=0.2)
    return SETTINGS[drive]


def measured_size(it: BenchSetting, name: str, strength: float, *, substeps: int = 1) -> float:
    """Size by the definition, from the readings of every run with and without the effect; steps may be multiplied."""
    rig, _ = ALL[name].hide(it, it.rig, strength)
    squares: dict[str, list[np.ndarray]] = {}
    for n, (commands, lead) in enumerate(zip(it.commands, it.leads, strict=True)):
        found = []
        for one in (it.rig, rig):
            steps = substeps * bench_substeps(arranged(one.plant), one.table, rate=RATE)
            found.append(readings(one, run_rig(one, commands, rate=RATE, lead_in=lead, substeps=steps, seed=n), run=n))
        for channel, plain in found[0].items():
            squares.setdefault(channel, []).append(np.array([plain**2, (found[1][channel] - plain) ** 2]).sum(axis=1))
    sums = {channel: np.sum(parts, axis=0) for channel, parts in squares.items()}
    return max(float(np.sqrt(change / whole)) for whole, change in sums.values() if whole > 0)


def test_the_catalogue_is_that_of_records() -> None:
    assert set(INSIDE) == RECORDS
    assert len(OUTSIDE_BY_NAME) >= 6
    assert not set(INSIDE) & set(OUTSIDE_BY_NAME)


@pytest.mark.parametrize("name", ALL)
def test_size_as_asked_in_voltage_drive(name: str) -> None:
    """Two per cent within 2 % of it, with twice as many steps: so neither the search nor the integrator misses it."""
    it = setting("voltage")
    found = effect_of_size(it, ALL[name], 0.02, exact=True)
    assert found.size == pytest.approx(0.02, rel=0.006)
    assert measured_size(it, name, found.strength, substeps=2) == pytest.approx(0.02, rel=0.02)
    assert found.parameters
    assert all(np.isfinite(value) for value in found.parameters.values())


@pytest.mark.parametrize("name", ["eddy_currents", "amplifier_bandwidth", "coil_heating", "time_delay", "cogging"])
def test_size_as_asked_in_current_drive(name: str) -> None:
    it = setting("current")
    found = effect_of_size(it, ALL[name], 0.02, exact=True)
    assert measured_size(it, name, found.strength) == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize("name", ["coulomb_friction", "structural_mode", "periodic_disturbance", "random_force"])
def test_size_as_asked_of_a_mechanical_rig(name: str) -> None:
    it = setting("force")
    found = effect_of_size(it, ALL[name], 0.02, exact=True)
    assert set(found.channels) == {"position_m"}
    assert measured_size(it, name, found.strength) == pytest.approx(0.02, rel=0.02)


def test_a_small_size_too() -> None:
    found = effect_of_size(setting("voltage"), ALL["eddy_currents"], 0.001)
    assert found.size == pytest.approx(0.001, rel=0.006)


@pytest.mark.parametrize(("name", "least"), [("gap_offset", 6 * 0.005 * 6e-4), ("coil_heating", None)])
def test_coinciding_effects_are_at_least_six_tolerances(name: str, least: float | None) -> None:
    it = setting("current")
    small, full = (effect_of_size(it, ALL[name], 0.001, exact=exact) for exact in (True, False))
    assert small.size == pytest.approx(0.001, rel=0.006)
    assert full.size > 3 * small.size
    if least is not None:
        assert abs(full.parameters["offset"]) == pytest.approx(least)
        nominal = it.rig.plant.magnets.nominal_gap
        total = ALL[name].hide(it, it.rig, full.strength)[0].plant.magnets.nominal_gap - 6e-4
        assert abs(total) >= least  # the drawn deviation does not take from it
        assert abs(nominal - 6e-4) <= 3 * 0.005 * 6e-4
    else:
        rig, _ = ALL[name].hide(it, it.rig, full.strength)
        run = run_rig(rig, it.commands[0], rate=RATE, lead_in=it.leads[0])
        plain = run_rig(it.rig, it.commands[0], rate=RATE, lead_in=it.leads[0])
        resistance = np.polyfit(plain.current[:, 0], run.voltage[:, 0] - plain.voltage[:, 0], 0)
        rise = float(np.mean(run.voltage[:, 0] - plain.voltage[:, 0]) / np.mean(plain.current[:, 0]))
        assert resistance.size == 1
        assert rise / it.rig.plant.circuit.resistance >= 6 * Tolerance().coil_resistance


@pytest.mark.parametrize(
    ("drive", "name", "size", "said"),
    [
        ("force", "eddy_currents", 0.03, "eddy_currents: not visible here, the rig has no magnets"),
        ("voltage", "early_saturation", 0.9, "cannot be reached in this voltage drive"),
    ],
)
def test_what_cannot_be_is_refused(drive: str, name: str, size: float, said: str) -> None:
    with pytest.raises(InputError, match=said):
        effect_of_size(setting(drive), ALL[name], size)
