"""The reduced field beside the full one: the same numbers, one coenergy, convergence in N, and when it gives up."""

import dataclasses

import numpy as np
import pytest
from conftest import ROOT

import msl_fem.magnetics.sweep.reduced_rows
from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.reduced.cubature import fewest, null_space, sparse_weights
from msl_fem.magnetics.reduced.full_field import FullField
from msl_fem.magnetics.reduced.integrands import force_integrands, number_integrands
from msl_fem.magnetics.reduced.linear_systems import SystemsAt
from msl_fem.magnetics.reduced.newton import line_search
from msl_fem.magnetics.reduced.reduced_iron import IronTerms
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, ReducedModel
from msl_fem.magnetics.reduced.reduction import Reducer, Reduction, ReductionSettings
from msl_fem.magnetics.sweep.reduced_rows import reduced_rows
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, sweep
from msl_fem.materials.curves import Curves, curves_of, magnetise_all
from msl_fem.materials.material import e1_iron, laminated, load_iron

GAPS = np.geomspace(2e-4, 8e-4, 5)
CURRENTS = 8 * np.linspace(0, 1, 8) ** 2
SETTINGS = ReductionSettings(tolerance=2e-4)


@pytest.fixture(scope="module")
def field() -> MagnetField:
    magnet = load_actuator(ROOT / "geometries" / "e1.toml").magnet
    mesh = magnet_mesh(magnet, 3e-4, "fast")
    return MagnetField(magnet, mesh, folder=ROOT, order=2)


@pytest.fixture(scope="module")
def full(field: MagnetField) -> FullField:
    return FullField(field.model, [field.model.source])


@pytest.fixture(scope="module")
def points() -> FieldPoints:
    return FieldPoints(np.repeat(GAPS, CURRENTS.size), np.tile(CURRENTS, GAPS.size)[:, None])


def reduce(full: FullField, points: FieldPoints, settings: ReductionSettings) -> Reduction | None:
    reducer = Reducer(full, points, settings)
    reducer.draft()
    return reducer.reduction()


@pytest.fixture(scope="module")
def reduction(full: FullField, points: FieldPoints) -> Reduction:
    made = reduce(full, points, SETTINGS)
    assert made is not None
    return made


def unseen(n: int) -> FieldPoints:
    rng = np.random.default_rng(7)
    gap = np.exp(rng.uniform(np.log(GAPS[0]), np.log(GAPS[-1]), n))
    return FieldPoints(gap, 8 * rng.uniform(0.05, 1, (n, 1)))


def errors(model: ReducedModel, full: FullField, points: FieldPoints) -> np.ndarray:
    """(n, 2) of force and flux linkage against full solutions, of the largest."""
    states = model.solve(points)
    assert (states.steps > 0).all()
    exact = np.empty((len(points), 2))
    for n in range(len(points)):
        solution = full.solve(points, n, model.basis.vectors @ states.states[n])
        numbers = full.numbers(float(points.coordinate[n]), solution.potential)
        exact[n] = numbers.energy_slope, numbers.flux_linkage[0]
    found = np.column_stack([states.energy_slope, states.flux_linkage[:, 0]])
    return np.abs(found - exact) / np.abs(exact).max(axis=0)


def test_certificate_holds_off_the_grid(reduction: Reduction, full: FullField) -> None:
    certificate = reduction.certificate
    assert errors(reduction.model, full, unseen(6)).max() <= certificate.error_estimate <= SETTINGS.tolerance
    assert certificate.error_estimate >= SETTINGS.tolerance / 4, "however small its dozen checks are"
    assert 1 <= certificate.effectivity < 5
    assert certificate.checked >= 6


def test_numbers_are_slopes_of_one_coenergy(reduction: Reduction) -> None:
    """Taylor: the coenergy's differences of the fourth order are force and flux linkage, theirs the slopes."""
    at, step = np.array([4e-4, 3.0]), np.array([4e-6, 0.03])
    weight = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}

    def states(axis: int):
        places = np.array([at + k * step * (np.arange(2) == axis) for k in weight])
        return reduction.model.solve(FieldPoints(places[:, 0], places[:, 1:]))

    def slope(axis: int, values: np.ndarray) -> float:
        return float(np.array(list(weight.values())) @ values) / step[axis]

    here = reduction.model.solve(FieldPoints(at[:1], at[None, 1:]))
    along_gap, along_current = states(0), states(1)
    assert slope(0, along_gap.coenergy) == pytest.approx(-here.energy_slope[0], rel=1e-6)
    assert slope(1, along_current.coenergy) == pytest.approx(here.flux_linkage[0, 0], rel=1e-6)
    assert slope(0, along_gap.energy_slope) == pytest.approx(here.energy_slope_by_coordinate[0], rel=1e-4)
    assert slope(1, along_current.energy_slope) == pytest.approx(here.energy_slope_by_current[0, 0], rel=1e-4)
    assert slope(1, along_current.flux_linkage[:, 0]) == pytest.approx(here.inductance[0, 0, 0], rel=1e-4)


