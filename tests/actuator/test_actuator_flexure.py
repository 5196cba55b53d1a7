"""[motion.flexure] and [tolerances] of actuator files: what they imply, what is refused, and what stays as it was."""

import copy
import tomllib
from pathlib import Path
from typing import Any

import pytest

from msl_fem.actuator import Actuator, load_actuator, parse_actuator
from msl_fem.errors import ActuatorError
from msl_fem.files.schema import document
from msl_fem.files.toml_text import toml_text

GEOMETRIES = Path(__file__).parents[2] / "geometries"


@pytest.fixture
def content() -> dict[str, Any]:
    return tomllib.loads((GEOMETRIES / "fast_tool_servo_flexure.toml").read_text(encoding="utf-8"))


def test_the_stiffness_follows_from_the_leaves(content: dict[str, Any]) -> None:
    motion = parse_actuator(content).motion
    assert motion is not None
    assert motion.flexure is not None
    leaf = motion.flexure.leaf
    own = leaf.plate_factor * 206e9 * 25e-3 * 1e-9 / 54e-3**3  # 12 E I/L^3
    assert motion.stiffness == pytest.approx(4 * own, rel=1e-12)
    assert motion.notes == ()


def test_a_stated_stiffness_wins_and_the_difference_is_told(content: dict[str, Any]) -> None:
    content["motion"]["stiffness"] = "1.5e5 N/m"
    motion = parse_actuator(content).motion
    assert motion is not None
    assert motion.stiffness == 1.5e5
    assert motion.notes == ("motion.stiffness 150 kN/m counts; the flexure's closed form gives 139.1 kN/m, -7.2 %",)


def test_the_file_reads_back_without_the_implied_stiffness(content: dict[str, Any]) -> None:
    actuator = parse_actuator(content)
    written = toml_text(document(actuator))
    assert "stiffness" not in tomllib.loads(written)["motion"]
    again = parse_actuator(tomllib.loads(written))
    assert again == actuator
    assert again.digest == actuator.digest
    dumped = actuator.model_dump(by_alias=True, exclude_none=True)
    dumped["motion"]["flexure"]["thickness"] = 2e-3  # as rig.toml may state it anew
    other = Actuator.model_validate(dumped)
    assert actuator.motion is not None
    assert other.motion is not None
    assert other.motion.stiffness == pytest.approx(8 * actuator.motion.stiffness, rel=1e-12)


def test_actuators_without_the_new_sections_keep_their_digest() -> None:
    """The stored table's provenance names it."""
    digest = load_actuator(GEOMETRIES / "fast_tool_servo.toml").digest
    assert digest.startswith("200d200b9607de6e")


def test_tolerances_do_not_change_the_drawn_actuator(content: dict[str, Any]) -> None:
    plain = parse_actuator(content)
    made = parse_actuator(content | {"tolerances": {"gap": "10 um", "bh_polarisation": "3 %", "stacking_factor": 0.02}})
    assert made.digest == plain.digest
    assert made.tolerances is not None
    assert made.tolerances.gap == pytest.approx(10e-6)
    assert made.tolerances.bh_polarisation == pytest.approx(0.03)
    assert made.tolerances.stack_depth is None


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("material", "wood", r"motion\.flexure\.material: unknown flexure material 'wood'; choose one of spring_steel"),
        ("thickness", "20 mm", r"thickness 20 mm is above 10\.8 mm"),
        ("count", 3, "count 3 is odd, but opposed leaves come in pairs"),
        ("count", 0, "greater than 0"),
        ("sets", 3, "1 or 2"),
        ("length", "5 kg", r"motion\.flexure\.length: unit 'kg' has the wrong dimension"),
        ("lenght", "5 mm", "unknown key"),
        ("roll_inertia", "1 kg", "wrong dimension"),
        ("pitch_inertia", 6e-4, "no unit"),
        ("width", None, r"motion\.flexure\.width: is missing"),
    ],
)
def test_a_faulty_flexure_is_one_line(content: dict[str, Any], key: str, value: Any, said: str) -> None:
    faulty = copy.deepcopy(content)
    if value is None:
        del faulty["motion"]["flexure"][key]
    else:
        faulty["motion"]["flexure"][key] = value
    with pytest.raises(ActuatorError, match=said) as caught:
        parse_actuator(faulty)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("gap", "-1 um", "greater than or equal to 0"),
        ("bh_polarisation", "80 %", "less than or equal to 0.5"),
        ("legs", "1 mm", "unknown key"),
    ],
)
def test_faulty_tolerances_are_one_line(content: dict[str, Any], key: str, value: str, said: str) -> None:
    with pytest.raises(ActuatorError, match=said):
        parse_actuator(content | {"tolerances": {key: value}})


def test_the_same_leaves_in_another_number_of_sets(content: dict[str, Any]) -> None:
    motion = parse_actuator(content).motion
    assert motion is not None
    flexure = motion.flexure
    assert flexure is not None
    two, one = flexure.placements(), flexure.placements(1)
    assert sorted({p.along for p in two}) == [-0.035, 0.035]
    assert {p.along for p in one} == {0.0}
    assert len(one) == len(two) == 4
    assert sorted({p.sideways for p in one}) == [-0.0125, 0.0125]
    with pytest.raises(ActuatorError, match="cannot be parted into 2 sets"):
        flexure.model_copy(update={"count": 2, "sets": 1}).placements(2)
