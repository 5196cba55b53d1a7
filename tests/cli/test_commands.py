"""Each command does its job, prints the fields that scripts read, and refuses bad input in one line."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from cli_paths import E1, EMPS, SERVO, TABLE

from msl_fem.files.toml_text import toml_text
from msl_fem.record import load_record
from msl_fem.table.magnetic_table import read_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/cli/conftest.py


def test_solve_meets_the_reference(msl_fem: Run, tmp_path: Path) -> None:
    """E1 at 5 A and 0.5 mm: the converged values of tests/reference."""
    picture, vtu = tmp_path / "field.png", tmp_path / "field.vtu"
    found = msl_fem(
        "solve", E1, "--current", "5 A", "--gap", "0.5 mm", "--json", "--picture", str(picture), "--vtu", str(vtu)
    ).json
    assert found["force_N"] == pytest.approx(211.029, rel=2e-3)
    assert found["flux_linkage_Wb"] == pytest.approx(0.0605392, rel=1e-3)
    assert found["coenergy_J"] == pytest.approx(0.164467, rel=1e-3)
    assert found["force_stress_tensor_N"] == pytest.approx(found["force_N"], rel=5e-3)
    assert 0 < found["force_error_estimate"] < 2e-3
    assert set(found["flux_density_T"]) == {"centre_leg", "yoke", "outer_leg", "armature"}
    assert found["flux_density_T"]["centre_leg"]["mean"] == pytest.approx(1.52371, rel=3e-3)
    assert found["unknowns"] > 1000
    assert found["newton_iterations"] >= 3
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert b"UnstructuredGrid" in vtu.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--current", "5 V", "--gap", "0.5 mm"], "--current: unit 'V' has the wrong dimension"),
        (["--current", "5", "--gap", "0.5 mm"], "--current: '5' has no unit"),
        (["--current", "5 A", "--gap", "-0.5 mm"], "gap -500 µm is not allowed"),
        (["--current", "5 A", "--gap", "0 mm"], "gap 0 m is not allowed"),
        (["--current", "5 A", "--gap", "0.5 mm", "--accuracy", "best"], "accuracy 'best' is unknown"),
        (["--current", "1,2 A", "--gap", "0.5 mm"], "give one value"),
    ],
)
def test_solve_refuses_in_one_line(msl_fem: Run, arguments: list[str], said: str) -> None:
    assert said in msl_fem("solve", E1, *arguments).complaint


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"10 mm"', '"10 V"'), "magnet.centre_leg_width: unit 'V' has the wrong dimension"),
        (("stack_depth", "stack_dept"), "stack_dept"),
        (('stack_depth = "20 mm"', ""), "magnet.stack_depth: is missing"),
        (('"m19"', '"unobtainium"'), "unknown iron 'unobtainium'"),
    ],
)
def test_a_bad_actuator_file_is_one_line(msl_fem: Run, tmp_path: Path, change: tuple[str, str], said: str) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(Path(SERVO).read_text().replace(*change, 1))
    assert said in msl_fem("solve", str(file), "--current", "1 A", "--gap", "1 mm").complaint


def test_a_missing_file_is_one_line(msl_fem: Run, tmp_path: Path) -> None:
    missing = str(tmp_path / "none.toml")
    assert "none.toml: cannot be read" in msl_fem("study", missing).complaint
    assert "no such file" in msl_fem("lookup", str(tmp_path / "t.nc"), "--current", "1 A", "--gap", "1 mm").complaint
    assert "cannot be read" in msl_fem("guard", str(tmp_path / "m"), "--current", "1 A", "--gap", "1 mm").complaint
    msl_fem("identify", str(tmp_path / "record")).complaint  # noqa: B018 - asserts inside


def test_table_then_lookup(msl_fem: Run, tmp_path: Path) -> None:
    file = tmp_path / "t.nc"
    made = msl_fem(
        "table", E1, "--gaps", "0.45,0.5,0.56 mm", "--currents", "1,2,3 A", "-o", str(file), "--workers", "1", "--json"
    ).json
    assert (made["points"], made["failed"]) == (9, 0)
    for name in ("mesh_error", "interpolation_error", "reciprocity_error", "cpu_seconds"):
        assert 0 < made[name] < math.inf
    assert [p.name for p in tmp_path.iterdir()] == ["t.nc"], "no cache or temporary file is left"
    found = msl_fem("lookup", str(file), "--current", "2 A", "--gap", "0.5 mm", "--json").json
    assert found["force_N"] == pytest.approx(read_table(file).nodes["force"][1, 2], rel=1e-12)
    beyond = msl_fem("lookup", str(file), "--current", "5 A", "--gap", "0.5 mm").complaint
    assert "current 5 A lies outside the table's 0 ... 3 A of either sign (gaps 0.45 ... 0.56 mm)" in beyond
    assert (
        "outside the table's 0.45 ... 0.56 mm"
        in msl_fem("lookup", str(file), "--current", "1 A", "--gap", "0.1 mm").complaint
    )


def test_a_table_needs_both_grids_or_ranges(msl_fem: Run, tmp_path: Path) -> None:
    out = str(tmp_path / "t.nc")
    assert "both --currents and --gaps" in msl_fem("table", E1, "--gaps", "0.1,0.2 mm", "-o", out).complaint
    assert "to choose a grid from" in msl_fem("table", E1, "-o", out).complaint
    assert (
        "at least 2 different gaps"
        in msl_fem("table", E1, "--gaps", "0.1 mm", "--currents", "1,2 A", "-o", out).complaint
    )
    assert not Path(out).exists()


def test_map_and_guard(msl_fem: Run, tmp_path: Path) -> None:
    file = tmp_path / "map.json"
    made = msl_fem("map", TABLE, "-o", str(file), "--json").json
    assert made["levels_T"] == [1.2, 1.6]
    assert made["criterion"] == "mean"
    assert len(made["current_A"]) == 2
    assert len(made["gap_m"]) == len(made["current_A"][0])
    assert np.all(np.diff(made["current_A"][0]) > 0), "a larger gap needs more current"
    assert json.loads(file.read_text())["levels_T"] == [1.2, 1.6]
    regions = {}
    for current in ("1 A", "3 A", "6 A", "nan"):
        judged = msl_fem("guard", str(file), "--current", current, "--gap", "0.3 mm", "--json").json
        regions[current] = judged["region"]
        assert judged["reason"]
    assert regions == {"1 A": "preferred", "3 A": "discouraged", "6 A": "unacceptable", "nan": "unacceptable"}
    outside = msl_fem("guard", str(file), "--current", "1 A", "--gap", "5 mm", "--json").json
    assert (outside["region"], outside["limits_A"], outside["margin_A"]) == ("unacceptable", None, None)
    assert "--levels: '1.2' has no unit" in msl_fem("map", TABLE, "--levels", "1.2").complaint
    assert "criterion 'max'" in msl_fem("map", TABLE, "--criterion", "max").complaint


def test_simulate_writes_a_record_that_identify_takes(msl_fem: Run, tmp_path: Path) -> None:
    folder, model = tmp_path / "record", tmp_path / "model.json"
    noise = "band-limited-noise:channel=independent,band=500 Hz,bias=0.6 A,amplitude=0.1 A,duration=1 s,seed=2"
    made = msl_fem("simulate", SERVO, "--table", TABLE, "--excitation", noise, "-o", str(folder), "--json").json
    assert made["record"] == str(folder)
    record = load_record(folder)
    assert record.origin == "simulated"
    assert record.runs[0]["position_m"].size == 10_000
    found = msl_fem("identify", str(folder), "-o", str(model), "--json").json
    (fit,) = found["fit_percent"].values()
    assert fit["one_step"] > 99
    assert fit["free_run"] > 95
    assert set(found["parameters"]["a1"]) == {"value", "standard_error"}
    assert json.loads(model.read_text())


def test_excitations_given_one_by_one_are_those_of_a_file(msl_fem: Run, tmp_path: Path) -> None:
    """All of them are run, in order: none is left out silently."""
    keys = {"channel": "1", "bias": "0.3 A", "amplitude": "0.1 A", "duration": "0.5 s"}
    both = [{"name": "sine", **keys, "frequency": "20 Hz"},
            {"name": "sine", **keys, "frequency": "30 Hz", "role": "held-out"}]  # fmt: skip
    file = tmp_path / "both.toml"
    file.write_text(toml_text({"excitation": both}))
    texts = ["sine:" + ",".join(f"{k}={v}" for k, v in one.items() if k != "name") for one in both]
    common = ["simulate", SERVO, "--table", TABLE, "--rate", "2 kHz", "-o"]
    one_by_one = [word for text in texts for word in ("--excitation", text)]
    made = msl_fem(*common, str(tmp_path / "a"), *one_by_one, "--json").json
    assert list(made["runs"]) == ["sine_1", "sine_2"]
    again = msl_fem(*common, str(tmp_path / "b"), "--excitation", str(file), "--json").json
    assert again["runs"] == made["runs"]
    assert [run.role for run in load_record(tmp_path / "a").runs] == ["fit", "held-out"]
    for name in ("rig.toml", "sine_1.csv", "sine_2.csv"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_simulate_refuses_what_the_open_loop_does_not_bear(msl_fem: Run, tmp_path: Path) -> None:
    common = ["simulate", SERVO, "--table", TABLE, "-o", str(tmp_path / "r"), "--excitation"]
    strong = "sine:channel=common,frequency=20 Hz,bias=1.6 A,amplitude=0.4 A,duration=1 s"
    assert "stable up to 1.2" in msl_fem(*common, strong).complaint
    resonant = "sine:channel=differential,frequency=54 Hz,bias=0.6 A,amplitude=0.2 A,duration=1 s"
    assert "is borne" in msl_fem(*common, resonant).complaint
    assert not (tmp_path / "r").exists()
    assert "is no excitation" in msl_fem(*common, "hum:frequency=50 Hz").complaint


def test_identify_runs_on_the_real_drive(msl_fem: Run) -> None:
    """EMPS: mass 95.1 kg from b1 + b2 = T^2/m at T = 1 ms, whatever the friction does to the rest."""
    found = msl_fem("identify", EMPS, "--json").json
    assert set(found["fit_percent"]) == {"emps", "emps_pulses"}
    gain = found["parameters"]["b[force][1]"]["value"] + found["parameters"]["b[force][2]"]["value"]
    assert 1e-6 / gain == pytest.approx(95.1, rel=0.2)
    assert found["fit_percent"]["emps_pulses"]["one_step"] > 99.9
    assert not found["residual_tests"][0]["inside_band"], "friction is not in the model, and the test says so"


def test_control_tracks_without_violation(msl_fem: Run, tmp_path: Path) -> None:
    sine = "sine:frequency=2 Hz,amplitude=0.4 mm,duration=1 s"
    folder = tmp_path / "run"
    found = msl_fem("control", SERVO, "--table", TABLE, "--reference", sine, "-o", str(folder), "--json").json
    assert found["tracking_rms_m"] < 0.005 * 0.4e-3
    assert found["guard_violations"] == 0
    assert found["peak_sensitivity"] < 2
    assert found["bandwidth_Hz"] > 60
    assert load_record(folder).runs[0]["reference_m"].size == 2500
    far = "sine:frequency=2 Hz,amplitude=0.7 mm,duration=1 s"
    msl_fem("control", SERVO, "--table", TABLE, "--reference", far).complaint  # noqa: B018 - asserts inside


def test_the_installed_command_in_its_own_process() -> None:
    """Exit status and streams of the real executable, and a help that lists every command."""
    here = [sys.executable, "-m", "msl_fem.cli"]
    done = subprocess.run([*here, "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    for name in ("study", "solve", "table", "lookup", "map", "guard", "simulate", "identify", "control"):
        assert f"  {name} " in done.stdout
    wrong = subprocess.run(
        [*here, "lookup", TABLE, "--current", "99 A", "--gap", "1 mm"], capture_output=True, text=True, check=False
    )
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert wrong.stderr.startswith("error: current 99 A lies outside")
    assert subprocess.run([*here, "lookup"], capture_output=True, check=False).returncode == 2
    assert subprocess.run([*here, "conjure"], capture_output=True, check=False).returncode == 2