def test_reciprocity_to_rounding(reduction: Reduction, points: FieldPoints) -> None:
    """dF/di by the state's slope along the current, -dlambda/dgap by that along the gap."""
    states = reduction.states
    by_gap = states.by_coordinate @ reduction.model.sources[0]
    largest = np.abs(by_gap).max()
    assert np.abs(states.energy_slope_by_current[:, 0] + by_gap).max() <= 1e-9 * largest


def test_where_the_states_are_sought_from_changes_them_by_little_and_spares_steps(reduction: Reduction) -> None:
    """Along the slopes from the nearest points; at the points themselves the states are those already found."""
    known = reduction.states
    others = FieldPoints(known.points.coordinate * 1.02, known.points.currents * 0.97)
    start = known.near(others).states
    along, near = reduction.model.solve(others), reduction.model.solve(others, start)
    assert near.energy_slope == pytest.approx(along.energy_slope, rel=1e-6, abs=1e-8)
    assert near.steps.sum() < 0.8 * along.steps.sum()
    missed, moved = (np.linalg.norm(states - along.states) for states in (start, known.states))
    assert missed < 0.1 * moved
    assert np.array_equal(known.near(known.points).states, known.states)


def test_tangent_is_the_slope_of_the_gradient_by_both_ways_of_making_it(reduction: Reduction) -> None:
    """Taylor: the gradient's change less the tangent's is of the second order; with shared products and without."""
    model, (state, step) = reduction.model, reduction.states.states[[-1, -9]]
    direct, shared = (IronTerms(model.iron, many=many) for many in (False, True))
    curvature = direct.at(state[None])[1]
    upper = np.zeros((2, state.size, state.size))
    upper[:, *np.triu_indices(state.size)] = [terms.tangents(curvature)[0] for terms in (direct, shared)]
    assert upper[0] == pytest.approx(upper[1], rel=1e-9, abs=1e-12 * np.abs(upper[0]).max())
    tangent = upper[0] + np.triu(upper[0], 1).T
    along = direct.along(curvature, np.stack([step, state])[None])[0]
    assert along == pytest.approx(np.stack([step, state]) @ tangent, rel=1e-9, abs=1e-12 * np.abs(along).max())
    left = []
    for size in (1e-2, 1e-3):
        change = direct.at((state + size * step)[None])[0] - direct.at(state[None])[0]
        left.append(np.linalg.norm(change[0] - size * tangent @ step))
    assert 80 < left[0] / left[1] < 120


def test_line_search_ends_where_the_slope_is_small_and_says_what_is_there(reduction: Reduction) -> None:
    """From no field, along steps to ten times a solution, where the iron is far beyond its knee."""
    model, states = reduction.model, reduction.states
    n = int(np.argmax(states.points.currents[:, 0]))
    stiffness = model.linear.at(float(states.points.coordinate[n]))[0][None]
    load = states.points.currents[n] @ model.sources
    terms = IronTerms(model.iron, many=False)
    step = 10 * states.states[n][None]
    descent = step @ load
    systems, on = SystemsAt(stiffness, np.array([0])), np.array([0])
    found, force, curvature = line_search(0 * step, step, descent, systems, on, load[None], terms)
    assert np.linalg.norm(found) < 0.3 * np.linalg.norm(step)
    there = terms.at(found)
    assert (force, curvature) == (pytest.approx(there[0]), pytest.approx(there[1]))
    slope = step[0] @ (stiffness[0] @ found[0] + force[0] - load)
    assert abs(slope) <= 0.5 * descent[0]


