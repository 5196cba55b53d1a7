"""Other curves through an iron's points are admissible irons and pass through the points."""

import numpy as np
import pytest

from msl_fem.magnetics.field_map.gap_levels import other_curves
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import Iron, laminated, load_iron


@pytest.mark.parametrize("name", ["m19", "steel_1010", "vanadium_permendur"])
@pytest.mark.parametrize("stacking", [1.0, 0.94])
def test_they_pass_through_the_points_and_are_monotone(name, stacking):
    iron = laminated(load_iron(name), stacking)
    assert isinstance(iron, Iron)
    others = [other for other, share in other_curves(iron) if share == 1]
    assert len(others) == 2
    b = np.linspace(0, 1.2 * iron.tail_from, 4001)
    for other in others:
        np.testing.assert_allclose(other.magnetise(iron.flux_density)[0], iron.field_strength, rtol=1e-9, atol=1e-9)
        h, slope = other.magnetise(b)
        assert (slope > 0).all()
        assert (np.diff(h) > 0).all()
        assert other.stacking_factor == stacking
        assert (slope < 1.5 / MU_0).all()


def test_they_differ_between_the_points_and_agree_on_a_straight_line():
    b = np.linspace(0, 1, 6)
    straight = Iron("straight", b, 100 * b, "test")
    for other, _ in other_curves(straight):
        np.testing.assert_allclose(other.magnetise(np.linspace(0, 1, 77))[0], 100 * np.linspace(0, 1, 77), rtol=1e-9)
    iron = load_iron("m19")
    inner = (iron.flux_density[1:] + iron.flux_density[:-1]) / 2
    h = iron.magnetise(inner)[0]
    assert max(np.abs(other.magnetise(inner)[0] / h - 1).max() for other, _ in other_curves(iron)[:2]) > 1e-3


def test_half_the_points_are_left_out_once_the_odd_and_once_the_even_ones():
    iron = load_iron("m19")
    *_, odd, even = (other.flux_density for other, _ in other_curves(iron))
    assert {*odd, *even} == set(iron.flux_density)
    assert odd.size + even.size <= iron.flux_density.size + 3
    few = Iron("few", iron.flux_density[:8], iron.field_strength[:8], "test")
    assert len(other_curves(few)) == 2


def test_a_formula_has_none():
    assert other_curves(load_iron("analytic:e1")) == ()
