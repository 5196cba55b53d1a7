"""The rigid mover's six modes: closed forms, the plane's finite elements, and what a second set of leaves does."""

import math

import pytest

from msl_fem.actuator import Leaf, Placement, flexure_material, placed
from msl_fem.mechanics import Mode, Mover, mover_modes
from msl_fem.mechanics.flexure_beam import plane_modes

LEAF = Leaf(54e-3, 25e-3, 1e-3, flexure_material("spring_steel"))
MOVER = Mover(0.9, 2.4e-4, 6e-4, 6e-4)
TWO_SETS = placed((-0.035, 0.035), per_side=1, sides=(1, -1), reach=0.02, pitch=0.025)
ONE_SET = placed((0.0,), per_side=2, sides=(1, -1), reach=0.02, pitch=0.025)


def named(modes: tuple[Mode, ...]) -> dict[str, float]:
    return {mode.name: mode.frequency for mode in modes}


def frequency(stiffness: float, mass: float) -> float:
    return math.sqrt(stiffness / mass) / (2 * math.pi)


@pytest.mark.parametrize("places", [ONE_SET, TWO_SETS], ids=["one set", "two sets"])
def test_modes_in_the_plane_are_those_of_finite_elements(places: tuple[Placement, ...]) -> None:
    rigid = named(mover_modes(LEAF, places, MOVER))
    plane = plane_modes(LEAF, places, mass=MOVER.mass, inertia=6e-4)
    for name in ("motion", "along_leaves", "pitch"):
        solved = min(mode.frequency for mode in plane if mode.name == name)
        # a mode above the leaves' own (1862 Hz) feels their dynamics: the ends' mass is then good to half a percent
        assert rigid[name] == pytest.approx(solved, rel=1e-4 if solved < 500 else 5e-3)


def test_translations_in_closed_form() -> None:
    found = named(mover_modes(LEAF, TWO_SETS, MOVER))
    wide = LEAF.material.youngs_modulus * LEAF.thickness * LEAF.width**3 / 12
    shear = 12 * wide / (5 / 6 * LEAF.material.shear_modulus * LEAF.width * LEAF.thickness * LEAF.length**2)
    moving = 0.9 + 4 * 13 / 35 * LEAF.mass
    assert found["motion"] == pytest.approx(frequency(4 * LEAF.stiffness, moving), rel=1e-12)
    sideways = 4 * 12 * wide / ((1 + shear) * LEAF.length**3)
    assert found["sideways"] == pytest.approx(frequency(sideways, moving), rel=1e-12)
    along = 4 * LEAF.axial_rigidity / LEAF.length
    assert found["along_leaves"] == pytest.approx(frequency(along, 0.9 + 4 / 3 * LEAF.mass), rel=1e-12)


def test_a_second_set_holds_the_pitch_by_the_leaves_tension() -> None:
    """Two sets at +-d/2: k_pitch = sum of E A/L (d/2)^2 and small bending terms; one set has these alone."""
    heavy = Mover(900.0, None, None, 0.6)  # leaves without mass, so to speak
    stiffness = {}
    for name, places in (("one", ONE_SET), ("two", TWO_SETS)):
        pitch = named(mover_modes(LEAF, places, heavy))["pitch"]
        stiffness[name] = 0.6 * (2 * math.pi * pitch) ** 2
    bending = 4 * LEAF.bending_rigidity / LEAF.length**3 * (4 * LEAF.length**2 + 12 * LEAF.length * 0.02 + 12 * 0.02**2)
    assert stiffness["one"] == pytest.approx(bending, rel=1e-4)
    assert stiffness["two"] - stiffness["one"] == pytest.approx(
        4 * LEAF.axial_rigidity / LEAF.length * 0.035**2, rel=1e-4
    )


def test_two_sets_move_the_second_and_third_modes_more_than_1000_hz_above_the_first() -> None:
    """What Gutierrez and Ro (1998) report of their second set of flexures; one set leaves two modes below 150 Hz."""
    one, two = mover_modes(LEAF, ONE_SET, MOVER), mover_modes(LEAF, TWO_SETS, MOVER)
    assert [mode.frequency for mode in one[:3]] == sorted(mode.frequency for mode in one)[:3]
    assert one[2].frequency < 150
    assert two[0].name == "motion"
    assert two[1].frequency - two[0].frequency > 1000
    assert two[2].frequency - two[0].frequency > 1000


def test_a_single_leaf_does_not_guide() -> None:
    """On one leaf the mover tips: motion and pitch couple, and the lowest mode is far below the guided one."""
    lone = (Placement(0.0, -0.02, 0.0, -1),)
    lowest = mover_modes(LEAF, lone, MOVER)[0]
    assert lowest.frequency < 0.6 * frequency(LEAF.stiffness, 0.9)
    assert lowest.shares["pitch"] > 0.05


def test_a_rotation_without_inertia_is_held() -> None:
    held = mover_modes(LEAF, ONE_SET, Mover(0.9, None, None, None))
    assert len(held) == 3
    assert {mode.name for mode in held} == {"motion", "along_leaves", "sideways"}
