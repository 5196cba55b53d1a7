"""Both magnets and their armature against converged values, symmetries, tilt, and what independence misses."""

import numpy as np
import pytest
from conftest import ROOT
from field_problems import reference

from msl_fem.actuator import load_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.magnet_field import solve
from msl_fem.magnetics.field.two_sided import TwoSidedField, decoupling, solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition, two_sided_section

E1 = load_actuator(ROOT / "geometries" / "e1.toml")
MIDDLE = TwoSidedPosition(5e-4, 5e-4)
ROWS = reference("coupling.csv")


@pytest.fixture(scope="module")
def middle() -> TwoSidedField:
    return TwoSidedField(E1, MIDDLE)


@pytest.mark.parametrize("row", ROWS, ids=lambda r: f"{r['i1_A']:g},{r['i2_A']:g}")
def test_against_the_converged_values(middle, row):
    """Equal signs aid; the net force is towards side 1; within 5e-4 at the normal accuracy."""
    got, _ = middle.solve(row["i1_A"], row["i2_A"])
    assert got.flux_linkage_1 == pytest.approx(row["flux1_Wb"], rel=5e-4)
    assert got.flux_linkage_2 == pytest.approx(row["flux2_Wb"], rel=5e-4)
    assert got.coenergy == pytest.approx(row["coenergy_J"], rel=5e-4)
    assert got.net_force == pytest.approx(row["net_force_y_N"], rel=5e-4, abs=0.05)
    assert got.net_force_stress_tensor == pytest.approx(got.net_force, rel=1e-3, abs=0.05)
    assert got.side_force == got.torque == 0.0


@pytest.mark.parametrize("accuracy", ["fast", "normal"])
def test_stated_error_covers_the_true_one(accuracy):
    for row in ROWS[[2, 3, 9]]:
        point = solve_two_sided(E1, (row["i1_A"], row["i2_A"]), MIDDLE, accuracy=accuracy)
        true = abs(point.quantities.net_force - row["net_force_y_N"])
        assert true <= point.force_error_estimate < (2.5 if accuracy == "fast" else 0.25)


def test_each_gap_is_graded_by_its_own_size():
    """Corner sizes are fractions of the section's gap over strength^1.5."""
    section = two_sided_section(E1.magnet, TwoSidedPosition(2e-4, 8e-4)).section
    assert section.gap == pytest.approx(2e-4)
    faces = pytest.approx(2e-4), pytest.approx(-6.8e-3)
    sizes = {round(y, 9): section.gap / strength**1.5 for _, y, strength in section.corners if y in faces}
    assert sizes == pytest.approx({2e-4: 2e-4, -6.8e-3: 8e-4})


def test_changing_sides_turns_the_force_round():
    one = TwoSidedField(E1, TwoSidedPosition(3e-4, 7e-4)).solve(4.0, -6.0)[0]
    two = TwoSidedField(E1, TwoSidedPosition(7e-4, 3e-4)).solve(-6.0, 4.0)[0]
    assert one.net_force > 50
    assert two.net_force == pytest.approx(-one.net_force, rel=1e-3)
    assert two.flux_linkage_2 == pytest.approx(one.flux_linkage_1, rel=1e-3)


def test_full_section_agrees_with_the_half(middle):
    """A tilt of nothing needs the full section and changes nothing."""
    full = TwoSidedField(E1, TwoSidedPosition(5e-4, 5e-4, 1e-9))
    assert full.model.free.size > 1.5 * middle.model.free.size
    got, want = full.solve(5.0, 2.0)[0], middle.solve(5.0, 2.0)[0]
    assert got.net_force == pytest.approx(want.net_force, rel=1e-3)
    assert got.flux_linkage_1 == pytest.approx(want.flux_linkage_1, rel=5e-4)
    assert abs(got.torque) < 1e-3
    assert abs(got.side_force) < 1e-2


