"""Sweeps: the table against converged values and fresh field solutions, resuming, workers, failures, refused grids."""

import dataclasses
import os
import signal

import numpy as np
import pytest
from conftest import ROOT
from field_problems import reference

import msl_fem.computing.jobs
import msl_fem.magnetics.sweep.rows
from msl_fem.actuator import Actuator, load_actuator
from msl_fem.computing.row_cache import RowCache, content_key
from msl_fem.errors import ComputationError, InputError, NotConverged
from msl_fem.magnetics.field.magnet_field import MagnetField, magnet_mesh
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, default_grid, sweep
from msl_fem.table.magnetic_table import MagneticTable

POINTS = reference("reference.csv")
GAPS, CURRENTS = np.unique(POINTS["gap_mm"]) * 1e-3, np.unique(POINTS["current_A"])
SMALL = (np.array([2e-4, 4e-4, 8e-4]), np.array([1.0, 4.0, 8.0]))
FAST = SweepSettings(accuracy="fast")


@pytest.fixture(scope="module")
def e1() -> Actuator:
    return load_actuator(ROOT / "geometries" / "e1.toml")


@pytest.fixture(scope="module")
def e1_sweep(e1) -> tuple[MagneticTable, SweepReport]:
    """The 60 points of the reference, once for all tests."""
    return sweep(e1, GAPS, CURRENTS)


@pytest.fixture(scope="module")
def small(e1) -> MagneticTable:
    return sweep(e1, *SMALL, settings=FAST)[0]


def at_reference(table: MagneticTable, values: np.ndarray) -> np.ndarray:
    """The grid's values in the order of the reference's rows."""
    m = np.searchsorted(table.gap, POINTS["gap_mm"] * 1e-3 * (1 - 1e-9))
    n = np.searchsorted(table.current, POINTS["current_A"])
    return values[m, n]


def test_grid_agrees_with_the_reference(e1_sweep):
    table, _ = e1_sweep
    force = at_reference(table, table.nodes["force"])
    assert np.abs(force / POINTS["force_N"] - 1).max() < 1e-3
    assert np.abs(at_reference(table, table.nodes["flux_linkage"]) / POINTS["flux_linkage_Wb"] - 1).max() < 5e-4
    assert np.abs(at_reference(table, table.nodes["coenergy"]) / POINTS["coenergy_J"] - 1).max() < 5e-4
    assert np.abs(at_reference(table, table.extras["force_stress_tensor"]) / force - 1).max() < 5e-3


def test_stated_mesh_error_covers_the_true_one(e1_sweep):
    table, report = e1_sweep
    true = np.abs(at_reference(table, table.nodes["force"]) - POINTS["force_N"]).max() / POINTS["force_N"].max()
    assert true <= table.mesh_error < 1e-3
    assert report.mesh_error == table.mesh_error


def test_stated_interpolation_error_covers_fresh_solutions(e1, e1_sweep):
    """Field solutions at random points off the nodes, on the sweep's own mesh; 10 currents are few, and it says so."""
    table, _ = e1_sweep
    magnet = e1.magnet
    mesh = magnet_mesh(magnet, float(np.sqrt(GAPS[0] * GAPS[-1])))
    field = MagnetField(magnet, mesh, folder=e1.folder, order=2)
    rng = np.random.default_rng(8)
    scale = np.abs(table.nodes["force"]).max(), np.abs(table.nodes["flux_linkage"]).max()
    worst = np.zeros(2)
    for gap, current in zip(rng.uniform(1e-4, 1e-3, 30), rng.uniform(0, 12, 30), strict=True):
        got = field.quantities(field.solve(current, gap))
        there = table.evaluate(current, gap)
        difference = abs(got.force - there["force"]), abs(got.flux_linkage - there["flux_linkage"])
        worst = np.maximum(worst, np.array(difference) / scale)
    assert worst[0] <= table.interpolation_error
    assert worst.max() <= table.reciprocity_error
    assert table.interpolation_error < 20 * worst[0], "the statement is no empty phrase"
    assert 1e-4 < table.interpolation_error <= table.reciprocity_error < 1e-2


def test_more_nodes_bring_the_stated_error_down(e1, small):
    gaps, currents = SMALL
    denser, _ = sweep(e1, np.geomspace(gaps[0], gaps[-1], 5), np.linspace(1, currents[-1], 8), settings=FAST)
    assert denser.interpolation_error < 0.5 * small.interpolation_error


