"""One magnet's field against the converged values of E1, its error estimate, its air box, refused points."""

from types import SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from field_problems import reference
from random_cores import random_core

from msl_fem.actuator import Actuator, Air, ECore, load_actuator
from msl_fem.errors import ActuatorError, InputError
from msl_fem.magnetics.field.accuracy import LEVELS, force_error_estimate, routes_apart
from msl_fem.magnetics.field.magnet_field import MagnetField, field_of, magnet_mesh, solve
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow

POINTS = reference("reference.csv")
LINEAR = reference("reference_linear.csv")
REFERENCE_ERROR = (
    1e-5  # at least: where its own figure is smaller, refining far beyond it still moves the force so much
)


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(ROOT / "geometries" / "e1.toml")


def with_iron(magnet: ECore, name: str) -> ECore:
    return magnet.model_copy(update={"iron": magnet.iron.model_copy(update={"core": name, "armature": name})})


def test_e1_at_5_ampere_and_half_a_millimetre(e1):
    point = solve(e1, 5.0, 5e-4)
    got = point.quantities
    assert got.force == pytest.approx(211.029, rel=2e-3)
    assert got.flux_linkage == pytest.approx(0.0605392, rel=1e-3)
    assert got.coenergy == pytest.approx(0.164467, rel=1e-3)
    assert got.force_stress_tensor == pytest.approx(got.force, rel=5e-3)
    assert point.unknowns < 6000
    assert 0 < point.newton_iterations == len(point.residual_trail)
    assert point.notes == ()


@pytest.mark.parametrize(
    ("accuracy", "picked", "tolerance"),
    [("fast", slice(0, 60, 11), 5e-3), ("normal", slice(3, 60, 13), 1e-3), ("fine", slice(4, 60, 30), 1e-4)],
)
def test_stated_error_covers_the_true_one(e1, accuracy, picked, tolerance):
    """The estimate is neither below the true error of the force nor far from the level's accuracy."""
    for row in POINTS[picked]:
        point = solve(e1, row["current_A"], row["gap_mm"] * 1e-3, accuracy=accuracy)
        true = abs(point.quantities.force / row["force_N"] - 1)
        where = f"{row['current_A']} A, {row['gap_mm']} mm"
        assert true < tolerance, where
        assert true <= point.force_error_estimate + max(row["force_rel_uncertainty"], REFERENCE_ERROR), where
        assert point.force_error_estimate < 2 * tolerance, where


@pytest.mark.parametrize(("accuracy", "tolerance"), [("fast", 2e-3), ("normal", 1e-3), ("fine", 1e-4)])
def test_estimates_are_honest_and_close_over_the_reference(e1, accuracy, tolerance):
    """At every point the true error is below the estimate, and in the median the estimate is at most 5 times it."""
    level, net, stated, true = LEVELS[accuracy], [], [], []
    for gap in np.unique(POINTS["gap_mm"])[:: 4 if accuracy == "fine" else 3]:
        rows = np.sort(POINTS[POINTS["gap_mm"] == gap], order="current_A")
        mesh = magnet_mesh(e1.magnet, gap * 1e-3, accuracy)
        solver = RowSolver(SweepJob(e1.magnet, mesh, e1.folder, level.order))
        both = [solver.solve(SweepRow(gap * 1e-3, tuple(rows["current_A"]), refine)) for refine in (False, True)]
        points = [
            [SimpleNamespace(force=f, coenergy=w) for f, w in zip(a["force"], a["coenergy"], strict=True)] for a in both
        ]
        for row, found, finer in zip(rows, *points, strict=True):
            true.append(abs(found.force / row["force_N"] - 1))
            net.append(true[-1] - max(row["force_rel_uncertainty"], REFERENCE_ERROR))
            stated.append(force_error_estimate(level, found, finer))
    assert len(true) == 20
    assert max(net) < tolerance
    assert (np.array(net) <= stated).all()
    assert np.median(np.array(stated) / true) <= 5


@pytest.mark.parametrize("seed", [7, 14, 18])
def test_stated_error_covers_the_true_one_on_other_magnets(seed):
    """Against a mesh ten times finer at the corners and a degree higher: chamfers, overhangs, other proportions."""
    rng = np.random.default_rng(seed)
    magnet, gap = random_core(rng, largest=12e-3), float(rng.uniform(2e-4, 1e-3))
    converged = MagnetField(
        magnet, triangulate(magnet.section(gap), MeshSize(0.001, 2.0, 0.5, 0.5)), folder=ROOT, order=3
    )
    actuator = Actuator.model_validate(
        {"schema": 1, "name": "random", "end_effects": "none", "magnet": magnet.model_dump()}
    )
    saturating = 1.6 * 2 * gap / (4e-7 * np.pi * magnet.coil.turns)
    for current in (0.3 * saturating, 2 * saturating):
        truth = converged.quantities(converged.solve(current, gap)).force
        for accuracy in ("fast", "normal"):
            point = solve(actuator, current, gap, accuracy=accuracy)
            assert abs(point.quantities.force / truth - 1) <= point.force_error_estimate


def test_linear_iron_against_its_reference(e1):
    magnet = with_iron(e1.magnet, "linear:1000")
    for gap in np.unique(LINEAR["gap_mm"])[::2]:
        field = MagnetField(magnet, magnet_mesh(magnet, gap * 1e-3), folder=e1.folder, order=2)
        for row in LINEAR[LINEAR["gap_mm"] == gap]:
            got = field.quantities(field.solve(row["current_A"], gap * 1e-3))
            assert got.force == pytest.approx(row["force_N"], rel=1e-3)
            assert got.flux_linkage == pytest.approx(row["flux_linkage_Wb"], rel=1e-3)
            assert got.coenergy == pytest.approx(got.flux_linkage * row["current_A"] / 2, rel=1e-9)


