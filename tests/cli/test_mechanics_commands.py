"""The commands flexure, gap-trade and tolerances: their fields, tables, pages, and refusals in one line."""

from collections.abc import Callable
from pathlib import Path

import pytest
from cli_paths import E1, ROOT, SERVO, TABLE

FLEXURE = str(ROOT / "geometries" / "fast_tool_servo_flexure.toml")
Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
FEW = ("--gaps", "0.3,0.6 mm", "--levels", "1.2 T", "--samples", "200", "--checks", "2", "--workers", "1")


def test_flexure(msl_fem: Run, tmp_path: Path) -> None:
    page = tmp_path / "flexure.html"
    found = msl_fem("flexure", FLEXURE, "--bandwidth", "100 Hz", "-o", str(page), "--json").json
    assert found["stiffness_N_per_m"] == pytest.approx(1.4e5, rel=0.01)
    assert found["first_mode_ok"] is False
    assert found["stress_ok"] is True
    assert [modes["sets"] for modes in found["modes"]] == [1, 2]
    assert min(found["modes"][1]["above_first_Hz"]) > 1000
    assert found["full_range"]["force_beam_N"] > found["full_range"]["force_linear_N"]
    assert page.read_text(encoding="utf-8").startswith("<!")
    table = msl_fem("flexure", FLEXURE)
    assert table.status == 0
    assert "the same leaves in 2 set(s)" in table.stdout


def test_a_stated_stiffness_is_told(msl_fem: Run, tmp_path: Path) -> None:
    file = tmp_path / "stated.toml"
    text = Path(FLEXURE).read_text(encoding="utf-8")
    file.write_text(text.replace('damping = "12', 'stiffness = "1.4e5 N/m"\ndamping = "12', 1), encoding="utf-8")
    told = msl_fem("flexure", str(file), "--json")
    assert told.json["stiffness_used_N_per_m"] == 1.4e5
    assert "motion.stiffness 140 kN/m counts" in told.stderr


def test_gap_trade(msl_fem: Run) -> None:
    found = msl_fem("gap-trade", SERVO, "--table", TABLE, "--amplitude", "20 um", "--json").json
    assert found["amplitude_m"] == pytest.approx(20e-6)
    assert found["range_m"][0] < found["range_m"][-1]
    assert found["bandwidth_full_range_Hz"][0] > found["bandwidth_full_range_Hz"][-1]
    assert found["level_current_A"][0] < found["level_current_A"][-1]


def test_tolerances(msl_fem: Run, tmp_path: Path) -> None:
    page = tmp_path / "tolerances.html"
    found = msl_fem("tolerances", SERVO, *FEW, "--tolerance", "gap=5 um", "-o", str(page), "--json").json
    by_name = {s["name"]: s for s in found["sensitivities"]}
    assert by_name["gap"]["tolerance"] == pytest.approx(5e-6)
    assert 0.98 < by_name["stack_depth"]["force"] < 0.999, "the stack's ends do not grow with it"
    assert by_name["gap"]["force"] < -1.5
    assert found["band"]["method"] == "linearised"
    assert found["band"]["low_A"][0][0] < found["current_A"][0][0] < found["band"]["high_A"][0][0]
    assert [p.name for p in tmp_path.iterdir()] == ["tolerances.html"], "no kept magnets are left"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("flexure", SERVO), "fast_tool_servo has no [motion.flexure]"),
        (("flexure", FLEXURE, "--bandwidth", "5 m"), "--bandwidth: unit 'm' has the wrong dimension"),
        (("gap-trade", SERVO, "--table", TABLE, "--clearance", "1 um"), "clearance 1 µm must lie within"),
        (("gap-trade", SERVO, "--table", TABLE, "--level", "99 T"), "0.001 ... 10 T"),
        (("tolerances", E1), "give --gaps"),
        (("tolerances", SERVO, "--tolerance", "legs=1 mm"), "--tolerance 'legs=1 mm': write NAME=LIMIT"),
        (("tolerances", SERVO, "--tolerance", "gap=1 kg"), "--tolerance gap: unit 'kg' has the wrong dimension"),
        (("tolerances", SERVO, "--resume"), "--resume needs -o"),
        (("tolerances", SERVO, "--gap", "1 mm"), "both --current and --gap"),
        (("tolerances", SERVO, "--samples", "1"), "samples 1 is not allowed"),
        (("tolerances", SERVO, "--gaps", "0.3,0.6 mm", "--levels", "9 T"), "9 T is not reached"),
    ],
)
def test_refusals_are_one_line(
    msl_fem: Run, arguments: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in msl_fem(*arguments, "--json").complaint
    assert list(tmp_path.iterdir()) == []
