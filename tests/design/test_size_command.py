"""The command `size`: the fields that scripts read, the files it leaves, and one line for what is wrong."""

import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from conftest import ROOT
from sizing_requirements import one_beginning

from msl_fem.actuator import load_actuator
from msl_fem.design.sizing import closed_search
from msl_fem.magnetics.sweep.table_sweep import default_grid

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
REQUIREMENT = """
schema = 1
name = "servo"
[force]
minimum = "150 N"
gap = "0.5 mm"
[heat]
current_density = "6 A/mm^2"
[iron]
core = "sheets.csv"
armature = "m19"
stacking_factor = 0.96
[motion]
payload = "0.4 kg"
nominal_gap = "0.6 mm"
range = "0.4 mm"
"""


@pytest.fixture(scope="module", autouse=True)
def beginning() -> Iterator[None]:
    with one_beginning():
        yield


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A requirement whose core's iron is a file beside it."""
    (tmp_path / "sheets.csv").write_bytes((ROOT / "msl_fem" / "materials" / "m19.csv").read_bytes())
    path = tmp_path / "r.toml"
    path.write_text(REQUIREMENT)
    return path


def test_a_requirement_becomes_an_actuator_file_that_solves(msl_fem: Run, file: Path, tmp_path: Path) -> None:
    target = tmp_path / "out" / "geometry.toml"
    said = msl_fem("size", str(file), "-o", str(target), "--trials", "4", "--workers", "1", "--json").json
    assert said["geometry"] == str(target)
    assert said["mass_kg"] > said["moving_mass_kg"] > 0
    assert said["mass_kg"] < said["first_guess"]["mass_kg"]
    assert {c["name"] for c in said["constraints"]} >= {"force", "flux_density", "current", "current_density"}
    for constraint in said["constraints"]:
        assert constraint["margin"] >= -1e-9 * abs(constraint["limit"])
        sign = 1 if constraint["at"] == "most" else -1
        assert constraint["margin"] == pytest.approx(sign * (constraint["limit"] - constraint["value"]), abs=1e-12)
    masses = [one["mass_kg"] for one in said["pareto"]]
    assert masses == sorted(masses)
    assert Path(said["picture"]).read_bytes().startswith(b"\x89PNG")
    # the written magnet, at the stated current and fine accuracy: the force, and the flux density below the limit
    current = f"{said['current_A']!r} A"
    at = ("--current", current, "--gap", "0.5 mm", "--accuracy", "fine")
    point = msl_fem("solve", str(target), *at, "--json").json
    assert point["force_N"] == pytest.approx(said["force_N"], rel=1e-6)
    assert point["force_N"] >= 150.0
    # and what both polarities cost on its armature, at that current: a second run of another command
    off = ("--gap", "0.4 mm", "--gap-2", "0.8 mm", "--current-2", current)
    costs = msl_fem("solve", str(target), "--current", current, *off, "--json").json["polarity"]
    for name in ("opposing", "aiding"):
        for key, value in costs[name].items():
            assert said["polarity"][name][key] == pytest.approx(value, rel=1e-2, abs=1e-5)
    opposing, aiding = (abs(costs[name]["force_error_of_sides_apart"]) for name in ("opposing", "aiding"))
    assert opposing > 10 * aiding
    assert max(section["mean"] for section in point["flux_density_T"].values()) <= 1.2
    # and it is a whole actuator: sides, motion, drive, controller, a default grid
    actuator = load_actuator(target)
    assert actuator.sides is not None
    assert actuator.controller is not None
    assert actuator.motion is not None
    assert actuator.motion.moving_mass == pytest.approx(0.4 + said["moving_mass_kg"], rel=1e-3)
    assert actuator.coil_resistance() == pytest.approx(said["resistance_ohm"], rel=1e-12)
    assert default_grid(actuator)[1].max() == pytest.approx(12.0)
    assert tomllib.loads(target.read_text())["magnet"]["iron"]["core"] == "../sheets.csv"


def test_people_get_the_front_and_the_choice(msl_fem: Run, file: Path, tmp_path: Path) -> None:
    target = str(tmp_path / "g.toml")
    done = msl_fem("size", str(file), "-o", target, "--trials", "2", "--workers", "1")
    assert done.status == 0, done.stderr
    for text in ("Pareto front over mass, loss", "first guess: mass", "constraints, flux density: margin"):
        assert text in done.stdout
    assert "Warning" not in done.stderr
    assert "Optuna" not in done.stderr


def test_an_impossible_requirement_is_one_line_and_leaves_nothing(
    msl_fem: Run, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By searches too short for good figures, which `test_clash` judges."""
    monkeypatch.setattr(closed_search, "_GENERATIONS", 4)
    file.write_text(
        REQUIREMENT.replace('"150 N"', '"10 kN"') + '[envelope]\nwidth = "20 mm"\nheight = "20 mm"\ndepth = "20 mm"\n'
    )
    before = sorted(tmp_path.iterdir())
    said = msl_fem("size", str(file), "-o", str(tmp_path / "g.toml"), "--json").complaint
    assert "servo cannot be met: 10000 N at 500 µm below 1.2 T" in said
    assert "times as large" in said
    assert sorted(tmp_path.iterdir()) == before


def test_what_only_the_field_refuses_says_what_the_closest_design_lacks(
    msl_fem: Run, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So near to what can be that the closed equations cannot tell."""
    monkeypatch.setattr(closed_search, "_GENERATIONS", 10)
    file.write_text(REQUIREMENT + '[envelope]\nwidth = "44 mm"\nheight = "38 mm"\ndepth = "44 mm"\n')
    done = msl_fem("size", str(file), "-o", str(tmp_path / "g.toml"), "--trials", "3", "--workers", "1", "--json")
    assert done.status == 1
    assert done.stdout == ""
    said = [line for line in done.stderr.splitlines() if line.startswith("failed:")]
    assert len(said) == 1
    assert "none of 3 designs of 150 N at 500 µm meets all constraints; the closest" in said[0]
    assert "(at most" in said[0]
    assert not (tmp_path / "g.toml").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--storage", "sqlite:////nowhere/x.db"), "storage 'sqlite:////nowhere/x.db' cannot be reached"),
        (("--workers", "2", "--scheduler", "tcp://127.0.0.1:1"), "give --workers or --scheduler, not both"),
        (("--trials", "0"), "not '0'"),
        (("-o", "r.toml/x"), "cannot be written (Not a directory)"),
        (("-o", "r.toml"), "r.toml is the requirement itself"),
        (("--scheduler", "nonsense"), "no scheduler answers at 'nonsense'"),
    ],
)
def test_a_wrong_option_is_one_line(
    msl_fem: Run, file: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(file.parent)
    text = file.read_text()
    assert said in msl_fem("size", str(file), "--json", *arguments).complaint
    assert file.read_text() == text


def test_a_rubbish_requirement_is_one_line(msl_fem: Run, file: Path) -> None:
    file.write_text(REQUIREMENT + "bogus = 1\n")
    assert "r.toml: motion.bogus: unknown key" in msl_fem("size", str(file)).complaint
    file.write_text(REQUIREMENT.replace("sheets.csv", "none.csv"))
    assert "none.csv: cannot be read" in msl_fem("size", str(file), "-o", str(file.parent / "g.toml")).complaint
