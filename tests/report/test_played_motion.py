"""The played motion: its piece of the run, and where the mover and the models are drawn."""

import numpy as np
import pytest

from msl_fem.diagnosis.result import ChannelResiduals
from msl_fem.report.played_motion import LEFT, RIGHT, SPAN, PlayedMotion, motion_of, motion_stage

RATE = 1e4
TIME = np.arange(8000) / RATE
MEASURED = 4e-4 * np.sin(2 * np.pi * 5 * TIME)
BEFORE = 2e-6 * np.sin(2 * np.pi * 5 * TIME) * np.exp(-(((TIME - 0.65) / 0.1) ** 2))
LEFT_OVER = ChannelResiduals("sweep", "held-out", "position_m", RATE, 5e-8, BEFORE, BEFORE / 2, BEFORE / 40)
MODELS = (("as believed", LEFT_OVER.nominal), ("with what was found", LEFT_OVER.extended))


@pytest.fixture
def motion() -> PlayedMotion:
    made = motion_of(LEFT_OVER, MEASURED, MODELS)
    assert made is not None
    return made


def test_the_piece_is_about_the_largest_error_and_inside_the_run(motion: PlayedMotion) -> None:
    assert motion.time[-1] - motion.time[0] == pytest.approx(SPAN, rel=0.01)
    assert motion.time[-1] == TIME[-1]
    assert motion.time[0] < TIME[np.argmax(np.abs(BEFORE))]
    assert np.interp(motion.time, TIME, MEASURED) == pytest.approx(motion.measured)


def test_a_model_stands_where_it_says_and_distances_are_magnified_by_a_round_number(motion: PlayedMotion) -> None:
    measured, before, after = motion.places()
    assert motion.magnified == 50.0
    metres = np.ptp(measured) / np.ptp(motion.measured)
    assert (measured - before) / metres == pytest.approx(50.0 * motion.errors[0][1])
    assert (measured - after) / metres == pytest.approx(50.0 * motion.errors[1][1])
    assert min(one.min() for one in (measured, before, after)) >= LEFT
    assert max(one.max() for one in (measured, before, after)) <= RIGHT
    assert "drawn 50 times as large" in motion_stage(LEFT_OVER, motion).sentence


def test_large_errors_are_drawn_as_they_are() -> None:
    made = motion_of(LEFT_OVER, MEASURED, (("as believed", 100 * BEFORE), MODELS[1]))
    assert made is not None
    assert made.magnified == 1.0
    assert "as they are" in motion_stage(LEFT_OVER, made).sentence


@pytest.mark.parametrize(
    ("measured", "after"),
    [(np.zeros(8000), BEFORE / 40), (MEASURED, np.where(TIME > 0.7, np.nan, 0.0))],
    ids=["it does not move", "a model left its range"],
)
def test_what_cannot_be_played_is_left_out(measured: np.ndarray, after: np.ndarray) -> None:
    assert motion_of(LEFT_OVER, measured, (MODELS[0], ("with what was found", after))) is None
