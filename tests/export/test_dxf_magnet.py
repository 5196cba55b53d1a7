"""A section that left as DXF comes back as a mesh whose magnet has the same force; what is no section is refused."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
from conftest import ROOT

import msl_fem
from msl_fem.actuator import load_actuator
from msl_fem.errors import InputError
from msl_fem.export.dxf_magnet import DrawnMagnet, _outlines, magnet_from_dxf


@pytest.fixture(scope="module")
def drawing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("dxf") / "section.dxf"
    msl_fem.export_as(load_actuator(ROOT / "geometries" / "fast_tool_servo.toml"), target, to="dxf")
    return target


def drawn(**changes: object) -> DrawnMagnet:
    magnet = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml").magnet
    iron = magnet.iron
    stated = {
        "turns": magnet.turns, "stack_depth": magnet.stack_depth, "core": iron.core, "armature": iron.armature,
        "stacking_factor": iron.stacking_factor,
    }  # fmt: skip
    return DrawnMagnet(**(stated | changes))


def test_the_magnet_of_a_drawing_has_the_drawn_magnets_force(drawing: Path, tmp_path: Path) -> None:
    """Two meshes, two symmetries, one magnet: linear and saturated, at the drawn gap and at another."""
    original = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    imported = load_actuator(magnet_from_dxf(drawing, tmp_path / "drawn.toml", drawn()))
    assert imported.magnet.gap == pytest.approx(0.6e-3, rel=1e-9)
    for current, gap in ((9.0, 0.6e-3), (2.0, 0.4e-3)):
        theirs = msl_fem.solve(original, current, gap, accuracy="fast", end_effects=False).quantities
        ours = msl_fem.solve(imported, current, gap, accuracy="fast").quantities
        assert ours.force == pytest.approx(theirs.force, rel=1e-2), (current, gap)
        assert ours.flux_linkage == pytest.approx(theirs.flux_linkage, rel=1e-2)


def changed(drawing: Path, target: Path, edit) -> Path:
    document = ezdxf.readfile(drawing)
    edit(document.modelspace())
    document.saveas(target)
    return target


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda space: [space.delete_entity(e) for e in space.query('*[layer=="armature"]')], "no layer begins with"),
        (lambda space: space.add_line((0, 0), (1, 1), {"layer": "core"}), "layer core holds a LINE"),
        (lambda space: space.add_polyline2d([(0, 0), (1, 1), (2, 0)], dxfattribs={"layer": "core"}), "is open"),
    ],
)  # fmt: skip
def test_what_is_no_section_is_refused(drawing: Path, tmp_path: Path, edit, told: str) -> None:
    with pytest.raises(InputError, match=told):
        magnet_from_dxf(changed(drawing, tmp_path / "bad.dxf", edit), tmp_path / "out.toml", drawn())
    assert not list(tmp_path.glob("out*")), "nothing is half-written"


def test_a_wrong_pull_and_a_file_that_is_none_are_told(drawing: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="towards -y the core begins"):
        magnet_from_dxf(drawing, tmp_path / "out.toml", drawn(pull="-y"))
    (tmp_path / "no.dxf").write_text("nothing")
    with pytest.raises(InputError, match="cannot be read as DXF"):
        magnet_from_dxf(tmp_path / "no.dxf", tmp_path / "out.toml", drawn())


def test_a_newer_file_in_its_own_units_holds_the_same_outlines(drawing: Path, tmp_path: Path) -> None:
    newer = ezdxf.new("R2010", units=ezdxf.units.CM)
    for line in ezdxf.readfile(drawing).modelspace():
        points = [(v.dxf.location.x / 10, v.dxf.location.y / 10) for v in line.vertices]
        newer.modelspace().add_lwpolyline(points, close=True, dxfattribs={"layer": line.dxf.layer})
    newer.saveas(tmp_path / "newer.dxf")
    for old, new in zip(_outlines(drawing, None), _outlines(tmp_path / "newer.dxf", None), strict=True):
        assert new.name == old.name
        np.testing.assert_allclose(new.vertices, old.vertices, atol=1e-12)
