"""The guard is never milder than any curve through the map's currents, in exact arithmetic and at the last bit."""

import dataclasses
import math
from bisect import bisect_right
from fractions import Fraction

import numpy as np
import pytest
from conftest import closed_form_table
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import Akima1DInterpolator, CubicHermiteSpline, CubicSpline, PchipInterpolator

from msl_fem.errors import InputError
from msl_fem.maps import Guard, OperatingMap, operating_map
from msl_fem.maps.guard import REASONS, REGIONS, limit_at, margin_of, reason_of, region_of

N_POINTS = 1_000_000
CURVES = {
    "chords": lambda x, y: lambda g: np.interp(g, x, y),
    "monotone": PchipInterpolator,
    "not-a-knot": CubicSpline,
    "natural": lambda x, y: CubicSpline(x, y, bc_type="natural"),
    "slopes of parabolas": lambda x, y: CubicHermiteSpline(x, y, np.gradient(y, x)),
    "Akima": Akima1DInterpolator,
    "makima": lambda x, y: Akima1DInterpolator(x, y, method="makima"),
}


def raw_map(
    gap: object, current: object, *, current_max: float, allowance: float = 0.0, **more: object
) -> OperatingMap:
    """A map as a file may hold it, without what a table knows of sag; nan where a level is not reached."""
    i = np.array(current, dtype=float)
    return OperatingMap(
        levels=1.0 + 0.2 * np.arange(len(i)),
        gap=np.array(gap, dtype=float),
        current=i,
        section=(("yoke",) * i.shape[1],) * len(i),
        error=np.zeros_like(i),
        allowance=np.full_like(i, allowance),
        current_max=current_max,
        **more,
    )


def convex() -> OperatingMap:
    gap = np.geomspace(0.05e-3, 1.2e-3, 8)
    return raw_map(gap, [0.3 + 3e6 * gap**2, 0.8 + 5e6 * gap**2], current_max=12.0)


def wavy() -> OperatingMap:
    gap = np.linspace(0.1e-3, 1e-3, 15)
    wave = 2 + 4e3 * gap + 0.3 * np.sin(3e4 * gap)
    return raw_map(gap, [wave, wave + 0.01], current_max=7.0)


def steps() -> OperatingMap:
    return raw_map([1e-4, 2e-4, 2.0001e-4, 5e-4, 9e-4], [[1, 1, 4, 4, 4.5], [1, 1.2, 9, 9, 9]], current_max=9.0)


def from_table() -> OperatingMap:
    return operating_map(closed_form_table(n_gap=7, n_current=10), levels=(0.8, 1.5))


MAPS = {"convex": convex, "wavy": wavy, "steps": steps, "from a table": from_table}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("name", MAPS)
def test_no_region_is_milder_than_by_a_curve_through_the_raw_currents(name, curve):
    """A million random pairs, half of them within a hair of a limit of the curve."""
    raw = MAPS[name]()
    rng = np.random.default_rng(21)
    gap = rng.uniform(raw.gap[0], raw.gap[-1], N_POINTS)
    gap[::5] = rng.choice(np.r_[raw.gap, np.nextafter(raw.gap[1:-1], 0), np.nextafter(raw.gap[1:-1], 1)], gap[::5].size)
    first, last = (CURVES[curve](raw.gap, row)(gap) for row in raw.current)
    current = rng.uniform(0, 1.1 * raw.current_max, N_POINTS)
    current[::2] = np.where(rng.random(N_POINTS) < 0.5, first, last)[::2] * (
        1 + rng.uniform(0, 1e-3, N_POINTS)[::2] ** 4
    )
    region = np.where(current <= first, 0, np.where(current <= last, 1, 2))
    found = Guard(raw).regions(current * rng.choice([-1.0, 1.0], N_POINTS), gap)
    milder = np.flatnonzero(found < region)
    assert milder.size == 0, (current[milder[0]], gap[milder[0]], first[milder[0]], last[milder[0]])
    assert (found == region).mean() > 0.3, "the guard must not forbid everything"


def test_curves_with_known_slopes_count_too():
    """A map solved point by point knows dI/dgap; a Hermite cubic with steep slopes sags far below its chords."""
    plain = wavy()
    slope = np.full_like(plain.current, 4e3) + 9e3 * np.cos(3e4 * plain.gap)
    known = dataclasses.replace(plain, gap_slope=slope)
    gap = np.random.default_rng(22).uniform(plain.gap[0], plain.gap[-1], 200_000)
    for k in range(2):
        hermite = CubicHermiteSpline(plain.gap, plain.current[k], slope[k])(gap)
        assert (Guard(known).limit(gap)[k] <= hermite).all()
        assert (Guard(plain).limit(gap)[k] > hermite).any()


