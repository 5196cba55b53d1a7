"""Irons: the library's curves, the saturation tail, laminations, refused and cut curves."""

import json

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from msl_fem.errors import MaterialError
from msl_fem.materials.constants import MU_0
from msl_fem.materials.material import LIBRARY, MIN_POINTS, iron_from_points, laminated, linear_iron, load_iron

NAMES = sorted(json.loads((LIBRARY / "index.json").read_text()))
IRONS = [*NAMES, "analytic:e1", "linear:1000"]


def saturating_points(n: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """B, H of a plausible curve, B = mu_0 H + 1.9 T H/(H + 400 A/m)."""
    h = np.r_[0.0, np.geomspace(20.0, 3e4, n - 1)]
    return MU_0 * h + 1.9 * h / (h + 400.0), h


@pytest.mark.parametrize("name", IRONS)
def test_curve_rises_at_least_as_fast_as_vacuum(name):
    iron = load_iron(name)
    b = np.linspace(0, 3.5, 20001)
    h, slope = iron.magnetise(b)
    assert h[0] == 0
    assert (np.diff(h) > 0).all()
    assert (slope > 0).all()
    if name != "analytic:e1":  # a formula made for the purpose; beyond 2 T its dB/dH falls to a third of vacuum's
        assert MU_0 * slope.max() <= 1 + 1.1e-4


@pytest.mark.parametrize("name", IRONS)
def test_slope_is_the_derivative_of_the_curve(name):
    iron = load_iron(name)
    b = np.random.default_rng(1).uniform(0.05, 3.0, 200)
    step = 1e-6
    ahead, behind = (iron.magnetise(b + s)[0] for s in (step, -step))
    assert np.allclose((ahead - behind) / (2 * step), iron.magnetise(b)[1], rtol=1e-3)


@pytest.mark.parametrize("name", ["m19", "m45", "steel_1010", "m270_35a_pyleecan", "analytic:e1", "linear:1000"])
@pytest.mark.parametrize("stacking", [1.0, 0.9])
def test_energy_density_is_the_integral_of_field_strength(name, stacking):
    iron = laminated(load_iron(name), stacking)
    levels = [0.3, 1.1, 1.6, 2.2, 2.9]
    kinks = [] if np.isinf(iron.tail_from) else [b for b in iron.flux_density if b < 2.9]
    total, previous = 0.0, 0.0
    for level in levels:
        inside = [k for k in kinks if previous < k < level]
        edges = np.array([previous, *inside, level])
        total += sum(
            quad(lambda b: float(iron.magnetise(np.array([b]))[0][0]), lo, hi, epsrel=1e-10)[0]
            for lo, hi in zip(edges[:-1], edges[1:], strict=True)
        )
        previous = level
        assert float(iron.energy_density(np.array(level))) == pytest.approx(total, rel=2e-8)


@pytest.mark.parametrize("name", NAMES)
def test_tail_continues_the_curve_and_approaches_saturation(name):
    iron = load_iron(name)
    end = iron.tail_from
    (h_in, h_out), (s_in, s_out) = iron.magnetise(np.array([end * (1 - 1e-12), end * (1 + 1e-12)]))
    assert h_out == pytest.approx(h_in, rel=1e-8)
    assert s_out == pytest.approx(s_in, rel=2e-4)
    b = end + np.array([1.0, 3.0, 9.0, 90.0])
    h, _ = iron.magnetise(b)
    polarisation = b - MU_0 * h
    saturation = polarisation[-1] + (polarisation[-1] - polarisation[-2]) * h[-2] / (h[-1] - h[-2])
    assert (np.diff(polarisation) > -1e-9).all(), "polarisation must not fall"
    missing = (saturation - polarisation[:2]) * h[:2]
    assert missing[0] == pytest.approx(missing[1], rel=1e-3, abs=1.0), "J_s - J must fall like 1/H"
    assert 1.4 < saturation < 2.6, "no iron alloy saturates outside"


@pytest.mark.parametrize("name", IRONS)
@pytest.mark.parametrize("stacking", [0.96, 0.8])
def test_lamination_mixes_the_fluxes_at_equal_field_strength(name, stacking):
    """B = s B_iron(H) + (1 - s) mu_0 H, against a root search on the sheets' own curve."""
    sheet = load_iron(name)
    stack = laminated(sheet, stacking)
    exact = np.isinf(sheet.tail_from)
    average = np.linspace(0.05, 2.0, 14) if exact else stack.flux_density[1:]

    def excess(b_iron: float, b: float) -> float:
        return stacking * b_iron + (1 - stacking) * MU_0 * float(sheet.magnetise(np.array([b_iron]))[0][0]) - b

    b_iron = np.array([brentq(excess, 0, b / stacking, args=(b,), xtol=1e-15) for b in average])
    h, _ = stack.magnetise(average)
    assert np.allclose(h, sheet.magnetise(b_iron)[0], rtol=1e-9)
    assert np.allclose(stack.iron_flux_density(average), b_iron, rtol=0, atol=1e-9)
    if not exact:  # between the points the two splines may differ a little
        between = (average[:-1] + average[1:]) / 2
        b_iron = np.array([brentq(excess, 0, b / stacking, args=(b,), xtol=1e-15) for b in between])
        assert np.abs(stack.iron_flux_density(between) - b_iron).max() < 1e-4 * (1 - stacking) / 0.2


@pytest.mark.parametrize("name", ["analytic:e1", "linear:1000", "m19"])
def test_laminated_slope_and_energy_belong_to_its_curve(name):
    stack = laminated(load_iron(name), 0.9)
    b, step = np.linspace(0.1, 2.4, 24), 1e-6
    h, slope = stack.magnetise(b)
    assert np.allclose((stack.magnetise(b + step)[0] - stack.magnetise(b - step)[0]) / (2 * step), slope, rtol=2e-4)
    energy = (stack.energy_density(b + step) - stack.energy_density(b - step)) / (2 * step)
    assert np.allclose(energy, h, rtol=1e-5)


def test_full_stacking_changes_nothing():
    iron = load_iron("m19")
    assert laminated(iron, 1.0) is iron


def test_linear_iron_is_linear():
    h, slope = linear_iron(500.0).magnetise(np.array([0.0, 1.2]))
    assert np.allclose(h, [0.0, 1.2 / (500 * MU_0)])
    assert np.allclose(slope, 1 / (500 * MU_0))


def test_e1_iron_follows_its_formula():
    b = np.array([0.5, 1.6, 2.2])
    share = b**11 / (b**11 + 4.4e4)
    assert np.allclose(load_iron("analytic:e1").magnetise(b)[0], b / MU_0 * (1.6e-4 + (1 - 1.6e-4) * share), rtol=1e-14)


def test_origin_is_added_where_it_is_missing():
    b, h = saturating_points()
    with_origin, without = (iron_from_points(x, y, name="x", source="test") for x, y in ((b, h), (b[1:], h[1:])))
    assert (with_origin.flux_density == without.flux_density).all()
    assert not with_origin.note


def test_curve_is_cut_with_a_note_where_it_turns_back():
    b, h = saturating_points()
    h[9] = h[8] * 0.9
    iron = iron_from_points(b, h, name="kinked", source="test")
    assert iron.tail_from == b[8]
    assert "kinked" in iron.note
    assert f"{b[8]:g} T" in iron.note
    assert "point 9 of 12" in iron.note
    assert laminated(iron, 0.96).note == iron.note


def test_curve_is_cut_where_it_rises_slower_than_vacuum():
    b, h = saturating_points()
    b[-1] = b[-2] + 0.9 * MU_0 * (h[-1] - h[-2])
    iron = iron_from_points(b, h, name="slow", source="test")
    assert iron.tail_from == b[-2]
    assert iron.note


def test_rounding_in_a_printed_curve_is_forgiven():
    b, h = saturating_points()
    b[-1] = b[-2] + (1 - 5e-5) * MU_0 * (h[-1] - h[-2])
    assert not iron_from_points(b, h, name="rounded", source="test").note


def test_wavy_points_fall_back_to_a_monotone_curve():
    """A sharp knee makes the cubic spline overshoot; the curve must neither fall nor beat vacuum."""
    h = np.array([0.0, 10, 20, 30, 40, 5e4, 1e5, 1.5e5])
    b = np.array([0.0, 0.5, 1.0, 1.4, 1.5, 1.6, 1.67, 1.735])
    iron = iron_from_points(b, h, name="sharp", source="test")
    field, slope = iron.magnetise(np.linspace(0, 2.5, 5001))
    assert (np.diff(field) > 0).all()
    assert slope.min() > 0
    assert MU_0 * slope.max() <= 1 + 1e-9


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda b, h: (b[:3], h[:3]), f"at least {MIN_POINTS}"),
        (lambda b, h: (b[:-1], h), "equally long"),
        (lambda b, h: (np.where(b > 1, np.nan, b), h), "finite"),
        (lambda b, h: (b - 0.1, h), "starts at"),
        (lambda b, h: (b[::-1], h[::-1]), "usable points"),
        (lambda b, h: (b, np.full_like(h, 7.0)), "usable points"),
        (lambda b, h: (np.empty(0), np.empty(0)), "0 usable points"),
    ],
)
def test_what_is_not_a_curve_is_refused(change, word):
    with pytest.raises(MaterialError, match=word) as caught:
        iron_from_points(*change(*saturating_points()), name="bad", source="test")
    assert str(caught.value).startswith("bad: ")


