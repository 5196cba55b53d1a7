"""The position to come against the sampled plant, and against a free body."""

import numpy as np
import pytest

from msl_fem.control.gap_to_come import position_after
from msl_fem.control.linear_plant import LinearPlant

PERIOD = 4e-4


def plant(*, delay: int = 1, lag: float = 6e3, stiffness: float = 1.4e5) -> LinearPlant:
    return LinearPlant(0.9, stiffness, 12.0, lag, PERIOD, delay)


@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("lag", [6e3, np.inf])
@pytest.mark.parametrize("periods", [0, 1, 2, 5])
def test_whole_periods_are_those_of_the_sampled_plant(delay: int, lag: float, periods: int) -> None:
    believed = plant(delay=delay, lag=lag)
    model = believed.sampled()
    rng = np.random.default_rng(1)
    state, command = rng.standard_normal(model.A.shape[0]), 3.0
    row = position_after(believed, periods * PERIOD)
    found = row @ np.array([*state[:2], 0.0, *state[2:], command])
    for _ in range(periods):
        state = model.A @ state + model.B[:, 0] * command
    assert found == pytest.approx(state[0], rel=1e-10)


def test_a_free_body_under_a_disturbance() -> None:
    """x + v t + d t^2/(2 m), with a command that has not begun to act."""
    free = LinearPlant(0.9, 1e-9, 0.0, np.inf, PERIOD, 3)
    lead = 1.9 * PERIOD
    row = position_after(free, lead)
    assert row[:3] == pytest.approx([1.0, lead, lead**2 / 1.8], rel=1e-9)
    assert row[-1] == 0.0


def test_parts_of_a_period_are_those_of_a_faster_clock() -> None:
    believed = plant(delay=0)
    faster = LinearPlant(0.9, 1.4e5, 12.0, 6e3, PERIOD / 4, 0).sampled()
    state, command = np.array([1e-4, 0.02, -5.0]), 3.0
    found = position_after(believed, 0.75 * PERIOD) @ np.array([*state[:2], 0.0, *state[2:], command])
    for _ in range(3):
        state = faster.A @ state + faster.B[:, 0] * command
    assert found == pytest.approx(state[0], rel=1e-10)