@pytest.mark.parametrize("seed", [0, 4, 7])
def test_where_a_level_is_not_reached_curves_of_those_reached_count(seed):
    """Their ends differ from those of the curves that go on to the map's end."""
    gap, rng = np.linspace(0.1e-3, 1e-3, 10), np.random.default_rng(seed)
    known = np.arange(10) < 8
    raw = raw_map(gap, [np.where(known, rng.uniform(1, 5, 10), np.nan)], current_max=5.0)
    x = rng.uniform(gap[0], gap[7], 100_000)
    for curve in CURVES.values():
        assert (Guard(raw).limit(x)[0] <= curve(gap[known], raw.current[0, known])(x)).all()
    assert (Guard(raw).limit(gap)[0] < 5.0).all()


def exact_chord(raw: OperatingMap, level: int, gap: float) -> Fraction:
    """The chord of the raw currents in exact arithmetic."""
    m = min(max(bisect_right(raw.gap.tolist(), gap) - 1, 0), raw.gap.size - 2)
    g0, g1, i0, i1 = (Fraction(float(v)) for v in (*raw.gap[m : m + 2], *raw.current[level, m : m + 2]))
    return i0 + (Fraction(gap) - g0) / (g1 - g0) * (i1 - i0)


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_rounding_never_lifts_a_limit_above_the_exact_chord(data):
    """Without any allowance the limit may exceed the chord by no bit, and falls short of it by few."""
    gaps = data.draw(st.lists(st.floats(1e-6, 1e-2), min_size=2, max_size=6, unique=True).map(sorted))
    currents = data.draw(st.lists(st.floats(1e-9, 10.0), min_size=len(gaps), max_size=len(gaps)))
    raw = raw_map(gaps, [currents], current_max=10.0)
    guard = Guard(raw)
    inside = data.draw(st.lists(st.floats(gaps[0], gaps[-1]), min_size=1, max_size=20))
    for gap in (*inside, *gaps, *np.nextafter(gaps[1:], 0), *np.nextafter(gaps[:-1], 1)):
        limit, chord = Fraction(float(guard.limit(gap)[0])), exact_chord(raw, 0, float(gap))
        assert limit <= chord
        if len(gaps) == 2:
            assert chord - limit <= Fraction(1, 2**44) * 10


def test_an_allowance_larger_than_a_current_is_kept_between_the_gaps():
    """A line that is negative at a node stays so: raised to zero there it would lift the whole chord."""
    raw = raw_map([1e-4, 2e-4, 3e-4], [[0.1, 3.0, 6.0]], current_max=9.0, allowance=1.0)
    guard = Guard(raw)
    x = np.linspace(1e-4, 3e-4, 1001)
    np.testing.assert_allclose(
        guard.limit(x)[0], np.maximum(np.interp(x, raw.gap, raw.current[0]) - 1.0, 0), atol=1e-12
    )
    assert guard.limit(1e-4)[0] == 0.0
    assert guard.classify(0.0, 1e-4) == "preferred"
    assert guard.classify(5e-324, 1e-4) == "unacceptable"


def slow_limit(guard: Guard, level: int, gap: float) -> float:
    """The slow, obvious twin: bisection, no buckets."""
    a = guard.arrays
    if math.isnan(gap) or gap < a.gap[0] or gap > a.gap[-1]:
        return math.nan
    m = min(bisect_right(a.gap.tolist(), gap) - 1, a.gap.size - 2)
    return max(float(a.limit[level, m]) + float(a.slope[level, m]) * (gap - float(a.gap[m])), 0.0)


