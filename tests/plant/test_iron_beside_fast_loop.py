"""What iron takes of the current of a loop that is fast against the step: as few steps tell it as many."""

import numpy as np
import pytest
from coupled_twin import changed

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import run_lanes
from msl_fem.plant.plant import plant_parameters, surface_of
from msl_fem.plant.simulate import Options, Simulation, simulate
from msl_fem.table.magnetic_table import MagneticTable

RATE = 1e4
IRON = {
    "memory": {"magnetic_hysteresis": {"coercive_current": 0.02, "reversal_current": 0.3}},
    "bent memory": {
        "magnetic_hysteresis": {"coercive_current": 0.02, "reversal_current": 0.3, "spacing": 2.0, "broadening": 1.0}
    },
    "low field": {"early_saturation": {"low_field_current": 0.02, "low_field_width": 0.2}},
    "knee": {"early_saturation": {"knee_excess": 0.05}},
    "remanence": {
        "magnetic_hysteresis": {"coercive_current": 0.02, "reversal_current": 0.3},
        "remanent_flux": {"current_1": 0.03, "halving_current": 0.5},
    },
}


def wandering(n: int, hold: str) -> Inputs:
    """Currents about 0.5 A that change at each sample, and turn."""
    steps = np.random.default_rng(3).standard_normal((n, 2))
    return Inputs(0.5 + 0.1 * np.sin(np.cumsum(0.3 * steps, axis=0)), RATE, hold=hold)  # type: ignore[arg-type]


def off(few: np.ndarray, many: np.ndarray) -> float:
    """RMS from the tenth sample on, over what changes."""
    return float(np.sqrt(np.mean((few[10:] - many[10:]) ** 2)) / np.std(many[10:]))


@pytest.mark.parametrize("hold", ["zero-order", "linear"])
@pytest.mark.parametrize("numbers", [{}, {"mutual": 2e-3}], ids=["apart", "mutual flux"])
@pytest.mark.parametrize("more", [{}, {"cross_coupling": {"share": 0.1}}], ids=["", "shared current"])
@pytest.mark.parametrize("iron", IRON)
def test_one_step_is_as_good_as_many(
    servo: Actuator,
    table: MagneticTable,
    iron: str,
    more: dict[str, dict[str, float]],
    numbers: dict[str, float],
    hold: str,
) -> None:
    plant = plant_parameters(changed(servo, drive={"bandwidth": 2e3}))._replace(**numbers)
    effects = EffectValues(IRON[iron] | more).vector()[None]

    def run(steps: int) -> list[np.ndarray]:
        settings = LaneSettings(effects=effects)
        lanes = run_lanes(surface_of(table), [plant], wandering(200, hold), substeps=steps, settings=settings)
        return [lanes.current[0], lanes.voltage[0], lanes.true_position[0]]

    many, most = run(60), (2e-4, 1e-3) if hold == "zero-order" else (5e-4, 2.5e-3)
    for steps in (1, 2):
        few = run(steps)
        assert off(few[0], many[0]) < most[0]
        assert off(few[1], many[1]) < most[1]


def test_sides_that_share_current_rise_together(servo: Actuator, table: MagneticTable) -> None:
    """Without iron, where commands run straight: a target is that of both sides."""
    actuator, values = changed(servo, drive={"bandwidth": 2e3}), EffectValues({"cross_coupling": {"share": 0.1}})
    one, many = (
        simulate(actuator, table, wandering(200, "linear"), effects=values, options=Options(substeps=steps))
        for steps in (1, 60)
    )
    assert off(one.current, many.current) < 2e-4


def test_a_moving_gap_changes_what_iron_takes(servo: Actuator, table: MagneticTable) -> None:
    """At one step, as at many: position and current of a mover that swings."""
    actuator = changed(servo, drive={"bandwidth": 2e3})
    options = [Options(substeps=steps, position=2e-5, velocity=0.02) for steps in (1, 60)]
    values = EffectValues(IRON["memory"])
    one, many = (
        simulate(actuator, table, wandering(200, "zero-order"), effects=values, options=how) for how in options
    )
    assert off(one.current, many.current) < 2e-4
    assert off(one.position, many.position) < 1e-3
    assert one.audit.hysteresis == pytest.approx(many.audit.hysteresis, rel=1e-4)


@pytest.mark.parametrize("iron", IRON)
def test_what_iron_takes_warms_the_copper(servo: Actuator, table: MagneticTable, iron: str) -> None:
    """The coil's current within a step is the magnetising one and what iron takes, at one step as at many."""
    actuator, values = changed(servo, drive={"bandwidth": 2e3}), EffectValues(IRON[iron])
    one, many = (
        simulate(actuator, table, wandering(200, "zero-order"), effects=values, options=Options(substeps=steps))
        for steps in (1, 60)
    )
    assert one.audit.copper == pytest.approx(many.audit.copper, rel=5e-5)


@pytest.mark.parametrize("iron", ["none", *IRON])
def test_a_jump_against_the_voltage_limit(servo: Actuator, table: MagneticTable, iron: str) -> None:
    """The limit acts in the first part of a step: where it ceases to, iron takes another part than at the begin."""
    commands = np.zeros((12, 2))
    commands[3:] = 0.3
    actuator = changed(servo, drive={"bandwidth": 2e3, "voltage_limit": 80.0})
    effects = EffectValues(IRON[iron]) if iron in IRON else None

    def run(steps: int) -> Simulation:
        return simulate(actuator, table, Inputs(commands, RATE), effects=effects, options=Options(substeps=steps))

    many, one, two = run(480), run(1), run(2)
    assert many.voltage[3, 0] > 60.0
    at_one, at_two = (1e-7, 1e-7) if iron == "none" else (2.5e-3 if iron == "remanence" else 1e-3, 2e-5)
    assert np.abs(one.current - many.current).max() < at_one
    assert np.abs(two.current - many.current).max() < at_two