def test_solutions_taken_are_states_with_their_slopes(full: FullField, points: FieldPoints) -> None:
    """Each solved roughly, so that its state is near the reduced one at its point."""
    reducer = Reducer(full, points, SETTINGS)
    reducer.draft()
    basis = reducer.space.basis(SETTINGS.modes * SETTINGS.tolerance)
    known = reducer.taken_in(basis)
    found = ReducedModel(basis, full.sources, basis.whole_iron()).solve(known.points)
    for name in ("states", "by_current", "by_coordinate"):
        one, other = getattr(known, name), getattr(found, name)
        assert np.linalg.norm(one - other) < 0.05 * np.linalg.norm(other), name


def test_a_far_start_leads_to_the_same_states(reduction: Reduction) -> None:
    """The line search: a full step from there overshoots by far in the saturated iron."""
    known = reduction.states
    again = reduction.model.solve(known.points, -3 * known.states[::-1])
    assert (again.steps > 0).all()
    assert again.steps.max() <= 20
    driven = known.points.currents[:, 0] > 0
    assert again.energy_slope[driven] == pytest.approx(known.energy_slope[driven], rel=1e-6)
    assert np.array_equal(again.states[~driven], np.zeros_like(again.states[~driven]))


def test_error_falls_with_the_number_of_functions(reduction: Reduction, full: FullField) -> None:
    basis = reduction.model.basis
    whole = ReducedModel(basis, full.sources, basis.whole_iron())
    saturated = FieldPoints(np.array([2.3e-4, 2.8e-4, 5e-4]), np.array([[5.0], [7.0], [6.5]]))
    few = [errors(whole.without_last(basis.size - n), full, saturated).max() for n in (2, 6, basis.size)]
    assert few[0] > 5 * few[1] > 25 * few[2], few


