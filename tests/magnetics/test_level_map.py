"""The map from field solutions: against direct solutions, its stated errors, and a guard that it keeps honest."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
from level_jobs import E1, SERVO, currents_at, field_at, job_of, with_iron

import msl_fem
from msl_fem.errors import ComputationError, InputError, NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField, field_of
from msl_fem.magnetics.field_map import FieldMapSettings, default_gaps, field_map
from msl_fem.magnetics.field_map.gap_levels import GapRow
from msl_fem.maps import Guard, OperatingMap, map_from_json, map_to_json
from msl_fem.materials.material import load_iron

FAST = FieldMapSettings(accuracy="fast")
THREE = (2e-4, 5e-4, 1e-3)


@pytest.fixture(scope="module")
def e1() -> OperatingMap:
    return field_map(E1, THREE)


@pytest.fixture(scope="module")
def coarse() -> OperatingMap:
    return field_map(SERVO, np.geomspace(0.05e-3, 1.2e-3, 12), settings=FAST)


@pytest.mark.parametrize("m", range(3))
def test_e1_s_currents_bring_their_levels_in_direct_solutions(e1, m):
    """Solved at the map's current on a mesh of the gap's own: the named section is the most loaded, at its level."""
    field = field_of(E1, float(e1.gap[m]))
    for k, level in enumerate(e1.levels):
        found = field.quantities(field.solve(float(e1.current[k, m]), float(e1.gap[m]))).flux_density
        means = {name: section.mean for name, section in found.items()}
        assert e1.section[k][m] == max(means, key=means.__getitem__) == "centre_leg"
        assert means["centre_leg"] == pytest.approx(level, rel=5e-4)


@pytest.mark.parametrize("m", range(3))
def test_e1_s_currents_agree_with_fine_ones_to_a_fifth_of_a_per_cent(e1, m):
    fine = currents_at(E1, float(e1.gap[m]), (1.2, 1.6), "fine")
    error = np.abs(e1.current[:, m] - fine)
    assert (error < 2e-3 * fine).all()
    assert (error < e1.error[:, m]).all(), "the stated error covers it"
    assert (e1.error[:, m] < 3e-3 * fine).all()


@pytest.mark.parametrize(
    ("criterion", "gap"), [("mean", 1e-4), ("mean", 1.1e-3), ("percentile=95", 4e-4), ("max=1mm", 4e-4)]
)
def test_the_stated_error_covers_the_true_one(gap, criterion):
    made = field_map(SERVO, (gap, 1.12 * gap), criterion=criterion, settings=FAST)
    better = "normal" if criterion.startswith("max") else "fine"
    error = np.abs(made.current[:, 0] - currents_at(SERVO, gap, (1.2, 1.6), better, criterion))
    assert (error <= made.error[:, 0]).all()
    assert (made.error[:, 0] < 0.015 * made.current[:, 0]).all()
    np.testing.assert_allclose(made.error, made.mesh_error + made.bh_error, atol=5e-5)


@pytest.mark.parametrize("actuator", [E1, SERVO], ids=["e1", "servo"])
def test_no_chord_lies_above_the_curve_between_the_gaps(actuator):
    """Fresh roots at five gaps off the nodes, on another mesh than the map's, and of the first on one of its own."""
    made = field_map(actuator, default_gaps(actuator)[::2], settings=FAST)
    guard = Guard(made)
    other = field_at(actuator, 3e-4)
    for n, gap in enumerate(np.random.default_rng(5).uniform(made.gap[0], made.gap[-1], 5)):
        true = currents_at(actuator, float(gap), (1.2, 1.6), field=None if n == 0 else other)
        limit = guard.limit(gap)
        assert (limit <= true).all(), gap
        assert (limit > 0.98 * true).all(), gap


def test_half_the_points_of_a_curve_and_its_error_covers_the_formula(tmp_path):
    """E1's iron from points two and a half tenths of a tesla apart, whose curve differs visibly from the formula's."""
    b = np.r_[np.arange(0.0, 1.3, 0.25), np.arange(1.4, 2.5, 0.2)]
    h = load_iron("analytic:e1").magnetise(b)[0]
    rows = "\n".join(f"{x:.9g},{y:.9g}" for x, y in zip(h, b, strict=True))
    (tmp_path / "points.csv").write_text(f"H_A_per_m,B_T\n{rows}\n")
    by_points = with_iron(E1, "points.csv").model_copy(update={"file": tmp_path / "e1.toml"})
    found, true = (field_map(a, (1e-4, 4e-4), levels=(1.2, 1.5), settings=FAST) for a in (by_points, E1))
    difference = np.abs(found.current - true.current)
    assert difference.max() > 2e-3 * true.current.max(), "else the test tells nothing"
    assert (difference <= found.bh_error + 1e-4).all()
    assert (found.bh_error < 30 * difference + 1e-3).all()
    assert (true.bh_error == 0).all(), "a formula leaves nothing open"


