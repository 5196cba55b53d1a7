"""`solve` of both magnets with their armature, and of a magnet given by a mesh."""

from collections.abc import Callable

import pytest
from cli_paths import E1
from conftest import ROOT

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
SERVO = str(ROOT / "geometries" / "fast_tool_servo.toml")
U_CORE = str(ROOT / "geometries" / "u_core.toml")
BOTH = ("--current", "5 A", "--current-2", "2 A", "--gap", "0.5 mm", "--gap-2", "0.5 mm")


def test_both_magnets_meet_the_reference(msl_fem: Run) -> None:
    found = msl_fem("solve", E1, *BOTH, "--json").json
    assert found["net_force_N"] == pytest.approx(167.4008, rel=1e-3)
    assert found["flux_linkage_1_Wb"] == pytest.approx(0.061059387, rel=1e-3)
    assert found["flux_linkage_2_Wb"] == pytest.approx(0.028440668, rel=1e-3)
    assert found["torque_Nm"] == 0


def test_a_negative_second_current_opposes(msl_fem: Run) -> None:
    opposing = [a if a != "2 A" else "-2 A" for a in BOTH]
    found = msl_fem("solve", E1, *opposing, "--accuracy", "fast", "--json").json
    assert found["net_force_N"] == pytest.approx(168.56826, rel=1e-2)
    assert found["flux_linkage_2_Wb"] == pytest.approx(-0.023782739, rel=1e-2)


def test_what_each_polarity_costs_is_said(msl_fem: Run) -> None:
    """At 1.2 T on both sides in the middle: the armature of the servo saturates under opposing currents alone."""
    where = ("--gap", "0.5 mm", "--gap-2", "0.7 mm", "--accuracy", "fast", "--json")
    found = msl_fem("solve", SERVO, "--current", "3.4 A", "--current-2", "4.4 A", *where).json["polarity"]
    assert found["of_these_currents"] == "aiding"
    assert found["of_the_actuator"] == "opposing"
    assert found["opposing"]["force_error_of_sides_apart"] > 0.03
    assert abs(found["aiding"]["force_error_of_sides_apart"]) < 0.003
    one_side = msl_fem("solve", SERVO, "--current", "3.4 A", "--current-2", "0 A", *where).json
    assert "polarity" not in one_side


def test_tilt_gives_a_torque(msl_fem: Run) -> None:
    found = msl_fem("solve", E1, *BOTH, "--tilt", "1 mrad", "--accuracy", "fast", "--json").json
    assert found["tilt_rad"] == 1e-3
    assert found["torque_Nm"] == pytest.approx(0.0844, rel=0.02)


def test_a_mesh_has_its_own_gap(msl_fem: Run) -> None:
    alone = msl_fem("solve", U_CORE, "--current", "1 A", "--json").json
    stated = msl_fem("solve", U_CORE, "--current", "1 A", "--gap", "0.5 mm", "--json").json
    assert alone == stated
    assert alone["force_N"] == pytest.approx(22.744, rel=1e-3)
    assert alone["gap_m"] == 5e-4


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((E1, "--current", "5 A"), "--gap is missing"),
        ((E1, *BOTH[:-2]), "both gaps are needed"),
        ((E1, *BOTH[:2], *BOTH[4:]), "--current-2 is missing"),
        ((E1, *BOTH, "--tilt", "1 mm"), "--tilt: unit 'mm' has the wrong dimension"),
        ((E1, *BOTH, "--picture", "a.png"), "--picture and --vtu"),
        ((U_CORE, "--current", "1 A", "--gap", "5 mm"), "gap 5 mm is not allowed"),
        ((U_CORE, *BOTH), "none to share"),
    ],
)
def test_what_does_not_belong_together_is_refused(msl_fem: Run, arguments: tuple[str, ...], said: str) -> None:
    assert said in msl_fem("solve", *arguments).complaint
