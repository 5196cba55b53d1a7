"""The FMU of an extended model is `simulate` with effects: every channel, all effects at once and each by itself."""

import numpy as np
import pytest
from effect_sets import ALL_EFFECTS, rough
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from fmu_master import PAIRS, RATE, SINGLE, Master, cases, changed, exported, steps
from printed_library import AS_COMPILED

from msl_fem.computing.laws import parse_expression
from msl_fem.control import ControllerChoice
from msl_fem.control.design_model import design_model_with_effects
from msl_fem.control.designs import designed
from msl_fem.errors import InputError
from msl_fem.export import fmu, fmu_library
from msl_fem.export.c_controller import ControllerSource, controller_header
from msl_fem.export.formats import ModelSource
from msl_fem.maps import operating_map
from msl_fem.plant import Inputs, Options, plant_parameters, simulate
from msl_fem.plant.effects import CATALOGUE, EffectValues, declared
from msl_fem.plant.extended_model import ExtendedModel, write_extended_model
from msl_fem.table.magnetic_table import write_table

WITHIN = 1e-9
"""Of full scale."""
MEASURED = SINGLE | PAIRS | {"current_measured": "measured_current"}
N_SAMPLE = 200
LARGEST = {"amplifier_bandwidth": {"lag": 2e-4, "slew_time": 1e-4}, "time_delay": {"command": 4.3e-4, "position": 3e-4}}
"""What is more than in all effects together, where a run bears it alone."""


def assert_is_simulated(master, actuator, table, effects, commands, *, within=WITHIN):
    """The unit's run is that of `simulate` with as many steps."""
    step = master.get("largest_step")[0]
    options = Options(substeps=max(1, int(np.ceil(1 / RATE / step - 1e-9))))
    wanted = simulate(actuator, table, Inputs(commands, RATE, 3.0), effects=effects, options=options)
    found = master.run(commands, sides=wanted.current.shape[1], disturbance=3.0, measured=True)
    for name, attribute in MEASURED.items():
        reference = getattr(wanted, attribute)
        if not reference.size:
            continue
        scale = np.abs(reference).max()
        assert scale > 0, name
        np.testing.assert_allclose(found[name], reference, rtol=0, atol=within * scale, err_msg=name)
    return wanted


@pytest.fixture(scope="module")
def archive(servo, table, tmp_path_factory):
    return exported(servo, table, tmp_path_factory.mktemp("effects"), effects=ALL_EFFECTS)


@pytest.fixture
def quiet(servo):
    """The servo with a sensor that does not round."""
    return changed(servo, position_sensor={"resolution": 0.0})


def test_every_effect_together(archive, quiet, table):
    assert validate_fmu(str(archive)) == []
    master = Master(archive).initialise()
    assert_is_simulated(master, quiet, table, ALL_EFFECTS, rough(N_SAMPLE).commands)
    assert master.said == []


def test_to_the_last_bit_where_the_compiler_fuses_as_the_kernel_does(servo, table, tmp_path, monkeypatch):
    """Memory, impacts, limits, delays: every function of the kernel has its part in these runs."""
    monkeypatch.setattr(fmu_library, "FLAGS", (*fmu_library.FLAGS, *AS_COMPILED))
    stop = changed(servo, motion={"end_stop": 5e-4, "end_stop_restitution": 0.4}, position_sensor={"resolution": 0.0})
    master = Master(exported(stop, table, tmp_path, effects=ALL_EFFECTS)).initialise()
    commands = np.r_[rough(100).commands, steps([7.0, 1.0], n=100)]
    wanted = assert_is_simulated(master, stop, table, ALL_EFFECTS, commands, within=0.0)
    assert wanted.audit.impact > 0
    assert wanted.samples_at_voltage_limit.max() > 0


