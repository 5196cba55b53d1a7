"""The tables that ship agree with fresh field solutions of the actuators they name."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.magnetics.field.accuracy import LEVELS
from msl_fem.magnetics.field.magnet_field import magnet_mesh, solve
from msl_fem.magnetics.field.two_sided import TwoSidedField
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.sweep.rows import RowSolver, SweepJob, SweepRow
from msl_fem.table.magnetic_table import read_table
from msl_fem.table.pair_table import is_pair_table, read_pair_table

TABLES = sorted(path for path in (ROOT / "lookup_tables").glob("*.nc") if not is_pair_table(path))
PAIRS = sorted(path for path in (ROOT / "lookup_tables").glob("*.nc") if is_pair_table(path))


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_a_table_is_that_of_its_actuator(path) -> None:
    """Hash, stated errors, and force and flux at random points off the nodes within the errors stated."""
    table, actuator = read_table(path), load_actuator(ROOT / "geometries" / f"{path.stem}.toml")
    assert table.provenance["actuator_sha256"] == actuator.digest
    assert 0 < table.mesh_error < 1e-3
    assert 0 < table.interpolation_error < 1e-3
    generator = np.random.default_rng(11)
    scale = np.abs(table.nodes["force"]).max()
    ends = not str(table.provenance["end_effects"]).startswith("none")
    for _ in range(4):
        current, gap = generator.uniform(0.2, table.current[-1]), generator.uniform(1e-4, table.gap[-1])
        fresh = solve(actuator, current, gap, end_effects=ends).quantities
        allowed = table.mesh_error + table.interpolation_error
        assert abs(float(table.force(current, gap)) - fresh.force) < 1.5 * allowed * scale
        assert float(table.flux_linkage(current, gap)) == pytest.approx(fresh.flux_linkage, rel=2e-3)


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_between_the_nodes_a_table_is_what_fields_say(path) -> None:
    """On the table's own mesh, midway between nodes: 0.1 % of full scale, and 0.5 % of every force above 1 N."""
    table, actuator = read_table(path), load_actuator(ROOT / "geometries" / f"{path.stem}.toml")
    magnet, scale = actuator.magnet, np.abs(table.nodes["force"]).max()
    mesh = magnet_mesh(magnet, float(np.sqrt(table.gap[0] * table.gap[-1])))
    solver = RowSolver(SweepJob(magnet, mesh, actuator.folder, LEVELS["normal"].order))
    middle = (table.current[1:] + table.current[:-1]) / 2
    for m in (0, 1, table.gap.size // 2, table.gap.size - 2):
        gap = float(np.sqrt(table.gap[m] * table.gap[m + 1]))
        fresh = solver.solve(SweepRow(gap, tuple(middle.tolist())))["force"]
        off = np.abs(table.force(middle, gap) - fresh)
        assert off.max() < 1e-3 * scale
        assert (off[fresh > 1] / fresh[fresh > 1]).max() < 5e-3


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_three_routes_to_the_force_agree_over_the_whole_grid(path) -> None:
    """Virtual work, stress tensor, and the coenergy's difference between gaps, the saturated corner included."""
    table = read_table(path)
    scale = np.abs(table.nodes["force"]).max()
    by_stress = table.extras["force_stress_tensor"]
    assert np.abs(by_stress - table.nodes["force"]).max() < 2 * table.mesh_error * scale
    # mean force between neighbouring gaps: from stored coenergies, and by quadrature of the stored forces and slopes
    width = np.diff(table.gap)[:, None]
    force, slope = table.nodes["force"], table.nodes["force_gap_slope"]
    by_energy = -np.diff(table.nodes["coenergy"], axis=0) / width
    by_force = (force[1:] + force[:-1]) / 2 - width * (slope[1:] - slope[:-1]) / 12  # Euler and Maclaurin
    assert np.abs(by_energy - by_force).max() < 3e-3 * scale


def test_there_is_a_table_and_the_readme_names_each() -> None:
    assert TABLES
    text = (ROOT / "lookup_tables" / "README.md").read_text()
    assert all(path.name in text for path in TABLES)


@pytest.mark.parametrize("path", PAIRS, ids=lambda p: p.stem)
def test_a_pairs_table_is_what_a_section_meshed_at_its_place_says(path) -> None:
    """Hash, and 0.1 % of the largest force and flux linkage at random points where no iron is far beyond its knee."""
    table, actuator = read_pair_table(path), load_actuator(ROOT / "geometries" / f"{path.stem[: -len('_pair')]}.toml")
    assert table.provenance["actuator_sha256"] == actuator.digest
    assert 0 < table.mesh_error < 1e-3
    scale = {name: np.abs(table.nodes[name]).max() for name in ("force", "flux_linkage_1", "flux_linkage_2")}
    for x, i, j in np.random.default_rng(5).uniform([-4e-4, 0.1, -2], [4e-4, 1.0, 2], (6, 3)):
        fresh = TwoSidedField(actuator, TwoSidedPosition(6e-4 - x, 6e-4 + x)).solve(i, j)[0]
        found = table.evaluate(x, i, j)
        for name, truth in (
            ("force", fresh.net_force),
            ("flux_linkage_1", fresh.flux_linkage_1),
            ("flux_linkage_2", fresh.flux_linkage_2),
        ):
            assert abs(float(found[name]) - truth) < 1e-3 * scale[name], (name, x, i, j)