def test_report_counts_what_was_done(e1_sweep):
    table, report = e1_sweep
    assert report.points == 60
    assert report.failed == 0
    assert report.reused_rows == 0
    assert 60 < report.newton_iterations < 360
    assert 3000 < report.unknowns < 6000
    assert report.cpu_seconds > 0
    assert report.notes == ()
    assert set(table.provenance) >= {"actuator", "actuator_sha256", "iron", "mesh", "solver", "versions", "date"}


def test_column_without_current_is_added(e1_sweep):
    table, _ = e1_sweep
    assert table.current[0] == 0
    assert table.current.size == CURRENTS.size + 1
    for name in ("coenergy", "flux_linkage", "force"):
        assert not table.nodes[name][:, 0].any()


def test_inductance_of_the_table_is_positive_everywhere(e1_sweep):
    """Field energy is convex: between the nodes the interpolant must not lose that."""
    table, _ = e1_sweep
    current, gap = np.meshgrid(np.linspace(-12, 12, 241), np.linspace(1e-4, 1e-3, 91))
    assert table.evaluate(current, gap)["incremental_inductance"].min() > 0


# --- resuming ---------------------------------------------------------------------------------------------------------


def same(one: MagneticTable, other: MagneticTable, *, rel: float = 1e-9) -> bool:
    """Whether two tables hold the same arrays to a share of their largest values."""
    pairs = [({**one.nodes, **one.extras}[k], v) for k, v in {**other.nodes, **other.extras}.items()]
    return len(pairs) == len(one.nodes) + len(one.extras) and all(
        np.abs(a - b).max() <= rel * np.abs(b).max() for a, b in pairs
    )


class Interrupted(Exception):  # noqa: N818
    """What stops a sweep in these tests."""


def break_after(monkeypatch: pytest.MonkeyPatch, rows: int) -> list[float]:
    """Let the sweep die after so many rows; returns the list of gaps begun."""
    begun: list[float] = []
    solve = msl_fem.magnetics.sweep.rows.RowSolver.solve

    def stand_in(self, row):
        begun.append(row.gap)
        if len(begun) > rows:
            raise Interrupted
        return solve(self, row)

    monkeypatch.setattr(msl_fem.magnetics.sweep.rows.RowSolver, "solve", stand_in)
    return begun


def test_sweep_goes_on_where_it_was_interrupted(e1, small, tmp_path, monkeypatch):
    settings = dataclasses.replace(FAST, cache=tmp_path / "rows", resume=True)
    with monkeypatch.context() as patch:
        break_after(patch, 3)
        with pytest.raises(Interrupted):
            sweep(e1, *SMALL, settings=settings)
    assert len(list((tmp_path / "rows").glob("*.npz"))) == 3
    begun = break_after(monkeypatch, 100)
    seen: list[tuple[int, int]] = []
    table, report = sweep(e1, *SMALL, settings=settings, progress=lambda done, total: seen.append((done, total)))
    assert report.reused_rows == 3
    assert len(begun) == 8 - 3
    assert seen == [(n, 8) for n in range(3, 9)]
    assert same(table, small)
    assert table.mesh_error == pytest.approx(small.mesh_error, rel=1e-6)
    assert table.interpolation_error == pytest.approx(small.interpolation_error, rel=1e-6)


def test_without_resume_nothing_is_reused(e1, tmp_path):
    settings = dataclasses.replace(FAST, cache=tmp_path)
    for _ in range(2):
        _, report = sweep(e1, [2e-4, 4e-4], [1.0, 2.0], settings=settings)
        assert report.reused_rows == 0


def test_rows_of_another_magnet_iron_or_accuracy_are_not_reused(e1, tmp_path):
    """The cache's keys hold all that determines the answers; a CSV curve counts by its points, not by its name."""
    grid = ([2e-4, 4e-4], [1.0, 2.0])
    settings = dataclasses.replace(FAST, cache=tmp_path / "rows", resume=True)

    def of_iron(h_end: float) -> Actuator:
        points = np.array([[0, 0], [100, 1.0], [300, 1.3], [1000, 1.5], [5000, 1.7], [h_end, 2.0]])
        lines = [f"{h:g},{b:g}" for h, b in points]
        (tmp_path / "own.csv").write_text("H_A_per_m,B_T\n" + "\n".join(lines))
        magnet = e1.magnet
        magnet = magnet.model_copy(
            update={"iron": magnet.iron.model_copy(update={"core": "own.csv", "armature": "own.csv"})}
        )
        return e1.model_copy(update={"magnet": magnet, "file": tmp_path / "e1.toml"})

    first = of_iron(60000.0)
    sweep(first, *grid, settings=settings)
    assert sweep(first, *grid, settings=settings)[1].reused_rows == 5
    assert sweep(of_iron(61000.0), *grid, settings=settings)[1].reused_rows == 0, "the same name, another curve"
    deeper = e1.model_copy(update={"magnet": e1.magnet.model_copy(update={"stack_depth": 0.021})})
    for other, changed in (
        (e1, settings),
        (deeper, settings),
        (deeper, dataclasses.replace(settings, accuracy="normal")),
    ):
        assert sweep(other, *grid, settings=changed)[1].reused_rows == 0


