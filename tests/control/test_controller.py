"""One step of the controller against its law written out anew, and at its limits."""

import numpy as np
import pytest
from servo_controllers import delayed_design, plain, rival, servo_design

from msl_fem.control import ControllerDesign
from msl_fem.control.controller import (
    D_HAT,
    FORCE,
    INTEGRAL,
    N_FIXED,
    N_PREFERRED,
    N_VIOLATION,
    NO_SHAPE,
    V_HAT,
    ControllerParameters,
    controller_state,
    controller_step,
)
from msl_fem.control.inverse import magnet_force


def at_rest(position: float) -> np.ndarray:
    return np.array([position, 0.0, 0.0, position, 0.0, 0.0])


def coming(p: ControllerParameters, before: np.ndarray, state: np.ndarray, y: float) -> float:
    """m, the position that a step inverted at: of the states before it, and of its estimates and force."""
    n = p.model_a.shape[0]
    known = before[N_FIXED : N_FIXED + n - 2]
    return float(p.gap_row @ np.array([y, state[V_HAT], state[D_HAT], *known, state[FORCE]]))


def forces_of_a_plain_twin(design: ControllerDesign, references: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """(n,) forces of the law as the docstrings of controller and filter state it, with matrices and no limits."""
    law, p = design.law, design.law.plant
    model, k, km = p.sampled(), law.gains.state, law.model_gains.state
    n, force_states = k.size, k.size - 2 - p.delay
    known, followed, sent, predicted, total = np.zeros(n - 2), np.zeros(n), [0.0] * p.delay, np.zeros(3), 0.0
    followed[0] = predicted[0] = measured[0]
    out = []
    for (r, v, a, *later), y in zip(references, measured, strict=True):
        velocity, disturbance = predicted[1:] + law.estimator.gain * (y - predicted[0])
        u = -law.gains.integral * total - k @ np.array([y, velocity, *known])
        if law.feedforward:
            ahead = np.array([p.stiffness, p.damping, p.mass]) @ later
            now = [p.stiffness * r + p.damping * v + p.mass * a][:force_states]
            promised = ahead + km @ (np.array([r, v, *now, *sent]) - followed)
            u += promised + k @ followed
            total += y - followed[0]
            followed = model.A @ followed + model.B[:, 0] * promised
            sent = [*sent, ahead][1:] if p.delay else []
        else:
            total += y - r
        predicted = law.estimator.prediction @ np.array([y, velocity, disturbance, *known, u])
        known = (model.A @ np.array([0.0, 0.0, *known]) + model.B[:, 0] * u)[2:]
        out.append(u)
    return np.array(out)


@pytest.mark.parametrize("delay", [0, 1, 2])
@pytest.mark.parametrize("ideal_drive", [False, True])
@pytest.mark.parametrize("feedforward", [True, False])
def test_the_force_is_that_of_the_law_written_out(delay, ideal_drive, feedforward):
    design = delayed_design(delay, ideal_drive=ideal_drive)
    design = design if feedforward else plain(design)
    rng, n = np.random.default_rng(delay), 30
    references = rng.standard_normal((n, 6)) * [1e-7, 1e-4, 0.1, 1e-7, 1e-4, 0.1]
    measured = 1e-8 * rng.standard_normal(n)  # without a plant the law need not be stable, so small and short
    state, command, forces = controller_state(design.parameters), np.zeros(2), np.empty(n)
    for j in range(n):
        controller_step(design.parameters, state, references[j], measured[j], command)
        forces[j] = state[FORCE]
    assert state[N_PREFERRED] == n
    np.testing.assert_allclose(forces, forces_of_a_plain_twin(design, references, measured), rtol=1e-8, atol=1e-9)


def test_the_currents_give_the_force_at_the_coming_gap():
    p = servo_design().parameters
    state, command = controller_state(p), np.zeros(2)
    for y in (0.0, 1e-6, 3e-6, 6e-6):
        before = state.copy()
        controller_step(p, state, at_rest(0.2e-3), y, command)
    position = coming(p, before, state, y)
    assert position > 7e-6
    gap = 0.6e-3 - position
    assert 2 * magnet_force(p.inverse.surface_1, command[0], gap) == pytest.approx(state[FORCE], rel=1e-9)
    assert command[1] == 0.0


def test_the_integral_does_not_wind_up_while_the_force_is_cut():
    parameters = servo_design(feedforward=False).parameters
    limited = parameters._replace(inverse=parameters.inverse._replace(current_limit=0.2))
    command, states = np.zeros(2), []
    for p in (parameters, limited):
        state = controller_state(p)
        for _ in range(400):
            controller_step(p, state, at_rest(0.3e-3), 0.0, command)
        states.append(state)
    free, held = (abs(s[INTEGRAL]) for s in states)
    assert held < 0.1 * free
    assert states[1][INTEGRAL] < 0
    for _ in range(4):  # the error turns: the integral comes back at once
        controller_step(limited, states[1], at_rest(-0.3e-3), 0.0, command)
    assert states[1][INTEGRAL] > 0


def test_a_reading_that_is_no_number_gives_no_current_for_its_sample_alone():
    p = servo_design().parameters
    state, command = controller_state(p), np.zeros(2)
    for y in (np.nan, 0.0, np.nan, 0.0, np.inf, 0.0):
        controller_step(p, state, at_rest(0.2e-3), y, command)
        assert (command > 0).any() == np.isfinite(y)
        assert np.isfinite(command).all()
        assert np.isfinite(state).all()
    assert state[N_VIOLATION] == 3


def test_a_lost_reading_hardly_moves_the_estimate():
    """The filter predicts over the gap: its next innovation is that of a sample without a push."""
    p = servo_design().parameters
    states = [controller_state(p) for _ in range(2)]
    command, held = np.zeros(2), at_rest(0.1e-3)
    for k in range(60):
        for n, state in enumerate(states):
            controller_step(p, state, held, 0.1e-3 if (k, n) != (50, 1) else np.nan, command)
    assert states[1][V_HAT] == pytest.approx(states[0][V_HAT], abs=0.02)


def test_outside_the_map_nothing_is_commanded_and_a_violation_is_counted():
    p = servo_design().parameters
    state, command = controller_state(p), np.zeros(2)
    for _ in range(2):
        command[:] = 9.0
        controller_step(p, state, at_rest(0.6e-3), 0.58e-3, command)
        np.testing.assert_array_equal(command, [0.0, 0.0])
    assert state[N_VIOLATION] == 2
    assert state[FORCE] == 0.0


@pytest.mark.parametrize("kind", ["lqr", "robust", "pid"])
def test_the_step_is_the_linear_law_as_a_system(kind):
    """Two routes to one force: the compiled step, and the law as state space whose frequency responses are judged."""
    design = plain(servo_design() if kind == "lqr" else rival(kind))
    law, p = design.law.controller(), design.parameters
    rng, n = np.random.default_rng(4), 40
    references, measured = 1e-8 * rng.standard_normal((n, 6)), 1e-8 * rng.standard_normal(n)
    measured[0] = 0.0
    state, command, x = controller_state(p), np.zeros(2), np.zeros(law.A.shape[0])
    for j in range(n):
        controller_step(p, state, references[j], measured[j], command)
        inputs = np.array([measured[j], 0.0, p.reference_gain @ references[j, :3], references[j, 0]])
        force = law.C[0] @ x + law.D[0] @ inputs
        x = law.A @ x + law.B @ inputs
        assert state[FORCE] == pytest.approx(force, rel=1e-7, abs=1e-9)
    assert (kind == "robust") == (tuple(p.shape) != NO_SHAPE)


def test_a_believed_cubic_spring_is_carried_by_the_magnets():
    p = servo_design().parameters
    states, command = [controller_state(p) for _ in range(2)], np.zeros((2, 2))
    stiff = p._replace(cubic=1e11)
    for _ in range(3):
        pulls = []
        for one, state, out in zip((p, stiff), states, command, strict=True):
            before = state.copy()
            controller_step(one, state, at_rest(0.3e-3), 0.3e-3, out)
            position = coming(one, before, state, 0.3e-3)
            pulls.append(2 * magnet_force(p.inverse.surface_1, out[0], 0.6e-3 - position))
        assert pulls[1] - pulls[0] == pytest.approx(1e11 * position**3, rel=1e-6)
        assert states[0][FORCE] == pytest.approx(states[1][FORCE], rel=1e-12)