def test_levels_are_flux_densities_in_the_iron_itself():
    """The stack's mean is the stacking factor times that, and the air's small share."""
    thin = with_iron(E1, "analytic:e1", stacking_factor=0.8)
    made = field_map(thin, (3e-4, 4e-4), levels=(1.2,), settings=FAST)
    field = field_of(thin, 3e-4, accuracy="fast")
    potential = field.solve(float(made.current[0, 0]), 3e-4).potential
    _, along_x, along_y, *_ = field.probes.cuts["centre_leg"]
    averaged = np.hypot(along_x @ potential, along_y @ potential)[1:-1].mean()
    assert averaged == pytest.approx(0.8 * 1.2, rel=5e-3)


def test_a_level_beyond_the_largest_current_is_not_reached():
    settings = dataclasses.replace(FAST, current_max=4.0)
    made = field_map(E1, (2e-4, 5.5e-4, 8e-4), settings=settings)
    np.testing.assert_array_equal(np.isnan(made.current), [[False, False, True], [False, True, True]])
    assert made.current_max == 4.0
    assert made.not_reached()[0] == "1.2 T is not reached below 4 A at gap 800 µm"
    assert set(made.section[1]) == {"centre_leg"}
    assert np.isfinite(made.allowance).all()
    guard = Guard(made)
    for gap in (3e-4, 4.5e-4, 7e-4):
        true = np.minimum(currents_at(E1, gap, (1.2, 1.6)), 4.0)
        assert (guard.limit(gap) <= true).all()


def test_flux_densities_beyond_the_points_of_the_curve_are_said(tmp_path):
    b = np.r_[0.0, np.linspace(0.2, 1.4, 9)]
    h = load_iron("analytic:e1").magnetise(b)[0]
    rows = "\n".join(f"{x:.9g},{y:.9g}" for x, y in zip(h, b, strict=True))
    (tmp_path / "short.csv").write_text(f"H_A_per_m,B_T\n{rows}\n")
    short = with_iron(E1, "short.csv").model_copy(update={"file": tmp_path / "e1.toml"})
    made = field_map(short, (2e-4, 5e-4), levels=(1.0, 1.45), settings=FAST)
    assert made.on_tail == (("", ""), ("core", "core"))
    assert any("1.45 T lies beyond the last B-H point of the core's iron at 1.4 T" in w for w in made.warnings)
    assert any("at 1.45 T and 2 of 2 gaps" in w and "of the core lies beyond" in w for w in made.warnings)
    assert not any("at 1 T" in w for w in made.warnings)


def test_default_gaps_hold_round_numbers_the_ends_and_the_nominal_gap():
    gaps = default_gaps(SERVO)
    assert gaps[0] == pytest.approx(0.05e-3)
    assert gaps[-1] == pytest.approx(1.2e-3)
    for wanted in (0.1e-3, 0.2e-3, 0.5e-3, 0.6e-3, 1e-3):
        assert np.abs(gaps - wanted).min() < 1e-12
    assert (gaps[1:] / gaps[:-1] < 1.15).all()
    alone = default_gaps(E1)
    assert (alone[0], alone[-1]) == (pytest.approx(1e-4), pytest.approx(1.25e-3))
    assert np.abs(alone - 1e-3).min() < 1e-12


def test_processes_change_nothing(coarse):
    few = [0, 5, 11]  # with both ends, so the same mesh
    again = field_map(SERVO, coarse.gap[few], settings=dataclasses.replace(FAST, workers=2))
    np.testing.assert_allclose(again.current, coarse.current[:, few], rtol=1e-9)
    assert [list(row) for row in again.section] == [[row[m] for m in few] for row in coarse.section]
    assert coarse.warnings == ()
    assert coarse.current_max == 12.0, "the drive's limit"


