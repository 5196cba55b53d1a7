"""The operating map against the closed-form magnet, its criterion, falling curves, and its JSON file."""

import dataclasses
import json
import math

import numpy as np
import pytest
from conftest import closed_form_table, saturating_reluctance
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from msl_fem.errors import InputError, OutOfTable, TableError
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.maps.level_currents import CORNER_RADIUS, Criterion, _crossings, monotone_or_why_not, parse_criterion
from msl_fem.maps.map_file import map_to_json, read_map, write_map
from msl_fem.table.magnetic_table import MagneticTable

CENTRE_LEG = 200 * 0.01 * 0.02  # turns x section of the fixture's centre leg, which its yoke follows at 0.9


def true_current(gap: float, level: float) -> float:
    """The current that brings the level in the closed-form magnet; nan beyond 12 A."""

    def excess(current: float) -> float:
        return float(saturating_reluctance(np.array(current), np.array(gap))["flux_linkage"]) / CENTRE_LEG - level

    return brentq(excess, 0.0, 12.0, xtol=1e-13) if excess(12.0) > 0 else math.nan


def with_flux_densities(table: MagneticTable, **sections: np.ndarray) -> MagneticTable:
    return dataclasses.replace(table, extras={f"flux_density_{k}": v for k, v in sections.items()})


@pytest.mark.parametrize("n_current", [8, 12, 20])
def test_currents_lie_within_the_stated_error_of_the_closed_form(n_current):
    found = operating_map(closed_form_table(n_current=n_current))
    truth = np.array([[true_current(g, level) for g in found.gap] for level in found.levels])
    error = np.abs(found.current - truth)
    assert (error <= found.error).all()
    assert np.median(found.error / error) < 50, "the stated error should not be far from the true one"
    if n_current == 20:
        assert (error < 2e-4 * truth).all()


def test_gaps_between_the_nodes_of_the_table(table):
    gap = np.array([0.07e-3, 0.33e-3, 1.1e-3])
    found = operating_map(table, gap=gap, levels=(0.8, 1.2))
    truth = np.array([[true_current(g, level) for g in gap] for level in (0.8, 1.2)])
    error = np.abs(found.current - truth)
    assert (error <= found.error).all()
    assert (error < 1e-3 * truth).all()


def test_the_section_that_reaches_a_level_first_is_named(table):
    leg = np.array(table.extras["flux_density_centre_leg"])
    near, far = table.gap < 0.4e-3, table.gap >= 0.4e-3
    yoke = np.where(near[:, None], 1.1 * leg, 0.5 * leg)
    found = operating_map(with_flux_densities(table, centre_leg=leg, yoke=yoke))
    for row in found.section:
        assert set(np.array(row)[near]) == {"yoke"}
        assert set(np.array(row)[far]) == {"centre_leg"}
    plain = operating_map(table)
    np.testing.assert_allclose(found.current[:, far], plain.current[:, far])
    assert (found.current[:, near] < plain.current[:, near]).all()


def test_where_a_section_passes_a_level_more_than_once_the_first_time_counts(table):
    """Flux that leaves a section for another one as the iron saturates, and comes back."""
    dented = np.array(table.extras["flux_density_centre_leg"])
    dented[:, -3:] = [1.0, 0.9, 2.0]
    rows = slice(6, 13)
    found = operating_map(with_flux_densities(table, centre_leg=dented), levels=(1.2,), gap=table.gap[rows])
    np.testing.assert_allclose(found.current[0], [true_current(g, 1.2) for g in found.gap], rtol=0.01)


def test_a_level_beyond_the_currents_is_not_reached_and_says_so(table):
    found = operating_map(table, levels=(1.2, 1.9))
    never = np.isnan(found.current)
    truth = np.array([[true_current(g, level) for g in found.gap] for level in found.levels])
    np.testing.assert_array_equal(never, np.isnan(truth))
    assert never[1].any()
    assert not never[0].any()
    assert len(found.not_reached()) == never.sum()
    assert "1.9 T is not reached below 12 A at gap 1.2 mm" in found.not_reached()


def test_a_curve_that_falls_with_the_gap_is_warned_of(table):
    assert operating_map(table).warnings == ()
    dented = np.array(table.extras["flux_density_centre_leg"])
    dented[8] *= 1.4  # more flux at one gap, as from a bad field solution
    (first, second) = operating_map(with_flux_densities(table, centre_leg=dented)).warnings
    assert first.startswith("the 1.2 T curve falls between gaps")
    assert second.startswith("the 1.6 T curve falls between gaps")
    assert first.endswith("a larger gap should need more current; look for noise in the table's flux densities")


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        ({"levels": (1.6, 1.2)}, "increasing"),
        ({"levels": ()}, "levels"),
        ({"levels": (-1.0, 1.2)}, "positive"),
        ({"levels": (math.nan,)}, "positive"),
        ({"gap": [0.3e-3]}, "at least two"),
        ({"gap": [0.4e-3, 0.3e-3]}, "increasing"),
    ],
)
def test_wishes_that_cannot_be_are_refused(table, bad, said):
    with pytest.raises(InputError, match=said):
        operating_map(table, **bad)


