"""The coupled model along simulated runs: it finds what was shifted, and its predictor's errors are white."""

from dataclasses import replace

import numpy as np
import pytest
from shifted_records import RATE, in_voltage_drive, simulated_record

from msl_fem.comparison.accuracy import nrmse
from msl_fem.plant import simulate
from msl_fem.plant.excitation import Inputs
from msl_fem.prediction import (
    ModelHypothesis,
    ProcessNoise,
    Start,
    fit_record,
    free_run,
    k_step,
    kalman_filter,
    kernel_plant,
    measured_start,
    noise_floor,
    open_loop_stable,
    run_data,
    tuned_process_noise,
)
from msl_fem.prediction.free_run import error_growth
from msl_fem.prediction.run_data import highest_band_sigma
from msl_fem.record import Run

SHIFT = {"stiffness": 0.97, "damping": 1.2}


@pytest.fixture(scope="module")
def record(servo, table):
    return simulated_record(servo, table, SHIFT)


@pytest.fixture(scope="module")
def runs(record):
    return [run_data(record, run) for run in record.runs]


@pytest.fixture(scope="module")
def refit(record, runs, table):
    return fit_record(ModelHypothesis(record.actuator, table), runs[:1], record.tolerance)


def test_the_fit_finds_the_shift_inside_its_interval(refit, servo):
    assert refit.by == "free run"
    assert refit.fit.converged
    for name, factor in SHIFT.items():
        found = refit.parameters[name]
        assert found.low < factor * getattr(servo.motion, name) < found.high, (name, found)
        assert found.high - found.low < 0.02 * found.value
    assert abs(refit.parameters["moving_mass"].tolerances) < 2
    assert not refit.far


def test_after_the_fit_a_run_that_it_never_saw_is_at_the_noise_floor(refit, runs):
    run = runs[1]
    plant = kernel_plant(refit.belief, rate=run.rate)
    free = free_run(plant, run, measured_start(plant, run))
    for name in ("position_m", "current_1_A", "current_2_A"):
        floor = run.noise[name].sigma / run.measured[name].std()
        assert nrmse(run.measured[name], free.readings[name]) == pytest.approx(floor, rel=0.05)


def test_errors_grow_with_the_horizon(runs, servo, table):
    """As believed, one sample ahead is best and a free run worst."""
    run = runs[1]
    plant = kernel_plant(ModelHypothesis(servo, table), rate=run.rate)
    found = kalman_filter(plant, run, tuned_process_noise(plant, runs[:1]))
    errors = [
        nrmse(run.measured["position_m"][40:], made["position_m"][40:])
        for made in (
            found.one_step,
            k_step(plant, run, found, 10),
            free_run(plant, run, measured_start(plant, run)).readings,
        )
    ]
    assert errors[0] < errors[1] / 3 < errors[2] / 9


def test_one_sample_ahead_two_ways(runs, servo, table):
    plant = kernel_plant(ModelHypothesis(servo, table), rate=RATE)
    head = runs[0].first(200)
    found = kalman_filter(plant, head, ProcessNoise(1e-5, 1e-3))
    again = k_step(plant, head, found, 1)
    for name in ("position_m", "current_1_A"):
        np.testing.assert_allclose(again[name][1:], found.one_step[name][1:], rtol=0, atol=1e-14)


def test_innovations_of_the_true_model_are_white_and_of_their_predicted_size(refit, runs):
    run = runs[0]
    plant = kernel_plant(refit.belief, rate=run.rate)
    found = kalman_filter(plant, run, tuned_process_noise(plant, runs[:1]))
    for name, values in found.whitened.items():
        e = values[40:]
        assert e.std() == pytest.approx(1, abs=0.05), name
        correlation = np.array([e[:-k] @ e[k:] for k in range(1, 21)]) / (e @ e)
        assert np.abs(correlation).max() < 4 / np.sqrt(e.size), name


def test_of_a_linear_plant_the_predictor_is_the_kalman_filter(servo):
    """A mass on a spring under a held force, against the textbook's recursion in matrices."""
    from scipy.linalg import expm

    from msl_fem.record import Noise, Record, Sampling

    motion = servo.motion.model_copy(update={"moving_mass": 1.0, "stiffness": 4e4, "damping": 3.0})
    drive = servo.drive.model_copy(update={"kind": "force", "bandwidth": None})
    sensor = servo.position_sensor.model_copy(update={"bandwidth": None})
    rig = servo.model_copy(
        update={"magnet": None, "sides": None, "motion": motion, "drive": drive, "position_sensor": sensor}
    )
    rng = np.random.default_rng(4)
    force = rng.standard_normal(1200)
    made = simulate(rig, None, Inputs(force, RATE), generator=rng)
    columns = {"time_s": made.time, "force_N": force, "position_m": made.measured_position}
    record = Record("simulated", rig, Sampling(rate=RATE), Noise(position=5e-8), runs=(Run("r", "", "fit", columns),))
    data = run_data(record, record.runs[0])
    plant = kernel_plant(ModelHypothesis(rig, None), rate=RATE)
    noise = ProcessNoise(1e-5, 0.0)
    found = kalman_filter(plant, data, noise, start=Start((0.0, 0.0), 0.0, 0.0))

    a = expm(np.array([[0, 1, 0], [-4e4, -3, 1], [0, 0, 0]]) / RATE)
    a, b = a[:2, :2], a[:2, 2]
    y, x, p = columns["position_m"], np.zeros(2), np.diag([5e-8**2, (5e-8 * RATE) ** 2])
    expected = np.full(y.size, np.nan)
    for k in range(1, y.size):
        x, p = a @ x + b * force[k - 1], a @ p @ a.T + np.diag([0, noise.velocity**2])
        expected[k] = x[0]
        gain = p[:, 0] / (p[0, 0] + 5e-8**2)
        x, p = x + gain * (y[k] - x[0]), p - np.outer(gain, p[0])
    np.testing.assert_allclose(found.one_step["position_m"][1:], expected[1:], rtol=0, atol=1e-11)
    assert found.whitened["position_m"][1:].std() > 0.2


