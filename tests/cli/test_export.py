"""The commands `export` and `guard`: files for other tools, and judgements of one command or many."""

import csv
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from cli_paths import E1, EMPS, SERVO, TABLE

from msl_fem.maps import Guard, operating_map, read_map, write_map
from msl_fem.table.magnetic_table import read_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py


@pytest.fixture(scope="module")
def map_file(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(write_map(operating_map(read_table(TABLE)), tmp_path_factory.mktemp("map") / "map.json"))


def test_a_guard_from_a_map_and_from_its_table_are_the_same(msl_fem: Run, map_file: str, tmp_path: Path) -> None:
    one, two = tmp_path / "one.h", tmp_path / "new" / "two.h"
    assert msl_fem("export", map_file, "--to", "c", "-o", str(one), "--json").json == {"files": [str(one)]}
    assert msl_fem("export", TABLE, "--to", "c", "--what", "guard", "-o", str(two), "--json").json["files"]
    assert one.read_text() == two.read_text()
    assert "fast_tool_servo_guard_region" in one.read_text()
    assert "one.h" in msl_fem("export", map_file, "--to", "c", "-o", str(one), "--name", "mine").stdout
    assert "mine_guard_region" in one.read_text()
    assert [path.name for path in tmp_path.rglob("*.*")] == ["one.h", "two.h"]


def test_a_table_as_csv_and_as_c(msl_fem: Run, tmp_path: Path) -> None:
    file, header, table = tmp_path / "t.csv", tmp_path / "t.h", read_table(TABLE)
    assert msl_fem("export", TABLE, "--to", "csv", "-o", str(file), "--json").json["files"] == [str(file)]
    with file.open(newline="") as stream:
        force = [float(row["force_N"]) for row in csv.DictReader(stream)]
    np.testing.assert_array_equal(np.reshape(force, (table.gap.size, -1)), table.nodes["force"])
    msl_fem("export", TABLE, "--to", "c", "-o", str(header), "--json").json  # noqa: B018 - asserts inside
    assert "fast_tool_servo_table_force" in header.read_text()


def test_an_actuator_with_its_table_as_fmu_mat_and_modelica(msl_fem: Run, tmp_path: Path) -> None:
    fmu, mat, text = tmp_path / "a.fmu", tmp_path / "a.mat", tmp_path / "a.txt"
    found = msl_fem("export", SERVO, "--table", TABLE, "--to", "fmu", "--name", "servo", "-o", str(fmu), "--json").json
    assert found["files"] == [str(fmu)]
    with zipfile.ZipFile(fmu) as content:
        inside = content.namelist()
    assert "modelDescription.xml" in inside
    assert ("binaries/linux64/servo.so" in inside) == (found["platforms"] == ["linux64"])
    msl_fem("export", TABLE, "--to", "mat", "-o", str(mat), "--json").json  # noqa: B018 - asserts inside
    msl_fem("export", TABLE, "--to", "modelica", "-o", str(text), "--json").json  # noqa: B018
    table = read_table(TABLE)
    np.testing.assert_array_equal(scipy.io.loadmat(mat)["x"][0, ::4], table.gap)
    assert text.read_text().startswith("#1\n# actuator: fast_tool_servo\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.fmu", "a.mat", "a.txt"]


def test_without_a_compiler_the_sources_are_said_to_be_alone(
    msl_fem: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    found = msl_fem("export", SERVO, "--table", TABLE, "--to", "fmu", "-o", str(tmp_path / "a.fmu"), "--json")
    assert found.json["platforms"] == []
    assert "sources alone" in found.stderr


def test_an_actuator_that_names_its_table(msl_fem: Run, tmp_path: Path) -> None:
    lines = Path(SERVO).read_text(encoding="utf-8")
    rest = lines[lines.index("[sides]") :]
    file = tmp_path / "a.toml"
    name = next(line for line in lines.splitlines() if line.startswith("name ="))
    file.write_text(f'schema = 1\n{name}\n[magnet]\nkind = "table"\ntable = "{TABLE}"\n{rest}', encoding="utf-8")
    out = tmp_path / "g.h"
    msl_fem("export", str(file), "--to", "c", "--what", "guard", "-o", str(out), "--json").json  # noqa: B018
    assert "fast_tool_servo_guard_region" in out.read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            (TABLE, "--to", "xml"),
            "--to xml is not available; there is c, csv, mat, modelica, simulink, dxf, femm, fmu, fmu3",
        ),
        ((TABLE, "--to", "c", "--what", "soul"), "--what soul is not available as c"),
        ((TABLE, "--to", "c", "--name", "Bad Name"), "--name 'Bad Name' cannot begin"),
        ((TABLE, "--to", "csv", "--name", "x"), "--to csv has none"),
        (("MAP", "--to", "csv"), "needs a file with table or actuator; this is one with a map"),
        ((E1 + "x", "--to", "c"), "e1.tomlx: cannot be read"),
        ((str(Path(TABLE).parent), "--to", "c"), "cannot be read (Is a directory)"),
        (("none.nc", "--to", "c"), "none.nc: no such file"),
        ((TABLE, "--to", "fmu"), "--to fmu --what model needs a file with actuator; this is one with a table"),
        ((TABLE, "--to", "mat", "--table", TABLE), "--table goes with an actuator file"),
        ((TABLE, "--to", "modelica", "--what", "guard"), "--what guard is not available as modelica"),
        ((str(Path(EMPS) / "emps.csv"), "--to", "c"), "not valid JSON"),
    ],
)
def test_what_cannot_be_exported_is_one_line(
    msl_fem: Run, map_file: str, tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    source = map_file if arguments[0] == "MAP" else arguments[0]
    assert said in msl_fem("export", source, *arguments[1:], "-o", str(tmp_path / "out"), "--json").complaint
    assert list(tmp_path.iterdir()) == []


def test_the_target_must_be_writable_and_not_the_source(msl_fem: Run, map_file: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    bad = str(tmp_path / "file" / "x")
    assert "cannot be written" in msl_fem("export", SERVO, "--to", "csv", "-o", bad, "--json").complaint
    before = Path(map_file).read_bytes()
    assert "is the source itself" in msl_fem("export", map_file, "--to", "c", "-o", map_file).complaint
    assert Path(map_file).read_bytes() == before


def test_a_rig_without_magnets_has_no_table(msl_fem: Run, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    rig.write_text('schema = 1\nname = "rig"\n[motion]\nmoving_mass = "1 kg"\n')
    said = msl_fem("export", str(rig), "--to", "csv", "-o", str(tmp_path / "t.csv")).complaint
    assert "rig has no [magnet]" in said


def test_several_commands_are_judged_at_once(msl_fem: Run, map_file: str) -> None:
    currents, gaps = ["1 A", "3 A", "6 A", "nan", "-inf"], ["0.3 mm", "0.3 mm", "0.3 mm", "0.3 mm", "inf m"]
    options = [text for i, g in zip(currents, gaps, strict=True) for text in (f"--current={i}", f"--gap={g}")]
    found = msl_fem("guard", map_file, *options, "--json").json
    regions = ["preferred", "discouraged", "unacceptable", "unacceptable", "unacceptable"]
    assert [one["region"] for one in found["judgements"]] == regions
    assert found["counts"] == {"preferred": 1, "discouraged": 1, "unacceptable": 3}
    assert [one["current_A"] for one in found["judgements"]] == [1.0, 3.0, 6.0, None, None]
    margin = float(Guard(read_map(map_file)).margin(3.0, 0.3e-3))
    assert found["judgements"][1]["margin_A"] == margin
    assert "outside the map's" in found["judgements"][4]["reason"]
    printed = msl_fem("guard", map_file, "--current", "1 A", "--gap", "0.3 mm", "--gap", "5 mm").stdout
    assert "1 preferred, 0 discouraged, 1 unacceptable" in printed


@pytest.mark.parametrize(
    ("current", "region", "reason"),
    [("inf", "unacceptable", "beyond the map's end"), ("-inf A", "unacceptable", "beyond"),
     ("NaN A", "unacceptable", "not a number"),
     ("-0 A", "preferred", "below")],
)  # fmt: skip
def test_what_is_no_current_is_judged_too(msl_fem: Run, map_file: str, current: str, region: str, reason: str) -> None:
    found = msl_fem("guard", map_file, f"--current={current}", "--gap", "0.3 mm", "--json").json
    assert found["region"] == region
    assert reason in found["reason"]
    assert len(found["limits_A"]) == 2


def test_guard_refuses_in_one_line(msl_fem: Run, map_file: str) -> None:
    uneven = ("--current", "1 A", "--current", "2 A", "--gap", "1 mm", "--gap", "1 mm", "--gap", "1 mm")
    assert "2 of --current and 3 of --gap make no pairs" in msl_fem("guard", map_file, *uneven).complaint
    assert "unit 'V'" in msl_fem("guard", map_file, "--current", "inf V", "--gap", "1 mm").complaint
    assert "give one value" in msl_fem("guard", map_file, "--current", "1,2 A", "--gap", "1 mm").complaint


def test_judging_a_command_loads_no_field_solver(map_file: str, tmp_path: Path) -> None:
    """A controller's desk has no mesher; scikit-fem and netgen stay outside."""
    code = (
        "import sys; from msl_fem.cli.output import run_guarded; from msl_fem.cli.app import app; "
        f"run_guarded(lambda: app(['guard', {map_file!r}, '--current', '1 A', '--gap', '1 mm'])); "
        "assert not {'skfem', 'netgen'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
