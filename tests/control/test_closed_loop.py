"""The guarded loop around the coupled model: its figures, its limits, and a slow twin."""

import time

import numpy as np
import pytest
from conftest import closed_form_table
from scipy.signal import lfilter
from servo_controllers import (
    RATE,
    TABLE,
    believed,
    delayed,
    delayed_design,
    reference,
    rest,
    servo,
    servo_design,
    servo_map,
    sine,
    step,
)

from msl_fem.control import PlantUnderTest, closed_loop_record, design_controller, run_closed_loop, with_measured_gap
from msl_fem.control.controller import controller_state, controller_step
from msl_fem.control.design_model import AtPosition
from msl_fem.control.inverse import force_domain
from msl_fem.control.stepper import reference_rows
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps.guard import Guard
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation import reference as excitation_reference
from msl_fem.plant.kernel import advance
from msl_fem.plant.layout import I1, I2, SENSOR, X, initial_state
from msl_fem.plant.plant import plant_parameters, surface_of


def noise(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_sine_over_most_of_the_range_is_tracked_to_half_a_percent():
    run = run_closed_loop(servo_design(), sine(0.4e-3, 2.0, 1.5), plant=believed(), generator=noise())
    assert run.tracking_rms <= 0.002 * 0.4e-3  # wanted: 0.5 % of the amplitude; this is what is reached, with room
    assert run.guard_violations == 0
    assert run.force_limited == 0
    assert run.region_counts["preferred"] == run.time.size


def test_without_the_feedforward_the_error_is_that_of_the_integral():
    """The source paper's plain law: its error at 2 Hz is the linear prediction's."""
    run = run_closed_loop(servo_design(feedforward=False), sine(0.4e-3, 2.0, 1.5), plant=believed(), generator=noise())
    predicted = abs(servo_design(feedforward=False).law.reference_response([2.0])[0] - 1)
    late = run.time > 0.5
    error = np.sqrt(np.mean((run.position - run.reference)[late] ** 2)) / (0.4e-3 / np.sqrt(2))
    assert error == pytest.approx(predicted, rel=0.05)
    assert error > 0.02


def test_a_step_settles_within_15_ms_with_5_percent_overshoot():
    run = run_closed_loop(servo_design(), step(0.2e-3, 0.3), plant=believed(), generator=noise())
    after = run.position[run.time >= 0.02] / 0.2e-3
    assert after.max() <= 1.05
    assert np.flatnonzero(np.abs(after - 1) > 0.02)[-1] + 1 <= 0.015 * RATE
    assert run.guard_violations == 0


@pytest.mark.parametrize(
    ("spec", "bound"),
    [
        ("ramp:frequency=5 Hz,amplitude=0.2 mm,duration=0.6 s", 0.01),
        ("sine:frequency=20 Hz,amplitude=0.1 mm,duration=0.5 s", 0.02),
    ],
)
def test_references_of_the_simulator_are_followed(spec, bound):
    wanted = excitation_reference(parse_excitation(spec, unit="m"), rate=RATE)
    run = run_closed_loop(servo_design(), wanted, plant=believed(), generator=noise())
    assert run.tracking_rms <= bound * np.abs(wanted.position).max()
    assert run.guard_violations == 0


def test_one_side_pulls_at_a_time():
    run = run_closed_loop(servo_design(), sine(0.3e-3, 5.0, 0.4), plant=believed(), generator=noise())
    assert (run.command >= 0).all()
    assert (run.command.min(axis=1) == 0).all()
    assert (run.command.max(axis=0) > 0.3).all()


def test_frozen_analysis_tells_where_the_measured_gap_loses_the_loop():
    """At 0.3 mm both hold; at 0.45 mm the inverse at the measured gap is late, and the mover runs away."""
    for design, position in ((servo_design(), 0.45e-3), (with_measured_gap(servo_design()), 0.3e-3)):
        run = run_closed_loop(design, rest(0.4, position), plant=believed(), generator=noise())
        assert np.std(run.position[-300:]) < 0.3e-6
    measured = with_measured_gap(servo_design())
    assert measured.law.spectral_radius(AtPosition(6.98e5)) > 1
    with pytest.raises(ComputationError, match="end of its travel"):
        run_closed_loop(measured, rest(0.4, 0.45e-3), plant=believed(), generator=noise())


def test_a_constant_disturbance_leaves_no_error():
    push = np.full(1000, 20.0)
    run = run_closed_loop(servo_design(), rest(0.4), plant=believed(), disturbance=push)
    assert np.abs(run.position).max() > 5e-6
    assert abs(run.position[-1]) < 0.05e-6
    assert run.force[-1] == pytest.approx(-20.0, rel=1e-2)
    assert run.disturbance_hat[-1] == pytest.approx(20.0, rel=1e-2)


def test_matched_noise_gives_the_innovations_that_the_filter_states():
    """Through the whole loop: position noise, white force errors and a wandering disturbance of the design's sizes."""
    rng, n = noise(5), 8000
    level = 0.01 * force_domain(servo_design().parameters.inverse, 0.0).highest
    wander = lfilter([1.0], [1.0, -0.99], level * rng.standard_normal(n))
    kicks = level * rng.standard_normal(n) + wander
    run = run_closed_loop(servo_design(), rest(n / RATE), plant=believed(), generator=rng, disturbance=kicks)
    ratio = np.mean(run.innovation[300:] ** 2) / servo_design().law.estimator.innovation_variance
    assert ratio == pytest.approx(1.0, abs=0.1)


def test_a_constant_force_that_is_believed_is_carried_from_the_start():
    hung = servo(motion={"constant_force": -15.0})
    design = design_controller(hung, TABLE, servo_map())
    run = run_closed_loop(design, rest(0.3), plant=PlantUnderTest(hung, TABLE))
    assert run.position[0] == pytest.approx(-15.0 / 1.4e5)
    assert abs(run.position[-1]) < 0.02e-6
    assert run.command[-1, 0] > 0.5
    assert np.abs(run.innovation[:2]).max() < 1e-9


def test_coils_in_parallel_take_twice_the_current_for_the_same_motion():
    halves = {"sides": {"connection": "parallel"}, "drive": {"current_limit": 24.0, "voltage_limit": 40.0}}
    parallel = servo(**halves)
    design = design_controller(parallel, TABLE, servo_map())
    wanted = sine(0.2e-3, 5.0, 0.4)
    one = run_closed_loop(servo_design(), wanted, plant=believed())
    two = run_closed_loop(design, wanted, plant=PlantUnderTest(parallel, TABLE))
    np.testing.assert_allclose(two.command, 2 * one.command, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(two.position, one.position, atol=1e-12)
    assert two.copper_loss == pytest.approx(one.copper_loss, rel=1e-6)


def test_a_single_side_with_a_spring_back():
    single = servo(sides={"count": 1})
    design = design_controller(single, TABLE, servo_map())
    run = run_closed_loop(design, rest(0.4, 0.2e-3), plant=PlantUnderTest(single, TABLE), generator=noise())
    assert np.abs(run.position[-200:] - 0.2e-3).max() < 1e-6
    assert (run.current[:, 1] == 0).all()


def test_the_guard_cuts_counts_and_is_never_passed():
    """With low levels a hard step asks for more than the last level allows."""
    levels = (0.2, 0.45)
    design = design_controller(servo(), TABLE, servo_map(levels))
    run = run_closed_loop(design, step(0.18e-3, 0.2), plant=believed(), generator=noise())
    assert run.guard_violations > 0
    assert run.region_counts["discouraged"] > 0
    assert sum(run.region_counts.values()) == run.time.size
    assert run.force_limited == 0
    guard = Guard(servo_map(levels))
    for side, gap in ((0, 0.6e-3 - run.measured), (1, 0.6e-3 + run.measured)):
        limit = guard.limit(gap)[-1]
        assert (run.command[:, side] <= limit * (1 + 1e-12)).all()
        assert side == 1 or (run.command[:, side] > 0.97 * limit).any()
    assert np.abs(run.position[-100:] - 0.18e-3).max() < 2e-6


def test_the_drive_limit_cuts_and_counts_apart():
    weak = servo(drive={"current_limit": 1.0})
    run = run_closed_loop(
        design_controller(weak, TABLE, servo_map()), step(0.2e-3, 0.2), plant=PlantUnderTest(weak, TABLE)
    )  # fmt: skip
    assert run.force_limited > 0
    assert run.guard_violations == 0
    assert run.command.max() == pytest.approx(1.0)


def test_the_compiled_loop_is_the_plain_one():
    design, wanted = servo_design(), sine(0.2e-3, 10.0, 0.1)
    run = run_closed_loop(design, wanted, plant=believed(), generator=noise(3))
    sensor = noise(3).normal(0.0, servo().position_sensor.noise, wanted.time.size)
    plant, surface = plant_parameters(servo()), surface_of(TABLE)
    state, memory = initial_state(plant, 0.0, 0.0, 0.0, 0.0), controller_state(design.parameters)
    late = np.zeros(2)
    samples = np.column_stack([wanted.position, wanted.velocity, wanted.acceleration])
    rows = reference_rows(design, samples, period=1 / RATE)
    for k in range(wanted.time.size):
        command = np.zeros(2)
        controller_step(design.parameters, memory, rows[k], state[SENSOR] + sensor[k], command)
        assert run.position[k] == pytest.approx(state[X], abs=1e-15)
        np.testing.assert_allclose(run.current[k], state[[I1, I2]], atol=1e-12)
        np.testing.assert_allclose(run.command[k], command, atol=1e-12)
        voltage = np.zeros(2)
        advance(surface, plant, None, state, late, 0.0, 4e-4 / 6, 6, voltage)
        np.testing.assert_allclose(run.voltage[k], voltage, atol=1e-9)
        late = command


@pytest.mark.parametrize("delay", [0, 2])
@pytest.mark.parametrize("ideal_drive", [False, True])
def test_other_delays_and_an_ideal_drive(delay, ideal_drive):
    plant = PlantUnderTest(delayed(delay, ideal_drive=ideal_drive), TABLE)
    design = delayed_design(delay, ideal_drive=ideal_drive)
    run = run_closed_loop(design, sine(0.3e-3, 2.0, 0.6), plant=plant, generator=noise())
    assert run.tracking_rms < 0.008 * 0.3e-3
    assert np.abs(run.innovation[1:]).max() < 5e-6


def test_figures_are_those_of_the_arrays():
    run = run_closed_loop(servo_design(), sine(0.2e-3, 10.0, 0.2), plant=believed(), generator=noise())
    assert run.tracking_rms == pytest.approx(np.sqrt(np.mean((run.position - run.reference) ** 2)))
    assert run.peak_current == run.current.max()
    assert run.copper_loss == pytest.approx(2.0 * np.mean(run.current[:, 0] ** 2 + run.current[:, 1] ** 2))
    content = run.to_json()
    assert content["tracking_rms_m"] == run.tracking_rms
    assert content["guard_violations"] == 0
    assert 30e-9 < np.std(run.measured - run.position) < 200e-9


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_a_record_holds_the_commands_that_act(delay):
    actuator = delayed(delay)
    design = servo_design() if delay == 1 else delayed_design(delay)
    run = run_closed_loop(design, sine(0.2e-3, 10.0, 0.4), plant=PlantUnderTest(actuator, TABLE), generator=noise())
    np.testing.assert_array_equal(run.acting[delay:], run.command[: run.time.size - delay])
    assert (run.acting[:delay] == 0).all()
    columns = closed_loop_record(actuator, run, excitation="sine").runs[0].columns
    np.testing.assert_array_equal(columns["command_2_A"], run.acting[:, 1])
    np.testing.assert_array_equal(columns["position_m"], run.measured)
    assert 1e-3 < np.std(columns["current_1_A"] - run.current[:, 0]) < 4e-3


def test_the_same_seed_gives_the_same_run_and_another_does_not():
    one, two, other = (
        run_closed_loop(servo_design(), rest(0.2), plant=believed(), generator=noise(s)).position for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()


def test_the_resolution_of_the_sensor_is_seen():
    coarse = PlantUnderTest(servo(position_sensor={"resolution": 1e-6}), TABLE)
    run = run_closed_loop(servo_design(), rest(0.3, 0.1e-3), plant=coarse)
    np.testing.assert_allclose(run.measured / 1e-6, np.round(run.measured / 1e-6), atol=1e-6)


def test_the_plant_may_differ_from_the_belief():
    heavy = run_closed_loop(
        servo_design(), sine(0.3e-3, 5.0, 0.4), plant=PlantUnderTest(servo(motion={"moving_mass": 1.0}), TABLE)
    )  # fmt: skip
    plain = run_closed_loop(servo_design(), sine(0.3e-3, 5.0, 0.4), plant=believed())
    assert plain.tracking_rms < heavy.tracking_rms < 0.01 * 0.3e-3


def with_changes(**changes: object):
    wanted = sine(0.1e-3, 5.0, 0.1)
    for name, value in changes.items():
        setattr(wanted, name, value)
    return wanted


@pytest.mark.parametrize(
    ("wanted", "said"),
    [
        (sine(0.51e-3, 2.0, 0.5), "beyond the -500"),
        (sine(0.4e-3, 250.0, 0.1), "guard, drive and table allow"),
        (with_changes(time=np.arange(250) / 1000.0), "loop's rate of 2500 Hz"),
        (with_changes(velocity=np.zeros(3)), "of one length"),
        (with_changes(acceleration=np.full(250, np.nan)), "finite"),
        (reference(np.zeros(1), np.zeros(1), np.zeros(1)), "at least 2"),
    ],
)
def test_references_that_cannot_be_followed_are_refused_before_the_run(wanted, said):
    with pytest.raises(InputError, match=said):
        run_closed_loop(servo_design(), wanted, plant=believed())


def test_a_disturbance_of_another_length_is_refused():
    with pytest.raises(InputError, match="disturbance"):
        run_closed_loop(servo_design(), rest(0.2), plant=believed(), disturbance=np.zeros(3))


def test_a_plant_with_another_drive_is_refused():
    with pytest.raises(InputError, match="commands currents"):
        run_closed_loop(servo_design(), rest(0.2), plant=PlantUnderTest(servo(drive={"kind": "voltage"}), TABLE))


def test_a_run_that_leaves_the_table_is_no_result():
    narrow = closed_form_table(n_gap=8)
    inner = narrow.gap >= 0.4e-3
    cut = PlantUnderTest(
        servo(),
        type(narrow)(
            narrow.gap[inner], narrow.current, {k: v[inner] for k, v in narrow.nodes.items()}
        ),
    )  # fmt: skip
    with pytest.raises(ComputationError, match=r"left its table \(gap 0\.4"):
        run_closed_loop(servo_design(), sine(0.4e-3, 2.0, 0.5), plant=cut)


def test_a_run_is_much_faster_than_its_time():
    wanted = sine(0.3e-3, 5.0, 4.0)
    run_closed_loop(servo_design(), rest(0.1), plant=believed())
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        run_closed_loop(servo_design(), wanted, plant=believed())
        best = min(best, time.process_time() - start)
    assert best < 4.0 / 10, "aimed at 20 times faster than real time on a quiet machine; 10 on a busy one"