@pytest.mark.parametrize(
    ("effect", "shape"),
    [
        *((effect, {}) for effect in ALL_EFFECTS.stated),
        ("coulomb_friction", {"transition_velocity": 1e-3}),
        ("amplifier_bandwidth", {"lag": 5e-5, "delay_share": 1.4}),
    ],
    ids=[*ALL_EFFECTS.stated, "coulomb_friction over the velocity", "amplifier_bandwidth that overshoots"],
)
def test_each_effect_is_a_parameter(archive, quiet, table, effect, shape):
    """One archive: the others are set to their neutral values, as the plain model's."""
    values = EffectValues({effect: dict(ALL_EFFECTS.stated[effect]) | LARGEST.get(effect, {}) | shape})
    master = Master(archive)
    start = master.neutral() | {f"{effect}_{name}": value for name, value in values.stated[effect].items()}
    commands = rough(N_SAMPLE).commands
    wanted = assert_is_simulated(master.initialise(**start), quiet, table, values, commands)
    plain = simulate(quiet, table, Inputs(commands, RATE, 3.0), options=Options(substeps=wanted.substeps))
    apart = [np.abs(getattr(wanted, name) - getattr(plain, name)).max() / np.abs(getattr(plain, name)).max()
             for name in ("measured_position", "measured_current", "voltage")]  # fmt: skip
    assert max(apart) > 100 * WITHIN  # or the test would say nothing of this effect


@pytest.mark.parametrize("kind", ["voltage", "one side, parallel", "force"])
def test_every_effect_that_another_build_can_have(servo, table, tmp_path, kind):
    """Into the end stop and off again, with all effects that the plant can have."""
    actuator, levels = cases(changed(servo, position_sensor={"resolution": 0.0}))[kind]
    sides = plant_parameters(actuator).sides
    has = {"magnets": sides > 0, "two sides": sides == 2, "drive lag": True}
    stated = {n: p for n, p in ALL_EFFECTS.stated.items() if all(has[need] for need in CATALOGUE[n].needs)}
    effects = EffectValues(stated)
    master = Master(exported(actuator, table, tmp_path, effects=effects)).initialise()
    wanted = assert_is_simulated(master, actuator, table if sides else None, effects, steps(levels, n=300))
    assert wanted.audit.impact > 0


def test_the_start_shares_the_current_with_iron_and_memory(archive, quiet, table):
    master = Master(archive).initialise(current_1_start=0.5, current_2_start=-0.3, position_start=1e-5)
    options = Options(currents=(0.5, -0.3), position=1e-5, substeps=10)
    wanted = simulate(quiet, table, Inputs(np.zeros((2, 2)), RATE), effects=ALL_EFFECTS, options=options)
    assert master.get("flux_linkage_1") == pytest.approx(wanted.flux_linkage[0, :1], rel=1e-12)
    assert master.get("position_measured") == pytest.approx(wanted.measured_position[:1], rel=1e-9)


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ({"magnetic_hysteresis_coercive_current": -1.0}, "magnetic_hysteresis_coercive_current must be between 0 and"),
        ({"drive_bandwidth": 0.0}, "needs a drive whose current cannot jump; set drive_bandwidth"),
        ({"coil_heating_initial_rise": float("nan")}, "a parameter is not a finite number"),
    ],
)
def test_parameters_that_cannot_be_are_refused_in_words(archive, start, said):
    master = Master(archive)
    with pytest.raises(FMICallException):
        master.initialise(**start)
    assert said in master.said[-1][1]


def test_delays_are_counted_in_equal_steps(archive):
    master = Master(archive).initialise()
    master.slave.doStep(0.0, 1 / RATE)
    with pytest.raises(FMICallException):
        master.slave.doStep(1 / RATE, 2 / RATE)
    assert "all communication steps are of one size" in master.said[-1][1]
    assert not master.description.coSimulation.canHandleVariableCommunicationStepSize
    late = Master(archive).initialise(time_delay_command=0.01)
    with pytest.raises(FMICallException):
        late.slave.doStep(0.0, 1e-4)
    assert "longer than the communication steps that are kept of it: 16 of a command" in late.said[-1][1]


