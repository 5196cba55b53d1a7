"""The effects on what is read: sensors, delays of channels, drift, hum."""

import numpy as np
import pytest
from coupled_twin import changed, linear_table
from effect_sets import effects, rough

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.simulate import Options, simulate
from msl_fem.table.magnetic_table import MagneticTable


@pytest.fixture(scope="module")
def inputs() -> Inputs:
    return rough(300)


def test_a_position_sensor_bends_its_reading(servo: Actuator, table: MagneticTable, inputs: Inputs) -> None:
    plain = simulate(servo, table, inputs)
    values = effects("position_sensor_nonlinearity", gain_error=0.02, quadratic=30.0, cubic=2e5)
    bent = simulate(servo, table, inputs, effects=values)
    y = plain.measured_position
    assert (bent.position == plain.position).all(), "the mover knows nothing of it"
    assert bent.measured_position == pytest.approx(1.02 * y + 30 * y**2 + 2e5 * y**3, rel=1e-12)


def test_currents_are_read_with_gain_and_offset(servo: Actuator, table: MagneticTable, inputs: Inputs) -> None:
    values = effects("current_sensor_error", gain_1=0.01, gain_2=-0.02, offset_1=0.03, offset_2=0.004)
    run = simulate(servo, table, inputs, effects=values)
    assert run.measured_current == pytest.approx(run.current * [1.01, 0.98] + [0.03, 0.004], rel=1e-13)


@pytest.mark.parametrize("bandwidth", [None, 200.0])
def test_a_sensor_s_lag_adds_to_its_own(servo: Actuator, bandwidth: float | None) -> None:
    """At constant velocity the reading is late by the lag and by the sensor's own time constant."""
    bench = changed(servo, motion={"stiffness": 0.0, "damping": 0.0}, position_sensor={"bandwidth": bandwidth})
    run = simulate(
        bench, linear_table(), Inputs(np.zeros((200, 2)), 1e4), effects=effects("position_sensor_lag", lag=5e-4),
        options=Options(velocity=0.01),
    )  # fmt: skip
    tau = 5e-4 + (0.0 if bandwidth is None else 1 / (2 * np.pi * bandwidth))
    exact = 0.01 * (run.time - tau * (1 - np.exp(-run.time / tau)))
    assert run.measured_position == pytest.approx(exact, rel=1e-9, abs=1e-15)


def test_channels_are_read_as_they_were(servo: Actuator, table: MagneticTable, inputs: Inputs) -> None:
    """By whole samples exactly; by parts as a run that is sampled ten times as fast knows them."""
    whole = simulate(servo, table, inputs, effects=effects("time_delay", position=2e-4, current=1e-4))
    plain = simulate(servo, table, inputs).measured_position
    assert plain.std() > 1e-6
    assert whole.measured_position[2:] == pytest.approx(plain[:-2], rel=1e-12)
    assert whole.measured_current[1:] == pytest.approx(whole.current[:-1], rel=1e-12)
    part = simulate(servo, table, inputs, effects=effects("time_delay", position=1.3e-4, current=0.4e-4))
    push = np.repeat(np.asarray(inputs.disturbance), 10)
    fine = simulate(servo, table, Inputs(np.repeat(inputs.commands, 10, axis=0), 1e5, push))
    at = np.arange(20, 3000, 10)
    assert part.measured_position[2:] == pytest.approx(fine.measured_position[at - 13], abs=1e-9)
    assert part.measured_current[2:] == pytest.approx(fine.current[at - 4], abs=3e-4 * 0.1)


def test_drift_and_hum_are_on_the_reading_alone(servo: Actuator, table: MagneticTable, inputs: Inputs) -> None:
    values = EffectValues(
        {
            "sensor_drift": {"offset": 2e-7, "rate": 1e-6, "acceleration": -2e-6, "jerk": 3e-6},
            "periodic_disturbance": {
                "position_cosine": 2e-7, "position_sine": -1e-7, "current_cosine": 3e-3, "current_sine": 1e-3,
                "frequency": 60.0,
            },
        }
    )  # fmt: skip
    plain, run = simulate(servo, table, inputs), simulate(servo, table, inputs, effects=values)
    t, w = run.time, 2 * np.pi * 60.0
    drift = 2e-7 + 1e-6 * t - 2e-6 * t**2 / 2 + 3e-6 * t**3 / 6
    hum = 2e-7 * np.cos(w * t) - 1e-7 * np.sin(w * t)
    assert run.measured_position - plain.measured_position == pytest.approx(drift + hum, abs=1e-18)
    current_hum = 3e-3 * np.cos(w * t) + 1e-3 * np.sin(w * t)
    assert run.measured_current - run.current == pytest.approx(np.column_stack([current_hum] * 2), abs=1e-15)
    assert (run.position == plain.position).all()


def test_hum_of_the_reading_and_of_the_force_have_one_phase(servo: Actuator, table: MagneticTable) -> None:
    """A force a cos w t at rest begins with its crest: the acceleration of the first sample is a/m."""
    values = effects("periodic_disturbance", force_cosine=0.9, frequency=10.0)
    run = simulate(servo, table, Inputs(np.zeros((20, 2)), 1e4), effects=values)
    assert run.velocity[1] == pytest.approx(0.9 / 0.9 * 1e-4, rel=1e-3)