def test_the_gain_of_the_sensor_is_a_gauge(runs, servo, table):
    """m, k, c like s^-2, magnets like s, gap like s, reading gain like 1/s leave all readings (DIAGNOSIS, gauge)."""
    s, run = 1.05, runs[0].first(500)
    same = kernel_plant(ModelHypothesis(servo, table), rate=RATE)
    motion = dict.fromkeys(("moving_mass", "stiffness", "damping"), s**-2)
    moved = kernel_plant(
        ModelHypothesis(servo, table), rate=RATE, factors=motion | {"position_gain": 1 / s, "nominal_gap": s}
    )
    surface = moved.surface
    coefficients = surface.coefficients.copy()
    for power in range(6):  # of the gap, counted from the cell's edge
        coefficients[:, :, power] = coefficients[:, :, power] * s ** (-power)
    from dataclasses import replace

    stretched = surface._replace(gap=surface.gap * s, coefficients=coefficients)
    p = moved.parameters._replace(travel=moved.parameters.travel * s)
    moved = replace(moved, surface=stretched, parameters=p)
    one = free_run(same, run, Start((0.5, 0.5), 1e-5, 0.0)).readings
    other = free_run(moved, run, Start((0.5, 0.5), 1e-5 * s, 0.0)).readings
    for name in ("position_m", "current_1_A"):
        np.testing.assert_allclose(other[name], one[name], rtol=0, atol=1e-6 * np.abs(one[name]).max())


def test_a_run_that_leaves_the_range_says_where(runs, servo, table):
    plant = kernel_plant(ModelHypothesis(servo, table), rate=RATE)
    ended = free_run(plant, runs[0], Start((0.5, 0.5), 0.0, 0.4))
    assert ended.ended is not None
    assert str(ended.ended) in ended.reason
    assert np.isnan(ended.readings["position_m"][ended.ended :]).all()
    assert np.isfinite(ended.readings["position_m"][: ended.ended]).all()


def test_stability_is_told_by_the_currents(runs, servo, table):
    belief = ModelHypothesis(servo, table)
    assert open_loop_stable(belief, runs[0])
    strong = {k: 3 * v if k.startswith("current") else v for k, v in runs[0].measured.items()}
    assert not open_loop_stable(belief, replace(runs[0], measured=strong))


def test_a_run_that_is_unstable_for_a_while_has_no_free_run(runs, servo, table):
    """Where the stiffness is -K an error grows by exp(t (sqrt(K/m) - c/(2 m))); here 0.1 s near a magnet."""
    belief, run = ModelHypothesis(servo, table), runs[0]
    assert error_growth(belief, run) == 1.0
    near = dict(run.measured)
    stretch = slice(1000, 1000 + int(0.1 * run.rate))
    x, current = 3e-4, 1.3
    near["position_m"], near["current_1_A"] = near["position_m"].copy(), near["current_1_A"].copy()
    near["position_m"][stretch], near["current_1_A"][stretch] = x, current
    it = replace(run, measured=near)
    motion = servo.motion
    slope = 2 * float(table.evaluate(current, motion.nominal_gap - x)["force_gap_slope"])
    missing = -(motion.stiffness + slope)
    assert missing > 0
    rate = np.sqrt(missing / motion.moving_mass) - motion.damping / (2 * motion.moving_mass)
    assert np.log(error_growth(belief, it)) == pytest.approx(0.1 * rate, rel=0.1)
    assert not open_loop_stable(belief, it)


def test_voltage_drive_reads_currents(servo, table):
    """Voltages in, currents and position out: resistance and stiffness found together."""
    believed = in_voltage_drive(servo)
    spec = "band-limited-noise:channel=independent,band=200 Hz,bias=1 V,amplitude=0.3 V,duration=1 s,seed=1"
    record = simulated_record(believed, table, {"stiffness": 0.98}, specs={"fit": spec})
    data = run_data(record, record.runs[0])
    assert set(data.measured) == {"current_1_A", "current_2_A", "position_m"}
    found = fit_record(ModelHypothesis(believed, table), [data], record.tolerance)
    k = found.parameters["stiffness"]
    assert k.low < 0.98 * 1.4e5 < k.high
    assert max(found.excess.values()) < 1.03
    r = found.parameters["coil_resistance"]
    assert r.low < 2.0 < r.high
    assert r.high - r.low < 0.02


def test_unstated_noise_is_found_in_the_highest_band():
    rng = np.random.default_rng(1)
    time = np.arange(5000) / RATE
    signal = 1e-4 * np.sin(2 * np.pi * 40 * time) + 3e-7 * rng.standard_normal(time.size)
    assert highest_band_sigma(signal) == pytest.approx(3e-7, rel=0.1)


def test_the_source_of_a_noise_is_told(record):
    assert noise_floor(record, "position_m").stated
    assert not noise_floor(record, "voltage_1_V").stated