def test_flux_density_of_sections_against_the_reference(e1):
    rows = reference("sections.csv")
    for gap in np.unique(rows["gap_mm"]):
        field = field_of(e1, gap * 1e-3, accuracy="fine")
        for current in np.unique(rows["current_A"]):
            got = field.quantities(field.solve(current, gap * 1e-3)).flux_density
            for row in rows[(rows["gap_mm"] == gap) & (rows["current_A"] == current)]:
                name = row["section"].split()[0]
                assert got[name].mean == pytest.approx(row["mean_absB_T"], rel=2e-3), row
                assert got[name].max == pytest.approx(row["max_absB_T"], rel=2e-3), row


def test_moved_mesh_agrees_with_a_mesh_made_at_that_gap(e1):
    """One mesh serves all gaps: within the stated errors of both."""
    moved = field_of(e1, 4e-4)
    better = moved.refined()
    for gap, current in ((1e-4, 2.0), (1e-3, 2.0), (2e-4, 12.0)):
        one = moved.quantities(moved.solve(current, gap)).force
        own_error = LEVELS["normal"].safety * abs(1 - better.quantities(better.solve(current, gap)).force / one)
        there = solve(e1, current, gap)
        assert abs(one / there.quantities.force - 1) <= own_error + there.force_error_estimate
        assert own_error < 2e-3


def test_default_air_box_cuts_off_less_than_1e_4_of_the_force(e1):
    """Against a box twice as large, saturated and not; E1's own box would move the force by up to 2e-3."""
    size = MeshSize(0.005, 2.0, 0.5, 0.5)
    magnet = e1.magnet.model_copy(update={"air": None})
    box = magnet.air_box
    twice = magnet.model_copy(update={"air": Air(side=2 * box.side, bottom=2 * box.bottom, top=2 * box.top)})
    for gap, current in ((1e-4, 12.0), (1e-3, 1.0)):
        fields = [MagnetField(m, triangulate(m.section(gap), size), folder=e1.folder, order=3) for m in (magnet, twice)]
        default, larger = (f.quantities(f.solve(current, gap)) for f in fields)
        assert default.force == pytest.approx(larger.force, rel=1e-4)
        assert default.flux_linkage == pytest.approx(larger.flux_linkage, rel=2e-4)


def test_chamfer_and_overhang_change_the_force_the_right_way(e1):
    """Chamfered poles pull less at a small gap; a wider armature catches a little more fringing flux."""
    magnet = e1.magnet

    def force(**change: float) -> float:
        m = magnet.model_copy(update=change)
        field = MagnetField(m, magnet_mesh(m, 5e-4, "fast"), folder=e1.folder, order=2)
        return field.quantities(field.solve(2.0, 5e-4)).force

    plain = force()
    assert force(pole_chamfer=1e-3) < 0.97 * plain
    assert plain * 1.001 < force(armature_overhang=4e-3) < 1.05 * plain


def test_notes_carry_cut_curves_and_tails(servo):
    magnet = with_iron(servo.magnet, "hiperco_50")
    point = solve(servo.model_copy(update={"magnet": magnet}), 1.0, 5e-4, accuracy="fast")
    assert len(point.notes) == 1
    assert "hiperco_50: the curve is cut after B = 2.3126 T" in point.notes[0]
    short = servo.model_copy(update={"magnet": with_iron(servo.magnet, "m270_35a_pyleecan")})
    assert "saturation tail" in solve(short, 40.0, 2e-4, accuracy="fast").notes[0]


@pytest.mark.parametrize(
    ("current", "gap", "words"),
    [
        (1.0, -1e-4, ("gap -100 µm", "20 mm")),
        (1.0, 0.0, ("gap 0 m", "above 0")),
        (1.0, 0.5, ("gap 500 mm", "half width")),
        (1.0, np.nan, ("gap nan", "above 0")),
        (np.inf, 5e-4, ("current inf", "finite")),
        (np.nan, 5e-4, ("current nan", "finite")),
    ],
)
def test_impossible_points_are_refused(e1, current, gap, words):
    with pytest.raises(InputError) as caught:
        solve(e1, current, gap)
    for word in words:
        assert word in str(caught.value)


def test_unknown_accuracy_lists_the_levels(e1):
    with pytest.raises(InputError, match="fast, normal, fine"):
        solve(e1, 1.0, 5e-4, accuracy="superb")


def test_actuator_without_a_core_is_refused(servo):
    with pytest.raises(ActuatorError, match="e-core"):
        solve(servo.model_copy(update={"magnet": None}), 1.0, 5e-4)


def test_two_routes_that_disagree_are_no_small_error(servo):
    """Iron without iron: both routes are rounding, and say so."""
    magnet = servo.magnet_kind()
    iron = magnet.iron.model_copy(update={"stacking_factor": 1e-6})
    thin = magnet.model_copy(update={"centre_leg_width": 0.137e-3, "iron": iron})
    point = solve(servo.model_copy(update={"magnet": thin}), 5.0, 0.00988, accuracy="fast", end_effects=False)
    apart = abs(point.quantities.force - point.quantities.force_stress_tensor) / abs(point.quantities.force)
    assert apart > 0.5
    assert point.force_error_estimate >= apart
    assert any("the mesh cannot tell this force" in note for note in point.notes)


@pytest.mark.parametrize(
    ("force", "stress", "apart"), [(2.0, 1.0, 0.5), (-1.0, 1.0, 2.0), (0.0, 0.0, 0.0), (0.0, 1.0, np.inf)]
)
def test_how_far_the_routes_are_apart(force, stress, apart):
    assert routes_apart(force, stress) == apart