def test_tilt_makes_a_torque_that_increases_it():
    """Torque = dW'/dtheta, odd in the tilt: against the coenergy's second difference, and destabilising."""
    tilt = 5e-3
    left, right = (TwoSidedField(E1, TwoSidedPosition(5e-4, 5e-4, t)).solve(5.0, 2.0)[0] for t in (tilt, -tilt))
    straight = TwoSidedField(E1, TwoSidedPosition(5e-4, 5e-4, 1e-9)).solve(5.0, 2.0)[0]
    assert left.torque > 0.3
    assert right.torque == pytest.approx(-left.torque, rel=1e-2)
    assert right.side_force == pytest.approx(-left.side_force, rel=2e-2)
    assert left.side_force == pytest.approx(-left.net_force * tilt, rel=0.4)  # the pull turns with the surface
    assert left.coenergy - straight.coenergy == pytest.approx(left.torque * tilt / 2, rel=0.05)


def test_decoupling_against_the_converged_values():
    """Shares and errors follow from the rows with one coil dead and with both."""
    rows = {(r["i1_A"], r["i2_A"]): r for r in ROWS}
    alone = rows[5, 0]
    for other in (5, -5):
        both = rows[5, other]
        got = decoupling(E1, (5.0, float(other)), MIDDLE)
        assert abs(got.linked_share_1) == pytest.approx(alone["flux2_Wb"] / alone["flux1_Wb"], rel=1e-3)
        assert got.flux_error_1 == pytest.approx(alone["flux1_Wb"] / both["flux1_Wb"] - 1, abs=2e-4)
        assert got.flux_error_2 == pytest.approx(got.flux_error_1, abs=1e-4)
        assert abs(got.force_error) < 1e-3
    alone_2 = rows[2, 0]
    got = decoupling(E1, (5.0, 2.0), MIDDLE)
    want = alone["net_force_y_N"] - alone_2["net_force_y_N"] - rows[5, 2]["net_force_y_N"]
    assert got.force_error == pytest.approx(want / alone["net_force_y_N"], abs=3e-4)
    assert got.linked_share_2 == pytest.approx(alone_2["flux2_Wb"] / alone_2["flux1_Wb"], rel=1e-3)


def test_chamfers_overhang_and_the_default_box_against_one_magnet_alone():
    """With coil 2 dead and far the net force is almost that of one magnet."""
    magnet = E1.magnet.model_copy(update={"air": None, "pole_chamfer": 1e-3, "armature_overhang": 2e-3})
    other = E1.model_copy(update={"magnet": magnet})
    alone = solve(other, 2.0, 4e-4).quantities
    got = TwoSidedField(other, TwoSidedPosition(4e-4, 15e-4)).solve(2.0, 0.0)[0]
    assert got.net_force == pytest.approx(alone.force, rel=2e-3)
    assert got.flux_linkage_1 == pytest.approx(alone.flux_linkage, rel=5e-3)


@pytest.mark.parametrize(
    ("currents", "position", "words"),
    [
        ((1.0, np.nan), MIDDLE, "current nan A"),
        ((1.0, 1.0), TwoSidedPosition(5e-4, -1e-4), "gap -100 µm is not allowed"),
        ((1.0, 1.0), TwoSidedPosition(5e-4, 5e-4, 0.03), "tilt 30 mrad brings the armature against a core.*24.5 mrad"),
        ((1.0, 1.0), TwoSidedPosition(5e-4, 5e-4, np.nan), "tilt nan rad is not allowed"),
        ((1.0, 1.0), TwoSidedPosition(5e-4, 5e-4, 1.0), "tilt 1 rad is not allowed"),
    ],
)
def test_impossible_points_are_refused(currents, position, words):
    with pytest.raises(InputError, match=words):
        solve_two_sided(E1, currents, position)


def test_unknown_accuracy_dead_coils_and_missing_cores_are_refused():
    with pytest.raises(InputError, match="fast, normal, fine"):
        solve_two_sided(E1, (1.0, 1.0), MIDDLE, accuracy="superb")
    with pytest.raises(InputError, match="needs both, not zero"):
        decoupling(E1, (1.0, 0.0), MIDDLE)
    with pytest.raises(ActuatorError, match="e-core"):
        solve_two_sided(E1.model_copy(update={"magnet": None}), (1.0, 1.0), MIDDLE)