def test_a_map_survives_json_with_all_that_it_states(coarse):
    content = json.loads(json.dumps(map_to_json(coarse), allow_nan=False))
    again = map_from_json(content)
    for name in ("current", "error", "mesh_error", "bh_error", "gap_slope", "allowance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(coarse, name))
    assert (again.criterion, again.on_tail, again.provenance) == (coarse.criterion, coarse.on_tail, coarse.provenance)
    assert content["criterion_meaning"].startswith("mean of |B| in the iron")
    assert content["provenance"]["mesh"]["accuracy"] == "fast"


def test_the_gap_slope_is_the_curve_s(coarse):
    central = (coarse.current[:, 2:] - coarse.current[:, :-2]) / (coarse.gap[2:] - coarse.gap[:-2])
    np.testing.assert_allclose(coarse.gap_slope[:, 1:-1], central, rtol=0.08)
    near = field_map(SERVO, (4e-4, 4.04e-4), settings=FAST)
    difference = (near.current[:, 1] - near.current[:, 0]) / 4e-6
    np.testing.assert_allclose(near.gap_slope.mean(axis=1), difference, rtol=1e-4)


def test_finished_gaps_are_not_solved_again(tmp_path, monkeypatch):
    gaps = (3e-4, 5e-4)
    settings = dataclasses.replace(FAST, cache=tmp_path / "rows", resume=True)
    whole = field_map(E1, gaps, settings=FAST)
    solve = MagnetField.solve

    def fails_at_the_last(self, current, gap, *, start=None):
        if gap > 4.5e-4:
            raise NotConverged("the field at 0.5 mm did not converge")
        return solve(self, current, gap, start=start)

    monkeypatch.setattr(MagnetField, "solve", fails_at_the_last)
    with pytest.raises(ComputationError, match=r"1 of 2 gaps failed; first: the field at 0.5 mm"):
        field_map(E1, gaps, settings=settings)
    solved = []

    def counted(self, current, gap, *, start=None):
        solved.append(gap)
        return solve(self, current, gap, start=start)

    monkeypatch.setattr(MagnetField, "solve", counted)
    finished = []
    again = field_map(E1, gaps, settings=settings, progress=lambda done, total: finished.append((done, total)))
    assert set(solved) == {5e-4}
    assert finished == [(1, 2), (2, 2)]
    np.testing.assert_array_equal(again.current, whole.current)
    for wish in ({"levels": (1.3,)}, {"criterion": "percentile=95"}, {"settings": {"current_max": 9.0}}):
        solved.clear()
        more = dataclasses.replace(settings, **wish.pop("settings", {}))
        field_map(E1, gaps, settings=more, **wish)
        assert set(solved) == set(gaps), "what is asked otherwise is solved anew"


@pytest.mark.parametrize(
    ("gap", "wishes", "said"),
    [
        ((2e-4,), {}, "at least 2 different gaps"),
        ((-2e-4, 3e-4), {}, "gap -200 µm is not allowed"),
        (THREE, {"levels": (1.6, 1.2)}, "increasing"),
        (THREE, {"criterion": "median"}, "criterion 'median' is unknown; choose mean, percentile=95"),
        (THREE, {"criterion": "max=3mm"}, "below half the thinnest iron, 2.5 mm"),
        (THREE, {"settings": FieldMapSettings(accuracy="superb")}, "fast, normal, fine"),
        (THREE, {"settings": FieldMapSettings(current_max=-1.0)}, "largest current must be positive"),
        (THREE, {"settings": FieldMapSettings(current_max=1e9)}, "melts"),
    ],
)
def test_wishes_that_cannot_be_are_refused(gap, wishes, said):
    with pytest.raises(InputError, match=said):
        field_map(E1, gap, **wishes)


def test_the_package_s_verb_takes_an_actuator_or_a_table(table):
    made = msl_fem.operating_map(E1, gap=(3e-4, 4e-4), levels=(1.0,), settings=FAST)
    assert made.provenance["method"].startswith("root finding")
    assert msl_fem.operating_map(table).provenance["method"] == "interpolated from a table"


def test_the_table_s_map_still_needs_no_finite_elements():
    code = (
        "import sys\n"
        "sys.modules['skfem'] = sys.modules['netgen'] = None\n"
        "import numpy as np, msl_fem\n"
        "from msl_fem.table.magnetic_table import MagneticTable\n"
        "try:\n    msl_fem.operating_map(object())\n"
        "except AttributeError:\n    print('asked the table')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "asked the table", done.stderr


def test_a_job_s_mesh_serves_all_its_gaps():
    """The same currents from a mesh made at the gap and from one stretched to it."""
    near, far = (job_of(E1, gap, "normal").solver().solve(GapRow(3e-4, (1.2, 1.6), 20.0)) for gap in (3e-4, 8e-4))
    np.testing.assert_allclose(near["current"], far["current"], rtol=1.5e-3)
    assert E1.magnet.section(3e-4).gap == 3e-4
