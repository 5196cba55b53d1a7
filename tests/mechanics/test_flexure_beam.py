"""The beam model: closed forms of textbooks, its order, the stretched beam's exact solution, and buckling."""

import math

import numpy as np
import pytest

from msl_fem.actuator import Leaf, Placement, flexure_material
from msl_fem.errors import ComputationError, InputError
from msl_fem.mechanics.flexure_beam import CLAMPED, FREE, GUIDED, SUPPORTED, LeafBeam, plane_modes

LEAF = Leaf(54e-3, 25e-3, 1e-3, flexure_material("spring_steel"))
EI, L = LEAF.bending_rigidity, LEAF.length
SPEED = math.sqrt(EI / (LEAF.mass / L)) / L**2 / (2 * math.pi)  # Hz


def order(errors: list[float]) -> float:
    return math.log2(abs(errors[-2] / errors[-1]))


def test_the_ends_stiffness_is_that_of_the_textbook() -> None:
    """Cantilever and guided beam: cubics solve both exactly."""
    k = LeafBeam(LEAF, 3).tip_stiffness()
    assert k == pytest.approx(EI / L**3 * np.array([[12, -6 * L], [-6 * L, 4 * L**2]]), rel=1e-9)
    assert np.linalg.inv(k)[0, 0] == pytest.approx(L**3 / (3 * EI), rel=1e-9), "cantilever"
    assert k[0, 0] == pytest.approx(LEAF.stiffness, rel=1e-9), "guided"


@pytest.mark.parametrize(
    ("base", "tip", "roots"),
    [
        (CLAMPED, CLAMPED, (4.730040745, 7.853204624)),
        (CLAMPED, FREE, (1.875104069, 4.694091133)),
        (CLAMPED, SUPPORTED, (3.926602312, 7.068582745)),
        (CLAMPED, GUIDED, (2.365020372, 5.497803919)),
    ],
)
def test_frequencies_are_the_textbooks_at_fourth_order(
    base: tuple[str, ...], tip: tuple[str, ...], roots: tuple[float, ...]
) -> None:
    """Roots of the frequency equations: Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1."""
    for mode, root in enumerate(roots):
        errors = [LeafBeam(LEAF, n).frequencies(base, tip)[mode] / (SPEED * root**2) - 1 for n in (8, 16)]
        assert 0 < errors[-1] < 1e-4, "from above: Rayleigh and Ritz"
        assert order(errors) == pytest.approx(4, abs=0.15)
    assert LeafBeam(LEAF).frequencies()[0] == pytest.approx(LEAF.first_frequency, rel=1e-5)


@pytest.mark.parametrize(
    ("base", "tip", "factor"),
    [(CLAMPED, FREE, 0.25), (CLAMPED, GUIDED, 1.0), (CLAMPED, SUPPORTED, 2.045748), (CLAMPED, CLAMPED, 4.0)],
)
def test_buckling_loads_are_eulers_at_fourth_order(base: tuple[str, ...], tip: tuple[str, ...], factor: float) -> None:
    exact = factor * math.pi**2 * EI / L**2
    errors = [LeafBeam(LEAF, n).critical_compression(base, tip) / exact - 1 for n in (4, 8)]
    assert 0 < errors[-1] < 2e-3
    assert order(errors) == pytest.approx(4, abs=0.2)


def test_the_stretched_leaf_is_the_exact_solution_at_fourth_order() -> None:
    """Two routes: Newton on elements, hyperbolic functions. At twice the thickness the linear force is a quarter."""
    x = 2e-3
    found = [LeafBeam(LEAF, n).deflect(x) for n in (8, 16)]
    for quantity, exact in (("force", LEAF.held_force(x)), ("tension", LEAF.tension(x))):
        errors = [getattr(one, quantity) / exact - 1 for one in found]
        assert 0 < errors[-1] < 3e-5
        assert order(errors) == pytest.approx(4, abs=0.15)
    assert found[-1].force > 3.5 * LEAF.stiffness * x


def test_small_displacements_give_the_cubic_term() -> None:
    x = 5e-5
    excess = LeafBeam(LEAF, 32).deflect(x).force - LEAF.stiffness * x
    assert excess == pytest.approx(LEAF.cubic_stiffness * x**3, rel=2e-3)


def test_the_beams_stress_is_the_closed_forms() -> None:
    x = 1e-4
    assert LeafBeam(LEAF).deflect(x, held_apart=False).stress == pytest.approx(LEAF.bending_stress(x), rel=1e-9)
    both = LEAF.bending_stress(x) + LEAF.membrane_stress(x)
    assert LeafBeam(LEAF).deflect(x).stress == pytest.approx(both, rel=5e-3)


def test_a_leaf_free_to_shorten_stays_linear() -> None:
    assert LeafBeam(LEAF).deflect(2e-3, held_apart=False).force == pytest.approx(LEAF.stiffness * 2e-3, rel=1e-9)


def test_a_push_softens_the_leaf_until_it_buckles() -> None:
    """The guided end's stiffness falls to 0 at Euler's load, nearly in a straight line; beyond, no shape is stable."""
    beam = LeafBeam(LEAF)
    euler = LEAF.critical_compression
    approach = euler * L / LEAF.axial_rigidity
    soft = beam.deflect(1e-6, approach=0.9 * approach).force / 1e-6
    assert soft == pytest.approx(0.1 * LEAF.stiffness, rel=0.03)
    with pytest.raises(ComputationError, match="the leaf buckles"):
        beam.deflect(1e-6, approach=1.1 * approach)


def test_displacements_beyond_the_theory_are_refused() -> None:
    with pytest.raises(InputError, match="a tenth of the leaf's length"):
        LeafBeam(LEAF).deflect(6e-3)


def test_a_mover_on_opposed_leaves_has_rayleighs_first_mode() -> None:
    """Mass with 13/35 of the leaves: within 1e-5 where the leaves weigh a percent; always from above."""
    places = [Placement(0.0, side * 0.02, 0.0, side) for side in (1, -1)]
    mass = 100 * LEAF.mass
    modes = plane_modes(LEAF, places, mass=mass, inertia=1.0)
    first = min((m for m in modes if m.name == "motion"), key=lambda m: m.frequency)
    rayleigh = math.sqrt(2 * LEAF.stiffness / (mass + 2 * 13 / 35 * LEAF.mass)) / (2 * math.pi)
    assert first.frequency == pytest.approx(rayleigh, rel=1e-5)
    assert first.frequency < rayleigh
    own = [m.frequency for m in modes if m.name == "leaves"][:2]
    assert own == pytest.approx([LEAF.first_frequency] * 2, rel=3e-3)