def test_the_command_takes_the_file_that_diagnose_writes(servo, table, tmp_path, msl_fem):
    found = EffectValues({"eddy_currents": {"time_constant": 1.2e-4}})
    model = write_extended_model(ExtendedModel(servo, found), tmp_path / "extended_model.toml")
    target, table_file = tmp_path / "model.fmu", tmp_path / "table.nc"
    write_table(table, table_file)
    done = msl_fem("export", str(model), "--table", str(table_file), "--to", "fmu", "-o", str(target), "--json")
    assert done.json["files"] == [str(target)]
    description = read_model_description(str(target))
    start = {v.name: v.start for v in description.modelVariables}
    assert float(start["eddy_currents_time_constant"]) == pytest.approx(1.2e-4, rel=1e-12)
    assert float(start["coulomb_friction_force"]) == 0.0


def test_the_controller_of_an_extended_model_knows_its_effects(servo, table, tmp_path, msl_fem):
    """Wider gaps want more current: the header is that of the design for the model, and not the plain one's."""
    table_file, headers = tmp_path / "table.nc", {}
    write_table(table, table_file)
    for name, offset in (("plain", 0.0), ("wider", 4e-5)):
        found = EffectValues({"gap_offset": {"offset": offset}})
        model = write_extended_model(ExtendedModel(servo, found), tmp_path / f"{name}.toml")
        target = tmp_path / f"{name}.h"
        done = msl_fem("export", str(model), "--table", str(table_file), "--to", "c", "--what", "controller",
                       "-o", str(target), "--json")  # fmt: skip
        assert done.json["files"] == [str(target)]
        headers[name] = target.read_text()
    regions = operating_map(table)
    known = design_model_with_effects(servo, table, regions, found)
    source = ControllerSource(designed(known, ControllerChoice()), regions)
    design_lines = [line for line in controller_header(source).splitlines() if "digest" not in line]
    assert [line for line in headers["wider"].splitlines() if "digest" not in line] == design_lines
    assert headers["plain"] != headers["wider"]


def test_an_effect_that_the_plant_cannot_have_is_refused(servo, table):
    ideal = changed(servo, drive={"bandwidth": None})
    with pytest.raises(InputError, match=r"state drive\.bandwidth, or leave the effect out"):
        fmu.fmu_files(ModelSource(ideal, table, ALL_EFFECTS))


def test_users_laws_leave_with_the_model(servo, quiet, table, tmp_path):
    """Force, voltage and reading: the printed laws run as the compiled ones, their parameters are the unit's."""
    causes = [
        parse_expression("drag: force = -a*v*abs(v) + b*tanh(x/p); a: 0..5000 N s2/m2; b: -2..2 N; p: 0.01..1 mm"),
        parse_expression("resistor: voltage = r*i; r: 0..2 ohm"),
        parse_expression("crosstalk: position_reading = c*i1*sin(g1/q)**2; c: -1..1 um/A; q: 0.1..1 mm"),
    ]
    values = {"a": 900.0, "b": 1.0, "p": 1e-4}
    with declared(*causes):
        effects = EffectValues(
            {"expression:drag": values, "expression:resistor": {"r": 0.7}, "expression:crosstalk": {"c": 3e-7}}
        )
        archive = exported(servo, table, tmp_path, effects=effects)
        assert validate_fmu(str(archive)) == []
        master = Master(archive).initialise()
        wanted = assert_is_simulated(master, quiet, table, effects, rough(N_SAMPLE).commands)
        changed_drag = EffectValues(dict(effects.stated) | {"expression:drag": values | {"a": 100.0}})
        again = Master(archive).initialise(expression_drag_a=100.0)
        other = assert_is_simulated(again, quiet, table, changed_drag, rough(N_SAMPLE).commands)
    assert np.abs(other.position - wanted.position).max() > 1e-6 * np.abs(wanted.position).max()
    units = {v.name: v.unit for v in read_model_description(str(archive)).modelVariables}
    assert (units["expression_drag_a"], units["expression_drag_b"]) == ("kg1.m-1", "N")
