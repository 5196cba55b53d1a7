"""True parameters lie in their tolerances, and a table's error is smooth, as large as stated, and creates no energy."""

import numpy as np
import pytest
from bench_rigs import SERVO_TABLE
from scipy.special import eval_legendre

from msl_fem.bench.rig import (
    ERROR_TERMS,
    Factor,
    averaged,
    draw_truth,
    error_factor,
    multiplied,
    multiplied_nodes,
    true_table,
)
from msl_fem.record import Tolerance

NAMES = [name for name in Tolerance.OF_THE_RIG if name != "table"]
TOLERANCE = Tolerance()


def test_two_hundred_draws_spread_as_the_tolerances_say() -> None:
    """Normal, cut at three sigma: its standard deviation is 0.9866 sigma; 200 draws tell it to 5 %."""
    drawn = [draw_truth(TOLERANCE, None, np.random.default_rng([seed, 1])) for seed in range(200)]
    for name in NAMES:
        relative = (np.array([getattr(one, name) for one in drawn]) - 1) / getattr(TOLERANCE, name)
        assert np.abs(relative).max() <= 3.0
        assert np.abs(relative).max() > 2.0
        assert relative.std() == pytest.approx(0.9866, abs=0.15)
        assert abs(relative.mean()) < 0.25
    pairs = np.corrcoef([[getattr(one, name) for one in drawn] for name in NAMES])
    assert np.abs(pairs - np.eye(len(NAMES))).max() < 0.3


def test_tables_error_is_of_the_stated_size() -> None:
    """Root mean square over seeds and nodes of the relative error, of force or flux, whichever is larger: 0.1 %."""
    squares = []
    for seed in range(40):
        truth = draw_truth(TOLERANCE, SERVO_TABLE, np.random.default_rng([seed, 1]))
        made = multiplied(SERVO_TABLE, error_factor(SERVO_TABLE, truth.table))
        squares.append(
            [np.mean((made.nodes[n][:, 1:] / SERVO_TABLE.nodes[n][:, 1:] - 1) ** 2) for n in ("force", "flux_linkage")]
        )
    force, flux = np.sqrt(np.mean(squares, axis=0))
    assert max(force, flux) == pytest.approx(TOLERANCE.table, rel=0.2)
    assert min(force, flux) > 0.1 * TOLERANCE.table


def test_the_same_seed_draws_the_same() -> None:
    one, two = (draw_truth(TOLERANCE, SERVO_TABLE, np.random.default_rng([7, 1])) for _ in range(2))
    assert [getattr(one, n) for n in NAMES] == [getattr(two, n) for n in NAMES]
    assert (one.table == two.table).all()


def test_the_true_table_is_made_of_one_coenergy() -> None:
    """Its nodes' forces, fluxes and slopes are the derivatives of its coenergy: checked between the nodes."""
    truth = draw_truth(TOLERANCE, SERVO_TABLE, np.random.default_rng([3, 1]))
    table = true_table(SERVO_TABLE, truth)
    i, g = np.meshgrid(np.linspace(0.3, 8.0, 9), np.linspace(2e-4, 1.1e-3, 9))
    di, dg = 1e-5, 1e-10
    at = table.evaluate(i, g)
    energy = {s: table.evaluate(i, g + s * dg)["coenergy"] for s in (-1, 1)}
    assert at["force"] == pytest.approx(-(energy[1] - energy[-1]) / (2 * dg), rel=1e-5)
    energy = {s: table.evaluate(i + s * di, g)["coenergy"] for s in (-1, 1)}
    assert at["flux_linkage"] == pytest.approx((energy[1] - energy[-1]) / (2 * di), rel=1e-7)
    scale = at["force"] / SERVO_TABLE.force(i, g)
    assert np.abs(scale - truth.magnetic_scale).max() < 1e-2


def test_error_terms_derivatives() -> None:
    """Every first partial of the factor against differences between the table's own nodes."""
    table = SERVO_TABLE
    for n in range(len(ERROR_TERMS)):
        unit = np.eye(len(ERROR_TERMS))[n]
        factor = error_factor(table, unit)
        i, g = table.current, table.gap
        along_i = np.gradient(factor.value, i, axis=1, edge_order=2)
        along_g = np.gradient(factor.value, g, axis=0, edge_order=2)
        for exact, rough in ((factor.over_current, along_i), (factor.over_gap, along_g)):
            inner = np.s_[3:-3, 5:-5]
            assert np.abs(exact[inner] - rough[inner]).max() <= 0.12 * np.abs(exact).max() + 1e-9


def coenergy_with_error(i: np.ndarray, g: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """The believed coenergy times 1 + sum c P_a(u) P_b(z), from the formula alone."""
    table = SERVO_TABLE
    u = i**2 / (i**2 + (table.current[-1] / 6) ** 2)
    u = 2 * u * (1 + 1 / 36) - 1
    z = 2 * np.log(g / table.gap[0]) / np.log(table.gap[-1] / table.gap[0]) - 1
    terms = sum(
        c * eval_legendre(a, u) * eval_legendre(b, z) for c, (a, b) in zip(coefficients, ERROR_TERMS, strict=True)
    )
    return table.evaluate(i, g)["coenergy"] * (1 + terms)


def test_nodes_are_the_derivatives_of_the_product() -> None:
    """All six nodes' values of a table with large errors, by differences of the formula at inner nodes."""
    coefficients = 0.1 * np.random.default_rng(2).standard_normal(len(ERROR_TERMS))
    made = multiplied_nodes(SERVO_TABLE, error_factor(SERVO_TABLE, coefficients))
    g, i = np.meshgrid(SERVO_TABLE.gap[2:-2], SERVO_TABLE.current[6:-4], indexing="ij")
    di, dg = 2e-3 * i, 2e-3 * g

    def w(k: int, m: int) -> np.ndarray:
        return coenergy_with_error(i + k * di, g + m * dg, coefficients)

    wanted = {
        "coenergy": w(0, 0),
        "flux_linkage": (w(1, 0) - w(-1, 0)) / (2 * di),
        "force": -(w(0, 1) - w(0, -1)) / (2 * dg),
        "incremental_inductance": (w(1, 0) - 2 * w(0, 0) + w(-1, 0)) / di**2,
        "force_current_slope": -(w(1, 1) - w(1, -1) - w(-1, 1) + w(-1, -1)) / (4 * di * dg),
        "force_gap_slope": -(w(0, 1) - 2 * w(0, 0) + w(0, -1)) / dg**2,
    }
    for name, values in wanted.items():
        found = made[name][2:-2, 6:-4]
        assert np.abs(found - values).max() <= 4e-3 * np.abs(values).max(), name


def test_a_constant_factor_scales_everything() -> None:
    made = multiplied(SERVO_TABLE, Factor(np.array(1.02)))
    for name, values in SERVO_TABLE.nodes.items():
        assert made.nodes[name] == pytest.approx(1.02 * values, rel=1e-14)


def test_averaging_over_gaps() -> None:
    """Two magnets that differ by 0.1 mm to either side, at one current."""
    made = averaged(SERVO_TABLE, [-1e-4, 1e-4], [0.5, 0.5])
    i, g = np.array([0.5, 3.0]), np.array([6e-4, 4e-4])
    wanted = 0.5 * (SERVO_TABLE.force(i, g - 1e-4) + SERVO_TABLE.force(i, g + 1e-4))
    assert made.force(i, g) == pytest.approx(wanted, rel=2e-4)
    assert (wanted > SERVO_TABLE.force(i, g)).all()
