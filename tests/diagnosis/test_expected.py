"""Expected sizes: from the drawing, the tolerances and the iron's data, each held against the numbers by hand."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.diagnosis.planning.expected import USUAL, ExpectedCause, expected_causes, unexpected
from msl_fem.materials.core_loss_data import sheet_of
from msl_fem.plant.believed import PLAIN_BELIEF, Belief, BelievedValue
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.plant import plant_parameters
from msl_fem.record import Tolerance

SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
DRAWN = Belief(
    "as-designed",
    (
        BelievedValue("mutual_inductance", "share", -0.023, 0.0012, "field of both sides"),
        BelievedValue("coil_heating", "rise_per_joule", 1e-4, 3e-5, "copper"),
        BelievedValue("coil_heating", "cooling_rate", 0.005, 0.0015, "copper"),
    ),
)


def causes(drawn: Belief = DRAWN, *, known: bool = False) -> dict[str, ExpectedCause]:
    return {one.effect: one for one in expected_causes(SERVO, drawn, tolerance=Tolerance(), rate=1e4, known=known)}


def test_the_drawing_comes_first_then_tolerances() -> None:
    found = causes()
    assert found["mutual_inductance"].size == -0.023
    assert found["mutual_inductance"].source == "the drawing: field of both sides"
    assert found["coil_heating"].values == {"rise_per_joule": 1e-4, "cooling_rate": 0.005}
    assert found["gap_offset"].size == pytest.approx(0.005 * 0.6e-3)
    assert found["gap_offset"].unit == "m"
    assert found["current_sensor_error"].values == {"gain_1": 0.005, "gain_2": 0.005}
    assert causes(PLAIN_BELIEF)["mutual_inductance"].size == Tolerance().mutual_inductance


def test_of_what_is_believed_already_one_sigma_is_left() -> None:
    """Amounts alone: how fast a coil cools is a shape, and stays."""
    found = causes(known=True)
    assert found["mutual_inductance"].size == 0.0012
    assert found["coil_heating"].values == {"rise_per_joule": 3e-5, "cooling_rate": 0.005}
    assert found["gap_offset"].size == causes()["gap_offset"].size


def test_tilt_is_the_variance_of_a_gap_that_is_off_at_the_edges() -> None:
    edge = 0.005 * 0.6e-3
    over_the_face = np.linspace(-edge, edge, 20001)
    assert causes()["armature_tilt"].size == pytest.approx(np.var(over_the_face), rel=1e-3)


def test_coercive_current_follows_from_the_loop_of_the_irons_loss() -> None:
    """The loop drawn by that half-width, integrated, loses what the material's data say of a cycle, whole core."""
    current = causes()["magnetic_hysteresis"].size
    magnet = SERVO.magnet_kind()
    assert 5e-3 < current < 5e-2, "M-19 has some 40 A/m, the path some 0.1 m, the coil 200 turns"
    coefficients = sheet_of("m19").coefficients
    per_volume = coefficients.density * coefficients.hysteresis  # J/m3 of a cycle at 1 T
    up, down = np.linspace(-1, 1, 1001), np.linspace(1, -1, 1001)
    length = sum(part.length for part in magnet.circuit.parts)
    width = current * magnet.turns / length  # A/m: the mean coercive field of the path
    loop = np.trapezoid(np.full(1001, width), up) + np.trapezoid(np.full(1001, -width), down)
    assert loop == pytest.approx(per_volume, rel=1e-6)
    assert causes()["remanent_flux"].values == {"current_1": current, "current_2": current}


def test_what_nothing_makes_likely_is_left_out_and_said() -> None:
    plant = plant_parameters(SERVO)
    assert set(unexpected(plant)) == {"drive_limit", "thermal_history", "coulomb_friction"}
    assert "coulomb_friction" not in unexpected(plant._replace(stiffness=0.0))
    assert set(causes()) == set(CATALOGUE) - set(unexpected(plant))
    usual = [one for one in causes().values() if one.source == USUAL]
    assert all(one.size > 0 for one in usual)
    assert causes()["structural_mode"].values["frequency"] == pytest.approx(3 * 62.77, rel=1e-2)
