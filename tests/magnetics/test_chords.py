"""The allowance against curves that are known: chords through the reduced nodes stay below."""

import numpy as np
import pytest

from msl_fem.magnetics.field_map.level_map import chord_allowance, neighbours_counted


def reduced_chord(gap, curve, slope, at, section=None):
    current = curve(gap)[None]
    names = section or (("leg",) * gap.size,)
    allowance = chord_allowance(gap, current, slope(gap)[None], error=np.zeros_like(current), section=names)
    return np.interp(at, gap, (current - allowance)[0]), allowance[0]


@pytest.mark.parametrize("n", [2, 3, 6, 12])
@pytest.mark.parametrize("power", [0.6, 1.0, 1.4, 2.0, 4.0])
def test_chords_stay_below_convex_and_concave_curves(n, power):
    gap, at = np.geomspace(0.1, 1.0, n), np.linspace(0.1, 1.0, 500)
    limit, allowance = reduced_chord(gap, lambda g: g**power, lambda g: power * g ** (power - 1), at)
    assert (limit <= at**power + 1e-12).all()
    if power <= 1:
        assert allowance == pytest.approx(0, abs=1e-12)


def test_chords_stay_below_random_smooth_curves():
    """Also with turning points: cubics and sines between the nodes."""
    generator, at = np.random.default_rng(8), np.linspace(0.1, 1.0, 1000)
    for _ in range(200):
        a, b, c = generator.uniform(-1, 1, 3)
        gap = np.sort(np.r_[0.1, generator.uniform(0.12, 0.98, 5), 1.0])

        def curve(g, a=a, b=b, c=c):
            return 3 * g + a * g**2 + b * g**3 + 0.1 * np.sin(4 * c * g)

        def slope(g, a=a, b=b, c=c):
            return 3 + 2 * a * g + 3 * b * g**2 + 0.4 * c * np.cos(4 * c * g)

        assert (reduced_chord(gap, curve, slope, at)[0] <= curve(at) + 1e-12).all()


def test_a_change_of_the_loading_section_may_bend_a_chord_more():
    """The curve is the smaller of two, each convex; the change of section doubles the sag that is counted."""
    gap, at = np.array([0.0, 1.0]), np.linspace(0, 1, 200)

    def curve(g):
        return np.minimum(2 + 2 * g**4, 1.9 + 2.1 * g)

    slope = np.array([2.1, 8.0])
    names = (("leg", "yoke"),)
    limit, _ = reduced_chord(gap, curve, lambda g: slope, at, names)
    assert (limit <= curve(at) + 1e-12).all()
    one = chord_allowance(gap, curve(gap)[None], slope[None], error=np.zeros((1, 2)), section=(("leg", "leg"),))
    two = chord_allowance(gap, curve(gap)[None], slope[None], error=np.zeros((1, 2)), section=names)
    np.testing.assert_allclose(two, 2 * one)


def test_errors_add_and_the_end_of_the_map_needs_no_slope():
    gap = np.array([1.0, 2.0, 3.0])
    current, slope = np.array([[1.0, 2.0, 2.5]]), np.array([[1.0, 1.0, np.nan]])
    error = np.array([[0.01, 0.02, 0.0]])
    allowance = chord_allowance(gap, current, slope, error=error, section=(("leg",) * 3,))
    np.testing.assert_allclose(allowance, [[0.02, 0.02, 0.02]])


def test_an_error_that_passes_through_zero_counts_as_its_neighbours_relative_one():
    current, error = np.array([[1.0, 2.0, 4.0, np.nan]]), np.array([[0.01, 0.0, 0.02, 0.0]])
    np.testing.assert_allclose(neighbours_counted(current, error), [[0.01, 0.02, 0.02, 0.0]])
