"""The thermal limit beside the operating map: fields, columns, notes, bad input before the work begins."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_paths import ROOT, SERVO, TABLE

from msl_fem.cli.losses import ThermalTexts
from msl_fem.cli.map import thermal_columns, thermal_notes, thermal_request, thermal_to_json
from msl_fem.maps import map_from_json, map_to_json, operating_map
from msl_fem.table.magnetic_table import read_table

Command = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
GAPS = [2e-4, 6e-4, 1e-3]


def test_fields_of_an_actuator() -> None:
    table, request = read_table(TABLE), thermal_request(ThermalTexts(duty=0.5, period="10 s", frequency="400 Hz"))
    fields = thermal_to_json(Path(SERVO), GAPS, request, table=table)
    assert len(fields["continuous_current_A"]) == 3
    assert sorted(fields["continuous_current_A"]) == fields["continuous_current_A"]
    assert all(d > c for c, d in zip(fields["continuous_current_A"], fields["duty_current_A"], strict=True))
    assert fields["thermal"]["frequency_Hz"] == 400.0
    assert list(thermal_columns(fields)) == ["continuous in A", "at duty in A"]
    flat = thermal_to_json(Path(SERVO), GAPS, thermal_request(ThermalTexts(resistance="2 K/W")), table=table)
    assert flat["continuous_current_A"] == [pytest.approx(5.5165, rel=1e-4)] * 3
    assert any("2 K/W" in note for note in thermal_notes(flat))


def test_a_map_with_a_limit_still_reads_as_a_map() -> None:
    table = read_table(TABLE)
    made = operating_map(table)
    content = map_to_json(made) | thermal_to_json(Path(SERVO), made.gap, thermal_request(ThermalTexts()), table=table)
    again = map_from_json(json.loads(json.dumps(content)))
    assert again.current == pytest.approx(made.current, nan_ok=True)


def test_a_limit_that_cannot_be_known_is_null_with_a_reason(tmp_path: Path) -> None:
    """A magnet given by a mesh, without a coil's window and without a stated cooling; a table alone has no fields."""
    table = read_table(TABLE)
    fields = thermal_to_json(ROOT / "geometries" / "u_core.toml", GAPS, thermal_request(ThermalTexts()), table=table)
    assert fields["continuous_current_A"] is None
    assert "--thermal-resistance" in fields["thermal"]["reason"]
    assert thermal_columns(fields) == {}
    assert thermal_notes(fields)[0].startswith("no thermal limit")
    assert thermal_to_json(Path(TABLE), GAPS, thermal_request(ThermalTexts()), table=table) == {}


def test_the_map_of_a_table_has_no_thermal_fields(msl_fem: Command) -> None:
    assert "continuous_current_A" not in msl_fem("map", TABLE, "--json").json


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--duty", "2"), "a duty of 2 is not allowed"),
        (("--frequency", "5 m"), "--frequency: unit 'm' has the wrong dimension"),
        (("--frequency", "0 Hz"), "must be above 0 Hz"),
        (("--ambient", "warm"), "--ambient: 'warm' is not a temperature"),
    ],
)
def test_bad_options_are_refused_before_the_sweep(msl_fem: Command, arguments: tuple[str, ...], said: str) -> None:
    assert said in msl_fem("map", SERVO, *arguments).complaint
