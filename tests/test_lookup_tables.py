"""The tables that ship agree with fresh field solutions of the actuators they name."""

import numpy as np
import pytest
from conftest import ROOT

from msl_fem.actuator import load_actuator
from msl_fem.magnet_field import solve
from msl_fem.table import read_table

TABLES = sorted((ROOT / "lookup_tables").glob("*.nc"))


@pytest.mark.parametrize("path", TABLES, ids=lambda p: p.stem)
def test_a_table_is_that_of_its_actuator(path) -> None:
    """Hash, stated errors, and force and flux at random points off the nodes within the errors stated."""
    table, actuator = read_table(path), load_actuator(ROOT / "geometries" / f"{path.stem}.toml")
    assert table.provenance["actuator_sha256"] == actuator.digest
    assert 0 < table.mesh_error < 1e-3
    assert 0 < table.interpolation_error < 1e-3
    generator = np.random.default_rng(11)
    scale = np.abs(table.nodes["force"]).max()
    for _ in range(4):
        current, gap = generator.uniform(0.2, table.current[-1]), generator.uniform(1e-4, table.gap[-1])
        fresh = solve(actuator, current, gap).quantities
        allowed = table.mesh_error + table.interpolation_error
        assert abs(float(table.force(current, gap)) - fresh.force) < 1.5 * allowed * scale
        assert float(table.flux_linkage(current, gap)) == pytest.approx(fresh.flux_linkage, rel=2e-3)


def test_there_is_a_table_and_the_readme_names_each() -> None:
    assert TABLES
    text = (ROOT / "lookup_tables" / "README.md").read_text()
    assert all(path.name in text for path in TABLES)
