"""Gains and zeros of instruments, leakage and mutual flux are fitted like resistance and mass."""

from dataclasses import replace

import numpy as np
import pytest

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.plant import Inputs, simulate
from msl_fem.plant.simulate import Options, Simulation
from msl_fem.prediction import ModelHypothesis, fit_record, free_parameters, run_data
from msl_fem.prediction.free_run import Start, free_run, measured_start
from msl_fem.prediction.hypothesis import kernel_plant
from msl_fem.prediction.nuisances import ADDITIVE, NUISANCES
from msl_fem.prediction.run_data import RunData
from msl_fem.record import Noise, Record, Run, Sampling, Tolerance
from msl_fem.table.magnetic_table import MagneticTable

RATE, N = 5e3, 5000
NOISE = Noise(position=5e-8, current=2e-3, voltage=5e-3)
OTHERS = Tolerance(
    moving_mass=0, stiffness=0, damping=0, coil_resistance=0, nominal_gap=0, position_gain=0, magnetic_scale=0, table=0,
    mutual_inductance=0.01,
)  # fmt: skip


def of_drive(servo: Actuator, kind: str) -> Actuator:
    assert servo.drive is not None
    drive = {"kind": kind, "bandwidth": None if kind == "voltage" else 1e3, "voltage_limit": None}
    return servo.model_copy(update={"drive": servo.drive.model_copy(update=drive)})


def record_of(actuator: Actuator, table: MagneticTable, factors: dict[str, float], *, kind: str) -> Record:
    """A run as the plant with these factors makes it, from commands with a bias; voltages or commands as its drive."""
    rng = np.random.default_rng(5)
    smooth = np.apply_along_axis(np.convolve, 0, rng.standard_normal((N, 2)), np.ones(10) / np.sqrt(10), "same")
    asked = 0.5 + (0.1 if kind == "voltage" else 0.02) * smooth
    names = [("voltage_{}_V" if kind == "voltage" else "command_{}_A").format(j) for j in (1, 2)]
    read = ("current_1_A", "current_2_A", "voltage_1_V", "voltage_2_V")
    columns = {"time_s": np.arange(N) / RATE, "position_m": np.zeros(N)} | {name: rng.random(N) for name in read}
    columns |= {name: asked[:, j] for j, name in enumerate(names)}
    empty = Record(
        "simulated", actuator, Sampling(rate=RATE), NOISE, OTHERS, runs=(Run("run", "noise", "fit", columns),)
    )
    data = run_data(empty, empty.runs[0])
    plant = kernel_plant(ModelHypothesis(actuator, table, factors=factors), rate=RATE)
    found = free_run(plant, data, replace(measured_start(plant, data), currents=(0.3, 0.3), position=0.0, velocity=0.0))
    assert found.ended is None
    sigma = {"position": 5e-8, "current": 2e-3, "voltage": 5e-3}
    columns |= {n: v + sigma[n.split("_")[0]] * rng.standard_normal(N) for n, v in found.readings.items()}
    return replace(empty, runs=(Run("run", "noise", "fit", columns),))


