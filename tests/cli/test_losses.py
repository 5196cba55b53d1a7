"""The command `losses`: fields that scripts read, what is not known is null, bad input in one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_paths import E1, ROOT, SERVO, TABLE

from msl_fem.actuator import load_actuator
from msl_fem.losses import iron_loss, sine_operation
from msl_fem.record import Record, Run, write_record
from msl_fem.record.record import Sampling
from msl_fem.table.magnetic_table import read_table

Command = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
SINE = ("--current", "2 A", "--amplitude", "1 A", "--frequency", "100 Hz", "--gap", "0.6 mm")


def test_a_sine_about_a_bias(msl_fem: Command) -> None:
    found = msl_fem("losses", SERVO, *SINE, "--table", TABLE, "--temperature", "100 °C", "--json").json
    operation = sine_operation(2.0, 6e-4, frequency=100.0, amplitude=1.0)
    expected = iron_loss(read_table(TABLE), load_actuator(SERVO), operation=operation)
    assert found["current_rms_A"] == pytest.approx(np.sqrt(4.5))
    assert found["iron_loss_W"] == pytest.approx(expected.loss, rel=1e-12)
    assert found["core_iron_loss_W"] == pytest.approx(expected.core_loss, rel=1e-12)
    assert {s["name"] for s in found["sections"]} == {"centre_leg", "yoke", "outer_leg", "armature"}
    for s in found["sections"]:
        assert s["loss_W"] == pytest.approx(s["hysteresis_W"] + s["eddy_W"] + s["excess_W"])
    assert found["copper_loss_W"] == pytest.approx(4.5 * 1.3144, rel=2e-3)
    assert found["alternating_share"] > 0
    assert found["wire"]["name"] == "0.71 mm"
    assert found["wire"]["resistance_factor_at_bandwidth"] == pytest.approx(1.1445 - 0.06, abs=0.02)  # hot copper
    assert found["thermal"]["continuous_current_A"] < found["thermal"]["runaway_current_A"]
    assert found["thermal"]["steady_rise_K"] > 80
    assert any("Lamination Steels" in note for note in found["notes"])


def test_thinner_sheets_lose_less(msl_fem: Command) -> None:
    losses = [
        msl_fem("losses", SERVO, *SINE, "--table", TABLE, *more, "--json").json for more in ((), ("--sheet", "0.36 mm"))
    ]
    assert losses[1]["iron_loss_W"] < losses[0]["iron_loss_W"]
    assert losses[1]["sections"][0]["sheet_m"] == 0.3556e-3


def test_what_is_not_known_is_null(msl_fem: Command) -> None:
    """Sheets of 0.5 mm: the eddy-current term alone; an RMS current that runs away: no temperature."""
    found = msl_fem("losses", SERVO, *SINE, "--table", TABLE, "--sheet", "0.5 mm", "--json").json
    assert found["iron_loss_W"] is None
    assert found["sections"][0]["hysteresis_W"] is None
    assert found["sections"][0]["eddy_W"] > 0
    assert any("no loss data for sheets of 0.5 mm" in note for note in found["notes"])
    hot = msl_fem("losses", SERVO, "--current", "4 A", "--json").json
    assert hot["thermal"]["steady_temperature_K"] is None
    assert any("heats the winding without end" in note for note in hot["notes"])
    assert hot["iron_loss_W"] == 0.0
    assert hot["sections"] == []
    almost = msl_fem("losses", SERVO, "--current", "3.1 A", "--json").json
    assert almost["thermal"]["steady_rise_K"] is None
    assert any("resistance is known for" in note for note in almost["notes"])


def test_a_winding_that_does_not_fit_is_said(msl_fem: Command, tmp_path: Path) -> None:
    path = tmp_path / "many.toml"
    path.write_text(Path(SERVO).read_text().replace("turns = 200", "turns = 90000"))
    found = msl_fem("losses", str(path), "--current", "0.01 A", "--json").json
    assert found["wire"] is None
    assert any("no wire is chosen: 90000 turns do not fit" in note for note in found["notes"])


def test_a_records_run(msl_fem: Command, tmp_path: Path) -> None:
    """The same sine as a run of a record: the same loss."""
    actuator = load_actuator(SERVO)
    t = np.arange(8000) / 20000
    phase = 2 * np.pi * 100 * t
    columns = {
        "time_s": t, "current_1_A": 2 + np.sin(phase), "current_2_A": 0 * t, "position_m": 1e-5 * np.sin(phase),
    }  # fmt: skip
    record = Record("simulated", actuator, Sampling(rate=20000.0), runs=(Run("sine", "sine", "fit", columns),))
    write_record(record, tmp_path / "record")
    given = ("--record", str(tmp_path / "record"), "--frequency", "100 Hz")
    found = msl_fem("losses", SERVO, *given, "--table", TABLE, "--json").json
    sine = msl_fem("losses", SERVO, *SINE, "--gap-amplitude", "10 um", "--table", TABLE, "--json").json
    assert found["iron_loss_W"] == pytest.approx(sine["iron_loss_W"], rel=1e-3)
    assert found["copper_loss_W"] == pytest.approx(sine["copper_loss_W"], rel=1e-6)
    other = msl_fem("losses", SERVO, *given, "--side", "2", "--table", TABLE, "--json").json
    assert other["iron_loss_W"] == pytest.approx(0.0, abs=1e-12)
    parallel = tmp_path / "parallel.toml"
    parallel.write_text(Path(SERVO).read_text().replace('connection = "series"', 'connection = "parallel"'))
    half = msl_fem("losses", str(parallel), *given, "--table", TABLE, "--json").json
    assert half["current_rms_A"] == pytest.approx(found["current_rms_A"] / 2, rel=1e-9)


def test_people_get_a_table(msl_fem: Command) -> None:
    found = msl_fem("losses", SERVO, "--current", "1 A", "--duty", "0.5", "--period", "10 s", "--wire", "awg")
    assert found.status == 0
    assert "thermal: duty current" in found.stdout
    assert "AWG 21" in found.stdout
    assert "note: two nodes" in found.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "--current is missing"),
        (("--current", "1 A", "--amplitude", "1 A"), "--frequency is missing"),
        (("--current", "1 m"), "--current: unit 'm' has the wrong dimension"),
        (("--current", "1 A", "--ambient", "20"), "--ambient: '20' is not a temperature"),
        (("--current", "1 A", "--ambient", "20 m"), "--ambient: '20 m' is not a temperature"),
        (("--current", "1 A", "--temperature", "-400 degC"), "--temperature: '-400 degC' is below absolute zero"),
        (("--current", "1 A", "--temperature-rise", "80 degC"), "has an offset; use 'K'"),
        (("--current", "1 A", "--temperature-rise", "0 K"), "a rise of 0 K from 20 degC is not allowed"),
        (("--current", "1 A", "--duty", "0"), "a duty of 0 is not allowed"),
        (("--current", "1 A", "--period", "-1 s"), "a period of -1 s is not allowed"),
        (("--current", "1 A", "--thermal-resistance", "2 W/K"), "wrong dimension"),
        (("--current", "1 A", "--wire", "swg"), "wire series 'swg' is unknown"),
        (("--current", "1 A", "--grade", "7"), "grade 7 is not known"),
        (("--current", "1 A", "--packing", "wild"), "packing 'wild' is unknown"),
        (("--current", "1 A", "--record", "x"), "leave --current"),
        (("--record", "x"), "--frequency is missing"),
        ((*SINE, "--table", TABLE, "--sheet", "1 km"), "must be 0.01 ... 50 mm"),
        (("--current", "9 A", "--amplitude", "9 A", "--frequency", "9 Hz", "--table", TABLE), "outside the table"),
    ],
)
def test_bad_input_is_one_line(msl_fem: Command, arguments: tuple[str, ...], said: str) -> None:
    found = msl_fem("losses", SERVO, *arguments)
    assert said in found.complaint


def test_magnets_without_dimensions(msl_fem: Command) -> None:
    found = msl_fem("losses", str(ROOT / "geometries" / "u_core.toml"), "--current", "1 A")
    assert found.status == 2
    assert msl_fem("losses", E1, "--current", "1 A", "--json").json["thermal"]["continuous_current_A"] > 1
