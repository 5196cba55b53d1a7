"""`simulate` with an extended model and with an operating map."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from cli_paths import SERVO, TABLE
from conftest import Outcome

from msl_fem.record import load_record

Run = Callable[..., Outcome]
STEP = "step:channel=differential,bias=0.4 A,amplitude=0.1 A,duration=0.2 s"


def test_an_extended_model_is_simulated_and_not_given_away(msl_fem: Run, tmp_path: Path) -> None:
    model = tmp_path / "extended_model.toml"
    model.write_text(Path(SERVO).read_text() + '\n[effects.current_sensor_error]\noffset_1 = "50 mA"\n')
    common = ["--table", TABLE, "--excitation", STEP, "--json"]
    plain = msl_fem("simulate", SERVO, *common, "--belief", "plain", "-o", str(tmp_path / "plain")).json
    made = msl_fem("simulate", str(model), *common, "-o", str(tmp_path / "extended")).json
    assert plain["effects"] == []
    assert made["effects"] == ["current_sensor_error"]
    records = [load_record(tmp_path / name) for name in ("plain", "extended")]
    assert records[0].actuator.digest == records[1].actuator.digest
    runs = [record.runs[0] for record in records]
    assert np.mean(runs[1]["current_1_A"] - runs[0]["current_1_A"]) - 0.05 < 1e-3
    assert abs(np.mean(runs[1]["current_2_A"] - runs[0]["current_2_A"])) < 1e-9
    assert "[effects" not in "".join(p.read_text() for p in (tmp_path / "extended").glob("*.toml"))


def test_an_effect_that_is_none_is_one_line(msl_fem: Run, tmp_path: Path) -> None:
    model = tmp_path / "extended_model.toml"
    model.write_text(Path(SERVO).read_text() + '\n[effects.magnetic_histeresis]\ncoercive_current = "1 A"\n')
    said = msl_fem("simulate", str(model), "--table", TABLE, "--excitation", STEP, "-o", str(tmp_path / "r")).complaint
    assert "'magnetic_histeresis' is no effect of the catalogue" in said
    assert not (tmp_path / "r").exists()


def test_a_run_outside_the_map_is_refused(msl_fem: Run, tmp_path: Path) -> None:
    levels, record = tmp_path / "map.json", str(tmp_path / "r")
    assert msl_fem("map", TABLE, "--levels", "0.05,0.1 T", "-o", str(levels), "--json").json
    arguments = ["simulate", SERVO, "--table", TABLE, "--map", str(levels), "-o", record]
    assert "side 1 leaves the operating map" in msl_fem(*arguments, "--excitation", STEP).complaint
    quiet = "step:channel=differential,bias=0.1 A,amplitude=0.02 A,duration=0.2 s"
    assert msl_fem(*arguments, "--excitation", quiet, "--json").json["record"] == record


def test_a_voltage_limit_that_was_met_is_explained(msl_fem, tmp_path: Path) -> None:
    step = "step:bias=0.6 A,amplitude=10 mA,duration=40 ms"
    run = msl_fem(
        "simulate",
        str(SERVO),
        "--table",
        str(TABLE),
        "--excitation",
        step,
        "--belief",
        "plain",
        "-o",
        str(tmp_path / "r"),
    )
    assert "the voltage limit was met in" in run.stderr