TRUE = {
    "voltage": {
        "position_zero": 2e-6, "current_zero_1": 4e-3, "current_zero_2": -3e-3, "voltage_gain_1": 1.02,
        "voltage_gain_2": 0.99, "leakage_inductance_1": 0.02, "leakage_inductance_2": -0.01, "mutual_inductance": 0.014,
    },
    "current": {
        "command_gain_1": 0.99, "command_zero_2": 6e-3, "voltage_gain_1": 1.01, "current_gain_2": 0.985,
        "leakage_inductance_1": 0.02, "mutual_inductance": -0.01,
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", ["voltage", "current"])
def test_what_instruments_do_is_found(servo: Actuator, table: MagneticTable, kind: str) -> None:
    """All at one to four tolerances, among all that such a run shows: within four standard errors, which are small."""
    actuator, true = of_drive(servo, kind), TRUE[kind]
    record = record_of(actuator, table, true, kind=kind)
    belief = ModelHypothesis(actuator, table)
    fit = fit_record(belief, [run_data(record, record.runs[0])], OTHERS)
    assert set(true) < set(fit.parameters)
    assert max(fit.excess.values()) < 1.1
    for name, fitted in fit.parameters.items():
        value = true.get(name, NUISANCES[name].neutral)
        error = (fitted.high - fitted.low) / 3.92
        assert abs(fitted.value - value) < 4 * error, (name, fitted, value)
        if name in ("mutual_inductance", "leakage_inductance_1"):
            assert error < 0.5 * getattr(OTHERS, NUISANCES[name].tolerance)
    p = kernel_plant(fit.belief, rate=RATE).parameters
    assert p.mutual == pytest.approx(fit.parameters["mutual_inductance"].value * p.inductance)


def test_only_what_a_run_shows_is_free(servo: Actuator, table: MagneticTable) -> None:
    belief = ModelHypothesis(of_drive(servo, "voltage"), table)
    record = record_of(belief.actuator, table, {}, kind="voltage")
    names = set(free_parameters(belief, Tolerance(current_zero=0.0), runs=[run_data(record, record.runs[0])]))
    assert {"mass", "command_gain_1", "force_zero", "static_gap_zero", "current_zero_1"}.isdisjoint(names)
    assert {"moving_mass", "voltage_gain_2", "command_zero_1", "current_gain_1", "leakage_inductance_2"} <= names
    assert set(NUISANCES) - ADDITIVE == {n for n in NUISANCES if n.endswith(("gain", "gain_1", "gain_2"))}


def test_a_force_drives_gain_and_zero_act_on_what_moves(servo: Actuator) -> None:
    """F = (reading - zero)/gain: the readings of a rig under another force."""
    rig = parse_actuator({
        "schema": 1, "name": "rig", "drive": {"kind": "force"},
        "motion": {"moving_mass": "0.5 kg", "stiffness": "2000 N/m", "damping": "8 N s/m"},
    })  # fmt: skip
    force = np.random.default_rng(1).standard_normal(2000)
    reading = 1.01 * force + 0.2
    plant = kernel_plant(ModelHypothesis(rig, None, factors={"force_gain": 1.01, "force_zero": 0.2}), rate=1e3)
    columns = {"time_s": np.arange(2000) / 1e3, "force_N": reading, "position_m": 1e-6 * force}
    record = Record("simulated", rig, Sampling(rate=1e3), runs=(Run("run", "", "fit", columns),))
    data = run_data(record, record.runs[0])
    found = free_run(plant, data, replace(measured_start(plant, data), position=0.0, velocity=0.0))
    exact: Simulation = simulate(rig, None, Inputs(force, 1e3), options=Options(substeps=plant.substeps))
    assert found.readings["position_m"] == pytest.approx(exact.position, abs=1e-12)


def test_mutual_flux_acts_in_current_loops_faster_than_samples(servo: Actuator, table: MagneticTable) -> None:
    """Loops of 1 kHz at 1 kHz, at the steps that are taken and at a hundred."""
    actuator = of_drive(servo, "current")
    push = np.random.default_rng(3).choice([-0.02, 0.02], size=(300, 1))
    data = RunData("run", "fit", 1e3, 0.5 + push * np.array([[1.0, -1.0]]), {"position_m": np.zeros(300)}, {})

    def position(substeps: int | None, share: float = 0.02) -> np.ndarray:
        plant = kernel_plant(ModelHypothesis(actuator, table, factors={"mutual_inductance": share}), rate=1e3)
        taken = replace(plant, substeps=substeps or plant.substeps)
        return free_run(taken, data, Start((0.5, 0.5), 0.0, 0.0)).readings["position_m"]

    exact = position(100)
    assert np.abs(position(None) - exact).max() < 0.02 * np.abs(position(100, 0.0) - exact).max()
