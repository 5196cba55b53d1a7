"""The table of both sides: against fields, its symmetries and reciprocity, its file, the commands."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.errors import InputError, OutOfTable, TableError
from msl_fem.magnetics.field.pair_field import PairField, pair_magnet, pair_mesh
from msl_fem.magnetics.sweep.pair_grid import default_pair_grid
from msl_fem.magnetics.sweep.pair_rows import PairSweepRow, pair_job
from msl_fem.magnetics.sweep.pair_sweep import pair_sweep
from msl_fem.magnetics.sweep.pair_symmetry import with_each_alone
from msl_fem.magnetics.sweep.reduced_rows import reduced_side_rows
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings
from msl_fem.table.magnetic_table import read_table
from msl_fem.table.pair_table import PAIR_NODES, PairTable, read_pair_table, write_pair_table

SERVO = ROOT / "geometries/fast_tool_servo.toml"
GAP_SUM = 1.2e-3


@pytest.fixture(scope="module")
def servo() -> Actuator:
    return load_actuator(SERVO)


@pytest.fixture(scope="module")
def swept(servo: Actuator) -> tuple[PairTable, SweepReport]:
    positions, currents = np.array([0.15e-3, 0.3e-3]), np.array([0.7, 1.6, 2.8])
    plane = SweepSettings(accuracy="fast", end_effects=False)
    return pair_sweep(servo, positions, currents, gap_sum=GAP_SUM, settings=plane)


@pytest.fixture(scope="module")
def path(swept: tuple[PairTable, SweepReport], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pair_table(swept[0], tmp_path_factory.mktemp("pair") / "pair.nc")


def run(arguments: list[str]) -> int:
    return run_guarded(lambda: app(arguments))


def test_it_is_what_fields_between_the_nodes_say(servo: Actuator, swept: tuple[PairTable, SweepReport]) -> None:
    """On random points, on the sweep's own mesh; what it states as interpolation error holds them."""
    table, report = swept
    field = PairField(servo, pair_mesh(pair_magnet(servo), np.sqrt(0.3e-3 * 0.9e-3), "fast"), gap_sum=GAP_SUM, order=2)
    rng = np.random.default_rng(3)
    largest = {name: np.abs(table.nodes[name]).max() for name in ("force", "flux_linkage_1", "flux_linkage_2")}
    for x, i, j in rng.uniform([-0.3e-3, -2.8, -2.8], [0.3e-3, 2.8, 2.8], (12, 3)):
        solution = field.solve(x, i, j)
        q = field.quantities(solution, (i, j))
        found = table.evaluate(x, i, j)
        for name, scale in largest.items():
            assert abs(found[name] - getattr(q, name)) < max(3 * report.reciprocity_error, 1e-4) * scale, name
    assert report.interpolation_error < 5e-3
    assert report.points == 5 * 7 * 7


def test_reciprocity_is_exact(swept: tuple[PairTable, SweepReport]) -> None:
    """d lambda_1/d i_2 = d lambda_2/d i_1 and dF/d i_1 = d lambda_1/dx: by differences of the table."""
    table, _ = swept
    x, i, j, h = 0.11e-3, 1.1, -2.1, 1e-4
    by_2 = (table.evaluate(x, i, j + h)["flux_linkage_1"] - table.evaluate(x, i, j - h)["flux_linkage_1"]) / (2 * h)
    by_1 = (table.evaluate(x, i + h, j)["flux_linkage_2"] - table.evaluate(x, i - h, j)["flux_linkage_2"]) / (2 * h)
    assert by_2 == pytest.approx(by_1, rel=1e-6)
    assert by_2 == pytest.approx(float(table.evaluate(x, i, j)["mutual_inductance"]), rel=1e-6)


def test_symmetries_hold_everywhere(swept: tuple[PairTable, SweepReport]) -> None:
    table, _ = swept
    rng = np.random.default_rng(4)
    x, i, j = rng.uniform([-0.3e-3, -2.8, -2.8], [0.3e-3, 2.8, 2.8], (50, 3)).T
    here, exchanged, reversed_ = table.evaluate(x, i, j), table.evaluate(-x, j, i), table.evaluate(x, -i, -j)
    assert exchanged["force"] == pytest.approx(-here["force"], abs=1e-6)
    assert exchanged["flux_linkage_2"] == pytest.approx(here["flux_linkage_1"], abs=1e-10)
    assert reversed_["force"] == pytest.approx(here["force"], abs=1e-6)
    assert reversed_["flux_linkage_1"] == pytest.approx(-here["flux_linkage_1"], abs=1e-10)


def test_the_file_reads_back(swept: tuple[PairTable, SweepReport], path: Path) -> None:
    table, again = swept[0], read_pair_table(path)
    assert np.array_equal(again.nodes["force"], table.nodes["force"])
    assert again.sections == table.sections
    assert again.evaluate(1e-4, 1.0, -1.0) == table.evaluate(1e-4, 1.0, -1.0)
    with pytest.raises(TableError, match="both sides"):
        read_table(path)
    with pytest.raises(TableError, match="one magnet"):
        read_pair_table(ROOT / "lookup_tables/fast_tool_servo.nc")


