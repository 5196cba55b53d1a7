"""From forces to currents: the hand-over between the sides, the bias, and what the guard says."""

from functools import cache

import numpy as np
import pytest
from servo_controllers import TABLE, believed, rest, servo_belief, servo_design

from msl_fem.control import LqrOptions, lqr_design, run_closed_loop
from msl_fem.control.inverse import force_domain, hand_over, held_stiffness, magnet_force
from msl_fem.control.output_stage import (
    BIAS,
    DISCOURAGED,
    FORCE_LIMITED,
    HARD_HAND_OVER,
    INVERSE,
    PREFERRED,
    VIOLATION,
    OutputStage,
    commanded_currents,
)
from msl_fem.errors import InputError


@cache
def held():
    """What the controller inverts; asked for by the first test, not where the module is read."""
    return servo_design().parameters.inverse


def currents(stage: OutputStage, force: float, *, position: float = 0.0, inverse=None):
    command = np.full(2, 7.0)
    given, verdict = commanded_currents(
        stage, inverse or held(), force, (position, position), (np.inf, np.inf), command
    )
    return given, verdict, command


def pull_of(command: np.ndarray, position: float = 0.0) -> float:
    """What the table says that two magnets a side pull with."""
    pulls = [2 * float(TABLE.force(command[j], 0.6e-3 - (1 - 2 * j) * position)) for j in range(2)]
    return pulls[0] - pulls[1]


@pytest.mark.parametrize("overlap", [0.0, 0.5, 5.0])
@pytest.mark.parametrize("position", [-0.3e-3, 0.0, 0.1e-3])
def test_the_currents_give_the_force_with_and_without_an_overlap(overlap, position):
    for force in (-80.0, -3.0, -1e-3, 0.0, 1e-6, 0.4, 25.0):
        given, verdict, command = currents(OutputStage(INVERSE, overlap, 0.0, 1.0), force, position=position)
        assert verdict == PREFERRED
        assert given == pytest.approx(force, abs=1e-12)
        assert pull_of(command, position) == pytest.approx(force, rel=1e-9, abs=1e-9)
        assert (command > 0).sum() == (2 if overlap else int(force != 0))


def test_the_hand_over_keeps_the_product_and_is_smooth_where_the_hard_one_has_a_corner():
    for force in (-30.0, -0.2, 0.0, 0.7, 300.0):
        first, second = hand_over(force, 2.0)
        assert first - second == pytest.approx(force, abs=1e-12)
        assert first * second == pytest.approx(4.0, rel=1e-12)
        assert hand_over(force, 0.0) == (max(force, 0.0), max(-force, 0.0))
    step = 1e-4
    slopes = [(hand_over(f + step, 2.0)[0] - hand_over(f - step, 2.0)[0]) / (2 * step) for f in (-1e-3, 0.0, 1e-3)]
    np.testing.assert_allclose(slopes, 0.5, atol=1e-3)


def test_an_overlap_bounds_the_slope_of_the_current():
    """Without one, a force a thousand times smaller takes a current only 32 times smaller."""
    hard = [currents(HARD_HAND_OVER, f)[2][0] for f in (1e-3, 1.0)]
    assert hard[1] / hard[0] == pytest.approx(np.sqrt(1e3), rel=1e-3)
    soft = [currents(OutputStage(INVERSE, 1.0, 0.0, 1.0), f)[2][0] for f in (0.0, 1e-3, 1e-2)]
    assert (soft[2] - soft[0]) / (soft[1] - soft[0]) == pytest.approx(10.0, rel=0.01)


def test_an_overlap_adds_the_other_sides_stiffness():
    x, force, h = 0.2e-3, 28.0, 1e-8
    pulls = hand_over(force, 4.0)
    _, _, command = currents(OutputStage(INVERSE, 4.0, 0.0, 1.0), force, position=x)
    slope = (pull_of(command, x + h) - pull_of(command, x - h)) / (2 * h)
    assert held_stiffness(held(), force, x, overlap=4.0) == pytest.approx(slope, rel=1e-4)
    assert held_stiffness(held(), force, x, overlap=4.0) > held_stiffness(held(), force, x)
    assert pulls[1] > 0


def test_an_overlap_calms_the_loop_at_rest_and_costs_copper_loss():
    made = lqr_design(servo_belief(), options=LqrOptions(overlap=1.0))
    hard, soft = (
        run_closed_loop(d, rest(1.0), plant=believed(), generator=np.random.default_rng(2))
        for d in (servo_design(), made)
    )
    late = hard.time > 0.3
    assert np.std(soft.position[late]) < 0.7 * np.std(hard.position[late])
    assert soft.copper_loss > hard.copper_loss + 0.1
    assert (soft.command[1:] > 0).all()


@pytest.mark.parametrize("overlap", [-1.0, 1e4, np.nan])
def test_an_impossible_overlap_is_refused(overlap):
    with pytest.raises(InputError, match=r"an overlap of .* is not possible"):
        lqr_design(servo_belief(), options=LqrOptions(overlap=overlap))


def test_a_single_side_has_no_overlap():
    with pytest.raises(InputError, match="two sides"):
        lqr_design(servo_belief(sides={"count": 1}), options=LqrOptions(overlap=1.0))


def test_the_verdict_is_the_worst_of_the_sides():
    most = force_domain(held(), 0.0).highest
    assert currents(HARD_HAND_OVER, 1.01 * most)[1] == VIOLATION
    assert currents(HARD_HAND_OVER, 0.9 * most)[1] == DISCOURAGED
    weak = held()._replace(current_limit=0.5)
    given, verdict, command = currents(HARD_HAND_OVER, -1e3, inverse=weak)
    assert verdict == FORCE_LIMITED
    assert command[1] == 0.5
    assert given == pytest.approx(-2 * magnet_force(held().surface_1, 0.5, 0.6e-3))
    assert currents(HARD_HAND_OVER, np.nan)[:2] == (0.0, VIOLATION)
    assert currents(HARD_HAND_OVER, 10.0, position=0.58e-3)[:2] == (0.0, VIOLATION)


def test_about_a_bias_the_difference_of_the_currents_is_the_force():
    stage = OutputStage(BIAS, 0.0, 1.2, 70.0)
    given, verdict, command = currents(stage, 7.0)
    np.testing.assert_allclose(command, [1.3, 1.1])
    assert (given, verdict) == (pytest.approx(7.0), PREFERRED)
    given, _, command = currents(stage, 140.0)  # one side would have to push
    np.testing.assert_allclose(command, [3.2, 0.0])
    assert given == pytest.approx(112.0)
    given, verdict, command = currents(stage, 7e3)
    assert verdict == VIOLATION
    assert command[0] < 6
    assert currents(stage, 0.0, position=0.58e-3)[1] == VIOLATION


def test_parallel_coils_share_the_bias():
    belief = servo_belief(sides={"connection": "parallel"}, drive={"current_limit": 24.0, "voltage_limit": 40.0})
    _, _, command = currents(OutputStage(BIAS, 0.0, 2.4, 35.0), 7.0, inverse=belief.inverse)
    np.testing.assert_allclose(command, [2.6, 2.2])
