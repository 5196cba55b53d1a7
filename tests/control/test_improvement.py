"""What a diagnosis is worth to a loop: foretold on the same plants, and seen on one that nobody knew."""

import numpy as np
import pytest
from servo_controllers import TABLE, servo, servo_design, servo_map, sine

from msl_fem.control import PlantUnderTest, design_model_with_effects, lqr_design, run_closed_loop
from msl_fem.control.improvement import Improvement
from msl_fem.control.posterior_plants import Posterior
from msl_fem.control.unseen_plants import UnseenPlants, on_unseen_plants
from msl_fem.plant.effects import EffectValues
from msl_fem.report.unseen_stage import improvement_stage


def plants(*error: float) -> UnseenPlants:
    n = len(error)
    return UnseenPlants((), np.array(error), np.zeros(n), np.zeros(n))


def test_what_one_loop_alone_holds_counts_for_it() -> None:
    over = Improvement(plants(0.01, 0.01, np.nan, 0.02, 0.2), plants(0.03, np.nan, 0.02, 0.02, np.nan))
    assert over.factors == pytest.approx([3.0, np.inf, 0.0, 1.0, np.nan], nan_ok=True)
    assert over.quantiles == (0.0, 3.0, np.inf)
    told = over.to_json()
    assert told["factor_interval"] == [0.0, None]
    assert told["belief_held_share"] == 3 / 5
    none = Improvement(plants(np.nan), plants(np.nan)).to_json()
    assert none["factor"] is None


def test_the_page_says_the_factor_and_what_cannot_be_said() -> None:
    stage = improvement_stage(Improvement(plants(0.01, 0.01, 0.02), plants(0.05, 0.05, np.nan)))
    assert "to track 5 times better" in stage.sentence
    assert dict(stage.numbers)["95 % of the plants"] == "5 times ... infinitely (the other is not held)"
    assert "not to be said" in improvement_stage(Improvement(plants(np.nan), plants(np.nan))).sentence


def test_the_foretold_factor_is_seen_on_a_plant_within_the_posterior() -> None:
    """A gap that is 20 um wider than believed, told within 1 um: the loop that knows it is better as foretold."""
    told = EffectValues({"gap_offset": {"offset": 20e-6}})
    loop = lqr_design(design_model_with_effects(servo(), TABLE, servo_map(), told))
    posterior, fitted = Posterior({}, {"gap_offset": {"offset": 0.5e-6}}), PlantUnderTest(servo(), TABLE, told)
    track = sine(0.3e-3, 2.0, 0.5)
    both = [
        on_unseen_plants(one, track, lambda g: posterior.draw(fitted, g), n=6, suspects=())
        for one in (loop, servo_design())
    ]
    over = Improvement(*both)
    low, foretold, high = over.quantiles
    assert foretold > 3
    true = PlantUnderTest(servo(), TABLE, EffectValues({"gap_offset": {"offset": 20.4e-6}}))
    errors = []
    for one in (servo_design(), loop):
        run = run_closed_loop(one, track, plant=true, generator=np.random.default_rng(99))
        errors.append(float(np.std((run.measured - run.reference)[run.time.size // 2 :])))
    assert errors[0] / errors[1] == pytest.approx(foretold, rel=0.3)
    assert 0.9 * low < errors[0] / errors[1] < 1.1 * high
