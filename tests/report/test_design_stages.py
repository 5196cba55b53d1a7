"""The design in the report: the numbers of the file and those that follow from it, by hand."""

import re

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.materials.constants import MU_0
from msl_fem.report.design_stages import heat_stage, iron_stage, magnet_stage, magnet_stages
from msl_fem.report.page_words import round_values

SERVO = ROOT / "geometries" / "fast_tool_servo.toml"


def test_the_design_can_be_made_again_from_the_page(tmp_path) -> None:
    actuator = load_actuator(SERVO)
    stage = magnet_stage(actuator)
    numbers = dict(stage.numbers)
    assert numbers["turns"] == "200"
    assert numbers["natural frequency, no current"] == f"{np.sqrt(1.4e5 / 0.9) / (2 * np.pi):.4g} Hz"
    # armature 40 mm x 6 mm x 20 mm, 96 % of it M-19 of 7650 kg/m3
    assert numbers["mass of the armature"] == f"{40e-3 * 6e-3 * 20e-3 * 0.96 * 7650e3:.3g} g"
    assert stage.listing
    again = tmp_path / "again.toml"
    again.write_text(stage.listing[1], encoding="utf-8")
    assert load_actuator(again).digest == actuator.digest


def test_the_drawing_takes_the_pages_colours_and_holds_no_text_of_the_file() -> None:
    actuator = load_actuator(SERVO)
    crafted = actuator.magnet.iron.model_copy(update={"core": "--><script>window.ran=1</script>.csv"})
    magnet = actuator.magnet.model_copy(update={"iron": crafted})
    drawing = magnet_stage(actuator.model_copy(update={"magnet": magnet})).drawing
    assert "script" not in drawing
    assert "var(--ink)" in drawing
    assert not re.search(r"#1f2937|#334155", drawing)


def test_the_irons_curve_passes_its_points() -> None:
    curve, points = iron_stage(load_actuator(SERVO)).plot.data
    there = np.interp(np.log(points.x[2:-1]), np.log(curve.x), curve.y)
    np.testing.assert_allclose(there, points.y[2:-1], rtol=0.01)
    slope = np.diff(curve.y) / np.diff(curve.x) / MU_0
    assert slope.max() == pytest.approx(12740, rel=0.05), "the largest differential permeability that the page states"


def test_the_heat_curve_meets_the_limit_at_the_continuous_current() -> None:
    stage = heat_stage(load_actuator(SERVO))
    curve = stage.plot.data[0]
    stated = float(dict(stage.numbers)["continuous current of a coil"].split()[0])
    assert np.interp(stated, curve.x, curve.y) == pytest.approx(80.0, rel=0.01)


def test_a_magnet_without_dimensions_has_no_drawing() -> None:
    assert magnet_stages(load_actuator(ROOT / "geometries" / "u_core.toml")) == []


def test_gaps_of_a_legend_are_round() -> None:
    assert round_values(5e-5, 1.2e-3) == [5e-5, 8e-5, 2e-4, 5e-4, 1e-3, 1.2e-3]
