"""A scene is made where rendering is possible, and its absence is said where it is not."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.export.vtu import write_vtu
from msl_fem.magnetics.field.magnet_field import field_of
from msl_fem.report import scene
from msl_fem.report.scene import render_scene


@pytest.fixture(scope="module")
def vtu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    field = field_of(load_actuator(ROOT / "geometries" / "e1.toml"), 5e-4, accuracy="fast")
    path = tmp_path_factory.mktemp("scene") / "field.vtu"
    write_vtu(field, field.solve(2.0, 5e-4), path)
    return path


@pytest.mark.skipif(find_spec("pyvista") is None, reason="pyvista (the extra 'scenes') is not installed")
def test_a_picture_or_a_reason(vtu: Path, tmp_path: Path) -> None:
    picture = tmp_path / "scene.png"
    reason = render_scene(vtu, picture, depth=0.02)
    assert picture.read_bytes().startswith(b"\x89PNG") if not reason else not picture.exists()


@pytest.mark.parametrize(
    ("child", "said"),
    [("kill -SEGV $$", "killed by signal 11"), ("echo 'no module' >&2; exit 1", "no module"), ("exit 0", "status 0")],
)
def test_a_child_that_dies_is_said_and_leaves_the_old_picture(
    vtu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str, said: str
) -> None:
    script, picture = tmp_path / "python", tmp_path / "scene.png"
    script.write_text(f"#!/bin/sh\n{child}\n")
    script.chmod(0o755)
    picture.write_bytes(b"old")
    monkeypatch.setattr(scene.sys, "executable", str(script))
    reason = render_scene(vtu, picture, depth=0.02)
    assert reason.startswith("no scene")
    assert said in reason
    assert picture.read_bytes() == b"old"
