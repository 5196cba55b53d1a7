"""The dimensioned section: every dimension of the file is named with its length; what is no drawing is refused."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.files.quantity import format_quantity
from msl_fem.report.section_drawing import draw_section, save_drawing

DRAWN = ("fast_tool_servo", "u_core_ui60", "pot_core_holding")


def words_of(figure) -> str:
    return "\n".join(text.get_text() for axes in figure.axes for text in axes.texts)


@pytest.mark.parametrize("name", DRAWN)
def test_every_length_of_the_file_stands_in_the_drawing(name: str, tmp_path: Path) -> None:
    actuator = load_actuator(ROOT / "geometries" / f"{name}.toml")
    magnet = actuator.magnet_kind()
    figure = draw_section(actuator)
    words = words_of(figure)
    stated = magnet.model_dump()
    flat = {key: value for key, value in stated.items() if isinstance(value, float) and value > 0}
    flat |= {f"coil.{key}": stated["coil"][key] for key in ("width", "height")}
    for key, value in flat.items():
        if key not in ("stack_depth", "armature_overhang", "pole_chamfer"):
            assert f"{key.replace('.', ' ').replace('_', ' ')} {format_quantity(value, 'm')}" in words
    assert "turns" in words
    save_drawing(figure, tmp_path / "section.svg")
    assert (tmp_path / "section.svg").read_text().count("<path") > 20


def test_names_that_do_not_fit_into_their_part_stand_below() -> None:
    narrow = draw_section(load_actuator(ROOT / "geometries" / "roters_plunger.toml"), 5e-3)
    assert "roters_1020_half_hard.csv" not in words_of(narrow)
    below = [text.get_text() for text in narrow.texts]
    assert below[0].startswith("core: roters_1020_half_hard.csv; armature: roters_1020_half_hard.csv\n2550 turns")
    wide = words_of(draw_section(load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")))
    assert "core: m19" in wide
    assert "armature: m19" in wide


@pytest.mark.parametrize("name", DRAWN)
def test_measures_are_of_the_section(name: str) -> None:
    """Every dimension's ends lie on outlines of the section, and its length is the file's."""
    magnet = load_actuator(ROOT / "geometries" / f"{name}.toml").magnet_kind()
    section = magnet.section(1e-3)
    places = np.array([np.abs(v) for region in section.regions for v in region.vertices])
    for measure in magnet.measures(1e-3):
        for point in (measure.start, measure.end):
            for axis in (0, 1):
                assert np.abs(places[:, axis] - abs(point[axis])).min() < 1e-12, measure.name
        owner, _, key = measure.name.rpartition(".")
        value = getattr(getattr(magnet, owner) if owner else magnet, key)
        assert measure.length == pytest.approx(value, rel=1e-12)


def test_a_small_gap_is_drawn_larger_and_says_so() -> None:
    servo = load_actuator(ROOT / "geometries/fast_tool_servo.toml")
    assert "gap 50 µm (drawn larger)" in words_of(draw_section(servo, 5e-5))
    assert "drawn larger" not in words_of(draw_section(servo, 1e-3))


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    servo, target = str(ROOT / "geometries/fast_tool_servo.toml"), tmp_path / "s.png"
    assert run_guarded(lambda: app(["draw", servo, "-o", str(target), "--json"])) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["dimensions"]["window_height_m"] == 0.02
    assert target.read_bytes().startswith(b"\x89PNG")
    for bad, said in (
        ([servo, "-o", str(tmp_path / "s.gif")], "svg, png, pdf"),
        ([str(ROOT / "geometries/u_core.toml"), "-o", str(target)], "kind with dimensions"),
        ([str(ROOT / "geometries/e1.toml"), "-o", str(target)], "nominal_gap"),
    ):
        assert run_guarded(lambda bad=bad: app(["draw", *bad])) == 2
        error = capsys.readouterr().err.strip()
        assert re.search(said, error)
        assert "\n" not in error
    assert sorted(path.name for path in tmp_path.iterdir()) == ["s.png"]
