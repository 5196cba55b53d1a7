"""The gap that a mesh has between its irons, against the one that its actuator file states."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.kinds.mesh_file import read_mesh
from msl_fem.magnetics.kinds.mesh_gap import doubt_about_gap

FILE = ROOT / "geometries" / "u_core.msh"
TURNS = {"+y": np.eye(2), "-y": -np.eye(2), "+x": np.array([[0, 1], [-1, 0]]), "-x": np.array([[0, -1], [1, 0]])}


def doubt(pull: str, gap: float) -> str | None:
    """Of the U-core's mesh, made at 0.5 mm and turned so that its armature is pulled in a direction."""
    mesh = read_mesh(FILE, unit=1e-3, gap=gap)
    return doubt_about_gap(replace(mesh, points=TURNS[pull] @ mesh.points), ("armature",), ("core",), pull)


@pytest.mark.parametrize("name", ["u_core", "bearing_pole_pair"])
def test_the_examples_have_the_gap_that_they_state(name: str) -> None:
    assert load_actuator(ROOT / "geometries" / f"{name}.toml").mesh_magnet().doubts == ()


@pytest.mark.parametrize("pull", TURNS)
def test_another_gap_is_doubted_or_refused(pull: str) -> None:
    """Less than the irons are apart anywhere cannot be; more may be meant, where the gap lies elsewhere."""
    assert doubt(pull, 5e-4) is None
    assert "stated gap, 550 µm; they are 500 µm apart" in str(doubt(pull, 5.5e-4))
    with pytest.raises(InputError, match="500 µm apart at the nearest"):
        doubt(pull, 4.5e-4)


def test_a_working_gap_beside_a_smaller_one_is_none_to_doubt() -> None:
    """The core's inner side raised by 3 mm on one leg: the other leg's gap is the nearest, this one the stated."""
    mesh = read_mesh(FILE, unit=1e-3, gap=3.5e-3)
    x = mesh.points[0]
    core = np.unique(mesh.triangles[:, mesh.elements("core")])
    raised = core[x[core] > x[core].mean()]
    points = mesh.points.copy()
    points[1, raised] += 3e-3
    assert doubt_about_gap(replace(mesh, points=points), ("armature",), ("core",), "+y") is None
    assert doubt_about_gap(replace(mesh, points=points, gap=2e-3), ("armature",), ("core",), "+y") is not None


@pytest.mark.parametrize("unit", ["1 m", "1 um"])
def test_another_unit_of_length_is_refused(tmp_path: Path, unit: str) -> None:
    shutil.copy(FILE, tmp_path)
    file = tmp_path / "u.toml"
    file.write_text(FILE.with_suffix(".toml").read_text().replace('"1 mm" ', f'"{unit}"'))
    with pytest.raises(InputError, match=r"u_core\.msh: gap .* look at length_unit"):
        solve(load_actuator(file), 1.0, 5e-4)


def test_every_command_that_solves_says_the_doubt(tmp_path: Path, msl_fem) -> None:
    shutil.copy(FILE, tmp_path)
    file = tmp_path / "u.toml"
    file.write_text(FILE.with_suffix(".toml").read_text().replace('gap = "0.5 mm"', 'gap = "0.55 mm"'))
    for words in (
        ("solve", str(file), "--current", "1 A", "--accuracy", "fast"),
        ("table", str(file), "--gaps", "0.5, 0.55, 0.6 mm", "--currents", "0, 1, 2 A", "--accuracy", "fast",
         "--workers", "1", "-o", str(tmp_path / "t.nc")),
    ):  # fmt: skip
        assert "note: u_core.msh: no distance between core and armature" in msl_fem(*words).stderr


def test_a_node_number_that_is_none_is_refused_without_a_raw_warning(tmp_path: Path, recwarn) -> None:
    spoilt = FILE.read_text().replace("\n240 -10 ", "\n1099511627776 -10 ")
    assert spoilt != FILE.read_text()
    (tmp_path / "a.msh").write_text(spoilt)
    with pytest.raises(InputError, match="cannot be read as a mesh"):
        read_mesh(tmp_path / "a.msh", gap=5e-4)
    assert list(recwarn) == []
