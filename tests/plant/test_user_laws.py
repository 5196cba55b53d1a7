"""Users' laws in the kernel: closed forms, lanes, the step count, what designs and inverse dynamics take."""

import inspect
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import closed_form_table
from coupled_twin import changed
from effect_sets import rig, rough

from msl_fem.actuator import Actuator
from msl_fem.bench.law_program import FORCE, law_sum, with_law
from msl_fem.bench.plant import NO_LAWS
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import keep, rows_of
from msl_fem.computing.laws import parse_expression
from msl_fem.computing.laws.calculus import value_of
from msl_fem.control import design_model_with_effects
from msl_fem.errors import ActuatorError, InputError
from msl_fem.maps import operating_map
from msl_fem.plant import Inputs, simulate
from msl_fem.plant.effects import (
    CATALOGUE,
    EffectValues,
    MoverMotion,
    declare,
    declared,
    expressions,
    needed_force,
    values_of,
)
from msl_fem.plant.effects.expressions import LAW_X, motion_laws, set_addresses, steepest
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model, write_extended_model
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.step_count import rates_of_effects

TABLE = closed_form_table()
DRAG = parse_expression("drag: force = -a*v*abs(v); a: 0..5000 N s2/m2")
LINEAR = parse_expression("linear: force = -c*v - k*x + f; c: 0..50 N s/m; k: 0..1e5 N/m; f: -5..5 N")
RESISTOR = parse_expression("resistor: voltage = r*i; r: 0..2 ohm")
CROSSTALK = parse_expression("crosstalk: position_reading = c*(i1 - i2) + b*x; c: -1..1 um/A; b: -0.1..0.1")
EVERYTHING = parse_expression(
    "everything: force = f*(tanh(v/w) + sin(x/p)*exp(-abs(x)/p) + min(i1, i2)/n)*sqrt(g1/g2)*max(1, cos(x/p))"
    " + f*log(1 + (x/p)**2)*sign(v)**3 - f*abs(v/w)**1.5"
    "; f: -1..1 N; w: 1..100 mm/s; p: 0.1..1 mm; n: 0.5..2 A"
)


@pytest.fixture(autouse=True)
def _own_laws() -> Iterator[None]:
    with declared(DRAG, LINEAR, RESISTOR, CROSSTALK, EVERYTHING):
        yield


@pytest.fixture
def inputs() -> Inputs:
    return Inputs(0.1 * rough(400).commands, 1e4, 3.0)


def of(effect: str, **values: float) -> EffectValues:
    return EffectValues({f"expression:{effect}": values})


def test_a_linear_law_is_damping_stiffness_and_constant_force(servo: Actuator, inputs: Inputs) -> None:
    law = simulate(servo, TABLE, inputs, effects=of("linear", c=8.0, k=2e4, f=1.5))
    motion = servo.motion
    wanted = changed(
        servo, motion={"damping": motion.damping + 8.0, "stiffness": motion.stiffness + 2e4, "constant_force": 1.5}
    )
    plain = simulate(wanted, TABLE, inputs)
    assert np.abs(law.position - plain.position).max() < 1e-9 * np.abs(plain.position).max()
    assert abs(law.audit.imbalance) < 1e-6


def test_a_law_of_voltage_is_a_resistor(servo: Actuator, inputs: Inputs) -> None:
    """In voltage drive the currents are those of a coil of higher resistance; the ledger counts what is behind it."""
    driven = changed(servo, drive={"kind": "voltage", "bandwidth": None, "coil_resistance": 1.0})
    law = simulate(driven, TABLE, inputs, effects=of("resistor", r=0.5))
    own = 1.0 + 0.5 / (plant_parameters(driven).resistance)
    plain = simulate(changed(driven, drive={"coil_resistance": own}), TABLE, inputs)
    assert np.abs(law.current - plain.current).max() < 1e-9 * np.abs(plain.current).max()
    assert abs(law.audit.imbalance) < 1e-6
    lost = plain.audit.copper * 0.5 / (plant_parameters(driven).resistance + 0.5)
    assert plain.audit.electrical - law.audit.electrical == pytest.approx(lost, rel=1e-6)


