"""A run's picture says each channel's unit, and draws values in it."""

import numpy as np
import pytest

from msl_fem.record import Run
from msl_fem.report.pictures import MOST_POINTS, draw_run


def drawn(channels: dict[str, np.ndarray], n: int) -> dict[str, np.ndarray]:
    """Label of each panel to the values drawn in it."""
    run = Run("noise", "noise", "fit", {"time_s": np.arange(n) * 1e-4, **channels})
    figure = draw_run(run)
    assert ("one sample of 3 drawn" in figure.get_suptitle()) == (n > 2 * MOST_POINTS)
    return {axes.get_ylabel(): np.asarray(axes.lines[0].get_ydata()) for axes in figure.axes}


def test_small_values_get_a_prefix() -> None:
    wave = np.sin(np.arange(100.0))
    found = drawn({"position_m": 80e-6 * wave, "current_1_A": 0.6 * wave, "velocity_m_per_s": 1e-3 * wave}, 100)
    assert set(found) == {"position in µm", "current 1 in A", "velocity in m/s"}
    assert found["position in µm"] == pytest.approx(80 * wave)
    assert found["current 1 in A"] == pytest.approx(0.6 * wave)


def test_nothing_measured_and_long_runs() -> None:
    n = 2 * MOST_POINTS + 1
    found = drawn({"force_N": np.zeros(n)}, n)
    assert set(found) == {"force in N"}
    assert found["force in N"].size <= MOST_POINTS
