"""The unit of FMI 3.0 is that of FMI 2.0 behind another interface: its runs to the last bit, and as `simulate`."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_programs import STRICT, compiler
from effect_sets import ALL_EFFECTS, rough
from fmpy import simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from fmu_master import RATE, Master, assert_equal_runs, cases, changed, exported, run_in_python, steps

from msl_fem.export import fmu
from msl_fem.export.formats import ModelSource
from msl_fem.plant import Inputs, Options, simulate
from msl_fem.plant.extended_model import ExtendedModel, write_extended_model
from msl_fem.table.magnetic_table import write_table


@pytest.fixture(scope="module")
def archive(servo, table, tmp_path_factory):
    """Of the servo with every effect."""
    return exported(servo, table, tmp_path_factory.mktemp("fmi3"), effects=ALL_EFFECTS, fmi=fmu.FMI_3)


@pytest.mark.parametrize("kind", ["current", "force"])
def test_fmpy_validates_it_and_runs_as_python_does(servo, table, tmp_path, kind):
    """Pull-in, impacts, coming off: every channel and count, by FMPy's own master too."""
    actuator, levels = cases(servo)[kind]
    own = exported(actuator, table, tmp_path, fmi=fmu.FMI_3)
    assert validate_fmu(str(own)) == []
    wanted = run_in_python(actuator, table, steps(levels))
    assert wanted.audit.impact > 0
    master, sides = Master(own).initialise(), wanted.current.shape[1]
    assert_equal_runs(master.run(steps(levels), sides=sides, disturbance=3.0), wanted, within=1e-10)
    assert master.counts("steps_at_voltage_limit", sides) == wanted.samples_at_voltage_limit.tolist()
    assert master.get("time") == [pytest.approx(500 / RATE)]
    assert master.said == []
    start = {f"command_{k + 1}": level for k, level in enumerate(levels)} | {"disturbance": 3.0}
    step = 1 / RATE
    found = simulate_fmu(str(own), stop_time=0.01, step_size=step, output_interval=step, start_values=start)
    np.testing.assert_allclose(found["position"], wanted.position[:101], rtol=0, atol=1e-10 * 5e-4)


def test_every_effect_as_in_simulate_and_in_fmi_2(archive, servo, table, tmp_path):
    assert validate_fmu(str(archive)) == []
    commands = rough(200).commands
    quiet = changed(servo, position_sensor={"resolution": 0.0})
    master = Master(archive).initialise()
    found = master.run(commands, sides=2, disturbance=3.0, measured=True)
    options = Options(substeps=max(1, int(np.ceil(1 / RATE / master.get("largest_step")[0] - 1e-9))))
    wanted = simulate(quiet, table, Inputs(commands, RATE, 3.0), effects=ALL_EFFECTS, options=options)
    assert_equal_runs(found, wanted, within=1e-9)
    other = Master(exported(servo, table, tmp_path, effects=ALL_EFFECTS)).initialise()
    for name, values in other.run(commands, sides=2, disturbance=3.0, measured=True).items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def test_states_are_kept_and_come_back_from_bytes(archive):
    master = Master(archive).initialise(command_1=0.4)
    slave = master.slave
    for k in range(5):
        slave.doStep(k / RATE, 1 / RATE)
    kept, before = slave.getFMUState(), master.get("position", "current_1", "time")
    data = slave.serializeFMUState(kept)
    for k in range(5, 9):
        slave.doStep(k / RATE, 1 / RATE)
    assert master.get("position", "current_1", "time") != before
    slave.setFMUState(slave.deserializeFMUState(data))
    assert master.get("position", "current_1", "time") == before
    with pytest.raises(FMICallException):
        slave.deserializeFMUState(b"x" + data[1:])
    assert "not a serialized state of this FMU" in master.said[-1][1]
    slave.freeFMUState(kept)


@pytest.mark.parametrize(
    ("act", "told"),
    [
        (lambda m: m.initialise(magnetic_hysteresis_coercive_current=-1.0), "must be between 0 and"),
        (lambda m: m.slave.doStep(0.0, 1e-4), "cannot be called now: the instance is not initialised yet"),
        (lambda m: m.slave.getFloat64([9999]), "there is no Float64 with the value reference 9999"),
        (lambda m: m.slave.getInt8([0]), "there is no Int8; the types are Float64, Int32 and Boolean"),
        (lambda m: m.initialise().put("moving_mass", 1.0), "a parameter cannot be set once the simulation has begun"),
        (lambda m: m.initialise().put("position", 1.0), "an output cannot be set"),
        (lambda m: m.slave.enterEventMode(), "there are neither clocks nor events"),
    ],
)
def test_what_cannot_be_is_said(archive, act, told):
    master = Master(archive)
    with pytest.raises(FMICallException):
        act(master)
    assert told in master.said[-1][1]


def test_another_token_makes_no_instance(archive):
    with pytest.raises(Exception, match="Failed to instantiate"):
        Master(archive, guid="{other}")


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_its_source_compiles_without_a_warning(servo, table, tmp_path, name):
    content = fmu.fmu_files(ModelSource(servo, table, ALL_EFFECTS), fmi=fmu.FMI_3)
    for path, text in content.items():
        if path.startswith("sources/"):
            (tmp_path / Path(path).name).write_bytes(text)
    command = [compiler(name), *STRICT, "-std=c99", "-O0", "-fPIC", "-shared", "-o", "x.so", *fmu.FMI_3.compiled, "-lm"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]


def test_the_command_writes_it(servo, table, tmp_path, msl_fem):
    model = write_extended_model(ExtendedModel(servo, ALL_EFFECTS), tmp_path / "extended_model.toml")
    table_file, target = tmp_path / "table.nc", tmp_path / "model.fmu"
    write_table(table, table_file)
    done = msl_fem("export", str(model), "--table", str(table_file), "--to", "fmu3", "-o", str(target), "--json")
    assert done.json["platforms"] == ["x86_64-linux"]
    assert validate_fmu(str(target)) == []