@pytest.mark.parametrize("bandwidth", [None, 300.0, 1e6])
def test_a_current_loop_gives_the_voltage_that_a_law_takes(servo: Actuator, inputs: Inputs, bandwidth: float) -> None:
    """Loops that are ideal, integrated, and known in closed form: the currents stay, the voltage is r i higher."""
    driven = changed(servo, drive={"bandwidth": bandwidth, "voltage_limit": None})
    law = simulate(driven, TABLE, inputs, effects=of("resistor", r=0.5))
    plain = simulate(driven, TABLE, inputs, effects=EffectValues())
    assert np.abs(law.current - plain.current).max() < 1e-12
    more = law.voltage - plain.voltage
    after = np.r_[plain.current[1:], plain.current[-1:]]
    low, high = np.minimum(plain.current, after), np.maximum(plain.current, after)
    assert np.all(more[:-1] >= 0.5 * low[:-1] - 1e-3)
    assert np.all(more[:-1] <= 0.5 * high[:-1] + 1e-3)
    assert abs(law.audit.imbalance - plain.audit.imbalance) < 1e-6


def test_a_law_of_the_reading_adds_to_it_alone(servo: Actuator, inputs: Inputs) -> None:
    quiet = changed(servo, position_sensor={"resolution": 0.0})
    law = simulate(quiet, TABLE, inputs, effects=of("crosstalk", c=2e-7, b=0.01))
    plain = simulate(quiet, TABLE, inputs, effects=EffectValues())
    np.testing.assert_array_equal(law.position, plain.position)
    added = 2e-7 * (plain.current[:, 0] - plain.current[:, 1]) + 0.01 * plain.position
    assert np.abs(added).max() > 1e-8
    np.testing.assert_allclose(law.measured_position - plain.measured_position, added, rtol=0, atol=1e-18)


def test_without_amounts_a_law_is_nothing_even_where_it_is_not_defined(servo: Actuator, inputs: Inputs) -> None:
    plain = simulate(servo, TABLE, inputs, effects=EffectValues())
    with declared(parse_expression("pole: force = a*log(x/p)/x*p; a: 0..1 N; p: 0.1..1 mm")):
        neutral = simulate(servo, TABLE, inputs, effects=of("pole", a=0.0))
    np.testing.assert_array_equal(neutral.position, plain.position)


def test_lanes_are_single_runs_to_the_last_bit(servo: Actuator, inputs: Inputs) -> None:
    plant, surface = plant_parameters(servo), surface_of(TABLE)
    amounts = [0.0, 1e3, 5e3]
    vectors = np.array(
        [
            EffectValues(
                {
                    "expression:drag": {"a": a},
                    "expression:everything": {"f": a / 5e3, "w": 0.01, "p": 2e-4, "n": 1.0},
                    "expression:resistor": {"r": a / 1e4},
                    "expression:crosstalk": {"c": a * 1e-10},
                }
            ).vector()
            for a in amounts
        ]
    )
    lanes = run_lanes(surface, [plant] * 3, inputs, substeps=12, settings=LaneSettings(effects=vectors))
    for vector, position, read in zip(vectors, lanes.true_position, lanes.position, strict=True):
        alone = run_lanes(surface, [plant], inputs, substeps=12, settings=LaneSettings(effects=vector[None]))
        np.testing.assert_array_equal(position, alone.true_position[0])
        np.testing.assert_array_equal(read, alone.position[0])
    assert np.ptp(lanes.true_position, axis=0).max() > 1e-8


def test_the_compiled_law_the_bench_s_program_and_the_tree_agree(servo: Actuator) -> None:
    """Three routes to one value, all functions among them: the initial acceleration of a free run."""
    values = {"f": 0.9, "w": 0.02, "p": 3e-4, "n": 1.1}
    rest = {"x": 1.3e-4, "v": -0.013, "i1": 0.7, "i2": 0.4}
    gap = servo.motion.nominal_gap
    at = rest | {"g1": gap - rest["x"], "g2": gap + rest["x"]}
    tree = float(value_of(EVERYTHING.law, at | values))
    seen = np.array([at[n] for n in ("x", "v", "i1", "i2", "g1", "g2")])
    program = law_sum(with_law(NO_LAWS, EVERYTHING, values), FORCE, seen)
    assert program == pytest.approx(tree, rel=1e-14)
    e, work = np.zeros(240), np.zeros(20)
    for (cause, name), row in expressions.parameter_rows(expressions.DECLARED.values()).items():
        e[row] = values[name] if cause == "everything" else 0.0
    work[LAW_X : LAW_X + 6] = seen
    run_compiled(e, work)
    assert work[LAW_X + 6] == pytest.approx(tree, rel=1e-14)


def run_compiled(e: np.ndarray, work: np.ndarray) -> None:
    """The laws' machine code at their address."""
    set_addresses(e)
    _call(e, work)


