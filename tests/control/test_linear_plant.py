"""The sampled belief against the differential equation, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from servo_controllers import servo

from msl_fem.control.linear_plant import LinearPlant, linear_plant
from msl_fem.errors import ActuatorError, InputError

PLANT = LinearPlant(mass=0.9, stiffness=1.4e5, damping=12.0, lag=2 * np.pi * 1e3, period=4e-4, delay=1)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("lag", [2 * np.pi * 1e3, np.inf])
@pytest.mark.parametrize("magnet_stiffness", [0.0, 5e5])
def test_samples_lie_on_the_solution_of_the_differential_equation(delay, lag, magnet_stiffness):
    plant = LinearPlant(0.9, 1.4e5, 12.0, lag, 4e-4, delay)
    command = np.random.default_rng(0).normal(0, 20, 12)

    def rate(_t: float, y: np.ndarray, u: float) -> list[float]:
        force = y[2] if np.isfinite(lag) else u
        acceleration = (force - 12.0 * y[1] - (1.4e5 - magnet_stiffness) * y[0]) / 0.9
        return [y[1], acceleration, lag * (u - y[2]) if np.isfinite(lag) else 0.0]

    model = plant.sampled(magnet_stiffness=magnet_stiffness)
    state, y = np.zeros(model.A.shape[0]), np.zeros(3)
    for k in range(command.size):
        state = model.A @ state + model.B[:, 0] * command[k]
        acting = command[k - delay] if k >= delay else 0.0
        y = solve_ivp(rate, (0, 4e-4), y, args=(acting,), rtol=1e-11, atol=1e-14).y[:, -1]
        assert model.C @ state == pytest.approx(y[0], rel=1e-7, abs=1e-13)
        assert state[1] == pytest.approx(y[1], rel=1e-6, abs=1e-11)


def test_the_queue_holds_the_commands_under_way():
    model = LinearPlant(0.9, 1.4e5, 12.0, np.inf, 4e-4, 2).sampled()
    assert model.states == ("position", "velocity", "queue_1", "queue_2")
    state = np.zeros(4)
    for command in (1.0, 2.0, 3.0):
        state = model.A @ state + model.B[:, 0] * command
    np.testing.assert_array_equal(state[2:], [2.0, 3.0])


def test_lead_is_delay_half_the_hold_and_the_lag():
    assert PLANT.lead == pytest.approx(4e-4 + 2e-4 + 1 / (2 * np.pi * 1e3))
    assert LinearPlant(1, 1, 1, np.inf, 1e-3, 0).lead == pytest.approx(5e-4)


def test_the_reference_actuator():
    assert linear_plant(servo()) == PLANT
    assert linear_plant(servo(drive={"bandwidth": None})).lag == np.inf


@pytest.mark.parametrize("section", ["motion", "drive", "controller", "sides"])
def test_a_missing_section_is_named(section):
    with pytest.raises(ActuatorError, match=rf"\[{section}\]"):
        linear_plant(servo().model_copy(update={section: None}))


def test_other_drives_and_slow_loops_are_refused():
    with pytest.raises(ActuatorError, match="voltage"):
        linear_plant(servo(drive={"kind": "voltage"}))
    with pytest.raises(InputError, match="four samples"):
        linear_plant(servo(controller={"rate": 200.0}))


@pytest.mark.parametrize("magnets", [0.0, 3e5])
def test_a_delay_within_a_sample_is_that_of_ten_samples_a_sample(magnets: float) -> None:
    late = 0.3 * PLANT.period
    drive = replace(PLANT, lag=1 / (1 / PLANT.lag + late), dead_time=late, delay=0)
    assert drive.lead == pytest.approx(0.5 * PLANT.period + 1 / PLANT.lag + late)
    whole = drive.driven(magnet_stiffness=magnets)
    tenth = replace(PLANT, period=PLANT.period / 10, delay=3).sampled(magnet_stiffness=magnets)
    state, finer = np.zeros(whole.A.shape[0]), np.zeros(tenth.A.shape[0])
    for command in np.random.default_rng(1).normal(size=40):
        assert float(whole.C[0] @ state) == pytest.approx(float(tenth.C[0] @ finer), rel=1e-8, abs=1e-15)
        state = whole.A @ state + whole.B[:, 0] * command
        for _ in range(10):
            finer = tenth.A @ finer + tenth.B[:, 0] * command
