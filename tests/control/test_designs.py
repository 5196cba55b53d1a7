"""The designs beside the LQR: what each keeps, where it fails, and what is refused before any run."""

import dataclasses

import numpy as np
import pytest
from servo_controllers import TABLE, believed, rest, rival, servo, servo_belief, servo_design, sine, step

from msl_fem.computing.statespace import StateSpace
from msl_fem.control import (
    BiasOptions,
    ControllerChoice,
    Deviation,
    PlantUnderTest,
    RobustOptions,
    Wish,
    biased_design,
    check_stable_reach,
    default_bias,
    designed,
    held_points,
    pid_design,
    robust_design,
    run_closed_loop,
)
from msl_fem.control.baselines import bias_point
from msl_fem.control.controller import FORCE, controller_state, controller_step
from msl_fem.control.design_model import AtPosition
from msl_fem.control.robust_design import deviating_plant
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.effects import EffectValues

MODE = EffectValues({"structural_mode": {"mass_share": 0.08, "frequency": 450.0}})


def noise() -> np.random.Generator:
    return np.random.default_rng(1)


@pytest.mark.parametrize(("kind", "bound"), [("robust", 0.002), ("biased", 0.02), ("pid", 0.04)])
def test_every_design_tracks_in_its_range(kind, bound):
    run = run_closed_loop(rival(kind), sine(0.3e-3, 2.0, 1.0), plant=believed(), generator=noise())
    assert run.tracking_rms < bound * 0.3e-3
    assert run.guard_violations == 0


@pytest.mark.parametrize("kind", ["robust", "biased", "pid"])
def test_every_design_leaves_no_error_at_rest_and_keeps_its_wish(kind):
    made = rival(kind)
    assert made.kind == kind
    assert made.peak_sensitivity <= 2.0 * 1.002
    run = run_closed_loop(made, rest(0.5, 0.2e-3), plant=believed())
    assert abs(run.position[-1] - 0.2e-3) < 0.2e-6
    assert made.law_to_json()["design"] == kind


def test_the_robust_design_bears_a_structural_mode_that_the_lqr_does_not():
    plant = dataclasses.replace(believed(), effects=MODE)
    run = run_closed_loop(rival("robust"), sine(0.4e-3, 2.0, 0.6), plant=plant, generator=noise())
    assert run.tracking_rms < 0.002 * 0.4e-3
    with pytest.raises(ComputationError, match="does not hold it"):
        run_closed_loop(servo_design(), sine(0.4e-3, 2.0, 0.6), plant=plant, generator=noise())


def test_the_robust_law_is_stable_for_its_family_where_the_lqr_is_not():
    plant, place = servo_design().law.plant, AtPosition(5.4e5)
    mode = deviating_plant(plant, Deviation(mass_share=0.08, frequency=500.0), place.magnet_stiffness)
    assert rival("robust").law.spectral_radius(place, plant=mode) < 1
    assert servo_design().law.spectral_radius(place, plant=mode) > 1


def test_the_robust_search_weighs_the_compliance_against_the_peak():
    """What a spring that is 2 % off leaves of a sine at 60 Hz goes with |P S|."""
    f, softest = np.linspace(20.0, 100.0, 41), []
    for law in (rival("robust").law, robust_design(servo_belief(), options=RobustOptions(compliance=0.0)).law):
        p, jw = law.plant, 2j * np.pi * f
        own = p.mass * jw**2 + p.damping * jw + p.stiffness
        softest.append(np.abs((1 + law.loop_transfer(f)) * own).min())
    assert softest[0] > 1.03 * softest[1]
    assert rival("robust").peak_sensitivity < 1.9


