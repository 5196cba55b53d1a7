"""Simulated runs as a record."""

from pathlib import Path

import numpy as np
import pytest
from coupled_twin import changed

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import InputError
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.simulate import NamedRun, simulate, simulation_record
from msl_fem.record import load_record, write_record
from msl_fem.table.magnetic_table import MagneticTable


def test_a_record_of_two_runs_comes_back(servo: Actuator, table: MagneticTable, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    runs = []
    for name, role in (("noise", "fit"), ("sine", "held-out")):
        inputs = Inputs(0.4 + 0.05 * rng.standard_normal((1200, 2)), 1e4)
        runs.append(NamedRun(name, f"{name} in words", role, simulate(servo, table, inputs, generator=rng)))
    write_record(simulation_record(servo, runs), tmp_path / "record")
    record = load_record(tmp_path / "record")
    assert record.origin == "simulated"
    assert [r.name for r in record.runs_of("held-out")] == ["sine"]
    assert record.sampling is not None
    assert record.sampling.rate == 1e4
    assert (record.noise.position, record.noise.current) == pytest.approx((50e-9, 2e-3))
    for named in runs:
        run, simulation = record.run(named.name), named.simulation
        assert set(run.columns) == {
            "time_s", "command_1_A", "command_2_A", "voltage_1_V", "voltage_2_V", "current_1_A", "current_2_A",
            "position_m",
        }  # fmt: skip
        assert run["position_m"] == pytest.approx(simulation.measured_position, rel=1e-8)
        assert run["current_2_A"] == pytest.approx(simulation.measured_current[:, 1], rel=1e-8)
        assert run["voltage_2_V"] == pytest.approx(simulation.voltage[:, 1], rel=1e-8)
        assert run["command_1_A"] == pytest.approx(simulation.command[:, 0], rel=1e-8)


def test_a_rig_that_a_force_drives_records_the_force() -> None:
    rig = parse_actuator({
        "schema": 1, "name": "rig", "drive": {"kind": "force"},
        "motion": {"moving_mass": "0.5 kg", "stiffness": "2000 N/m", "damping": "8 N s/m"},
    })  # fmt: skip
    run = simulate(rig, None, Inputs(np.ones(1000), 1e3))
    record = simulation_record(rig, [NamedRun("step", "step", "fit", run)])
    assert set(record.runs[0].columns) == {"time_s", "force_N", "position_m"}
    assert record.noise.current is None


def test_a_voltage_drive_has_no_command_beside_its_voltage(servo: Actuator, table: MagneticTable) -> None:
    bench = changed(servo, drive={"kind": "voltage", "bandwidth": None})
    run = simulate(bench, table, Inputs(np.full((1000, 2), 0.5), 1e4))
    (recorded,) = simulation_record(bench, [NamedRun("hold", "", "fit", run)]).runs
    assert recorded["voltage_1_V"] == pytest.approx(0.5, rel=1e-12)
    assert "command_1_A" not in recorded


def test_runs_of_different_rates_make_no_record(servo: Actuator, table: MagneticTable) -> None:
    runs = [
        NamedRun(f"run_{rate:.0f}", "", "fit", simulate(servo, table, Inputs(np.zeros((10, 2)), rate)))
        for rate in (1e4, 2e4)
    ]
    with pytest.raises(InputError, match=r"\[10000\.0, 20000\.0\] Hz"):
        simulation_record(servo, runs)
