"""A reference that repeats is learned: where the condition says so it converges, and where it does not it diverges."""

import numpy as np
import pytest
from servo_controllers import TABLE, believed, rest, servo, servo_design, sine

from msl_fem.control import PlantUnderTest, closed_loop_response
from msl_fem.control.learning import (
    CONTRACTION,
    GAIN,
    derivatives,
    learn,
    learned_on_unseen_plants,
    learning_law,
    repeating,
    robustness_filter,
)
from msl_fem.control.scenario_response import response_over_belief, scenarios_of
from msl_fem.control.unseen_plants import random_plant
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues

AMPLITUDE = 1e-4
TRACK = sine(AMPLITUDE, 50.0, 0.4)
MOTION = servo().motion
OTHER = servo(motion={"moving_mass": 1.03 * MOTION.moving_mass, "stiffness": 0.96 * MOTION.stiffness})
LATE = PlantUnderTest(servo(), TABLE, EffectValues({"time_delay": {"position": 2.5e-4}}))
PLANTS = {
    "mass, stiffness": PlantUnderTest(OTHER, TABLE),
    "second mass": PlantUnderTest(
        servo(), TABLE, EffectValues({"structural_mode": {"mass_share": 0.03, "frequency": 400.0}})
    ),
    "force": PlantUnderTest(servo(), TABLE, EffectValues({"fringing": {"depth_error": 0.06}})),
    "gap": PlantUnderTest(servo(), TABLE, EffectValues({"gap_offset": {"offset": 1e-5}})),
    "late command": PlantUnderTest(servo(), TABLE, EffectValues({"time_delay": {"command": 1e-4}})),
}


def scenario(plant: PlantUnderTest):
    return scenarios_of(servo_design(), [plant], amplitude=AMPLITUDE)[0]


def both_ways(plant: PlantUnderTest, amplitude: float, frequencies: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """T'/T by sines through the simulated loop, of a plant over the belief, and by the loop gain, mean of sides."""
    found, own = (
        closed_loop_response(servo_design(), plant=one, frequencies=frequencies, amplitude=amplitude)
        for one in (plant, believed())
    )
    sides = scenarios_of(servo_design(), [plant], amplitude=amplitude)
    foretold = [response_over_belief(servo_design(), side, found.frequency) for side in sides]
    return found.response / own.response, np.mean(foretold, axis=0)


@pytest.mark.parametrize("name", PLANTS)
def test_the_linear_response_on_another_plant_is_that_of_the_whole_loop(name: str) -> None:
    """At an amplitude at which no voltage limit acts."""
    simulated, foretold = both_ways(PLANTS[name], 1e-6, [50.0, 120.0, 220.0])
    deviation = np.abs(foretold - 1).max()
    assert simulated == pytest.approx(foretold, abs=0.002 + 0.05 * deviation)
    assert deviation > 0.012


def test_a_cubic_spring_counts_by_its_describing_function() -> None:
    hard = PlantUnderTest(servo(), TABLE, EffectValues({"stiffness_nonlinearity": {"cubic": 6e11}}))
    simulated, foretold = both_ways(hard, AMPLITUDE, [40.0])
    assert simulated == pytest.approx(foretold, abs=0.004)
    assert abs(foretold[0] - 1) > 0.015


def test_a_trial_takes_off_the_error_what_the_condition_says() -> None:
    """Without noise the fundamental of the error falls by 1 - gain T'/T, a complex number."""
    plant = PLANTS["mass, stiffness"]
    law = learning_law(servo_design(), repeating(TRACK), [scenario(plant)])
    factor = 1 - GAIN * response_over_belief(servo_design(), scenario(plant), np.array([50.0]))[0]
    left = []
    for trials in (0, 1, 2):
        found = learn(servo_design(), TRACK, law, plant=plant, trials=trials)
        whole = (np.asarray(TRACK.position) - found.run.measured)[-law.samples :]
        left.append(np.fft.rfft(whole)[1])
    assert left[1] / left[0] == pytest.approx(factor, abs=0.03)
    assert left[2] / left[1] == pytest.approx(factor, abs=0.06)


def test_what_a_filter_lets_through_diverges_where_the_condition_says_so() -> None:
    """A position that comes a quarter of a millisecond late turns high frequencies by more than a right angle."""
    generator = np.random.default_rng(3)
    everything = learning_law(servo_design(), repeating(TRACK), [scenario(LATE)], band=np.inf)
    assert everything.contraction > 1.2
    assert not everything.converges
    found = learn(servo_design(), TRACK, everything, plant=LATE, trials=16, generator=generator)
    assert not found.errors[-1] < 3 * found.errors[1]
    filtered = learning_law(servo_design(), repeating(TRACK), [scenario(LATE)])
    assert filtered.converges
    assert filtered.contraction <= CONTRACTION
    found = learn(servo_design(), TRACK, filtered, plant=LATE, trials=6, generator=generator)
    assert found.errors[-1] < 0.7 * found.errors[0]
    spectrum = np.abs(np.fft.rfft(found.correction[:, 0]))
    assert spectrum[filtered.frequency > 1.5 * filtered.band].max() < 1e-6 * spectrum.max()


def test_plants_that_were_not_seen_are_tracked_better_after_it() -> None:
    n = 3
    law = learning_law(servo_design(), repeating(TRACK), [scenario(PLANTS["mass, stiffness"])])
    before, after = learned_on_unseen_plants(
        servo_design(), TRACK, law, lambda g: random_plant(believed(), g), trials=3, n=n, suspects=()
    )
    assert before.held == after.held == n
    assert after.error.max() < 0.7 * before.error.max()


def test_a_plant_with_which_the_loop_is_unstable_is_told() -> None:
    lost = PlantUnderTest(servo(), TABLE, EffectValues({"structural_mode": {"mass_share": 0.2, "frequency": 400.0}}))
    law = learning_law(servo_design(), repeating(TRACK), [scenario(lost), scenario(believed())])
    assert law.to_json()["scenario_plants_unstable"] == 1
    assert not law.converges


def test_the_filter_is_flat_then_falls_and_the_correction_has_its_derivatives() -> None:
    assert robustness_filter(np.array([0.0, 100.0, 125.0, 150.0, 400.0]), 100.0) == pytest.approx([1, 1, 0.5, 0, 0])
    t = np.arange(50) / 2500.0
    w = 2 * np.pi * 100.0
    found = derivatives(np.sin(w * t), 1 / 2500.0)
    assert found == pytest.approx(
        np.stack([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)], axis=1), abs=1e-6
    )


def test_what_cannot_be_learned_is_refused() -> None:
    with pytest.raises(InputError, match="does not repeat"):
        repeating(sine(AMPLITUDE, 50.3, 0.4))
    with pytest.raises(InputError, match="does not repeat"):
        repeating(rest(0.4, 1e-4))
    with pytest.raises(InputError, match="between 0 and 2"):
        learning_law(servo_design(), 50, gain=2.0)
    stronger = PlantUnderTest(servo(), TABLE, EffectValues({"fringing": {"depth_error": 0.2}}))
    with pytest.raises(InputError, match="nothing of a reference of 50 Hz can be learned"):
        learning_law(servo_design(), 50, [scenario(stronger)], gain=1.98)