@pytest.mark.parametrize("deviation", [Deviation(), Deviation(lag=2e-4), Deviation(gain=1.1)])
def test_a_family_member_without_a_second_mass_is_the_plain_plant_with_its_lags(deviation):
    plant, kappa = servo_design().law.plant, 3e5
    w = [1 / tau for tau in (deviation.lag, 1 / plant.lag) if tau]
    a, b = np.zeros((2 + len(w), 2 + len(w))), np.zeros((2 + len(w), 1))
    a[0, 1], a[1, :2] = 1, [-(plant.stiffness - kappa) / plant.mass, -plant.damping / plant.mass]
    a[1, -1], b[2] = deviation.gain / plant.mass, w[0]
    for k, rate in enumerate(w):
        a[2 + k, 2 + k] = -rate
        if k:
            a[2 + k, 1 + k] = rate
    f = np.array([3.0, 80.0, 700.0])
    by_hand = StateSpace(a, b, np.eye(1, 2 + len(w)), np.zeros((1, 1))).sampled(plant.period).response(f)[:, 0, 0]
    by_hand = by_hand * np.exp(-2j * np.pi * f * plant.period * plant.delay)
    np.testing.assert_allclose(deviating_plant(plant, deviation, kappa).response(f)[:, 0, 0], by_hand, rtol=1e-9)


def test_the_second_mass_of_a_family_member_is_that_of_the_coupled_equations():
    """Continuous transfer by elimination of the second mass, at frequencies far below half the rate."""
    plant, d, f = servo_design().law.plant, Deviation(mass_share=0.2, frequency=120.0, damping_ratio=0.05), 100.0
    fast = dataclasses.replace(plant, period=1e-5, delay=0)
    s, w = 2j * np.pi * f, 2 * np.pi * d.frequency
    link = w**2 + 2 * d.damping_ratio * w * s
    hanging = d.mass_share * plant.mass * s**2 * link / (s**2 + link)
    kept = (1 - d.mass_share) * plant.mass * s**2
    by_hand = 1 / (kept + hanging + plant.damping * s + plant.stiffness) / (1 + s / plant.lag) * np.exp(-s * 0.5e-5)
    assert deviating_plant(fast, d, 0.0).response([f])[0, 0, 0] == pytest.approx(by_hand, rel=1e-5)


def test_the_default_bias_takes_the_suspensions_stiffness_away():
    bias = default_bias(servo_belief())
    point = bias_point(servo_belief(), bias, 0.0)
    assert point.magnet_stiffness == pytest.approx(1.4e5, rel=1e-9)
    h = 1e-7
    slope = [2 * float(TABLE.force(bias, 0.6e-3 - x)) - 2 * float(TABLE.force(bias, 0.6e-3 + x)) for x in (-h, h)]
    assert (slope[1] - slope[0]) / (2 * h) == pytest.approx(1.4e5, rel=1e-4)
    assert rival("biased").parameters.stage.bias == bias
    assert rival("biased").law.plant.stiffness == pytest.approx(0.0, abs=1.0)


def test_points_held_about_a_bias_balance_the_suspension():
    points = held_points(servo_belief(), 1.0)
    assert points[0].position < -0.3e-3 < 0.3e-3 < points[-1].position
    for p in points[::7]:
        pulls = [2 * float(TABLE.force(max(1.0 + s * p.control, 0.0), 0.6e-3 - s * p.position)) for s in (1, -1)]
        assert pulls[0] - pulls[1] == pytest.approx(1.4e5 * p.position, abs=1e-6)
        h = 1e-5
        up = [2 * float(TABLE.force(1.0 + s * (p.control + h), 0.6e-3 - s * p.position)) for s in (1, -1)]
        assert (up[0] - up[1] - pulls[0] + pulls[1]) / h == pytest.approx(p.force_per_current, rel=1e-3)


def test_the_bias_costs_copper_loss_and_range():
    ours, theirs = (
        run_closed_loop(d, sine(0.3e-3, 2.0, 1.0), plant=believed(), generator=noise())
        for d in (servo_design(), rival("biased"))
    )
    assert theirs.copper_loss > 3 * ours.copper_loss
    assert theirs.tracking_rms > 5 * ours.tracking_rms
    assert rival("biased").stable_reach[1] < servo_design().stable_reach[1]


def test_the_biased_loop_holds_where_its_frozen_analysis_says_so():
    made = rival("biased")
    high = made.stable_reach[1]
    run = run_closed_loop(made, rest(0.6, 0.9 * high), plant=believed())
    assert abs(run.position[-1] - 0.9 * high) < 1e-6
    with pytest.raises(ComputationError):
        run_closed_loop(made, rest(0.6, high + 0.06e-3), plant=believed())


