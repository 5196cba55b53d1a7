"""What goes to other tools, read by those tools: CasADi, python-control, Gymnasium."""

import casadi as ca
import control
import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from msl_fem.actuator import Actuator
from msl_fem.computing.statespace import StateSpace
from msl_fem.control import linear_plant
from msl_fem.errors import InputError
from msl_fem.export.casadi_table import casadi_function
from msl_fem.export.control_system import control_system
from msl_fem.export.gymnasium_environment import LOST, LevitatedMover
from msl_fem.maps import operating_map
from msl_fem.plant import excitation_inputs, linearise, simulate
from msl_fem.table.magnetic_table import NODES, MagneticTable

STEP = "step:amplitude=2 mA,bias=0.3 A,channel=differential,duration=40 ms"


def test_casadi_has_the_tables_numbers_and_gradients(table: MagneticTable) -> None:
    """1e-10 of each quantity's full scale, both signs of the current, and exact derivatives at no current."""
    rng = np.random.default_rng(5)
    current = np.r_[rng.uniform(-12, 12, 400), 0.0, table.current[4], -table.current[-1]]
    gap = np.r_[rng.uniform(table.gap[0], table.gap[-1], 400), table.gap[3], table.gap[7], table.gap[-1]]
    function = casadi_function(table)
    read = function.map(current.size).call([current[None], gap[None]])
    ours = table.evaluate(current, gap)
    for name, values in zip(NODES, read, strict=True):
        difference = np.abs(np.asarray(values).ravel() - ours[name]).max()
        assert difference < 1e-10 * np.abs(table.nodes[name]).max(), name
    outside = function(12.5, 0.5e-3)
    assert all(np.isnan(float(value)) for value in outside)


def test_casadi_differentiates_the_force(table: MagneticTable) -> None:
    """What an optimiser takes: the gradient of the force by the other tool, against the table's own slopes."""
    i, g = ca.MX.sym("i"), ca.MX.sym("g")
    force = casadi_function(table)(current=i, gap=g)["force"]
    slopes = ca.Function("slopes", [i, g], [ca.gradient(force, i), ca.gradient(force, g)])(3.0, 0.4e-3)
    ours = table.evaluate(3.0, 0.4e-3)
    for mine, theirs in zip(("force_current_slope", "force_gap_slope"), slopes, strict=True):
        assert float(theirs) == pytest.approx(float(ours[mine]), rel=1e-10)


def test_python_control_steps_as_the_plant_does(servo: Actuator, table: MagneticTable) -> None:
    """The linear model in the other tool against the coupled model, for a step so small that it is linear."""
    run = simulate(servo, table, excitation_inputs(servo, STEP, rate=10e3))
    point = linearise(servo, table, currents=(0.3, 0.3))
    system = control_system(point.model)
    np.testing.assert_allclose(np.sort_complex(system.poles()), np.sort_complex(point.model.poles), rtol=1e-9)
    assert system.input_labels == ["command_1", "command_2", "disturbance"]
    settled = int(np.argmax(run.command[:, 0] != run.command[0, 0]))
    time = run.time[: run.time.size - settled]
    inputs = np.vstack([(run.command[settled:] - 0.3).T, np.zeros(time.size)])
    answer = control.forced_response(system, time, inputs)
    position = answer.outputs[system.output_labels.index("position")]
    moved = run.position[settled:] - run.position[settled]
    assert np.abs(moved - position).max() < 0.02 * np.abs(moved).max()


def test_a_sampled_model_keeps_its_period(servo: Actuator) -> None:
    sampled: StateSpace = linear_plant(servo).sampled()
    system = control_system(sampled)
    assert system.dt == sampled.sampling_period == 1 / servo.controller.rate
    at = 0.3j / sampled.sampling_period
    ours = sampled.C @ np.linalg.solve(np.exp(0.3j) * np.eye(len(sampled.A)) - sampled.A, sampled.B) + sampled.D
    assert complex(np.squeeze(system(np.exp(at * sampled.sampling_period)))) == pytest.approx(
        complex(ours[0, 0]), rel=1e-12
    )


@pytest.fixture(scope="module")
def mover(servo: Actuator, table: MagneticTable) -> LevitatedMover:
    return LevitatedMover(servo, table, operating_map(table), duration=0.02)


@pytest.mark.filterwarnings("ignore:.*infinity.*:UserWarning")
def test_gymnasiums_own_checker_takes_the_environment(mover: LevitatedMover) -> None:
    check_env(mover, skip_render_check=True)


def test_no_action_is_unacceptable(mover: LevitatedMover) -> None:
    """Random actions up to the end: the guard, asked anew with the position that the sensor told, allows each."""
    unacceptable = asked = 0
    for seed in range(4):
        mover.reset(seed=seed)
        mover.action_space.seed(seed)
        over = False
        while not over:
            told = mover._readings[0]
            _, _, lost, truncated, info = mover.step(mover.action_space.sample())
            over = lost or truncated
            gaps = mover._plant.parameters.nominal_gap - np.array([1, -1]) * told
            regions = mover.guard.classify(info["command"] * mover._plant.parameters.current_share, gaps)
            unacceptable += int((regions == "unacceptable").sum())
            asked += 2
    assert asked > 20
    assert unacceptable == 0


def test_a_proportional_agent_beats_none_and_a_run_can_be_repeated(mover: LevitatedMover) -> None:
    """The environment rewards what a controller is for; the same seed gives the same episode."""

    def episode(gain: float) -> tuple[float, list[float]]:
        seen, _ = mover.reset(seed=3, options={"target": 1e-4})
        total, over, positions = 0.0, False, []
        while not over:
            push = gain * (seen[1] - seen[0])
            seen, reward, lost, truncated, info = mover.step(np.array([max(push, 0), max(-push, 0)], np.float32))
            total, over = total + reward, lost or truncated
            positions.append(info["position"])
        return total, positions

    (pulled, path), (idle, _), (again, same) = episode(0.5), episode(0.0), episode(0.5)
    assert path == same
    assert pulled == again
    assert pulled > idle
    lost, _ = episode(-5.0)
    assert lost < LOST / 2


def test_a_voltage_drive_is_refused(servo: Actuator, table: MagneticTable) -> None:
    drive = servo.drive.model_copy(update={"kind": "voltage"})
    with pytest.raises(InputError, match='kind = "current"'):
        LevitatedMover(servo.model_copy(update={"drive": drive}), table, operating_map(table))
    assert issubclass(LevitatedMover, gymnasium.Env)
