"""Where a run begins that was cut out of a log: the mover is in motion there, and accelerates."""

import numpy as np
import pandas as pd
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.prediction import ModelHypothesis, kernel_plant, measured_start, run_data
from msl_fem.record import FrameLabels, record_from_frames

MASS, DAMPING, STIFFNESS = 2.0, 25.0, 5e4
AMPLITUDE, NOISE, RATE, N = 2e-4, 2e-7, 1e3, 500
SHAKER = f"""
schema = 1
name = "shaker"
[motion]
moving_mass = "{MASS} kg"
stiffness = "{STIFFNESS} N/m"
damping = "{DAMPING} N s/m"
[drive]
kind = "force"
[position_sensor]
noise = "{NOISE} m"
"""


@pytest.mark.parametrize("phase", [0.3, 2.0])
def test_a_start_in_motion_is_found_to_the_noise(tmp_path, phase: float) -> None:
    """Free decay in closed form, 25 Hz at 1 kHz: nine samples are a quarter of a period, so a straight line through
    them misses the velocity by 10 mm/s, which is no measure of how well the start is known."""
    (tmp_path / "shaker.toml").write_text(SHAKER)
    decay = DAMPING / (2 * MASS)
    turning = np.sqrt(STIFFNESS / MASS - decay**2)
    time = np.arange(N) / RATE
    true = AMPLITUDE * np.exp(-decay * time) * np.cos(turning * time + phase)
    position = true + np.random.default_rng(4).normal(0.0, NOISE, N)
    frame = pd.DataFrame({"time_s": time, "force_N": np.zeros(N), "position_m": position})
    record = record_from_frames(load_actuator(tmp_path / "shaker.toml"), {"cut": frame}, labels=FrameLabels())
    run = run_data(record, record.runs[0])
    start = measured_start(kernel_plant(ModelHypothesis(record.actuator, None), rate=RATE), run)
    velocity = -AMPLITUDE * (decay * np.cos(phase) + turning * np.sin(phase))
    assert start.position == pytest.approx(true[0], abs=NOISE / 2)  # 100 samples: some 0.2 of one's noise
    assert start.velocity == pytest.approx(velocity, abs=turning * NOISE / 2)