def test_a_gap_outside_the_table_is_refused_with_the_range(table):
    with pytest.raises(OutOfTable, match=r"2 mm lies outside the table's 0.05 ... 1.2 mm"):
        operating_map(table, gap=[0.3e-3, 2e-3])


def test_a_table_without_usable_sections_is_refused(table):
    with pytest.raises(TableError, match="flux_density_"):
        operating_map(dataclasses.replace(table, extras={}))
    holed = np.array(table.extras["flux_density_yoke"])
    holed[3, 4] = np.nan
    with pytest.raises(TableError, match="flux_density_yoke is not finite"):
        operating_map(with_flux_densities(table, yoke=holed))


def test_name_and_digest_come_from_the_provenance_or_the_caller(table):
    known = dataclasses.replace(table, provenance={"actuator": "a magnet", "actuator_sha256": "ab12"})
    found = operating_map(known, levels=(1.2,), gap=table.gap[[3, 9]])
    assert (found.actuator, found.digest) == ("a magnet", "ab12")
    named = operating_map(known, levels=(1.2,), gap=table.gap[[3, 9]], actuator="other", digest="")
    assert (named.actuator, named.digest) == ("other", "")


@pytest.fixture(scope="module")
def example(table: MagneticTable) -> OperatingMap:
    return operating_map(table, levels=(1.2, 1.9), gap=table.gap[3::4], actuator="example", digest="ff")


def test_a_map_survives_its_file(example, tmp_path):
    again = read_map(write_map(example, tmp_path / "new" / "map.json"))
    for field in dataclasses.fields(OperatingMap):
        one, other = getattr(example, field.name), getattr(again, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        else:
            assert one == other


def test_the_file_speaks_the_interface(example):
    content = map_to_json(example)
    assert content["levels_T"] == [1.2, 1.9]
    assert len(content["gap_m"]) == example.gap.size
    assert [len(row) for row in content["current_A"]] == [example.gap.size] * 2
    assert content["criterion"] == "mean"
    assert content["current_A"][1][-1] is None
    assert json.dumps(content, allow_nan=False)


def broken(content: dict, key: str, value: object) -> dict:
    return {k: v for k, v in content.items() if k != key} | ({} if value is Ellipsis else {key: value})


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("gap_m", ..., "gap_m is missing"),
        ("criterion", ..., "criterion is missing"),
        ("criterion", 3, "criterion must be a text"),
        ("criterion", "mode", "criterion 'mode' is unknown"),
        ("mesh_error_A", [[1.0]], "mesh_error has shape"),
        ("mesh_error_A", "small", "mesh_error_A must hold numbers in 2"),
        ("rests_on_tail", ["core"], "rests_on_tail must hold one list"),
        ("rests_on_tail", [["core"]], "on_tail must hold one name for each level and gap"),
        ("provenance", [1], "provenance must be a JSON object"),
        ("decoupling", "none", "decoupling must be a JSON object"),
        ("schema", 7, "schema is 7"),
        ("levels_T", [1.9, 1.2], "increasing"),
        ("levels_T", ["1.2", "1.9"], "levels_T must hold numbers"),
        ("gap_m", [1.0, None, 3.0, 4.0, 5.0], "gaps"),
        ("current_A", [1.0, 2.0], "current_A must hold numbers in 2"),
        ("current_A", [[1.0], [2.0]], "shape"),
        ("current_error_A", None, "current_error_A"),
        ("current_max_A", -1.0, "largest current"),
        ("section", "yoke", "section"),
        ("section", [["yoke"]], "section"),
    ],
)
def test_a_file_that_contradicts_itself_is_one_clear_error(example, tmp_path, key, value, said):
    path = tmp_path / "map.json"
    path.write_text(json.dumps(broken(map_to_json(example), key, value)))
    with pytest.raises(InputError, match=said) as caught:
        read_map(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_curves_in_the_wrong_order_or_range_are_refused(example):
    content = map_to_json(example)
    for change, said in (
        (list(reversed(content["current_A"])), "must need more current"),
        ([[-1.0] * 5, [None] * 5], "between 0 and"),
        ([[50.0] * 5, [None] * 5], "between 0 and"),
    ):
        with pytest.raises(InputError, match=said):
            OperatingMap(**{**_fields(example), "current": np.array(change, dtype=float)})
    with pytest.raises(InputError, match="not negative"):
        OperatingMap(**{**_fields(example), "allowance": -np.ones_like(example.allowance)})


def _fields(record: OperatingMap) -> dict:
    return {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}


@pytest.mark.parametrize("text", ["", "[1, 2", "[1, 2]", '"map"', "\xff"])
def test_what_is_no_map_file_is_one_clear_error(tmp_path, text):
    path = tmp_path / "map.json"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"map\.json"):
        read_map(path)