def test_pid_is_pid():
    """Its force for a ramp of readings, by the formula."""
    p = rival("pid").parameters
    state, command = controller_state(p), np.zeros(2)
    kp, kd, _ = p.reference_gain
    y, total, d = 1e-7 * np.array([0.0, 1.0, 3.0, 2.0, 2.5]), 0.0, 0.0
    for k, reading in enumerate(y):
        controller_step(p, state, np.array([2e-7, 1e-5, 0.0, 0.0, 0.0, 0.0]), reading, command)
        if k:
            d = 0.3 * d + 0.7 * (reading - y[k - 1]) * 2500.0
        force = kp * (2e-7 - reading) + kd * (1e-5 - d) - p.integral_gain * total
        total += reading - 2e-7
        assert state[FORCE] == pytest.approx(force, rel=1e-9)


def test_a_reference_beyond_the_stable_positions_is_refused_before_the_run():
    with pytest.raises(InputError, match=r"the pid design is stable from -\d+ µm to \d+ µm"):
        check_stable_reach(rival("pid"), sine(0.49e-3, 2.0, 0.1))
    check_stable_reach(rival("pid"), sine(0.3e-3, 2.0, 0.1))
    dead = dataclasses.replace(
        rival("pid"), frozen=tuple(dataclasses.replace(p, peak_sensitivity=np.inf) for p in rival("pid").frozen)
    )
    with pytest.raises(InputError, match="unstable in the middle"):
        check_stable_reach(dead, sine(0.1e-3, 2.0, 0.1))


def test_the_zones_are_those_of_the_standard():
    frozen = servo_design().frozen
    for p in frozen:
        expected = (
            "A"
            if p.peak_sensitivity <= 3
            else "B"
            if p.peak_sensitivity <= 4
            else "C"
            if p.peak_sensitivity <= 5
            else "D"
        )
        assert p.zone == expected
    reach = servo_design().zone_reach
    assert 0 < reach["A"] <= reach["B"] <= reach["C"] <= 0.5e-3
    assert all(p.zone == "A" for p in frozen if abs(p.position) <= reach["A"])


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        (
            ControllerChoice("fuzzy"),
            "'fuzzy' is no design; choose one of lqr, robust, scheduled, scheduled-rigid, biased, pid",
        ),
        (ControllerChoice("lqr", bias=1.0), "has no bias current"),
        (ControllerChoice("biased", overlap=1.0), "no hand-over"),
        (ControllerChoice("pid", feedforward=False), "comes in one form"),
        (ControllerChoice("biased", bias=50.0), "a bias of 50 A is not possible"),
        (ControllerChoice("biased", bias=0.0), "a bias of 0 A is not possible"),
        (
            ControllerChoice("robust", bandwidth=150.0, peak_sensitivity=1.2),
            "no law gives the whole family a bandwidth of 150 Hz",
        ),
        (ControllerChoice("pid", bandwidth=400.0), "out of range"),
    ],
)
def test_what_cannot_be_designed_is_said(choice, said):
    with pytest.raises(InputError, match=said):
        designed(servo_belief(), choice)


def test_one_side_has_no_bias():
    with pytest.raises(InputError, match="one side"):
        biased_design(servo_belief(sides={"count": 1}))


def test_a_pid_without_a_kalman_filter_has_no_stated_innovations():
    assert np.isnan(rival("pid").law.estimator.innovation_variance)
    slow = pid_design(servo_belief(), Wish(30.0, None))
    assert slow.feedback_bandwidth < rival("pid").feedback_bandwidth


def test_a_weaker_bias_reaches_less_far():
    weak = biased_design(servo_belief(), Wish(60.0, None), options=BiasOptions(0.3))
    assert weak.stable_reach[1] < rival("biased").stable_reach[1]


def test_the_step_of_the_robust_design():
    run = run_closed_loop(rival("robust"), step(0.2e-3, 0.3), plant=PlantUnderTest(servo(), TABLE), generator=noise())
    assert run.position.max() < 1.08 * 0.2e-3
    assert np.abs(run.position[-100:] - 0.2e-3).max() < 1e-6
