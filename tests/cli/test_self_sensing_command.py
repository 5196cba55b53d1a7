"""`self-sensing` prints the map of errors, and says what it cannot do."""

from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
SERVO = str(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE = ("--table", str(ROOT / "lookup_tables" / "fast_tool_servo.nc"))


def test_the_map_of_errors_in_json_and_for_people(msl_fem):
    short = ("--belief", "plain", "--runs", "4", "--window", "4 ms")
    result = msl_fem("self-sensing", SERVO, *TABLE, *short, "--json").json
    assert len(result["points"]["error_m"]) == 36
    assert result["share"] >= 0.6
    told = msl_fem("self-sensing", SERVO, *TABLE, *short)
    assert "100 %" in told.stdout
    assert "What it means" in told.stderr + told.stdout


def test_what_it_cannot_do_is_one_line(msl_fem):
    assert "samples a period" in msl_fem("self-sensing", SERVO, *TABLE, "--rate", "2 kHz").complaint
    assert "more than the drive gives" in msl_fem("self-sensing", SERVO, *TABLE, "--belief", "plain",
                                                  "--amplitude", "200 V").complaint  # fmt: skip
    rig = str(ROOT / "measurements" / "emps" / "actuator.toml")
    assert "has no [magnet]" in msl_fem("self-sensing", rig).complaint
