"""The guard's regions: conservative against the closed form, equal in all its forms, and with reasons."""

import dataclasses
import math

import numpy as np
import pytest
from conftest import closed_form_table
from test_operating_map import true_current

from msl_fem.maps import operating_map
from msl_fem.maps.guard import REGIONS, Guard, limit_at, region_of


@pytest.fixture(scope="module")
def guard() -> Guard:
    return Guard(operating_map(closed_form_table()))


@pytest.mark.parametrize(("n_gap", "n_current"), [(6, 12), (10, 8), (20, 20)])
def test_no_random_gap_has_a_limit_above_the_true_curve(n_gap, n_current):
    """Chords lie above a convex curve, so plain interpolation fails this."""
    guard = Guard(operating_map(closed_form_table(n_gap=n_gap, n_current=n_current)))
    gap = np.random.default_rng(3).uniform(0.05e-3, 1.2e-3, 400)
    limit = guard.limit(gap)
    for k, level in enumerate((1.2, 1.6)):
        truth = np.array([true_current(g, level) for g in gap])
        assert (limit[k] <= truth).all()
        assert (limit[k] > 0.5 * truth).all()


def test_the_allowance_costs_little_current(guard):
    gap = np.random.default_rng(4).uniform(0.05e-3, 1.2e-3, 200)
    for k, level in enumerate((1.2, 1.6)):
        truth = np.array([true_current(g, level) for g in gap])
        assert (guard.limit(gap)[k] > 0.995 * truth).all()


def test_regions_on_either_side_of_the_limits(guard):
    first, last = guard.limit(0.5e-3)
    for current, region in (
        (0.0, "preferred"),
        (first, "preferred"),
        (first + 1e-9, "discouraged"),
        (last, "discouraged"),
        (last + 1e-9, "unacceptable"),
        (-first, "preferred"),
        (-last - 1e-9, "unacceptable"),
    ):
        assert guard.classify(current, 0.5e-3) == region
        margin = guard.margin(current, 0.5e-3)
        assert margin == pytest.approx(last - abs(current), abs=1e-15)
        assert (margin < 0) == (region == "unacceptable")


@pytest.mark.parametrize(
    ("current", "gap", "said"),
    [
        (math.nan, 0.5e-3, "the current is not a number"),
        (1.0, math.nan, "the gap is not a number"),
        (1.0, 0.04e-3, "outside the map's 0.05 ... 1.2 mm"),
        (1.0, -1.0, "outside the map's"),
        (1.0, math.inf, "outside the map's"),
        (12.5, 1.19e-3, "beyond the map's end at 12 A"),
        (math.inf, 0.5e-3, "beyond the map's end"),
        (11.0, 0.5e-3, "1.6 T"),
    ],
)
def test_what_cannot_be_judged_is_unacceptable_with_a_reason(guard, current, gap, said):
    judged = guard.judge(current, gap)
    assert judged.region == "unacceptable"
    assert said in judged.reason
    if not 0.05e-3 <= gap <= 1.2e-3:
        assert judged.limits is None
        assert judged.margin is None


def test_json_of_a_judgement(guard):
    content = guard.judge(4.0, 0.6e-3).to_json()
    first, last = guard.limit(0.6e-3)
    assert content["region"] == "discouraged"
    assert content["limits_A"] == [first, last]
    assert content["margin_A"] == pytest.approx(last - 4.0)
    assert "1.2 T" in content["reason"]
    assert "centre leg" in content["reason"]
    assert guard.judge(0.1, 0.6e-3).to_json()["region"] == "preferred"
    assert "below" in guard.judge(0.1, 0.6e-3).reason


def test_where_a_level_is_not_reached_the_end_of_the_map_is_the_limit(table):
    guard = Guard(operating_map(table, levels=(1.2, 1.9)))
    judged = guard.judge(11.9, 1.19e-3)
    assert judged.region == "discouraged"
    assert "1.9 T not reached below 12 A" in judged.reason
    assert guard.judge(12.1, 1.19e-3).region == "unacceptable"
    never = np.flatnonzero(np.isnan(guard.operating_map.current[1]))
    gap = np.random.default_rng(5).uniform(table.gap[never[0] - 1], table.gap[never[0]], 50)
    truth = np.array([true_current(g, 1.9) for g in gap])
    assert (guard.limit(gap)[1] <= np.where(np.isnan(truth), 12.0, truth)).all()


def test_arrays_and_the_compiled_functions_say_the_same(guard):
    rng = np.random.default_rng(6)
    current, gap = rng.uniform(-13, 13, 500), rng.uniform(0.0, 1.3e-3, 500)
    current[::50], gap[::70] = np.nan, np.nan
    names = guard.classify(current, gap)
    assert [REGIONS[region_of(guard.arrays, i, g)] for i, g in zip(current, gap, strict=True)] == names.tolist()
    assert [guard.judge(i, g).region for i, g in zip(current[:60], gap[:60], strict=True)] == names[:60].tolist()
    assert set(names) == set(REGIONS)
    limits = guard.limit(gap)
    for k in range(2):
        np.testing.assert_array_equal(limits[k], [limit_at(guard.arrays, k, g) for g in gap])
    assert guard.limit(gap.reshape(10, 50)).shape == (2, 10, 50)
    assert guard.classify(current.reshape(10, 50), gap.reshape(10, 50)).shape == (10, 50)
    assert guard.classify(1.0, gap).shape == (500,)


def test_three_levels_and_one(table):
    three, one = Guard(operating_map(table, levels=(0.8, 1.2, 1.6))), Guard(operating_map(table, levels=(1.2,)))
    limit = three.limit(0.5e-3)
    assert three.classify(limit[1], 0.5e-3) == three.classify(limit[1] * 1.01, 0.5e-3) == "discouraged"
    assert three.classify(limit[2] * 1.01, 0.5e-3) == "unacceptable"
    only = one.limit(0.5e-3)[0]
    assert one.classify(only, 0.5e-3) == "preferred"
    assert one.classify(only * 1.01, 0.5e-3) == "unacceptable"


def test_no_level_has_a_limit_above_the_next(table):
    plain = operating_map(table)
    coarse = dataclasses.replace(plain, allowance=np.stack([plain.allowance[0], plain.current[1] * 0.9]))
    limit = Guard(coarse).limit(np.random.default_rng(7).uniform(0.05e-3, 1.2e-3, 1000))
    assert (limit[0] <= limit[1] * (1 + 1e-15)).all()
    assert (limit >= 0).all()
    assert (limit[0] < plain.current[0, 0]).any()
