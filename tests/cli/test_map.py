"""`msl-fem map` of an actuator and of a table: what it answers, what it states, what it refuses."""

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cli_paths import E1, PAIR, SERVO, TABLE

from msl_fem.actuator import load_actuator
from msl_fem.cli import map as map_command
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.field_map import FieldMapSettings, decoupling_map, decoupling_positions, field_map
from msl_fem.maps import OperatingMap, parse_criterion, read_map
from msl_fem.table.magnetic_table import read_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
FEW = ("--gaps", "0.2,0.5 mm", "--workers", "1", "--accuracy", "fast")


def test_an_actuator_s_map_is_of_field_solutions(msl_fem: Run, tmp_path: Path) -> None:
    """The file, the JSON and a direct solution at the file's current say the same."""
    file = tmp_path / "map.json"
    made = msl_fem("map", E1, "--gaps", "0.2,1 mm", "--workers", "1", "-o", str(file), "--json").json
    assert made == json.loads(file.read_text())
    assert not file.with_name(".map.json.rows").exists()
    for m, gap in enumerate(made["gap_m"]):
        for k, level in enumerate(made["levels_T"]):
            section = made["section"][k][m]
            found = solve(load_actuator(E1), made["current_A"][k][m], gap).quantities.flux_density[section]
            assert found.mean == pytest.approx(level, rel=1e-3)
    parts = np.array(made["mesh_error_A"]) + np.array(made["bh_interpolation_error_A"])
    np.testing.assert_allclose(made["current_error_A"], parts, atol=5e-5)
    assert made["provenance"]["method"].startswith("root finding on field solutions")
    assert made["warnings"] == []
    assert len(read_map(file).gap) == 2


@pytest.fixture(scope="module")
def mean() -> OperatingMap:
    """By the mean over a section, at the gaps of `FEW`."""
    return field_map(load_actuator(E1), (2e-4, 5e-4), levels=(1.2,), settings=FieldMapSettings(accuracy="fast"))


@pytest.mark.parametrize("criterion", ["percentile=95", "max", "max=1mm"])
def test_a_criterion_is_in_the_file_and_reads_back(msl_fem: Run, mean: OperatingMap, criterion: str) -> None:
    made = msl_fem("map", E1, "--criterion", criterion, "--levels", "1.2 T", *FEW, "--json").json
    assert made["criterion"] == criterion
    assert parse_criterion(made["criterion"]) == parse_criterion(criterion)
    radius = {"max": 0.5e-3, "max=1mm": 1e-3}.get(criterion)
    assert made["corner_radius_m"] == (None if radius is None else pytest.approx(radius))
    assert (np.array(made["current_A"]) < mean.current).all()
    assert set(made["section"][0]) <= {"centre_leg", "outer_leg", "yoke", "armature"}


def test_a_table_s_map_stays_the_table_s(msl_fem: Run) -> None:
    made = msl_fem("map", TABLE, "--gaps", "0.2,0.5 mm", "--json").json
    assert made["gap_m"] == [2e-4, 5e-4]
    assert made["provenance"]["method"] == "interpolated from a table"
    assert made["mesh_error_A"] is None
    assert (np.array(made["current_error_A"]) > 0).all()
    fields = msl_fem("map", SERVO, "--end-effects", "none", *FEW, "--json").json
    np.testing.assert_allclose(made["current_A"], fields["current_A"], rtol=3e-3)
    assert msl_fem("map", TABLE, "--json").json["gap_m"] == read_table(TABLE).gap.tolist()


@pytest.mark.parametrize(("table", "title"), [(TABLE, "operating map"), (PAIR, "operating map of both sides")])
def test_a_page_of_a_table_s_map(msl_fem: Run, table: str, title: str, tmp_path: Path) -> None:
    page = tmp_path / "map.html"
    made = msl_fem("map", table, "--report", page, "--json").json
    assert made["report"] == str(page)
    assert f"fast_tool_servo: {title}</h1>" in page.read_text().replace("<wbr>", "")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((TABLE, "--criterion", "max"), "criterion 'max' is not available from a table"),
        ((TABLE, "--criterion", "percentile=95"), "give the actuator file"),
        ((TABLE, "--decoupling"), "--decoupling needs field solutions"),
        ((TABLE, "--end-effects", "section"), "--end-effects needs field solutions"),
        ((TABLE, "--current-max", "5 A"), "--current-max needs field solutions"),
        ((E1, "--criterion", "median"), "criterion 'median' is unknown; choose mean, percentile=95"),
        ((E1, "--criterion", "max=0.5"), "criterion 'max=0.5': '0.5' has no unit"),
        ((E1, "--criterion", "max=4mm", *FEW), "below half the thinnest iron, 2.5 mm"),
        ((E1, "--gaps", "0.2 mm"), "at least 2 different gaps"),
        ((E1, "--gaps", "0.2 A"), "--gaps: unit 'A' has the wrong dimension"),
        ((E1, "--current-max", "-1 A"), "largest current must be positive"),
        ((E1, "--accuracy", "best"), "accuracy 'best' is unknown"),
        ((E1, "--resume"), "give the same -o FILE"),
        ((E1, "--report", "map.html", *FEW), "--report shows the map of a table"),
        ((E1, "--decoupling", *FEW), "e1 has no two sides that share an armature"),
    ],
)
def test_what_cannot_be_is_one_line(msl_fem: Run, arguments: tuple[str, ...], said: str) -> None:
    assert said in msl_fem("map", *arguments).complaint


def test_decoupling_is_in_the_json_and_said(msl_fem: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """At the positions of its default, of which two are enough here."""
    _, position = decoupling_positions(load_actuator(SERVO))
    assert len(position) == 5
    ends = partial(decoupling_map, positions=position[[0, -1]])
    monkeypatch.setattr(map_command, "decoupling_map", lambda actuator, **asked: ends(actuator, **asked))
    found = msl_fem("map", SERVO, *FEW, "--levels", "1 T", "--decoupling", "--json")
    content = found.json["decoupling"]
    assert content["level_T"] == [0.0, 0.5, 1.0]
    assert content["position_m"] == position[[0, -1]].tolist()
    for finding in content["findings"]:
        assert f"decoupling: {finding}" in found.stderr


def test_a_map_for_people(msl_fem: Run) -> None:
    printed = msl_fem("map", E1, *FEW)
    assert "centre leg" in printed.stdout
    assert "1.70" in printed.stdout
    assert "the currents are within" in printed.stderr


def test_a_level_that_is_not_reached_is_one_line_however_many_gaps(msl_fem: Run, tmp_path: Path) -> None:
    """2 T and no other level of these; the count is that of the file's holes, and the way out is the source's."""
    file = tmp_path / "map.json"
    printed = msl_fem("map", TABLE, "--levels", "1.2,2.0 T", "-o", str(file))
    missing = json.loads(file.read_text())["current_A"][1].count(None)
    assert missing > 1
    lines = [line for line in printed.stderr.splitlines() if "is not reached" in line]
    assert len(lines) == 1
    assert lines[0].startswith("note: 2 T is not reached below 12 A at ")
    assert f" {missing} of " in lines[0]
    assert lines[0].endswith("make the table with larger currents")
    of_fields = msl_fem("map", E1, "--levels", "1.2 T", "--current-max", "3 A", *FEW).stderr
    assert "at 1 of 2 gaps, 500 µm the smallest; give a larger --current-max" in of_fields
