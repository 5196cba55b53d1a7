"""A measured velocity is a reading of its own: it tells the damping, and a wrong gain of it is no cause."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sprung import DAMPING, MASS, SIGMA, STIFFNESS, record
from test_valid_readings import ALL_BUT_DAMPING

from msl_fem.diagnosis import diagnose
from msl_fem.record import Record
from msl_fem.record.plausibility import doubtful_channels
from msl_fem.report.diagnosis_page import write_diagnosis

OWN_FREQUENCY = float(np.sqrt(STIFFNESS / MASS))
NOISE = SIGMA * OWN_FREQUENCY / np.sqrt(3)
"""m/s: at the resonance, where the damping shows, three times what the position tells."""


def with_velocity(whole: Record, *, gain: float = 1.0) -> Record:
    rng = np.random.default_rng(9)
    runs = []
    for run in whole.runs:
        read = gain * run.extra["true_velocity"] + NOISE * rng.standard_normal(run.time.size)
        runs.append(replace(run, columns={**run.columns, "velocity_m_per_s": read}))
    return replace(whole, runs=tuple(runs), noise=whole.noise.model_copy(update={"velocity": NOISE}))


def test_a_velocity_halves_the_interval_of_the_damping(tmp_path: Path) -> None:
    """Position alone tells 1, the velocity at its noise 3: together 4 times as much, half the interval."""
    alone = replace(record(), tolerance=ALL_BUT_DAMPING)
    both = diagnose(with_velocity(alone))
    assert both.verdict == "nothing-found"
    first, second = (found.parameters["damping"] for found in (diagnose(alone), both))
    assert (second.high - second.low) / (first.high - first.low) == pytest.approx(0.5, abs=0.04)
    assert second.low < DAMPING < second.high
    page = write_diagnosis(with_velocity(alone), both, tmp_path, table=None)["report.html"].read_text(encoding="utf-8")
    assert '<td class="short">velocity<' in page
    channels = {entry.nominal.channel for entry in both.accuracy}
    assert channels == {"position_m", "velocity_m_per_s"}


def test_the_gain_of_a_velocity_is_the_instrument_s() -> None:
    """1 % off where 0.5 % are believed: fitted as a gain, and no cause."""
    found = diagnose(with_velocity(record(), gain=1.01))
    assert (found.verdict, found.names) == ("nothing-found", ())
    assert found.parameters["velocity_gain"].value == pytest.approx(1.01, abs=2e-3)


@pytest.mark.parametrize("word", ["forward", "backward", "central"])
def test_a_velocity_made_of_the_positions_is_doubted(word: str) -> None:
    whole = record()
    run = whole.runs[0]
    step = np.diff(run["position_m"]) / run.sampling_period
    made = {"forward": [*step, step[-1]], "backward": [step[0], *step], "central": np.gradient(run["position_m"], 1e-3)}
    false = replace(run, columns={**run.columns, "velocity_m_per_s": made[word]})
    (told,) = (t for t in doubtful_channels(false, whole.actuator, file="a.csv") if "velocity" in t)
    assert f"the {word} difference of position_m in every row" in told
    true = with_velocity(whole).runs[0]
    assert not any("difference" in t for t in doubtful_channels(true, whole.actuator, file="a.csv"))
