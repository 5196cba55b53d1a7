"""The reference pages and schemas are those of today's records, and say of real files what the readers say."""

import json
import sys
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT
from docs_walk import DOCS

from msl_fem.actuator import parse_actuator
from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.excitation_kinds import KINDS

sys.path.insert(0, str(DOCS))
from make_reference import pages

jsonschema = pytest.importorskip("jsonschema")
ACTUATORS = sorted((ROOT / "geometries").glob("*.toml"))
FILES = [
    *(("actuator", file) for file in ACTUATORS),
    *(("rig", file) for file in sorted((ROOT / "measurements").glob("*/rig.toml"))),
    *(("requirement", file) for file in sorted((ROOT / "requirements").glob("*.toml"))),
]


def validator(name: str) -> jsonschema.Draft202012Validator:
    schema = json.loads((DOCS / "schemas" / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("path", pages())
def test_a_page_is_made_from_the_records_of_today(path: str) -> None:
    """Else: python docs/make_reference.py"""
    assert (DOCS / path).read_text(encoding="utf-8").rstrip() == pages()[path].rstrip()


@pytest.mark.parametrize(("name", "file"), FILES, ids=lambda value: getattr(value, "stem", value))
def test_a_real_file_is_valid(name: str, file: Path) -> None:
    validator(name).validate(tomllib.loads(file.read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("magnet", "centre_leg_width"), 0.01),
        (("magnet", "center_leg_width"), "10 mm"),
        (("motion", "moving_mass"), "heavy"),
        (("drive", "kind"), "steam"),
        (("magnet", "coil", "turns"), -3),
    ],
)
def test_what_the_reader_refuses_the_schema_refuses(place: tuple[str, ...], value: object) -> None:
    content = tomllib.loads((ROOT / "geometries" / "fast_tool_servo.toml").read_text(encoding="utf-8"))
    section = content
    for key in place[:-1]:
        section = section[key]
    section[place[-1]] = value
    with pytest.raises(InputError):
        parse_actuator(content)
    assert not validator("actuator").is_valid(content)


def test_every_excitation_effect_and_section_is_on_its_page() -> None:
    made = pages()
    assert all(f"## `{name}`" in made["reference/excitations.md"] for name in KINDS)
    assert all(f"## `{name}`" in made["reference/effects.md"] for name in CATALOGUE)
    for section in ("[motion.flexure]", "[tolerances]", "`end_stop`", "`constant_force`", "gravity"):
        assert section in made["reference/actuator.md"]


def test_an_unknown_key_is_answered_with_those_there_are() -> None:
    content = tomllib.loads((ROOT / "geometries" / "fast_tool_servo.toml").read_text(encoding="utf-8"))
    content["motion"]["colour"] = "1 mm"
    with pytest.raises(InputError, match=r"motion.colour: unknown key; there are constant_force, damping, end_stop"):
        parse_actuator(content)
    content["magnet"]["colour"] = "1 mm"
    del content["motion"]["colour"]
    with pytest.raises(
        InputError, match=r"magnet.colour: unknown key; there are air, armature_overhang.*stack_depth"
    ) as why:
        parse_actuator(content)
    assert "post_diameter" not in str(why.value), "those of this kind alone"
    content["magnet"]["stack_depht"] = content["magnet"].pop("colour")
    with pytest.raises(InputError, match=r"stack_depht: unknown key; is stack_depth meant\?"):
        parse_actuator(content)
