"""Every kind of magnet with a shipped file goes through the same commands: from the file to a judged record."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from conftest import ROOT

from msl_fem.table.magnetic_table import read_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py


@dataclass(frozen=True)
class Tour:
    """What is asked of a shipped magnet: a working point, a coarse table about it, an excitation that it bears."""

    file: str
    current: str
    gap: str
    gaps: str
    currents: str
    level: str
    excitation: str
    sections: frozenset[str]
    losses: tuple[str, ...] = ()


ROUND = ("pot-core", "plunger")
NOISE = "band-limited-noise:bias={},amplitude={},band={},duration=0.25 s,role={}"
TOURS = {
    "u-core": Tour(
        "u_core_ui60", "2 A", "1.5 mm", "0.5,1,1.6,2.5 mm", "1,2,4,6 A", "0.7 T",
        "multisine:amplitude=0.02 mm,start=4 Hz,stop=12 Hz,duration=0.25 s,periods=1,loop=closed,role={}",
        frozenset({"leg", "yoke", "armature"}),
    ),
    "pot-core": Tour(
        "pot_core_holding", "1 A", "0.6 mm", "0.15,0.3,0.6,1.1 mm", "0.25,0.5,1,2 A", "0.8 T",
        NOISE.format("0.5 A", "0.1 A", "300 Hz", "{}"), frozenset({"post", "yoke", "ring", "armature"}),
    ),
    "plunger": Tour(
        "roters_plunger", "1 A", "20 mm", "16,20,25 mm", "0.5,1,1.5 A", "1 T",
        NOISE.format("1 A", "0.02 A", "60 Hz", "{}"), frozenset({"frame", "plunger"}),
    ),
    "mesh": Tour(
        "bearing_pole_pair", "3 A", "0.5 mm", "0.35,0.5,0.65 mm", "2,4,8 A", "0.5 T",
        NOISE.format("3 A", "0.2 A", "400 Hz", "{}"), frozenset({"core", "armature"}),
        ("--thermal-resistance", "1.5 K/W"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", TOURS)
def test_a_kind_goes_through_every_command(msl_fem: Run, tmp_path: Path, kind: str) -> None:
    """Eight commands on one coarse table, each against another; the record is too short for a search of causes.

    That search knows the table alone and no magnet; docs/kinds.md has the verdicts of whole records.
    """
    tour = TOURS[kind]
    file = str(ROOT / "geometries" / f"{tour.file}.toml")
    point = ("--current", tour.current, "--gap", tour.gap)
    coarse = ("--accuracy", "fast", "--workers", "1", "--json")
    table, map_file, record = (str(tmp_path / name) for name in ("t.nc", "map.json", "record"))

    solved = msl_fem("solve", file, *point, "--accuracy", "fast", "--json").json
    assert set(solved["flux_density_T"]) == tour.sections
    made = msl_fem("table", file, "-o", table, "--gaps", tour.gaps, "--currents", tour.currents, *coarse).json
    assert made["failed"] == 0
    assert str(read_table(table).provenance["solver"]).startswith("axisymmetric") == (kind in ROUND)
    looked = msl_fem("lookup", table, *point, "--json").json
    assert looked["force_N"] == pytest.approx(solved["force_N"], rel=0.02)

    few = ("--levels", tour.level, "--gaps", tour.gap)
    ends = ("--levels", tour.level, "--gaps", f"{tour.gap}, {tour.gaps.split(',')[-1]}".replace(" mm,", ","))
    mapped = msl_fem("map", file, "-o", map_file, *ends, *coarse).json
    judged = msl_fem("guard", map_file, *point, "--json").json
    largest = max(section["mean"] for section in solved["flux_density_T"].values())
    assert (judged["region"] == "preferred") == (largest < mapped["levels_T"][0])

    lost = msl_fem(
        "losses", file, "--table", table, *point, "--amplitude", "0.1 A", "--frequency", "50 Hz", "--json", *tour.losses
    ).json
    assert {section["name"] for section in lost["sections"]} == tour.sections
    assert lost["copper_loss_W"] > 0
    varied = msl_fem("tolerances", file, *few, *point, "--samples", "20", "--checks", "0", *coarse)
    assert varied.json["force_N"] == pytest.approx(solved["force_N"], rel=0.02)
    assert "gap" in {one["name"] for one in varied.json["sensitivities"]}

    runs = [f"--excitation={tour.excitation.format(role)}" for role in ("fit", "held-out")]
    simulated = msl_fem("simulate", file, "--table", table, "--rate", "5 kHz", *runs, "-o", record, "--json")
    assert simulated.status == 0, simulated.stderr
    verdict = msl_fem("diagnose", record, "--table", table, "--json").json
    assert verdict["verdict"] == "undecidable"
    assert "at least 3000 in 0.5 s are needed" in verdict["reason"]