@pytest.mark.parametrize(
    "gaps",
    [
        np.geomspace(1.1e-9, 10, 12),
        np.r_[1e-4, np.nextafter(1e-4, 1), np.nextafter(np.nextafter(1e-4, 1), 1), 3e-4],
        np.r_[1e-4, 3e-4 - np.arange(30)[::-1] * 1e-12],
        np.sort(np.random.default_rng(24).uniform(1e-5, 1e-3, 3000)),
        np.array([1e-4, 2e-4]),
    ],
    ids=["ten decades", "neighbouring numbers", "a crowd at the end", "three thousand", "two"],
)
def test_the_buckets_lead_to_the_interval_that_bisection_finds(gaps):
    rng = np.random.default_rng(25)
    guard = Guard(raw_map(gaps, [np.sort(rng.uniform(1, 5, gaps.size))], current_max=5.0))
    some = np.r_[rng.choice(gaps, 2000), gaps[[0, -1]], rng.uniform(gaps[0], gaps[-1], 2000)]
    some = np.r_[some, np.nextafter(some, 0), np.nextafter(some, np.inf)]
    np.testing.assert_array_equal(guard.limit(some)[0], [slow_limit(guard, 0, g) for g in some.tolist()])


@pytest.fixture(scope="module")
def guard() -> Guard:
    return Guard(operating_map(closed_form_table()))


def test_the_edges_of_the_map(guard):
    """A gap is inside up to the last bit of the ends; a current is within a limit up to its last bit."""
    nodes = guard.arrays.gap
    for end, out in ((nodes[0], 0.0), (nodes[-1], 1.0)):
        limit = guard.limit(end)
        assert np.isfinite(limit).all()
        assert guard.classify(0.0, end) == "preferred"
        outside = float(np.nextafter(end, out))
        assert guard.classify(0.0, outside) == "unacceptable"
        assert np.isnan(guard.limit(outside)).all()
        assert "gap outside" in REASONS[int(guard.reasons(0.0, outside))]
    for gap in (*nodes, *(0.5 * (nodes[1:] + nodes[:-1]))):
        first, last = guard.limit(gap)
        for sign in (-1, 1):
            assert guard.classify(sign * first, gap) == "preferred"
            assert guard.classify(sign * np.nextafter(first, 9), gap) == "discouraged"
            assert guard.classify(sign * last, gap) == "discouraged"
            assert guard.classify(sign * np.nextafter(last, 99), gap) == "unacceptable"
        assert guard.margin(last, gap) == 0
        assert guard.margin(np.nextafter(last, 99), gap) < 0


@pytest.mark.parametrize(
    ("current", "gap", "region", "reason"),
    [
        (-0.0, 5e-4, "preferred", "below the first level"),
        (5e-324, 5e-4, "preferred", "below the first level"),
        (0.0, 5e-324, "unacceptable", "gap outside the map"),
        (0.0, -0.0, "unacceptable", "gap outside the map"),
        (0.0, -5e-4, "unacceptable", "gap outside the map"),
        (0.0, math.inf, "unacceptable", "gap outside the map"),
        (math.nan, -1.0, "unacceptable", "current is not a number"),
        (0.0, math.nan, "unacceptable", "gap is not a number"),
        (-math.inf, 5e-4, "unacceptable", "current beyond the end of the map"),
        (1.7e308, 5e-4, "unacceptable", "current beyond the end of the map"),
        (11.0, 5e-4, "unacceptable", "above the last level"),
    ],
)
def test_odd_numbers_in_all_forms(guard, current, gap, region, reason):
    a = guard.arrays
    assert guard.classify(current, gap) == REGIONS[region_of(a, current, gap)] == region
    assert guard.classify(np.array([current]), gap).tolist() == [region]
    assert REASONS[reason_of(a, current, gap)] == REASONS[int(guard.reasons(current, gap))] == reason
    np.testing.assert_array_equal(guard.margin(current, gap), margin_of(a, current, gap))
    np.testing.assert_array_equal(guard.limit(gap)[1], limit_at(a, 1, gap))
    judged = guard.judge(current, gap)
    assert judged.region == region
    assert judged.margin is None or math.isfinite(judged.margin)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gap": np.array([1e-320, 2e-320, 3e-4])}, "not a magnet's, allowed are 1e-09"),
        ({"gap": np.array([1e-4, 2e-4, 1e300])}, "look at the unit"),
        ({"current_max": 1e300}, "there is no machine"),
        ({"allowance": np.array([[0.0, 1e25, 0.0]])}, "beyond 1e\\+20 A"),
    ],
)
def test_maps_of_impossible_sizes_are_refused(change, said):
    raw = raw_map([1e-4, 2e-4, 3e-4], [[1.0, 2.0, 3.0]], current_max=9.0)
    with pytest.raises(InputError, match=said):
        Guard(dataclasses.replace(raw, **change))