def test_file_of_points_is_read_in_either_order_of_columns(tmp_path):
    b, h = saturating_points()
    for header, rows in (("H_A_per_m,B_T", zip(h, b, strict=True)), ("B_T, H_A_per_m", zip(b, h, strict=True))):
        (tmp_path / "iron.csv").write_text(header + "\n" + "\n".join(f"{u:.17g},{v:.17g}" for u, v in rows) + "\n\n")
        iron = load_iron("iron.csv", folder=tmp_path)
        assert (iron.flux_density == b).all()
        assert (iron.field_strength == h).all()


def test_byte_order_mark_of_a_spreadsheet_is_no_fault(tmp_path):
    b, h = saturating_points()
    rows = "\n".join(f"{u:.17g},{v:.17g}" for u, v in zip(h, b, strict=True))
    (tmp_path / "iron.csv").write_text("H_A_per_m,B_T\n" + rows, encoding="utf-8-sig")
    assert (load_iron("iron.csv", folder=tmp_path).flux_density == b).all()


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "first line"),
        ("H,B\n1,2\n", "first line"),
        ("H_A_per_m,B_T,B_T\n0,0,0\n", "first line"),
        ("H_A_per_m,B_T\n\n0,0\n10;0.5\n", "line 4"),
        ("H_A_per_m,B_T\n0,0\n10,0.5,7\n", "line 3"),
        ("H_A_per_m,B_T\n0,0\n10,much\n", "line 3"),
        ("H_A_per_m,B_T\n", "usable points"),
        ("H_A_per_m,B_T\n0,0\n10,nan\n", "finite"),
    ],
)
def test_damaged_file_of_points_is_refused_with_its_line(tmp_path, text, word):
    (tmp_path / "iron.csv").write_text(text)
    with pytest.raises(MaterialError, match=word):
        load_iron("iron.csv", folder=tmp_path)


