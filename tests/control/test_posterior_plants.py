"""Plants that a diagnosis leaves possible: spread, bounds, and files that are no diagnosis."""

import numpy as np
import pytest
from servo_controllers import TABLE, believed, servo

from msl_fem.control import PlantUnderTest
from msl_fem.control.posterior_plants import posterior_of
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues

DIAGNOSIS = {
    "parameters": {
        "moving_mass": {"believed": 0.9, "fitted": 0.91, "ci95": [0.91 - 0.0091 * 1.96, 0.91 + 0.0091 * 1.96]},
        "position_gain": {"believed": 1.0, "fitted": 1.0, "ci95": [0.998, 1.002]},
        "damping": {"believed": 12.0, "fitted": 12.0, "ci95": [None, None]},
        "position_zero": {"believed": 0.0, "fitted": 0.0, "ci95": [-1e-6, 1e-6]},
    },
    "causes": [
        {"effect": "gap_offset", "parameters": {"offset": {"value": 18e-6, "unit": "m", "ci95": [17e-6, 19e-6]}}},
        {"effect": "structural_mode", "parameters": {"mass_share": {"value": 0.01, "unit": "", "ci95": [-0.09, 0.11]}}},
    ],
}
FITTED = PlantUnderTest(
    servo(motion={"moving_mass": 0.91}),
    TABLE,
    EffectValues({"gap_offset": {"offset": 18e-6}, "structural_mode": {"mass_share": 0.01, "frequency": 400.0}}),
)


def test_plants_are_spread_as_the_intervals_say() -> None:
    posterior, generator = posterior_of(DIAGNOSIS), np.random.default_rng(1)
    drawn = [posterior.draw(FITTED, generator) for _ in range(400)]
    mass = np.array([p.actuator.motion.moving_mass for p in drawn])
    assert mass.mean() == pytest.approx(0.91, abs=0.002)
    assert mass.std() == pytest.approx(0.0091, rel=0.1)
    offset = np.array([p.effects.get("gap_offset", "offset") for p in drawn])
    assert np.mean(np.abs(offset - 18e-6) < 1e-6) == pytest.approx(0.95, abs=0.03)
    assert {p.actuator.motion.damping for p in drawn} == {12.0}, "an open interval moves nothing"
    assert {p.effects.get("structural_mode", "frequency") for p in drawn} == {400.0}
    share = np.array([p.effects.get("structural_mode", "mass_share") for p in drawn])
    assert share.min() == 0.0, "no negative mass"
    gain = np.array([p.effects.get("position_sensor_nonlinearity", "gain_error") for p in drawn])
    assert gain.std() == pytest.approx(0.001, rel=0.1)


def test_what_goes_together_is_drawn_together() -> None:
    """A gap whose offset and nominal value the record tells only as a sum: drawn apart the sum would spread 10 um."""
    told = {
        "parameters": {"nominal_gap": {"believed": 6e-4, "fitted": 6e-4, "ci95": [5.86e-4, 6.14e-4]}},
        "causes": [{"effect": "gap_offset", "parameters": {"offset": {"value": 18e-6, "ci95": [4e-6, 32e-6]}}}],
        "correlation": {"names": ["nominal_gap", "gap_offset.offset"], "matrix": [[1.0, -0.995], [-0.995, 1.0]]},
    }
    posterior, generator = posterior_of(told), np.random.default_rng(3)
    drawn = [posterior.draw(FITTED, generator) for _ in range(300)]
    gap = np.array([p.actuator.motion.nominal_gap for p in drawn])
    offset = np.array([p.effects.get("gap_offset", "offset") for p in drawn])
    assert gap.std() == pytest.approx(7.1e-6, rel=0.12)
    assert offset.std() == pytest.approx(7.1e-6, rel=0.12)
    assert (gap + offset).std() == pytest.approx(7.1e-6 * np.sqrt(2 * 0.005), rel=0.15)
    apart = posterior_of({name: entry for name, entry in told.items() if name != "correlation"})
    several = [apart.draw(FITTED, generator) for _ in range(100)]
    sums = [p.actuator.motion.nominal_gap + p.effects.get("gap_offset", "offset") for p in several]
    assert np.std(sums) > 7e-6


def test_a_believed_effect_moves_within_its_interval() -> None:
    told = {
        "parameters": {"gap_offset.offset": {"believed": 18e-6, "fitted": 18e-6, "ci95": [17e-6, 19e-6]}},
        "causes": [],
    }
    posterior, generator = posterior_of(told), np.random.default_rng(3)
    drawn = [posterior.draw(FITTED, generator).effects.get("gap_offset", "offset") for _ in range(200)]
    assert np.std(drawn) == pytest.approx(1e-6 / 1.96, rel=0.15)


def test_nothing_fitted_draws_the_plant_itself() -> None:
    posterior = posterior_of({"parameters": {}, "causes": []})
    drawn = posterior.draw(believed(), np.random.default_rng(1))
    assert drawn.actuator.motion == servo().motion
    assert not drawn.effects.present


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"parameters": [], "causes": []},
        {"parameters": {"mass": 3}, "causes": []},
        {"parameters": {}, "causes": [], "correlation": {"names": ["a"], "matrix": [[1.0, 0.0], [0.0, 1.0]]}},
    ],
)
def test_what_is_no_diagnosis_is_refused(content: dict) -> None:
    with pytest.raises(InputError, match="no diagnosis"):
        posterior_of(content)