def test_what_a_mesh_gets_wrong_of_either_side_alone_is_taken_off_exactly() -> None:
    """W = a common term plus one of each side; a mesh with errors in those of the sides gives all derivatives of W."""
    x, i, j = np.meshgrid([-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-2.0, 0.0, 2.0], indexing="ij")

    def arrays(error: float) -> dict[str, np.ndarray]:
        common = [i * j, j, i, 0 * x, 0 * x, 0 * x, 1 + 0 * x, 0 * x, 0 * x, 0 * x]
        own = 1 + error
        first = [(2 + x) * i**2, 2 * (2 + x) * i, 0, i**2, 2 * (2 + x), 0, 0, 2 * i, 0, 0]
        second = [(2 - x) * j**2, 0, 2 * (2 - x) * j, -(j**2), 0, 2 * (2 - x), 0, 0, -2 * j, 0]
        made = zip(PAIR_NODES, common, first, second, strict=True)
        return {name: both + own * (one + two) + 0 * x for name, both, one, two in made}

    exact, coarse = arrays(0.0), arrays(0.05)
    beside = (i != 0) & (j != 0)
    alone = {name: np.where(beside, np.nan, values) for name, values in exact.items()}
    density = "flux_density_yoke_1"
    alone[density], coarse[density] = np.where(beside, np.nan, np.abs(i) / 2), np.abs(i) / 2 * 0.98
    found = with_each_alone(coarse, alone)
    for name, values in exact.items():
        np.testing.assert_allclose(found[name], values, atol=1e-13, err_msg=name)
    np.testing.assert_allclose(found[density], np.abs(i) / 2, atol=1e-15)


@pytest.mark.parametrize(
    ("point", "named"),
    [((4e-4, 0.0, 0.0), "position"), ((0.0, 3.0, 0.0), "current_1"), ((0.0, 0.0, np.nan), "current_2")],
)
def test_nothing_is_extrapolated(swept: tuple[PairTable, SweepReport], point: tuple[float, ...], named: str) -> None:
    with pytest.raises(OutOfTable, match=named):
        swept[0].evaluate(*point)


@pytest.mark.parametrize("name", PAIR_NODES)
def test_a_table_that_contradicts_itself_is_refused(swept: tuple[PairTable, SweepReport], name: str) -> None:
    table = swept[0]
    for factor, said in ((-30.0, "contradict"), (1e280, "above any magnet's")):
        with pytest.raises(TableError, match=said):
            replace(table, nodes={**table.nodes, name: factor * table.nodes[name]})


def test_the_default_grid_leaves_the_gaps_of_one_magnets(servo: Actuator) -> None:
    positions, currents = default_pair_grid(servo)
    assert positions == pytest.approx(-positions[::-1])
    assert positions[-1] == pytest.approx(0.55e-3)
    assert currents[-1] == 12.0
    assert positions.size * (2 * currents.size - 1) ** 2 >= 4000


@pytest.mark.parametrize(
    ("positions", "currents", "said"),
    [([0.7e-3], [1, 2], "no gap"), ([], [1, 2], "position"), ([1e-4], [1], "current")],
)
def test_bad_grids_are_refused(servo: Actuator, positions: list[float], currents: list[float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        pair_sweep(servo, positions, currents, gap_sum=GAP_SUM)


def test_the_command_resumes_and_lookup_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "pair.nc"
    options = ["--positions", "0.2 mm", "--currents", "1,2 A", "--accuracy", "fast", "--workers", "1", "--json"]
    assert run(["table", str(SERVO), "--sides", "both", "-o", str(target), *options]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["points"] == 3 * 5 * 5
    assert not list(tmp_path.glob(".*"))
    where = ["--current", "1 A", "--current-2", "-0.5 A", "--position", "0.1 mm"]
    assert run(["lookup", str(target), *where, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    table = read_pair_table(target)
    assert found["net_force_N"] == float(table.evaluate(1e-4, 1.0, -0.5)["force"])
    assert {"flux_linkage_1_Wb", "flux_linkage_2_Wb", "mutual_inductance_H"} <= set(found)
    for bad in (["--current", "1 A"], ["--current", "1 A", "--gap", "0.5 mm"], where[:4]):
        assert run(["lookup", str(target), *bad]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_table_with_far_apart_nodes_contradicts_nothing() -> None:
    """The shipped table's every third current: its force bends between two nodes more than the slopes at both tell."""
    table = read_pair_table(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")
    kept = np.arange(0, table.current_1.size, 3)
    nodes = {name: values[:, kept][:, :, kept] for name, values in table.nodes.items()}
    currents = table.current_1[kept]
    assert PairTable(table.one_sided, table.gap_sum, table.position, currents, currents, nodes=nodes).axes[1].size == 11


def test_one_side_alone_by_a_reduced_field(servo: Actuator) -> None:
    """It is the full field within its certificate, forces and flux linkages; slopes follow."""
    positions, currents = np.linspace(-0.25e-3, 0.25e-3, 11), 6 * np.linspace(0, 1, 16) ** 1.5
    job = pair_job(servo, GAP_SUM / 2 + positions, gap_sum=GAP_SUM, accuracy="fast")
    rows = [PairSweepRow(float(x), 0.0, tuple(currents.tolist())) for x in positions]
    reduced = reduced_side_rows(job.field(), rows, "fast")
    assert reduced is not None
    solver = job.solver()
    for k in (0, 7, 10):
        exact = solver.solve(rows[k])
        for name in ("force", "flux_linkage_2"):
            full_scale = max(np.abs(answer[name]).max() for answer in reduced.answers)
            off = np.abs(reduced.answers[k][name] - exact[name]).max()
            assert off <= reduced.certificate.error_estimate * full_scale, name
        for name in ("force_current_slope_2", "incremental_inductance_2", "force_position_slope"):
            assert reduced.answers[k][name] == pytest.approx(exact[name], abs=0.01 * np.abs(exact[name]).max()), name
        assert reduced.answers[k]["flux_density_yoke_2"] == pytest.approx(exact["flux_density_yoke_2"], abs=2e-3)
        assert "mutual_inductance" not in reduced.answers[k]