def test_a_missing_map_file_names_the_way_out(tmp_path):
    with pytest.raises(InputError, match="msl-fem map"):
        read_map(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("mean", Criterion("mean")),
        (" max ", Criterion("max", radius=CORNER_RADIUS)),
        ("max=0.5mm", Criterion("max", radius=5e-4)),
        ("max = 200 µm", Criterion("max", radius=2e-4)),
        ("percentile=95", Criterion("percentile", percent=95.0)),
        ("percentile=99.5 %", Criterion("percentile", percent=99.5)),
    ],
)
def test_a_criterion_s_text(text, wanted):
    found = parse_criterion(text)
    assert found.kind == wanted.kind
    for name in ("percent", "radius"):
        one, other = getattr(found, name), getattr(wanted, name)
        assert one == pytest.approx(other, nan_ok=True)


def test_what_it_means_is_said():
    assert "section" in parse_criterion("mean").meaning
    assert "99.5 %" in parse_criterion("percentile=99.5").meaning
    assert "200 µm from its corners" in parse_criterion("max=0.2mm").meaning
    assert all("in the iron" in parse_criterion(text).meaning for text in ("mean", "max", "percentile=50"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "unknown; choose mean, percentile=95"),
        ("median", "'median' is unknown"),
        ("mean=3", "'mean=3' is unknown"),
        ("percentile", "'percentile' is unknown"),
        ("max=", "'max=': '' is not a quantity"),
        ("max=3", "has no unit"),
        ("max=3 T", "wrong dimension"),
        ("max=0 mm", "must be positive"),
        ("max=-1mm", "must be positive, -1 mm"),
        ("percentile=0", "between 0 and 100"),
        ("percentile=100", "between 0 and 100"),
        ("percentile=nan", "is not a quantity"),
        ("x" * 1000, "unknown"),
    ],
)
def test_another_text_is_one_clear_error(text, said):
    with pytest.raises(InputError, match=said) as caught:
        parse_criterion(text)
    assert len(str(caught.value)) < 300
    assert math.isnan(Criterion("mean").radius)


GAP = np.array([1e-4, 2e-4, 4e-4])
LEGS = (("centre_leg",) * 3,)


def said(current, error=0.0, section=LEGS):
    row = np.array([current])
    return monotone_or_why_not(
        np.array([1.2]), GAP, row, error=np.full(row.shape, error), section=section, cause="look there"
    )


def test_a_rising_curve_and_one_that_ends_say_nothing():
    assert said([1.0, 1.0, 2.0]) == ()
    assert said([1.0, 2.0, np.nan]) == ()
    assert said([np.nan] * 3) == ()


@pytest.mark.parametrize(
    ("current", "more", "why"),
    [
        ([1.0, 0.9, 2.0], {}, "a larger gap should need more current; look there"),
        ([1.0, 0.9, 2.0], {"error": 0.06}, "the fall lies within the stated error of the currents"),
        (
            [1.0, 0.9, 2.0],
            {"section": (("centre_leg", "yoke", "yoke"),)},
            "the loading section changes from centre leg to yoke",
        ),
        ([np.nan, 0.9, 2.0], {}, "the level is not reached at the smaller gap"),
    ],
)
def test_a_fall_is_located_and_explained(current, more, why):
    (sentence,) = said(current, **more)
    assert sentence.startswith("the 1.2 T curve falls between gaps 100 µm and 200 µm")
    assert sentence.endswith(why)


def test_a_level_is_taken_where_the_whole_curve_first_takes_it() -> None:
    """Also inside a piece whose ends are both below the level, and at a node; NaN where it is never taken."""
    rng, i = np.random.default_rng(3), np.linspace(0.0, 5.0, 9)
    curves = np.concatenate([np.zeros((40, 1)), rng.uniform(0.0, 1.0, (40, 8))], axis=1)
    levels = np.concatenate([rng.uniform(0.0, 1.3, 39), curves[39:, 4]])
    found = _crossings(i, curves, levels)
    for curve, level, crossing in zip(curves, levels, found, strict=True):
        roots = CubicSpline(np.r_[-i[:0:-1], i], np.r_[-curve[:0:-1], curve]).solve(level, extrapolate=False)
        assert crossing == pytest.approx(min(roots[roots > 0], default=np.nan), rel=1e-9, nan_ok=True)
    assert np.isnan(found).any()
