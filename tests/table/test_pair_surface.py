"""The surface over a position and two currents: order, smoothness, and what must not be evaluated."""

import numpy as np
import pytest

from msl_fem.computing.arrays import Array
from msl_fem.table.pair_surface import CORNERS, DERIVATIVES, PairSurface, fit_pair_surface


def truth(x: Array, i: Array, j: Array, name: str) -> Array:
    """A derivative of sin(1.3 x + 0.2) exp(0.4 i) cos(0.7 j + 0.1)."""
    n_x, n_1, n_2 = (name.count(letter) for letter in "x12")
    along_x = np.sin(1.3 * x + 0.2 + n_x * np.pi / 2) * 1.3**n_x
    along_2 = np.cos(0.7 * j + 0.1 + n_2 * np.pi / 2) * 0.7**n_2
    return np.asarray(along_x * 0.4**n_1 * np.exp(0.4 * i) * along_2)


def surface(n: int) -> PairSurface:
    axes = np.linspace(-1, 1, n), np.linspace(-1, 1.5, n + 1), np.linspace(-2, 2, n + 2)
    grid = np.meshgrid(*axes, indexing="ij")
    return fit_pair_surface(*axes, {name: truth(*grid, name) for name in CORNERS})


def points(n: int = 300) -> Array:
    return np.random.default_rng(0).uniform([-1, -1, -2], [1, 1.5, 2], (n, 3)).T


def test_it_converges_with_its_order() -> None:
    """Values with h^6, slopes with h^5, second derivatives with h^4, the ends' own conditions included."""
    at = points()
    error = np.array([[np.abs(row - truth(*at, name)).max() for row, name in
                       zip(surface(n)(*at), DERIVATIVES, strict=True)] for n in (9, 17)])  # fmt: skip
    order = np.log2(error[0] / error[1])
    assert order[0] > 5.5
    assert (order[1:4] > 4.5).all()
    assert (order[4:] > 3.5).all()


def test_it_takes_the_nodes_values_and_slopes() -> None:
    fitted = surface(5)
    x, i, j = (v.ravel() for v in np.meshgrid(fitted.position, fitted.current_1, fitted.current_2, indexing="ij"))
    rows = dict(zip(DERIVATIVES, fitted(x, i, j), strict=True))
    for name in set(CORNERS) - {"x12"}:
        assert rows[name] == pytest.approx(truth(x, i, j, name), abs=1e-12), name


def test_first_and_second_derivatives_are_continuous_across_a_node() -> None:
    fitted = surface(7)
    for axis, nodes in enumerate((fitted.position, fitted.current_1, fitted.current_2)):
        at = [np.array([0.13, 0.13])] * 3
        at[axis] = nodes[2] + np.array([-1e-9, 1e-9])
        before, after = fitted(*at).T
        assert before == pytest.approx(after, abs=1e-7)


def test_rows_are_derivatives_of_one_another() -> None:
    fitted, at, h = surface(6), points(20) * 0.9, 1e-5
    rows = dict(zip(DERIVATIVES, fitted(*at), strict=True))
    for axis, letter in enumerate("x12"):
        step = np.zeros((3, 1))
        step[axis] = h
        after, before = (dict(zip(DERIVATIVES, fitted(*(at + sign * step)), strict=True)) for sign in (1, -1))
        for name in ("", "x", "1", "2"):
            key = next(k for k in DERIVATIVES if sorted(k) == sorted(name + letter))
            assert (after[name] - before[name]) / (2 * h) == pytest.approx(rows[key], abs=1e-7), (name, letter)


def test_outside_is_not_a_number() -> None:
    fitted = surface(5)
    assert np.isnan(fitted(np.array([1.01]), np.array([0.0]), np.array([0.0]))).all()
    assert np.isnan(fitted(np.array([0.0]), np.array([np.nan]), np.array([0.0]))).all()


def test_few_points_and_many_are_the_same() -> None:
    fitted, at = surface(5), points(150)
    assert np.array_equal(fitted(*at)[:, :20], fitted(*at[:, :20]))
