"""Readings that stand alone are found whatever moves beneath them, and leave a residual as its neighbours have it."""

import numpy as np
import pytest

from msl_fem.diagnosis.spikes import MOST, about_spikes, spikes, without_spikes
from msl_fem.prediction import RunData
from msl_fem.prediction.run_data import NoiseFloor
from msl_fem.record.validity import bridged

N, RATE = 8000, 1e3
CALM = np.ones(N, dtype=bool)
AT = np.array([500, 501, 2345, 7000])
AROUND = {n for at in AT for n in range(at - 2, at + 3)}
TIME = np.arange(N) / RATE
QUIET = 1e-6 * np.random.default_rng(1).standard_normal(N)


def sweep(fastest: float) -> np.ndarray:
    """1 mm of a sine whose frequency rises from nothing to `fastest` Hz over the run."""
    return 1e-3 * np.sin(np.pi * fastest * TIME**2 / TIME[-1])


@pytest.mark.parametrize("fastest", [0.0, 20.0, 150.0])
def test_spikes_are_found_under_slow_and_fast_motion_and_nothing_else_is(fastest: float) -> None:
    clean = sweep(fastest) + QUIET
    assert spikes(clean, CALM).size == 0
    spoilt = clean.copy()
    spoilt[AT] += 2e-3
    assert set(AT) <= set(spikes(spoilt, CALM)), "a spike of two samples is seen whole"
    assert set(spikes(spoilt, CALM)) <= AROUND


def test_what_is_frequent_is_no_spike() -> None:
    busy = QUIET.copy()
    busy[:: int(3 / MOST)] += 1e-3  # five samples each
    assert spikes(busy, CALM).size == 0


def test_a_residual_without_its_spikes_is_that_of_the_neighbours() -> None:
    line = 3.0 - 2.0 * TIME
    spoilt = np.array([line, -line])
    spoilt[:, [0, *AT]] = 1e9
    rest = bridged(spoilt, np.array([0, *AT]))
    assert rest[0, 1:] == pytest.approx(line[1:])
    assert rest[1, 1:] == pytest.approx(-line[1:])
    assert rest[:, 0] == pytest.approx([line[1], -line[1]]), "the end has one neighbour"
    assert bridged(spoilt, np.zeros(0, dtype=np.intp)) is spoilt


def run_of(commands: np.ndarray, current: np.ndarray) -> RunData:
    measured = {"position_m": QUIET, "current_1_A": current, "voltage_1_V": commands[:, 0]}
    noise = dict.fromkeys(measured, NoiseFloor(1e-6, "stated in [noise]"))
    return RunData("noise", "fit", RATE, commands, measured, noise)


def test_the_corner_behind_a_jump_of_the_command_is_its_own() -> None:
    commands = np.zeros((N, 2))
    commands[4000:, 0] = 1.0
    kept = 1e2 * QUIET
    current = np.where(TIME >= 4.0, 1 - np.exp(-np.maximum(TIME - 4.0, 0.0) / 2e-3), 0.0) + kept
    assert without_spikes(run_of(commands, current)).spikes == {}
    current[AT] += 1.0
    found = without_spikes(run_of(commands, current))
    assert set(AT) <= set(found.spikes["current_1_A"]) <= AROUND
    assert found.first(600).spikes["current_1_A"].max() < 600
    assert [one.text for one in about_spikes([found])] == [
        "current_1_A of noise: 16 samples (0.2 %, the first at 0.498 s) do not count, since they lie at 3 spikes"
    ]
