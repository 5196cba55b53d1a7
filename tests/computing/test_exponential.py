"""Exponential and logarithm of the kernel: within an ulp, whole range and edges, and each lane equal to a number."""

import numpy as np
import pytest

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import LANES, exponential, keep, logarithm, rows_of

EDGES = [0.0, -0.0, 1.0, np.inf, -np.inf, np.nan, 5e-324, 1e-310, -1.0, 709.78, 709.79, -745.1, -745.2, -708.5, 1.7e308]


@compiled
def both(x, a, b):
    given, first, second = rows_of(x), rows_of(a), rows_of(b)
    for n in range(x.shape[0]):
        first[n] = exponential(given[n])
        second[n] = logarithm(given[n])
    keep(x)
    keep(a)
    keep(b)


def computed(x):
    a, b = np.empty_like(x), np.empty_like(x)
    both(x, a, b)
    return a, b


def arguments():
    rng = np.random.default_rng(8)
    parts = [
        rng.uniform(-745, 710, 4000),
        rng.normal(size=4000),
        10.0 ** rng.uniform(-308, 308, 4000),
        rng.uniform(0.4, 2.5, 4000),
        1 + 1e-6 * rng.normal(size=4000),
        EDGES,
    ]
    x = np.concatenate(parts)
    return np.resize(x, -(-x.size // LANES) * LANES)


@pytest.mark.parametrize("which", [0, 1], ids=["exponential", "logarithm"])
def test_errors_are_below_an_ulp(which):
    x = arguments()
    found = computed(x)[which]
    with np.errstate(all="ignore"):
        exact = (np.exp, np.log)[which](x.astype(np.longdouble))
        rounded = exact.astype(float)
    assert np.array_equal(np.isnan(found), np.isnan(rounded))
    normal = np.isfinite(rounded) & (np.abs(rounded) > 2.3e-308)
    ulps = np.abs((found[normal] - exact[normal]) / np.spacing(np.abs(rounded[normal])))
    assert ulps.max() < 1.0
    edge = ~normal & ~np.isnan(rounded)
    assert np.all(np.abs(found[edge]) < np.inf) == np.all(np.isfinite(rounded[edge]))
    assert np.array_equal(np.isinf(found), np.isinf(rounded))
    assert np.allclose(found[edge & np.isfinite(rounded)], rounded[edge & np.isfinite(rounded)], rtol=0.0, atol=1e-323)


def test_each_lane_equals_a_number_to_the_last_bit():
    x = arguments()
    for number, lane in zip(computed(x), computed(x.reshape(-1, LANES)), strict=True):
        assert np.array_equal(number, lane.ravel(), equal_nan=True)
