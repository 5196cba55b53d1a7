"""Splines by numpy against scipy's."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import interpolate

from msl_fem.computing.arrays import Array
from msl_fem.computing.splines import (
    akima_slopes,
    b_splines,
    cubic_slopes,
    monotone_slopes,
    spline_derivative,
)

CURVES: dict[str, tuple[Callable[[Array, Array], Array], Callable[[Array, Array], interpolate.PPoly]]] = {
    "monotone": (monotone_slopes, interpolate.PchipInterpolator),
    "not-a-knot": (lambda x, y: cubic_slopes(x, y, natural=False), interpolate.CubicSpline),
    "natural": (
        lambda x, y: cubic_slopes(x, y, natural=True),
        lambda x, y: interpolate.CubicSpline(x, y, bc_type="natural"),
    ),
    "akima": (lambda x, y: akima_slopes(x, y, modified=False), interpolate.Akima1DInterpolator),
    "makima": (
        lambda x, y: akima_slopes(x, y, modified=True),
        lambda x, y: interpolate.Akima1DInterpolator(x, y, method="makima"),
    ),
}


def points(n: int, seed: int) -> tuple[Array, Array]:
    generator = np.random.default_rng(seed)
    y = generator.normal(size=n)
    if seed % 3 == 0:
        y = np.round(y)  # equal neighbours, flat pieces
    return np.cumsum(generator.uniform(0.1, 1.0, n)), np.sort(y) if seed % 2 else y


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("n", [2, 3, 4, 5, 9, 20])
def test_slopes_are_those_of_scipy(name: str, n: int) -> None:
    ours, theirs = CURVES[name]
    for seed in range(12):
        x, y = points(n, seed)
        np.testing.assert_allclose(ours(x, y), theirs(x, y)(x, 1), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("more", [1, 2, 3, 8, 15])
def test_an_interpolating_spline_is_that_of_scipy(degree: int, more: int) -> None:
    x, y = points(degree + more, more)
    spline = interpolate.make_interp_spline(x, y, k=degree)
    for order in range(1, min(degree, 2) + 1):
        scale = np.abs(spline(x, order)).max() + 1
        ours = spline_derivative(x, y, x, order, degree=degree)
        np.testing.assert_allclose(ours, spline(x, order), atol=1e-10 * scale)


def test_b_splines_and_their_derivatives_are_those_of_scipy() -> None:
    knots = np.r_[np.full(6, 0.0), np.repeat([0.2, 0.5, 0.7], 2), np.full(6, 1.0)]
    x = np.linspace(0, 1, 41)
    basis = interpolate.BSpline(knots, np.eye(knots.size - 6), 5)
    for order in range(6):
        expected = basis(x, order)
        np.testing.assert_allclose(b_splines(knots, 5, x, order), expected, atol=1e-12 * np.abs(expected).max())
