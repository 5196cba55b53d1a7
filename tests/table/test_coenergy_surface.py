"""The coenergy surface: exact at the nodes, of high order, smooth, reciprocal, conservative."""

import itertools

import numpy as np
import pytest
from conftest import closed_form_table, saturating_reluctance
from field_problems import observed_order

from msl_fem.table.coenergy_surface import CoenergySurface, evaluate, evaluate_slopes, fit_coenergy_surface
from msl_fem.table.magnetic_table import NODES, MagneticTable

RNG_SEED = 4


def surface_of(n_gap: int, n_current: int) -> CoenergySurface:
    return closed_form_table(n_gap=n_gap, n_current=n_current).surface


def random_points(table: MagneticTable, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Currents of either sign and gaps over the whole rectangle."""
    rng = np.random.default_rng(RNG_SEED)
    return rng.uniform(-table.current[-1], table.current[-1], n), rng.uniform(table.gap[0], table.gap[-1], n)


def partial(surface: CoenergySurface, current: float, gap: float, *, by_gap: int, by_current: int) -> float:
    """A derivative of W' straight from the coefficients of the cell, for i >= 0."""
    m = int(np.clip(np.searchsorted(surface.gap, gap) - 1, 0, surface.gap.size - 2))
    n = int(np.clip(np.searchsorted(surface.current, current) - 1, 0, surface.current.size - 2))
    polynomial = surface.coefficients[m, n]
    for axis, times in ((0, by_gap), (1, by_current)):
        polynomial = np.polynomial.polynomial.polyder(polynomial, times, axis=axis)
    return float(np.polynomial.polynomial.polyval2d(gap - surface.gap[m], current - surface.current[n], polynomial))


def test_nodes_are_met(table):
    current, gap = np.meshgrid(table.current, table.gap)
    got = dict(zip(NODES, table.surface(current, gap), strict=True))
    for name in ("coenergy", "flux_linkage", "force", "force_current_slope"):
        assert np.abs(got[name] - table.nodes[name]).max() <= 1e-11 * np.abs(table.nodes[name]).max(), name
    for name, edge in (("incremental_inductance", np.s_[:, -1]), ("force_gap_slope", np.s_[[0, -1], :])):
        wanted = table.nodes[name][edge]
        assert np.abs(got[name][edge] - wanted).max() < 1e-9 * np.abs(wanted).max(), name


@pytest.fixture(scope="module")
def mean_errors() -> dict[str, np.ndarray]:
    """Mean error of each quantity over the rectangle, on 41 x 41 and on 81 x 81 nodes."""
    current, gap = random_points(closed_form_table(), 4000)
    truth = saturating_reluctance(np.abs(current), gap)
    for odd in ("flux_linkage", "force_current_slope"):
        truth[odd] = np.sign(current) * truth[odd]
    found = [dict(zip(NODES, surface_of(n, n)(current, gap), strict=True)) for n in (41, 81)]
    return {name: np.array([np.abs(f[name] - truth[name]).mean() for f in found]) for name in NODES}


@pytest.mark.parametrize(
    ("name", "order"),
    [("coenergy", 6), ("force", 5), ("force_current_slope", 5), ("incremental_inductance", 4), ("force_gap_slope", 4)],
)
def test_order_of_convergence(mean_errors, name, order):
    """Quintic in each direction: order 6 in W', one less with each derivative along one direction."""
    assert observed_order(mean_errors[name]) == pytest.approx(order, abs=0.15)


def test_every_output_is_a_derivative_of_one_function(table):
    """Against the cell's polynomial, differentiated independently."""
    orders = {0: (0, 0, 1), 1: (0, 1, 1), 2: (1, 0, -1), 3: (0, 2, 1), 4: (1, 1, -1), 5: (2, 0, -1)}
    current, gap = random_points(table, 60)
    for i, g in zip(np.abs(current), gap, strict=True):
        got = table.surface(i, g)
        for row, (by_gap, by_current, sign) in orders.items():
            wanted = sign * partial(table.surface, i, g, by_gap=by_gap, by_current=by_current)
            assert got[row] == pytest.approx(wanted, rel=1e-10, abs=1e-14), list(NODES)[row]


def test_force_and_flux_are_reciprocal(table):
    """dF/di == -dlambda/dgap, or the table creates energy from nothing; differences exact for a cell's quintic."""
    current, gap = random_points(table, 300)
    inside = np.searchsorted(table.gap, gap) - 1
    left, right = table.gap[inside], table.gap[inside + 1]
    step = (right - left) / 8
    gap = np.clip(gap, left + 3.01 * step, right - 3.01 * step)
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    scale = np.abs(table.nodes["force_current_slope"]).max()
    flux_slope = (
        sum(
            w * (table.flux_linkage(current, gap + k * step) - table.flux_linkage(current, gap - k * step))
            for k, w in weights.items()
        )
        / step
    )
    force_slope = table.evaluate(current, gap)["force_current_slope"]
    assert np.abs(force_slope + flux_slope).max() < 1e-9 * scale
    cell = np.searchsorted(table.current, np.abs(current)) - 1
    low, high = table.current[cell], table.current[cell + 1]
    step = (high - low) / 8
    size = np.clip(np.abs(current), low + 3.01 * step, high - 3.01 * step)
    by_force = sum(
        w * (table.force(size + k * step, gap) - table.force(size - k * step, gap)) for k, w in weights.items()
    )
    got = table.evaluate(size, gap)["force_current_slope"]
    assert np.abs(by_force / step - got).max() < 1e-9 * scale


def test_second_derivatives_are_continuous_across_cell_edges(table):
    """Up to the step of one rounding: inductance and slopes do not jump where cells meet."""
    rng = np.random.default_rng(1)
    scale = {k: np.abs(v).max() for k, v in table.nodes.items()}
    pairs = []
    for g in table.gap[1:-1]:
        i = rng.uniform(-12, 12, 20)
        pairs.append((table.evaluate(i, g), table.evaluate(i, np.nextafter(g, 1))))
    for i in (*table.current[1:-1], *-table.current[1:-1]):
        g = rng.uniform(table.gap[0], table.gap[-1], 20)
        pairs.append((table.evaluate(i, g), table.evaluate(np.nextafter(i, np.sign(i) * 100), g)))
    for (one, other), name in itertools.product(pairs, NODES):
        assert np.abs(one[name] - other[name]).max() < 1e-9 * scale[name], name


def test_third_derivatives_are_continuous_too(table):
    """C3: the third derivatives from both sides of an edge, from the coefficients themselves."""
    c, surface = table.surface.coefficients, table.surface
    h = np.diff(surface.gap)[:, None, None]
    powers = np.arange(6)
    falling = powers * (powers - 1) * (powers - 2)
    at_end = np.einsum("mnpq,mp->mnq", c, falling * h[:, 0] ** np.clip(powers - 3, 0, None))
    at_start = 6 * c[:, :, 3]
    assert np.abs(at_end[:-1] - at_start[1:]).max() < 1e-8 * np.abs(at_start).max()


def test_surface_is_even_and_smooth_through_zero_current(table):
    current, gap = random_points(table, 200)
    one, other = table.evaluate(current, gap), table.evaluate(-current, gap)
    for name, sign in zip(NODES, (1, -1, 1, 1, -1, 1), strict=True):
        assert (one[name] == sign * other[name]).all(), name
    at_rest = table.evaluate(0.0, gap)
    for name in ("coenergy", "flux_linkage", "force", "force_current_slope"):
        assert np.abs(at_rest[name]).max() < 1e-14 * np.abs(table.nodes[name]).max()
    small = 1e-6
    slope = (table.flux_linkage(small, gap) - table.flux_linkage(-small, gap)) / (2 * small)
    assert np.allclose(slope, at_rest["incremental_inductance"], rtol=1e-6)
    step = 1e-3  # odd derivatives vanish: the inductance has no kink at i = 0
    kink = (table.evaluate(step, gap)["incremental_inductance"] - at_rest["incremental_inductance"]) / step
    assert np.abs(kink).max() < 1e-2 * np.abs(at_rest["incremental_inductance"]).max()


@pytest.mark.parametrize("way", ["rectangle", "ellipse", "through zero current"])
def test_no_closed_path_yields_energy(table, way):
    """The electrical work around a loop, the integral of i dlambda, equals the mechanical work, that of F d(-gap)."""
    x, weight = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(0, 1, 401)
    t = (edges[:-1, None] + (x + 1) / 2 * np.diff(edges)[:, None]).ravel()
    dt = np.tile(weight, 400) / 2 * np.repeat(np.diff(edges), 8)
    if way == "rectangle":
        corners = np.array([[1.0, 1e-4], [9.0, 1e-4], [9.0, 1e-3], [1.0, 1e-3], [1.0, 1e-4]])
        leg, share = np.floor(4 * t).astype(int), 4 * t % 1
        current, gap = (corners[leg] + share[:, None] * (corners[leg + 1] - corners[leg])).T
        current_rate, gap_rate = (4 * (corners[leg + 1] - corners[leg])).T
    else:
        centre, radius = (6.0, 5.0) if way == "ellipse" else (1.0, 8.0)
        current, gap = centre + radius * np.cos(2 * np.pi * t), 6e-4 + 5e-4 * np.sin(2 * np.pi * t)
        current_rate = -2 * np.pi * radius * np.sin(2 * np.pi * t)
        gap_rate = 2 * np.pi * 5e-4 * np.cos(2 * np.pi * t)
    q = table.evaluate(current, gap)
    flux_rate = q["incremental_inductance"] * current_rate - q["force_current_slope"] * gap_rate
    electrical = float(np.sum(current * flux_rate * dt))
    mechanical = float(np.sum(q["force"] * -gap_rate * dt))
    stored = (current * q["flux_linkage"] - q["coenergy"]).max()
    assert abs(mechanical) > 1e-2 * stored, "the loop does work, or it shows nothing"
    assert electrical == pytest.approx(mechanical, abs=1e-8 * stored)


def test_shortcut_for_the_equations_of_motion_agrees(table):
    """(inside, F, dlambda/di, dF/di) are those of the full evaluation."""
    surface, out = table.surface, np.empty(6)
    for i, g in zip(*random_points(table, 50), strict=True):
        assert evaluate(surface.gap, surface.current, surface.coefficients, i, g, out)
        inside, force, inductance, slope = evaluate_slopes(surface.gap, surface.current, surface.coefficients, i, g)
        assert inside
        assert np.allclose([force, inductance, slope], out[2:5], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("i", "g"), [(12.1, 5e-4), (-12.1, 5e-4), (1.0, 4e-5), (1.0, 2e-3), (np.nan, 5e-4), (1, np.nan)]
)
def test_outside_is_nan_never_a_number(table, i, g):
    surface, out = table.surface, np.zeros(6)
    assert not evaluate(surface.gap, surface.current, surface.coefficients, i, g, out)
    assert np.isnan(out).all()
    inside, *values = evaluate_slopes(surface.gap, surface.current, surface.coefficients, i, g)
    assert not inside
    assert np.isnan(values).all()


@pytest.mark.parametrize("n_gap", [2, 3, 4])
@pytest.mark.parametrize("n_current", [3, 4, 5])
def test_smallest_grids_still_meet_their_nodes(n_gap, n_current):
    table = closed_form_table(n_gap=n_gap, n_current=n_current)
    current, gap = np.meshgrid(table.current, table.gap)
    got = fit_coenergy_surface(table.gap, table.current, dict(table.nodes))(current, gap)
    assert np.allclose(got[2], table.nodes["force"], rtol=1e-9, atol=1e-9)


def test_shapes_broadcast(table):
    out = table.surface(np.linspace(0, 5, 4)[:, None], np.linspace(1e-4, 1e-3, 3))
    assert out.shape == (6, 4, 3)
    assert (out[:, 2, 1] == table.surface(np.linspace(0, 5, 4)[2], np.linspace(1e-4, 1e-3, 3)[1])).all()
