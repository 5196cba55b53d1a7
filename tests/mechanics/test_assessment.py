"""What a flexure's report says of the example, and when it says no."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

from msl_fem.actuator import Actuator, load_actuator, parse_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.mechanics import assess_flexure

FILE = Path(__file__).parent.parent.parent / "geometries" / "fast_tool_servo_flexure.toml"


@pytest.fixture
def content() -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def changed(content: dict[str, Any], **flexure: Any) -> Actuator:
    other = copy.deepcopy(content)
    other["motion"]["flexure"] |= flexure
    return parse_actuator({**other, "motion": {k: v for k, v in other["motion"].items() if v is not None}})


def test_the_example_does_what_the_paper_asks() -> None:
    report = assess_flexure(load_actuator(FILE), bandwidth=50.0)
    assert report.stiffness == pytest.approx(1.4e5, rel=0.01)
    assert report.stiffness_beam == pytest.approx(report.stiffness, rel=1e-9)
    assert report.stiffness_used == report.stiffness
    assert report.first_mode == pytest.approx(62.0, abs=0.1)
    assert report.first_mode_ok
    assert report.stress_ok
    assert report.notes == ()
    full = report.full_range
    assert full is not None
    assert full.force_beam == pytest.approx(full.force_exact, rel=1e-6)
    assert full.force_linear < full.force_exact < full.force_cubic
    one, two = report.modes
    assert (one.sets, two.sets) == (1, 2)
    assert min(two.above_first) > 1000 > max(one.above_first)


def test_thick_leaves_break_and_a_wide_band_is_not_met(content: dict[str, Any]) -> None:
    """The same stiffness from shorter, thinner leaves: more stress at the same range."""
    report = assess_flexure(changed(content, length="20 mm", thickness="0.6 mm"), bandwidth=5000.0)
    assert report.stress_ok is False
    assert report.first_mode_ok is False


def test_one_sided_leaves_have_no_cubic_term(content: dict[str, Any]) -> None:
    report = assess_flexure(changed(content, arrangement="one-sided"))
    assert report.cubic_stiffness == 0
    assert report.full_range is not None
    assert report.full_range.force_exact == report.full_range.force_linear
    assert report.full_range.force_beam == pytest.approx(report.full_range.force_linear, rel=1e-9)
    assert report.first_mode_ok is None


def test_what_is_not_stated_is_told(content: dict[str, Any]) -> None:
    bare = copy.deepcopy(content)
    for key in ("pitch_inertia", "set_spacing"):
        del bare["motion"]["flexure"][key]
    bare["motion"]["flexure"]["sets"] = 1
    bare["motion"]["stiffness"] = "1.4e5 N/m"
    report = assess_flexure(parse_actuator(bare))
    assert report.stiffness_used == 1.4e5
    assert report.stiffness == pytest.approx(0.7e5, rel=0.01)
    said = " ".join(report.notes)
    assert "motion.stiffness 140 kN/m counts; the flexure's closed form gives 69.57 kN/m, -50 %" in said
    assert "pitch_inertia is not stated" in said
    assert "set_spacing is missing" in said
    assert [modes.sets for modes in report.modes] == [1]


def test_refusals(content: dict[str, Any], servo: Actuator) -> None:
    with pytest.raises(ActuatorError, match=r"fast_tool_servo has no \[motion.flexure\]"):
        assess_flexure(servo)
    far = copy.deepcopy(content)
    far["motion"]["flexure"] |= {"length": "5 mm", "thickness": "0.1 mm"}
    far["motion"] |= {"nominal_gap": "2 mm", "range": "1 mm"}
    with pytest.raises(InputError, match="a tenth of the leaf's length"):
        assess_flexure(parse_actuator(far))