def test_table_numbers_are_those_of_the_full_solver(field: MagnetField, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that a row of a table has, with air that is deeper than the iron, too."""
    monkeypatch.setattr(msl_fem.magnetics.sweep.reduced_rows, "LEAST_POINTS", 20)
    job = SweepJob(field.magnet, field.model.mesh, field.folder, 2, end_effects=True, accuracy="fast")
    rows = [SweepRow(float(gap), tuple(CURRENTS.tolist())) for gap in GAPS]
    reduced = reduced_rows(job.field(), rows, "fast")
    assert reduced is not None
    exact = RowSolver(job).solve(rows[2])
    for name, values in exact.items():
        if name not in ("cpu_seconds", "newton_iterations"):
            limit = 1e-2 if "slope" in name or "inductance" in name else 1e-3
            assert np.abs(reduced.answers[2][name] - values).max() <= limit * np.abs(values).max(), name


def test_what_cannot_be_certified_is_not_reduced(full: FullField, points: FieldPoints) -> None:
    settings = dataclasses.replace(SETTINGS, tolerance=1e-13, rounds=1, drafts=1)
    assert reduce(full, points, settings) is None


def test_sweep_falls_back_to_the_full_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    e1 = load_actuator(ROOT / "geometries" / "e1.toml")
    monkeypatch.setattr(msl_fem.magnetics.sweep.reduced_rows, "LEAST_POINTS", 2)
    monkeypatch.setattr(msl_fem.magnetics.sweep.reduced_rows, "reduce_at_all", lambda *_: None)
    table, report = sweep(e1, [2e-4, 4e-4], [1.0, 2.0], settings=SweepSettings(accuracy="fast"))
    assert report.certificate is None
    assert "certificate" not in table.provenance
    assert report.solutions == 7, "6 nodes, the column without current among them, and 1 between"


def test_sums_for_numbers_are_the_irons_force_times_their_adjoints(reduction: Reduction, full: FullField) -> None:
    """The reduced force of the irons is what the load leaves of the linear regions' at a state of the whole quadrature;
    the sums for reduced forces are its own entries, over their size.
    """
    basis, (gap, current) = reduction.model.basis, (3e-4, 6.0)
    at = FieldPoints(np.array([gap]), np.array([[current]]))
    states = ReducedModel(basis, full.sources, basis.whole_iron()).solve(at)
    linear, weight = reduction.model.linear.at(gap)[0], basis.quadrature.weight
    force = current * reduction.model.sources[0] - linear @ states.states[0]
    sums = number_integrands(basis, states, np.array([2.0, 5.0])) @ weight
    expected = [states.by_coordinate[0] @ force / 2, states.by_current[0, 0] @ force / 5]
    assert sums == pytest.approx(expected, rel=1e-5)
    entries = force_integrands(basis, states.states) @ weight
    assert entries == pytest.approx(force / np.linalg.norm(force), abs=1e-5)


def test_cubature_that_keeps_the_numbers_sums_keeps_the_numbers(reduction: Reduction, full: FullField) -> None:
    """Of states that it was not made for, with half the points that all reduced forces of a dozen states would take."""
    basis, exact = reduction.model.basis, unseen(8)
    whole = ReducedModel(basis, full.sources, basis.whole_iron()).solve(exact)
    few = reduction.model.solve(exact)
    assert reduction.model.iron.weight.size < 6 * basis.size
    for name, limit in (("energy_slope", 3e-5), ("flux_linkage", 3e-5), ("coenergy", 1e-5), ("inductance", 1e-3)):
        one, other = getattr(few, name), getattr(whole, name)
        assert np.abs(one - other).max() <= limit * np.abs(other).max(), name


def test_a_cubature_that_misses_too_much_keeps_more_sums(full: FullField, points: FieldPoints) -> None:
    """From one fit that keeps far too few to several: points are added, and the one that misses least is taken."""
    missed, sizes = [], []
    for fits in (1, 4):
        reducer = Reducer(full, points, dataclasses.replace(SETTINGS, fit=60 * SETTINGS.fit, fits=fits))
        reducer.draft()
        made = reducer.model()
        assert made is not None
        missed.append(made[2].max())
        sizes.append(made[0].iron.weight.size)
    assert missed[1] < 0.3 * missed[0]
    assert sizes[1] > sizes[0]


def test_cubature_keeps_sums_with_positive_weights() -> None:
    rng = np.random.default_rng(3)
    rows, weight = rng.normal(size=(12, 500)) ** 3, rng.uniform(0.5, 2, 500)
    chosen, found = sparse_weights(rows, weight, tolerance=1e-6)
    assert chosen.size <= 13
    assert (found > 0).all()
    assert rows[:, chosen] @ found == pytest.approx(rows @ weight, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("dependent", [False, True])
def test_null_space_is_what_the_columns_map_to_nothing(dependent: bool) -> None:
    columns = np.random.default_rng(5).normal(size=(6, 14))
    if dependent:
        columns[4] = 2 * columns[1] - columns[0]
    free = null_space(columns)
    assert np.abs(columns @ free.T).max() < 1e-12 * np.abs(free).max()
    assert np.linalg.matrix_rank(free) == len(free) == 8


def test_fewest_weights_keep_the_moments_of_a_line() -> None:
    """Four moments of a hundred points are those of four of them at most."""
    x = np.linspace(-1, 1, 100)
    columns = np.stack([x**k for k in range(4)])
    weight = fewest(columns, np.full(100, 0.02))
    assert np.count_nonzero(weight) <= 4
    assert (weight >= 0).all()
    assert columns @ weight == pytest.approx(columns.sum(axis=1) * 0.02, abs=1e-12)


def magnetised(b: float, iron: int, curves: Curves) -> tuple[float, float]:
    h, slope = np.empty(1), np.empty(1)
    magnetise_all(np.array([b]), np.array([iron]), curves, h, slope)
    return float(h[0]), float(slope[0])


@pytest.mark.parametrize("iron", [load_iron("m19"), laminated(load_iron("steel_1010"), 0.96), e1_iron()])
def test_compiled_curve_is_the_iron(iron) -> None:
    curves = curves_of([load_iron("linear:1000"), iron])
    for b in (0.0, 0.01, 0.7, 1.4321, 1.9, 2.6):
        h, slope = iron.magnetise(np.array([b]))
        assert magnetised(b, 1, curves) == pytest.approx((h[0], slope[0]), rel=1e-6)
    assert magnetised(1.5, 0, curves)[0] == pytest.approx(load_iron("linear:1000").magnetise(np.array([1.5]))[0][0])


@pytest.mark.parametrize("name", ["m19", "steel_1010", "linear:1000"])
def test_every_piece_of_a_compiled_curve_is_found(name: str) -> None:
    iron = load_iron(name)
    curves = curves_of([e1_iron(), iron, load_iron("m19")])
    points = curves.b[curves.start[1] : curves.start[2]]
    for b in (*points, *(points[1:] + points[:-1]) / 2):
        h, slope = iron.magnetise(np.array([b]))
        assert magnetised(b, 1, curves) == pytest.approx((h[0], slope[0]), rel=1e-9)
