"""Cells of degree five from derivatives at nodes: exact for such polynomials, of sixth order for others."""

import numpy as np
import pytest

from msl_fem.computing.quintic_cell import AT_NODE, N_CELL, ORDERS, PADDED, ends_to_powers, expanded

AXES = np.array([0.1, 0.4]), np.array([-1.0, 0.5, 2.0]), np.array([3.0, 3.2])


def test_a_polynomial_of_degree_five_is_given_back() -> None:
    rng = np.random.default_rng(5)
    factors = [np.polynomial.Polynomial(rng.normal(size=6)) for _ in AXES]
    at_nodes = [np.array([factor.deriv(k)(nodes) if k else factor(nodes) for k in range(ORDERS)])
                for factor, nodes in zip(factors, AXES, strict=True)]  # fmt: skip
    nodes = np.einsum("ax,by,cz->xyzacb", *at_nodes).reshape(*(axis.size for axis in AXES), AT_NODE)
    cells = expanded(*AXES, nodes)
    assert cells.shape == (2, N_CELL)
    for cell, second in zip(cells, AXES[1][:-1], strict=True):
        begins = AXES[0][0], second, AXES[2][0]
        powers = [
            factor(np.polynomial.Polynomial([begin, 1])).coef for factor, begin in zip(factors, begins, strict=True)
        ]
        exact = np.einsum("p,k,q->pkq", powers[0], powers[2], powers[1])
        given = cell.reshape(6, 6, PADDED)
        at_end = [length ** np.arange(6) for length in (0.3, 0.2, 1.5)]  # what a power has grown to at the cell's end
        weights = np.einsum("p,k,q->pkq", *at_end)
        largest = np.abs(weights * exact).max()
        np.testing.assert_allclose(weights * given[:, :, :6], weights * exact, rtol=0, atol=1e-10 * largest)
        assert not given[:, :, 6:].any()


@pytest.mark.parametrize("function", [(np.sin, np.cos, lambda x: -np.sin(x))])
def test_the_error_falls_with_the_sixth_power_of_the_length(function) -> None:
    f, slope, curvature = function
    errors = []
    for length in (0.8, 0.4):
        cell = np.zeros(36 * 6)
        cell[:6] = [f(1.0), slope(1.0), curvature(1.0), f(1 + length), slope(1 + length), curvature(1 + length)]
        ends_to_powers(cell, 1, 36, 6, length)
        y = np.linspace(0, length, 41)
        errors.append(np.abs(np.polynomial.polynomial.polyval(y, cell[:6]) - f(1 + y)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.15)