@compiled
def _call(e: np.ndarray, work: np.ndarray) -> None:
    motion_laws(rows_of(e), rows_of(work))
    keep(e)
    keep(work)


def test_the_step_resolves_a_steep_law(servo: Actuator) -> None:
    plant = plant_parameters(servo)
    friction = parse_expression("friction: force = -f*tanh(v/w); f: 0..10 N; w: 0.1..10 mm/s")
    with declared(friction):
        rates = rates_of_effects(plant, of("friction", f=5.0, w=1e-3))
        assert rates["expression:friction"] == pytest.approx(5.0 / 1e-3 / plant.mass)
    assert steepest(LINEAR, plant, {"c": 3.0, "k": 7.0, "f": 1.0}) == pytest.approx({"v": 3.0, "x": 7.0})


def test_a_design_believes_a_law_s_slopes_at_rest(servo: Actuator) -> None:
    regions = operating_map(TABLE, levels=(1.2, 1.6))
    plain = design_model_with_effects(servo, TABLE, regions, EffectValues())
    known = design_model_with_effects(servo, TABLE, regions, of("linear", c=8.0, k=2e4, f=1.5))
    assert known.plant.damping - plain.plant.damping == pytest.approx(8.0)
    assert known.plant.stiffness - plain.plant.stiffness == pytest.approx(2e4)
    assert known.coupled.constant_force - plain.coupled.constant_force == pytest.approx(1.5)
    assert known.left_out == ()
    assert design_model_with_effects(servo, TABLE, regions, of("drag", a=3.0)).left_out == ("expression:drag.a",)
    assert CATALOGUE["expression:linear"].design.parameters == ("c", "k", "f")


def test_the_inverse_dynamics_take_a_law_of_the_motion() -> None:
    time = np.linspace(0, 1, 50)
    motion = MoverMotion(time, np.sin(time), np.cos(time), -np.sin(time), np.zeros(50))
    force = needed_force(plant_parameters(rig()), values_of(of("drag", a=2.0).vector()), motion)
    np.testing.assert_allclose(force, 2.0 * motion.velocity * np.abs(motion.velocity), rtol=1e-15)
    assert CATALOGUE["expression:drag"].inverse.parameters == ("a",)
    assert CATALOGUE["expression:crosstalk"].inverse.parameters == ()


def test_an_extended_model_keeps_its_law(servo: Actuator, tmp_path) -> None:
    effects = EffectValues({"expression:drag": {"a": 31.868}, "time_delay": {"command": 1.37e-4}})
    made = write_extended_model(ExtendedModel(servo, effects), tmp_path / "extended_model.toml")
    text = made.read_text()
    assert 'law = "-a*v*abs(v)"' in text
    assert 'a = "31.868 in 0.0..5000.0 N s^2/m^2"' in text
    assert load_extended_model(made).effects == effects
    made.write_text(text.replace("-a*v*abs(v)", "-a*v*v"))
    with pytest.raises(ActuatorError, match="'drag' is declared already as -a\\*v\\*abs\\(v\\); give the other cause"):
        load_extended_model(made)


def test_what_a_plant_must_have(servo: Actuator) -> None:
    one_sided = changed(servo, sides={"count": 1})
    with pytest.raises(InputError, match="expression:everything needs two sides"):
        simulate(one_sided, TABLE, Inputs(np.zeros((10, 1)), 1e4), effects=of("everything", f=1.0))
    with pytest.raises(InputError, match=r"expression:drag.a: 1e\+06 N s\^2/m\^2 is not allowed"):
        of("drag", a=1e6)


def test_the_functions_of_no_laws_name_none_of_those_declared() -> None:
    """They are made while a law of motion alone is simulated, for its voltages, and are printed for a plant without."""
    expressions._functions.cache_clear()
    assert not any("expression:" in inspect.getsource(function) for function in expressions._functions(()))
    assert "expression:drag" in inspect.getsource(expressions.law_functions()[0])


def test_declared_causes_go_with_their_block() -> None:
    extra = parse_expression("one_more: force = a*x; a: 0..1 N/m")
    n = EffectValues().vector().size
    with declared(extra):
        assert EffectValues().vector().size == n + 1
        names = "bcdefhk"  # ten are there
        terms = "+".join(f"{p}*x" for p in names)
        many = parse_expression(f"many: force = {terms};" + ";".join(f"{p}: 0..1 N/m" for p in names))
        with pytest.raises(InputError, match="parameters together; at most 16"):
            declare(many)
    assert EffectValues().vector().size == n
    assert "expression:one_more" not in CATALOGUE
