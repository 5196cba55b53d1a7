"""Plants that a controller has not seen: what is drawn, what is counted, and what a number of them tells."""

import numpy as np
import pytest
from servo_controllers import believed, rival, servo_design, sine

from msl_fem.control import PlantUnderTest
from msl_fem.control.unseen_plants import (
    UnseenPlants,
    least_share,
    on_unseen_plants,
    random_plant,
    suspected_plant,
    with_more,
)
from msl_fem.plant.effects import EffectValues

TRACK = sine(0.3e-3, 2.0, 0.5)


def test_plants_are_drawn_within_the_tolerances() -> None:
    generator = np.random.default_rng(1)
    drawn = [random_plant(believed(), generator) for _ in range(300)]
    mass = np.array([p.actuator.motion.moving_mass for p in drawn]) / 0.9 - 1
    gap = np.array([p.actuator.motion.nominal_gap for p in drawn]) / 0.6e-3 - 1
    assert mass.std() == pytest.approx(0.005, rel=0.15)
    assert gap.std() == pytest.approx(0.005, rel=0.15)
    assert np.abs(mass).max() <= 0.015
    assert abs(np.corrcoef(mass, gap)[0, 1]) < 0.2
    at_nominal_gap = [
        p.effects.get("fringing", "depth_error") + p.effects.get("fringing", "growth") * 0.6e-3 for p in drawn
    ]
    assert np.std(at_nominal_gap) == pytest.approx(0.002, rel=0.15)


def test_every_suspected_plant_has_the_three_at_their_sizes() -> None:
    generator = np.random.default_rng(2)
    drawn = [suspected_plant(believed(), generator).effects for _ in range(40)]
    offset = np.array([e.get("gap_offset", "offset") for e in drawn])
    assert np.abs(offset) == pytest.approx(18e-6)
    assert 5 < np.count_nonzero(offset > 0) < 35
    cubic = np.array([e.get("stiffness_nonlinearity", "cubic") for e in drawn])
    assert np.abs(cubic) == pytest.approx(8.8e10, rel=0.01)
    modes = [e.get("structural_mode", "frequency") for e in drawn]
    assert 300 <= min(modes) < 350 < 550 < max(modes) <= 600


def test_amounts_add_up_with_what_the_plant_has() -> None:
    own = EffectValues({"gap_offset": {"offset": 5e-6}, "structural_mode": {"mass_share": 0.02, "frequency": 400.0}})
    both = with_more(
        own, {"gap_offset": {"offset": 18e-6}, "structural_mode": {"mass_share": 0.03, "frequency": 350.0}}
    )
    assert both.get("gap_offset", "offset") == pytest.approx(23e-6)
    assert both.get("structural_mode", "mass_share") == pytest.approx(0.05)
    assert both.get("structural_mode", "frequency") == 350.0


def test_the_robust_loop_holds_what_the_lqr_loses() -> None:
    robust = on_unseen_plants(rival("robust"), TRACK, lambda g: suspected_plant(believed(), g), n=6)
    usual = on_unseen_plants(servo_design(), TRACK, lambda g: suspected_plant(believed(), g), n=6)
    assert robust.held == 6
    assert usual.held < 6
    figures = usual.to_json()
    assert figures["held_share"] == usual.held / 6
    assert 0 < robust.to_json()["error_95"] < 0.1


def test_plants_are_drawn_each_by_its_own_seed() -> None:
    """The same plants for every design, and one more plant does not change those before."""
    asked: list[list[float]] = [[], []]
    for n, kept in zip((2, 3), asked, strict=True):

        def draw(generator: np.random.Generator, kept: list[float] = kept) -> PlantUnderTest:
            plant = random_plant(believed(), generator)
            kept.append(plant.actuator.motion.moving_mass)
            return plant

        on_unseen_plants(servo_design(), TRACK, draw, n=n)
    assert asked[1][:2] == asked[0]
    assert len(set(asked[1])) == 3


def test_lost_runs_and_large_errors_are_not_held() -> None:
    found = UnseenPlants((), np.array([0.01, 0.2, np.nan, 0.02]), np.array([0, 3, 0, 1]), np.zeros(4))
    figures = found.to_json()
    assert (figures["held"], figures["held_share"]) == (2, 0.5)
    assert (figures["guard_violations"], figures["plants_with_guard_violations"]) == (4, 2)
    assert figures["error_largest"] == 0.02
    nothing = UnseenPlants((), np.full(3, np.nan), np.zeros(3), np.zeros(3)).to_json()
    assert (nothing["held_share"], nothing["held_share_at_least"], nothing["error_95"]) == (0.0, 0.0, None)


def test_what_a_number_of_plants_tells_of_all() -> None:
    """None lost of n: 0.05^(1/n). Else the bound is the share at which so many successes have 5 % chance."""
    assert least_share(20, 20) == pytest.approx(0.05 ** (1 / 20))
    share = least_share(17, 20)
    rng = np.random.default_rng(1)
    assert np.mean(rng.binomial(20, share, 200_000) >= 17) == pytest.approx(0.05, abs=0.002)
    assert least_share(0, 20) == 0.0
