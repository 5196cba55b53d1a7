"""The exported FMU is the coupled model: same runs as Python's, through impacts, limits and all drives."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from c_programs import STRICT, compiler
from fmpy.validation import validate_fmu
from fmu_master import RATE, Master, assert_equal_runs, cases, changed, exported, run_in_python, steps

from msl_fem.actuator import load_actuator
from msl_fem.export import fmu
from msl_fem.export.formats import ModelSource
from msl_fem.plant import Options
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parent.parent.parent
KINDS = list(cases(load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")))


@pytest.mark.parametrize("kind", KINDS)
def test_fmpy_validates_it_and_runs_as_python_does(servo, table, tmp_path, kind):
    """Pull-in, impacts, rest on the stop, coming off: every channel, and how often limits were met."""
    actuator, levels = cases(servo)[kind]
    archive = exported(actuator, table, tmp_path)
    assert validate_fmu(str(archive)) == []
    wanted = run_in_python(actuator, table, steps(levels))
    assert wanted.complete
    assert np.abs(wanted.position).max() > 4.9e-4  # it does meet its stop
    assert wanted.audit.impact > 0 or actuator.motion.end_stop_restitution == 1.0
    master, sides = Master(archive).initialise(), wanted.current.shape[1]
    assert_equal_runs(master.run(steps(levels), sides=sides, disturbance=3.0), wanted, within=1e-10)
    assert master.counts("steps_at_current_limit", sides) == wanted.samples_at_current_limit.tolist()
    assert master.counts("steps_at_voltage_limit", sides) == wanted.samples_at_voltage_limit.tolist()
    audit = wanted.audit
    energies = master.get("energy_electrical", "energy_copper", "energy_damping", "energy_external", "energy_impact")
    expected = [audit.electrical, audit.copper, audit.damping, audit.external, audit.impact]
    np.testing.assert_allclose(energies, expected, rtol=1e-9, atol=1e-12)
    assert master.said == []


def test_the_reference_actuators_pull_in_from_an_empty_folder(tmp_path):
    """No file of ours in reach, no module of ours loaded: the archive alone gives Python's pull-in to 1e-6."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    stop = changed(actuator, motion={"end_stop": 5e-4})
    table = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
    archive, empty = exported(stop, table, tmp_path), tmp_path / "empty"
    empty.mkdir()
    code = (
        "import sys, numpy, fmpy; "
        f"found = fmpy.simulate_fmu({str(archive)!r}, stop_time=0.03, step_size={1 / RATE}, "
        f"output_interval={1 / RATE}, "
        "start_values={'command_1': 6.0, 'disturbance': 3.0}, output=['position', 'current_1', 'flux_linkage_1']); "
        "assert not [name for name in sys.modules if name.startswith('msl_fem')]; "
        "numpy.save(sys.argv[1], numpy.array(found.tolist()))"
    )
    saved = tmp_path / "found.npy"
    subprocess.run([sys.executable, "-I", "-c", code, saved], cwd=empty, check=True, capture_output=True)
    assert list(empty.iterdir()) == []
    time, *found = np.load(saved).T
    wanted = run_in_python(stop, table, np.tile([6.0, 0.0], (301, 1)))
    assert wanted.position.max() == 5e-4
    np.testing.assert_allclose(time, wanted.time, atol=1e-12)
    for mine, theirs in zip(found, (wanted.position, wanted.current[:, 0], wanted.flux_linkage[:, 0]), strict=True):
        assert np.abs(mine - theirs).max() < 1e-6 * np.abs(theirs).max()


@pytest.mark.parametrize("kind", ["current", "one side, parallel", "force"])
@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_its_source_compiles_without_a_warning(servo, table, tmp_path, kind, name):
    content = fmu.fmu_files(ModelSource(cases(servo)[kind][0], table))
    for path, text in content.items():
        if path.startswith("sources/"):
            (tmp_path / Path(path).name).write_bytes(text)
    for level in ("-O0", "-O2"):
        done = subprocess.run(
            [compiler(name), *STRICT, "-std=c99", level, "-fPIC", "-shared", "-o", "x.so", *fmu.COMPILED, "-lm"],
            cwd=tmp_path, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[:3000]


def test_parameters_and_start_values_are_the_models(servo, table, tmp_path):
    """Set in the FMU as in the actuator file: the same run."""
    other = changed(
        servo,
        motion={"moving_mass": 0.5, "stiffness": 2e5, "damping": 30.0, "constant_force": 20.0, "nominal_gap": 7e-4},
        drive={"bandwidth": 700.0, "voltage_limit": 20.0, "current_limit": 0.4, "coil_resistance": 1.5},
        position_sensor={"bandwidth": 900.0},
    )
    start = {"position_start": 1e-4, "velocity_start": -0.05, "current_1_start": 0.5, "current_2_start": -0.25}
    options = Options(currents=(0.5, -0.25), position=1e-4, velocity=-0.05, substeps=7)
    wanted = run_in_python(other, table, steps([0.5, 0.3]), options)
    parameters = {
        "moving_mass": 0.5, "stiffness": 2e5, "damping": 30.0, "constant_force": 20.0, "nominal_gap": 7e-4,
        "drive_bandwidth": 700.0, "voltage_limit": 20.0, "current_limit": 0.4, "resistance": 3.0,
        "position_sensor_bandwidth": 900.0, "largest_step": 1 / (7 * RATE),
    }  # fmt: skip
    master = Master(exported(servo, table, tmp_path)).initialise(**parameters, **start)
    assert master.get("resistance") == [3.0]
    assert_equal_runs(master.run(steps([0.5, 0.3]), sides=2, disturbance=3.0), wanted, within=1e-10)
    assert master.counts("steps_at_current_limit", 2) == wanted.samples_at_current_limit.tolist() == [350, 0]


def test_an_end_stop_can_be_switched_on(servo, table, tmp_path):
    archive = exported(servo, table, tmp_path)
    stop = changed(servo, motion={"end_stop": 4e-4, "end_stop_restitution": 0.7})
    master = Master(archive).initialise(end_stop=True, travel=4e-4, end_stop_restitution=0.7)
    wanted = run_in_python(stop, table, steps([6.0, 0.0]))
    assert_equal_runs(master.run(steps([6.0, 0.0]), sides=2, disturbance=3.0), wanted, within=1e-10)


def test_forces_and_gaps_are_those_of_the_table(servo, table, tmp_path):
    master = Master(exported(servo, table, tmp_path)).initialise(current_1_start=2.0, position_start=2e-4)
    gap_1, gap_2, force_1, force_2 = master.get("gap_1", "gap_2", "force_1", "force_2")
    assert (gap_1, gap_2) == (servo.motion.nominal_gap - 2e-4, servo.motion.nominal_gap + 2e-4)
    assert force_1 == 2 * float(table.force(2.0, gap_1))
    assert abs(force_2) < 1e-12 * force_1


def test_communication_steps_of_any_size_give_one_run(servo, table, tmp_path):
    """Where the inputs stand, a run does not depend on how it is cut, but for the integrator's error."""
    archive = exported(servo, table, tmp_path)
    ends = []
    for n in (1, 10, 37):
        master = Master(archive).initialise(command_1=0.3)
        for k in range(n):
            master.slave.doStep(k * 0.01 / n, 0.01 / n)
        ends.append(master.get("position", "velocity", "current_1"))
    np.testing.assert_allclose(ends[1:], [ends[0]] * 2, rtol=1e-6)
    assert ends[0][0] > 1e-6
