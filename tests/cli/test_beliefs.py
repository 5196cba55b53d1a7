"""Which belief a command takes: what is stated counts, else as designed; of a simulated record without a word plain."""

from dataclasses import replace

import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.cli.believed import belief_about, belief_of
from msl_fem.errors import InputError
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table

TABLE = str(ROOT / "lookup_tables" / "fast_tool_servo.nc")


@pytest.mark.parametrize(
    ("origin", "stated", "name"),
    [
        ("measured", None, "as-designed"),
        ("simulated", None, "plain"),
        ("measured", "plain", "plain"),
        ("simulated", "as-designed", "as-designed"),
    ],
)
def test_what_is_stated_counts_else_the_drawing(origin: str, stated: str | None, name: str) -> None:
    record = replace(load_record(ROOT / "measurements" / "emps"), origin=origin, belief=stated)
    assert belief_about(record, None).name == name


def test_a_belief_that_there_is_not_is_refused() -> None:
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    assert belief_of("plain", servo, None).values == ()
    with pytest.raises(InputError, match="choose as-designed or plain"):
        belief_of("believed", servo, None)


def test_what_is_lacking_is_left_out_and_the_rest_believed(capfd: pytest.CaptureFixture[str]) -> None:
    """A foreign magnet tells neither faces, flux path nor surfaces: the command says so and goes on."""
    servo = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    bearing = load_actuator(ROOT / "geometries" / "bearing_pole_pair.toml")
    lacking = bearing.model_copy(update={"motion": servo.motion, "drive": servo.drive, "sides": servo.sides})
    assert belief_of(None, lacking, read_table(TABLE)).values == ()
    said = capfd.readouterr().err
    for what in ("end effects", "film of air", "eddy currents in the sheets", "heat of the windings"):
        assert f"note: not in the belief: {what}" in " ".join(said.split())


def test_what_is_believed_is_told_in_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    """Every effect once, and where its values stand; seven long lines at every run were not read."""
    belief = belief_of(None, load_actuator(ROOT / "geometries" / "fast_tool_servo.toml"), read_table(TABLE))
    lines = [line for line in capfd.readouterr().err.splitlines() if "believed as designed" in line]
    assert len(belief.values) > len(lines) == 1
    assert all(lines[0].count(one.effect.replace("_", " ")) == 1 for one in belief.values)
    assert "--json" in lines[0]


def test_what_the_table_has_already_is_told_apart(capfd: pytest.CaptureFixture[str]) -> None:
    plain = read_table(TABLE)
    table = replace(plain, provenance=plain.provenance | {"end_effects": "section", "end_effects_error": "0.012"})
    belief_of(None, load_actuator(ROOT / "geometries" / "fast_tool_servo.toml"), table)
    added, there = capfd.readouterr().err.split("; in the table already: ")
    assert there.startswith("fringing, leakage inductance (")
    assert "mutual inductance" in added
    assert "fringing" not in added