@pytest.mark.parametrize("name", ["unobtainium", "linear:0.5", "linear:much", "linear:nan", "linear:inf", "none.csv"])
def test_unknown_iron_is_refused_with_the_way_out(tmp_path, name):
    with pytest.raises(MaterialError) as caught:
        load_iron(name, folder=tmp_path)
    assert name in str(caught.value)


def test_unknown_iron_lists_the_library():
    with pytest.raises(MaterialError, match=r"m19.*steel_1010"):
        load_iron("unobtainium")


def test_coarse_points_leave_a_finite_initial_permeability():
    """A one-sided formula for the slope at B = 0 gives dH/dB = 0 here, and the field problem has no solution."""
    h, b = np.array([0.0, 100, 300, 1000, 5000, 60000]), np.array([0.0, 1.0, 1.3, 1.5, 1.7, 2.0])
    iron = iron_from_points(b, h, name="coarse", source="test")
    _, slope = iron.magnetise(np.array([0.0, 1e-3]))
    assert (slope > 50).all()
    assert (slope < 200).all()


@pytest.mark.parametrize(
    ("of_b", "of_h"), [(1e4, 1.0), (1e3, 1.0), (1.0, 1e-3), (1.0, 1 / 79.577), (20.0, 1.0)], ids=str
)
def test_units_that_make_no_iron_are_refused(of_b, of_h):
    m19 = load_iron("m19")
    with pytest.raises(MaterialError, match="look at the units"):
        iron_from_points(of_b * m19.flux_density, of_h * m19.field_strength, name="mine", source="test")


@pytest.mark.filterwarnings("error")
def test_fields_that_differ_by_less_than_a_float_can_tell_are_refused():
    b, h = saturating_points()
    with pytest.raises(MaterialError, match="a relative permeability of inf"):
        iron_from_points(b, np.r_[0.0, 1e-320, h[2:]], name="mine", source="test")


def test_columns_exchanged_are_refused():
    m19 = load_iron("m19")
    with pytest.raises(MaterialError, match="order of the columns"):
        iron_from_points(m19.field_strength, m19.flux_density, name="mine", source="test")


def test_what_is_seldom_met_is_noted():
    m19 = load_iron("m19")
    assert "seldom met" in iron_from_points(1.25 * m19.flux_density, m19.field_strength, name="mine", source="").note
    assert not iron_from_points(m19.flux_density, m19.field_strength, name="mine", source="").note
