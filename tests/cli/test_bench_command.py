"""The command `bench`: the fields scripts read, the sealed answer, refusals in one line."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from cli_paths import E1, EMPS, SERVO, TABLE

from msl_fem.record import load_record

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
NOISE = "band-limited-noise:bias=0.5 A,amplitude=0.05 A,band=300 Hz,duration=0.2 s"
SWEEP = "swept-sine:start=20 Hz,stop=200 Hz,bias=0.5 A,amplitude=0.02 A,duration=0.2 s"


def test_bench_writes_a_record_and_a_sealed_answer(msl_fem: Run, tmp_path: Path) -> None:
    record = tmp_path / "rec"
    found = msl_fem(
        "bench", SERVO, "--table", TABLE, "--excitation", NOISE, "--excitation", SWEEP, "--seed", "3",
        "--hide", "eddy_currents=3%", "-o", str(record), "--json",
    ).json  # fmt: skip
    assert found["record"] == str(record)
    answer = json.loads(Path(found["answer"]).read_text())
    assert Path(found["answer"]) == tmp_path / "rec.answer.json"
    assert set(answer) >= {"effects", "true_parameters", "seed"}
    assert answer["effects"][0]["effect"] == "eddy_currents"
    assert answer["effects"][0]["size"] == pytest.approx(0.03, rel=0.02)
    loaded = load_record(record)
    assert [run.role for run in loaded.runs] == ["fit", "held-out"]
    assert sorted(path.name for path in record.iterdir()) == sorted(
        ["actuator.toml", "rig.toml", "band_limited_noise_1.csv", "swept_sine_2.csv"]
    )
    again = msl_fem("bench", SERVO, "--table", TABLE, "--seed", "3", "-o", str(record))
    assert "is there already" in again.complaint


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--hide", "eddy=3%"], "'eddy' is no effect; there are gap_offset"),
        (["--hide", "fringing=3"], "'3' is no size; give a percentage"),
        (["--noise", "pink"], "--noise 'pink' is unknown"),
        (["--rate", "0 Hz"], "must be above 0 Hz"),
        (["--excitation", "noise:amplitude=1 A"], "'noise' is no excitation"),
        (["--answer", "{record}/answer.json"], "lies in the record's folder"),
        (["--excitation", "sine:frequency=100 Hz,bias=0.5 A,amplitude=0.02 A,duration=10 ms"], "has 100 samples"),
    ],
)
def test_bench_refuses_in_one_line(msl_fem: Run, tmp_path: Path, arguments: list[str], said: str) -> None:
    record = tmp_path / "rec"
    arguments = [text.format(record=record) for text in arguments]
    assert said in msl_fem("bench", SERVO, "--table", TABLE, "--seed", "1", "-o", str(record), *arguments).complaint
    assert not list(tmp_path.iterdir())


def test_bench_needs_a_drive_and_a_seed(msl_fem: Run, tmp_path: Path) -> None:
    record = str(tmp_path / "rec")
    said = msl_fem("bench", E1, "--table", TABLE, "--seed", "1", "-o", record, "--excitation", NOISE).complaint
    assert "has no [drive]" in said
    assert "--seed" in msl_fem("bench", SERVO, "-o", record).complaint


def test_bench_of_a_rig_without_a_spring(msl_fem: Run, tmp_path: Path) -> None:
    """The EMPS drive has neither spring nor magnets: its excitation has to be stated, and then it runs."""
    actuator, record = str(Path(EMPS) / "actuator.toml"), tmp_path / "rec"
    assert "state --excitation" in msl_fem("bench", actuator, "--seed", "1", "-o", str(record)).complaint
    found = msl_fem(
        "bench", actuator, "--seed", "1", "-o", str(record), "--rate", "1 kHz", "--hide", "coulomb_friction=3%",
        "--excitation", "sine:frequency=1 Hz,amplitude=20 N,duration=2 s,channel=1", "--json",
    ).json  # fmt: skip
    assert found["runs"]["sine"]["samples"] == 2000
