"""Rubbish on the command line and in files is one clear line with exit status 2, and nothing is left half-written."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from cli_paths import E1, EMPS, SERVO, TABLE

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
SINE = "sine:channel=1,frequency=5 Hz,bias=0.3 A,amplitude=0.1 A,duration=0.1 s"
OF_PLAIN = ("--belief", "plain", "--reference", "sine:frequency=2 Hz,amplitude=0.1 mm,duration=0.2 s")
POINT = ("--current", "1 A", "--gap", "0.5 mm")


def one_line(outcome: "Outcome") -> str:  # noqa: F821
    """The complaint, which is all that stderr holds."""
    said = outcome.complaint
    assert outcome.stderr.strip() == said
    return str(said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("bogus",), "No such command 'bogus'; 'msl-fem --help'"),
        (("sovle",), "No such command 'sovle'; is solve meant? 'msl-fem --help'"),
        (("solve", E1, "--bogus"), "No such option: --bogus; 'msl-fem solve --help'"),
        (("solve", E1), "Missing option '--current'"),
        (("table", E1, "-o", "t.nc", "--workers", "-1"), "not '-1'"),
        (("table", E1, "-o", "t.nc", "--workers", "x"), "not 'x'"),
        (("simulate", SERVO, "--excitation", SINE, "-o", "r", "--seed", "-1"), "not '-1'"),
        (("control", SERVO, "--seed", "-1"), "not '-1'"),
        (("simulate", SERVO, "--excitation", SINE, "-o", "r", "--rate", "-1 Hz"), "--rate -1 Hz is not allowed"),
        (("solve", E1, "--current", "1e300 A", "--gap", "0.5 mm"), "-3200 ... 3200 A"),
        (("solve", E1, "--current", "1 A", "--gap", "1 nm"), "gap 1 nm is not allowed"),
        (("table", E1, "-o", "t.nc", "--gaps", "1,2 mm", "--currents", "1e-300,1 A"), "closer than"),
        (("table", E1, "-o", "t.nc", "--gaps", "1,2 mm", "--currents", "1,1e9 A"), "current 1000 MA is not allowed"),
        (("table", E1, "-o", "t.nc", "--gaps", "1,2 mm", "--currents", ","), "--currents: '' is not a quantity"),
        (("map", TABLE, "--levels", "1e300 T"), "0.001 ... 10 T"),
        (("map", TABLE, "--levels", ",".join(str(1 + n * 1e-3) for n in range(200)) + " T"), "200 level(s)"),
        (("guard", TABLE, "--current", "nan V", "--gap", "1 mm"), "not valid JSON"),
        (("lookup", str(Path(TABLE).parent), *POINT), "is no file"),
        (("control", SERVO, "--table", TABLE, *OF_PLAIN, "--bandwidth", "1e-300 Hz"), "out of range"),
        (("control", SERVO, "--reference", "bogus:x=1"), "'bogus' is no excitation"),
    ],
)
def test_a_wrong_option_is_one_line(
    msl_fem: Run, arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in one_line(msl_fem(*arguments, "--json") if "--help" not in arguments else msl_fem(*arguments))
    assert list(tmp_path.iterdir()) == []


def test_a_long_text_is_shortened(msl_fem: Run) -> None:
    said = one_line(msl_fem("solve", E1, "--current", "5 A" + "x" * 5000, "--gap", "0.5 mm"))
    assert len(said) < 1300
    assert said.endswith('like "5 A"')


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("centre_leg_width", '"1e300 mm"', "1e+297 m is out of range"),
        ("centre_leg_width", '"1 nm"', "centre_leg_width 1 nm is below 20 µm"),
        ("window_height", '"100 m"', "window_height 100 m is above 10 m"),
        ("stack_depth", '"1 km"', "stack_depth 1 km is not allowed"),
        ("leg_clearance", '"1 nm"', "coil.leg_clearance 1 nm is below"),
        ("top", '"1 nm"', "air.top 1 nm is not allowed"),
        ("turns", "1000000000000", "turns: Input should be less than or equal to 1000000"),
        ("delay_samples", "1000000", "delay_samples: Input should be less than or equal to 20"),
        ("magnets_per_side", "1000000000", "magnets_per_side: Input should be less than or equal to 1000"),
        ("name", '"[bold]x[/bold]"', "name: String should match"),
    ],
)
def test_an_impossible_magnet_is_one_line(msl_fem: Run, tmp_path: Path, key: str, value: str, said: str) -> None:
    lines = Path(SERVO).read_text(encoding="utf-8").splitlines()
    at = next(n for n, line in enumerate(lines) if line.startswith(f"{key} ="))
    lines[at] = f"{key} = {value}"
    file = tmp_path / "a b ü.toml"
    file.write_text("\n".join(lines), encoding="utf-8")
    assert said in one_line(msl_fem("solve", str(file), *POINT, "--json"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data * 1e300, "above any magnet's"),
        (lambda data: data.assign(force=data.force * 1j), "expected real numbers"),
        (lambda data: data.assign_coords(gap=data.gap.values * 1e300), "look at the unit"),
        (lambda data: data.assign_coords(gap=[str(g) for g in data.gap.values]), "expected real numbers"),
        (lambda data: data.rename(gap="g"), "has dimensions ('g', 'current')"),
        (lambda data: data.assign_attrs(provenance="[1]"), "must be a JSON object"),
    ],
)
def test_a_rubbish_table_is_one_line(
    msl_fem: Run, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], said: str
) -> None:
    with xr.open_dataset(TABLE, engine="h5netcdf") as data:
        change(data.load()).to_netcdf(tmp_path / "t.nc", engine="h5netcdf")
    assert said in one_line(msl_fem("map", str(tmp_path / "t.nc"), "--json"))


def test_a_foreign_variable_is_left_alone(msl_fem: Run, tmp_path: Path) -> None:
    with xr.open_dataset(TABLE, engine="h5netcdf") as data:
        data.load().assign(room=("time", np.ones(3))).to_netcdf(tmp_path / "t.nc", engine="h5netcdf")
    assert msl_fem("lookup", str(tmp_path / "t.nc"), *POINT, "--json").json["force_N"] > 0


def test_a_map_of_rubbish_is_one_line(msl_fem: Run, tmp_path: Path) -> None:
    content = msl_fem("map", TABLE, "--json").json
    file = tmp_path / "m.json"
    file.write_text(json.dumps(content | {"current_max_A": 10**400}))
    assert "must hold one number" in one_line(msl_fem("guard", str(file), *POINT, "--json"))
    file.write_text(json.dumps(content))
    assert msl_fem("guard", str(file), "--current", "nan", "--gap", "1 mm", "--json").json["region"] == "unacceptable"
    assert "unit 'V'" in one_line(msl_fem("guard", str(file), "--current", "nan V", "--gap", "1 mm", "--json"))


@pytest.mark.parametrize(
    ("cells", "said"),
    [(None, "has 0 samples"), ("0.499,1e300,0.1,0.1", "beyond 1e+18"), ("0.499,x,0.1,0.1", "not a finite number")],
)
def test_a_broken_record_is_one_line(msl_fem: Run, tmp_path: Path, cells: str | None, said: str) -> None:
    for file in Path(EMPS).glob("*.[tc]*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    rows = (tmp_path / "emps.csv").read_text().splitlines()
    (tmp_path / "emps.csv").write_text("\n".join([*rows[:500], cells, *rows[501:]] if cells else rows[:1]) + "\n")
    assert said in one_line(msl_fem("identify", str(tmp_path), "--json"))


def test_orders_beyond_all_bearing_fail_in_one_line(msl_fem: Run) -> None:
    found = msl_fem("identify", EMPS, "--orders", "50,50,50", "--json")
    assert (found.status, found.stdout) in ((1, ""), (2, ""))
    assert "Traceback" not in found.stderr


@pytest.mark.parametrize("command", ["table", "study", "simulate", "control", "map", "identify"])
def test_an_output_that_cannot_be_written_is_said_before_the_work(msl_fem: Run, tmp_path: Path, command: str) -> None:
    """No table is computed, no loop run: each of these would take seconds to minutes."""
    (tmp_path / "file").write_text("x")
    source = EMPS if command == "identify" else SERVO
    more = ("--excitation", SINE) if command == "simulate" else ()
    said = one_line(msl_fem(command, source, *more, "-o", str(tmp_path / "file" / "x"), "--json"))
    assert "cannot be written (Not a directory)" in said
    assert (tmp_path / "file").read_text() == "x"


def test_a_study_does_not_start_where_a_foreign_folder_stands(msl_fem: Run, tmp_path: Path) -> None:
    (tmp_path / "record").mkdir()
    (tmp_path / "record" / "precious.txt").write_text("x")
    assert "holds files and is no record" in one_line(msl_fem("study", SERVO, "-o", str(tmp_path), "--json"))
    assert [path.name for path in tmp_path.rglob("*")] == ["record", "precious.txt"]


def test_names_in_brackets_are_printed_as_they_are(msl_fem: Run, tmp_path: Path) -> None:
    file = tmp_path / "[bold]t.nc"
    file.write_bytes(Path(TABLE).read_bytes())
    assert "[bold]t.nc" in msl_fem("lookup", str(file), *POINT).stdout


def test_residual_tests_are_rows_of_the_table(msl_fem: Run) -> None:
    printed = msl_fem("identify", EMPS).stdout
    rows = [line.split() for line in printed.splitlines()]
    assert any(row[:2] in (["force", "no"], ["force", "yes"]) for row in rows)
    assert sum(line.startswith(("What it means", "How sure", "What to do")) for line in printed.splitlines()) == 3
    assert "{" not in printed
