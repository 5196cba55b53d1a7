"""A drive with friction: found again from its own closed loop, and the real one near its published parameters."""

import sys
from pathlib import Path

import numpy as np
import pytest

from msl_fem.errors import InputError
from msl_fem.record import load_record

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

from friction_drive import (  # noqa: E402
    CascadeLoop,
    FrictionDrive,
    LowPass,
    closed_loop,
    filtered_equation,
    free_run,
    freely_refined,
    inverse_dynamics,
    refined,
)

EMPS = ROOT / "measurements" / "emps"
PUBLISHED = FrictionDrive(95.1089, 203.5034, 20.3935, -3.1648)
LOOP = CascadeLoop(160.18, 243.45, 35.15065)
PERIOD = 1e-3


@pytest.fixture(scope="module")
def simulated():
    reference = 0.1 * np.sin(2 * np.pi * 0.4 * PERIOD * np.arange(10_000)) ** 3
    return reference, *closed_loop(PUBLISHED, LOOP, reference, sampling_period=PERIOD, start=0.0)


def test_the_simulated_loop_obeys_its_equation(simulated):
    _, position, force = simulated
    columns, passed = filtered_equation(position, force, PERIOD)
    assert np.std(passed - columns @ PUBLISHED.vector) < 0.03 * np.std(passed)


def test_parameters_are_found_again(simulated):
    reference, position, force = simulated
    found, _ = inverse_dynamics(position, force, PERIOD)
    np.testing.assert_allclose(found.vector, PUBLISHED.vector, rtol=0.06)
    better = refined(found, LOOP, reference, position, sampling_period=PERIOD)
    np.testing.assert_allclose(better.vector, PUBLISHED.vector, rtol=1e-3)


def test_the_real_drive_is_near_its_published_parameters():
    run = load_record(EMPS).run("emps")
    found, deviations = inverse_dynamics(run["position_m"], run["force_N"], run.sampling_period)
    assert np.all(np.abs(found.vector - PUBLISHED.vector) < 3.0 * deviations)
    position, _ = closed_loop(
        found, LOOP, run["reference_m"], sampling_period=run.sampling_period, start=run["position_m"][0]
    )
    assert np.std(position - run["position_m"]) < 5e-5 * np.std(run["position_m"])


def test_a_filter_above_half_the_rate_is_refused(simulated):
    with pytest.raises(InputError, match="low-pass at 600 Hz"):
        inverse_dynamics(simulated[1], simulated[2], PERIOD, low_pass=LowPass(position=600.0))


def test_a_free_run_is_that_of_the_closed_form_and_its_fit_finds_the_drive() -> None:
    """Under a constant force the velocity rises with the time constant M / Fv to what friction leaves over Fv."""
    drive, period = FrictionDrive(95.0, 200.0, 20.0, -3.0), 1e-3
    time = np.arange(2000) * period
    position = free_run(drive, np.full(2000, 57.0), sampling_period=period, start=0.1)
    final, lag = (57.0 - 20.0 + 3.0) / 200.0, 95.0 / 200.0
    expected = 0.1 + final * (time - lag * (1 - np.exp(-time / lag)))
    assert np.abs(position - expected).max() < 1e-3 * np.ptp(expected)
    force = 60 * np.sin(9 * time) + 40 * np.sin(4 * time)
    measured = free_run(drive, force, sampling_period=period, start=0.0)
    found = freely_refined(FrictionDrive(90.0, 220.0, 22.0, -2.5), force, measured, sampling_period=period)
    assert found.vector == pytest.approx(drive.vector, rel=1e-3)