def test_damaged_row_is_solved_again(e1, tmp_path):
    settings = dataclasses.replace(FAST, cache=tmp_path, resume=True)
    table, _ = sweep(e1, [2e-4, 4e-4], [1.0, 2.0], settings=settings)
    one, two, three, *_ = sorted(tmp_path.glob("*.npz"))
    one.write_bytes(one.read_bytes()[: one.stat().st_size // 2])
    two.write_bytes(b"")
    three.write_bytes(b"no archive at all")
    again, report = sweep(e1, [2e-4, 4e-4], [1.0, 2.0], settings=settings)
    assert report.reused_rows == 2
    assert same(again, table, rel=1e-12)


def test_folder_that_cannot_hold_rows_is_said_before_the_work(e1, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    begun = break_after(monkeypatch, 100)
    with pytest.raises(InputError, match="cannot be written"):
        sweep(e1, *SMALL, settings=dataclasses.replace(FAST, cache=tmp_path / "file" / "rows"))
    assert begun == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_within_a_row_is_answered_behind_it(number, tmp_path, monkeypatch):
    """Within, the archive would stay half open, and its end tell so in a traceback."""

    def interrupt(number, frame):
        raise KeyboardInterrupt

    def interrupted(stream, **row):
        signal.raise_signal(number)
        saved(stream, **row)

    saved, before = np.savez, signal.signal(number, interrupt)
    monkeypatch.setattr(np, "savez", interrupted)
    cache = RowCache(tmp_path / "rows")
    try:
        with pytest.raises(KeyboardInterrupt):
            cache.put("a", {"force": np.array([1.0, 2.0])})
    finally:
        signal.signal(number, before)
    assert (cache.get("a") or {})["force"].tolist() == [1.0, 2.0]


def test_cache_is_cleared_without_touching_strangers(tmp_path):
    cache = RowCache(tmp_path / "rows")
    cache.put("a", {"force": np.array([1.0, 2.0])})
    assert (cache.get("a") or {})["force"].tolist() == [1.0, 2.0]
    assert cache.get("b") is None
    (tmp_path / "rows" / "notes.txt").write_text("mine")
    cache.clear()
    assert [p.name for p in (tmp_path / "rows").iterdir()] == ["notes.txt"]
    RowCache(tmp_path / "never made").clear()


def test_content_key_is_the_contents_name():
    assert content_key({"a": 1.5, "b": [2]}) == content_key({"b": [2], "a": 1.5})
    assert content_key({"a": 1.5}) != content_key({"a": 1.5000000001})


# --- workers and failures ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["fork", "forkserver", "spawn"])
def test_two_workers_make_the_same_table(e1, small, tmp_path, monkeypatch, method):
    monkeypatch.setattr(msl_fem.computing.jobs, "_start_method", lambda: method)
    settings = dataclasses.replace(FAST, workers=2, cache=tmp_path)
    table, report = sweep(e1, *SMALL, settings=settings)
    for stored in ("nodes", "extras"):
        for name, values in getattr(small, stored).items():
            assert np.array_equal(getattr(table, stored)[name], values), f"{name} to the last bit"
    assert table.mesh_error == small.mesh_error
    assert table.interpolation_error == small.interpolation_error
    assert report.cpu_seconds > 0
    assert len(list(tmp_path.glob("*.npz"))) == 8


def die(_row: object) -> None:
    os._exit(1)


def test_worker_that_dies_is_a_computation_error(e1, monkeypatch):
    """As when memory runs out: the pool breaks, and the message says how to go on."""
    monkeypatch.setattr(msl_fem.computing.jobs, "_start_method", lambda: "fork")
    monkeypatch.setattr(msl_fem.computing.jobs, "_solve_in_worker", die)
    with pytest.raises(ComputationError, match=r"worker process.*--resume"):
        sweep(e1, *SMALL, settings=dataclasses.replace(FAST, workers=2))


def fail_at(monkeypatch: pytest.MonkeyPatch, current: float, gap: float) -> None:
    """Let Newton fail at one point."""
    solve = MagnetField.solve

    def stand_in(self, i, g, *, start=None):
        if i == current and abs(g - gap) < 1e-12:
            raise NotConverged("made to fail")
        return solve(self, i, g, start=start)

    monkeypatch.setattr(MagnetField, "solve", stand_in)


def test_failed_point_is_named_and_the_rest_is_kept(e1, small, tmp_path, monkeypatch):
    settings = dataclasses.replace(FAST, cache=tmp_path, resume=True)
    with monkeypatch.context() as patch:
        fail_at(patch, 4.0, 4e-4)
        with pytest.raises(ComputationError, match=r"1 points.*4 A at 0\.4 mm.*--resume"):
            sweep(e1, *SMALL, settings=settings)
    table, report = sweep(e1, *SMALL, settings=settings)
    assert report.reused_rows >= 6, "all rows but those with the failed point"
    assert same(table, small)


def test_failed_check_between_the_nodes_is_no_silent_success(e1, monkeypatch):
    """Without its checks a table would state an error that nobody measured."""
    between = float(np.sqrt(2e-4 * 4e-4))
    for current in (0.5, 6.0):
        with monkeypatch.context() as patch:
            fail_at(patch, current, between)
            with pytest.raises(ComputationError, match=rf"{current:g} A at 0\.28"):
                sweep(e1, *SMALL, settings=FAST)


def test_point_that_fails_from_its_prediction_is_tried_from_nothing(e1, small, monkeypatch):
    solve = MagnetField.solve
    failed: list[float] = []

    def stand_in(self, i, g, *, start=None):
        if start is not None and i == 8.0:
            failed.append(g)
            raise NotConverged("made to fail")
        return solve(self, i, g, start=start)

    monkeypatch.setattr(MagnetField, "solve", stand_in)
    table, _ = sweep(e1, *SMALL, settings=FAST)
    assert len(failed) >= 3
    assert same(table, small, rel=1e-6), "slopes come from the tangent one step before the solution"


# --- grids ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gaps", "currents", "words"),
    [
        ([1e-4], [1.0, 2.0], ("at least 2 different gaps", "given are 1")),
        ([1e-4, 1e-4], [1.0, 2.0], ("at least 2 different gaps",)),
        ([1e-4, 2e-4], [0.0, 1.0], ("2 currents beside 0", "and 1")),
        ([-1e-4, 2e-4], [1.0, 2.0], ("gap -100 µm",)),
        ([1e-4, 1.0], [1.0, 2.0], ("half width",)),
        ([1e-4, np.nan], [1.0, 2.0], ("gap nan",)),
        ([1e-4, 2e-4], [-1.0, 2.0], ("current -1 A", "symmetry")),
        ([1e-4, 2e-4], [1.0, np.nan], ("current nan A",)),
        ([1e-4, 2e-4], [1.0, 2.0, np.inf], ("current inf A",)),
    ],
)
def test_bad_grids_are_refused(e1, gaps, currents, words):
    with pytest.raises(InputError) as caught:
        sweep(e1, gaps, currents, settings=FAST)
    for word in words:
        assert word in str(caught.value)


def test_default_grid_covers_the_ranges_with_a_margin(servo):
    gap, current = default_grid(servo)
    assert gap[[0, -1]] == pytest.approx([5e-5, 1.2e-3])
    assert current[[0, -1]] == pytest.approx([0, 12])
    assert np.allclose(gap[1:] / gap[:-1], gap[1] / gap[0])
    assert (np.diff(current, 2) > 0).all()


def test_the_default_grid_reaches_past_both_end_stops(servo):
    motion = servo.motion.model_copy(update={"end_stop": 5.5e-4})
    gap, _ = default_grid(servo.model_copy(update={"motion": motion}))
    assert gap[0] < servo.motion.nominal_gap - 5.5e-4
    assert gap[-1] > servo.motion.nominal_gap + 5.5e-4


def test_default_grid_of_parallel_magnets_halves_the_current(servo):
    parallel = servo.model_copy(update={"sides": servo.sides.model_copy(update={"connection": "parallel"})})
    assert default_grid(parallel)[1][-1] == pytest.approx(6.0)


def test_default_grid_needs_the_ranges(e1):
    with pytest.raises(InputError, match=r"e1 states no .*--gaps"):
        default_grid(e1)
