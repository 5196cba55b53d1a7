"""Stretches of a model with a second mass, each of which follows from what those before have done to it."""

from dataclasses import replace

import levitator
import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis.problem import FitProblem
from msl_fem.diagnosis.shooting import LONG, ModelSpread, Shooting, guessed
from msl_fem.diagnosis.start_refinement import StartRefinement
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.plant.effects import EffectValues
from msl_fem.prediction import ModelHypothesis, kernel_plant, run_data

GAIN = {"position_sensor_nonlinearity": {"gain_error": 0.01}}
ASIDE = np.array([0.0, 0.0, 5e-4, 0.02])  # A, A, m, m/s


def mode(frequency: float) -> dict[str, dict[str, float]]:
    values = {"mass_share": 0.45, "frequency": frequency, "damping_ratio": 0.01, "load_reading": 0.2}
    return {"structural_mode": values}


def shooting(hidden: dict[str, dict[str, float]], length: int = 192) -> Shooting:
    """Half a second of a levitated ball, its measured readings replaced by what the model simulates over stretches,
    with noise."""
    base = load_actuator(ROOT / "measurements" / "levitation_rig" / "actuator.toml")
    record = levitator.record(base, levitator.Truth(), seconds=0.5)
    data = run_data(record, record.runs[0])
    belief = replace(ModelHypothesis(record.actuator, levitator.table()), effects=EffectValues(hidden))
    plant = kernel_plant(belief, rate=data.rate)
    spread = ModelSpread(Unknowns((), 0, ()), np.zeros(0), np.zeros((0, 0)))
    shot = Shooting(FitProblem(plant, (data,), (), (), None), 0, spread, substeps=plant.substeps)
    left, chance = shot.missed(stretches(shot, length)), np.random.default_rng(3)
    noise = {name: data.noise[name].sigma * chance.standard_normal(left[name].size) for name in left}
    measured = {name: data.measured[name] - left[name] + noise[name] for name in left}
    made = replace(data, measured={**data.measured, **measured})
    return Shooting(replace(shot.problem, runs=(made,)), 0, spread, substeps=plant.substeps)


def stretches(shot: Shooting, length: int = 192, by: np.ndarray | float = 0.0) -> Stretches:
    """Of so many samples, with starts as they are read, moved by something."""
    found = guessed(shot.plant, shot.data, np.arange(0, len(shot.data.commands), length), shot.sigmas.size)
    return replace(found, starts=found.starts + by)


def over_noise(shot: Shooting, left: dict[str, np.ndarray]) -> float:
    """RMS of what is left, of the position."""
    return float(np.sqrt(np.mean((left["position_m"] / shot.data.noise["position_m"].sigma) ** 2)))


@pytest.fixture(scope="module")
def shot() -> Shooting:
    return shooting(mode(40.0))


def test_only_what_lasts_makes_a_stretch_follow_from_those_before(shot: Shooting) -> None:
    assert shot.follows_from_before
    assert not shooting(GAIN).follows_from_before
    assert not shooting({"position_sensor_lag": {"lag": 1e-3}}).follows_from_before


def test_starts_that_suit_together_are_found(shot: Shooting) -> None:
    """Each better by itself where those before it are others, they may be worse together."""
    aside = stretches(shot, by=ASIDE)
    assert np.isnan(over_noise(shot, shot.missed(aside))), "from there it leaves its table"
    assert over_noise(shot, shot.missed(shot.refined(aside, LONG))) == pytest.approx(1.0, abs=0.05)


def test_what_is_kept_leaves_what_it_is_said_to_leave(shot: Shooting) -> None:
    """After each step, of starts of which some were better and some were not."""
    aside = stretches(shot, by=ASIDE)
    for steps in (1, 2, 3):
        one = shot._refinement(aside)
        shot._refined_together([one], steps)
        left = shot.missed(one.best)
        squares = sum((values / shot.data.noise[name].sigma) ** 2 for name, values in left.items())
        assert float(np.sum(squares)) == pytest.approx(float(np.sum(one.least)), rel=1e-6)


def test_a_model_is_judged_from_starts_found_over_shorter_stretches() -> None:
    """Where those of another model lead nowhere."""
    shot = shooting(mode(20.0), length=128)
    aside = stretches(shot, 128, by=4 * ASIDE)
    assert over_noise(shot, shot.missed(shot.refined(aside, LONG))) > 10.0
    assert over_noise(shot, shot.followed(aside)) == pytest.approx(1.0, abs=0.05)


def test_stretches_of_a_model_whose_sensor_has_a_gain_begin_where_it_reads_them() -> None:
    shot = shooting(GAIN)
    first = shot.data.measured["position_m"] - shot.missed(stretches(shot))["position_m"]
    assert np.allclose(first[::192], stretches(shot).starts[:, 2], atol=1e-9)


@pytest.mark.parametrize(("by_themselves", "kept"), [(False, [1.0, 1.0, 1.0]), (True, [0.0, 1.0, 1.0])])
def test_starts_that_leave_far_less_together_are_kept_as_they_are(by_themselves: bool, kept: list[float]) -> None:
    """Where a stretch follows from those before, without a simulation of the better ones of each."""
    begins, lengths = np.array([0, 20, 50]), [20, 30, 40]
    cut = Stretches(begins, np.zeros((3, 4)), np.zeros((1, 2, 90)))
    one = StartRefinement(cut, np.ones(2), by_themselves=by_themselves)
    one.take(np.repeat([1.0, 9.0, 9.0], lengths)[None], cut.slopes)
    one.cut = replace(cut, starts=np.ones((3, 4)))
    one.take(np.repeat([2.0, 3.0, 4.0], lengths)[None], cut.slopes)
    assert not one.mixed
    assert one.best.starts[:, 2].tolist() == kept


@pytest.mark.parametrize(("outside", "kept"), [(False, 0), (True, 2)])
def test_of_starts_tried_together_those_are_kept_that_leave_least_where_it_counts(outside: bool, kept: int) -> None:
    """Those before, the new ones, or of each the better ones; the first stretch may not count."""
    begins, lengths = np.array([0, 20, 50]), [20, 30, 40]
    cut = Stretches(begins, np.zeros((3, 4)), np.zeros((1, 2, 90)), np.array([outside, False, False]))
    one = StartRefinement(cut, np.ones(2), by_themselves=False)
    one.take(np.repeat([1.0, 3.0, 3.0], lengths)[None], cut.slopes)
    one.cut = replace(cut, starts=np.ones((3, 4)))
    one.take(np.repeat([9.0, 2.0, 4.0], lengths)[None], cut.slopes)
    assert one.mixed
    assert one.best.starts[:, 2].tolist() == [0.0, 1.0, 0.0], "of each the better ones"
    one.mix(np.repeat([8.0, 2.0, 3.0], lengths)[None])
    assert one.best.starts[:, 2].tolist() == ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0])[kept]
