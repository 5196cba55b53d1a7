"""A table whose arrays contradict each other is refused, with the arrays named; coarse and measured grids pass."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from msl_fem.errors import TableError
from msl_fem.table import MagneticTable, read_table

ROOT = Path(__file__).parents[2]
Nodes = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def table() -> MagneticTable:
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


def times(name: str, factor: float) -> Callable[[Nodes], Nodes]:
    return lambda nodes: nodes | {name: nodes[name] * factor}


MISTAKES = {
    "coenergy reversed over the gaps": lambda nodes: nodes | {"coenergy": nodes["coenergy"][::-1]},
    "all zero": lambda nodes: {name: 0 * values for name, values in nodes.items()},
} | {
    f"{name} x {factor:g}": times(name, factor)
    for name, factor in (
        ("coenergy", -1.0), ("coenergy", 1000.0), ("force", 1000.0), ("force", -1.0), ("flux_linkage", 1 / 200),
        ("incremental_inductance", -1.0), ("incremental_inductance", 1000.0), ("force_gap_slope", -1.0),
        ("force_current_slope", -1.0), ("force_current_slope", 1e-3),
    )
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_table_that_contradicts_itself_is_refused(table: MagneticTable, mistake: str) -> None:
    with pytest.raises(TableError, match=r"look at the (sign|unit)"):
        MagneticTable(table.gap, table.current, MISTAKES[mistake](dict(table.nodes)))


@pytest.mark.parametrize("axis", ["gap", "current"])
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_an_axis_in_another_unit_is_refused(table: MagneticTable, axis: str, factor: float) -> None:
    axes = {"gap": table.gap, "current": table.current}
    axes[axis] = axes[axis] * factor
    with pytest.raises(TableError, match="the unit"):
        MagneticTable(axes["gap"], axes["current"], dict(table.nodes))


@pytest.mark.parametrize("error", [5.0, -1.0])
def test_a_stated_error_is_a_share(table: MagneticTable, error: float) -> None:
    with pytest.raises(TableError, match="mesh_error"):
        MagneticTable(table.gap, table.current, dict(table.nodes), mesh_error=error)


@pytest.mark.parametrize(("gaps", "currents"), [([0, -1], [0, 10, 20]), ([0, 3, -1], [0, 1, 20]), ([5, 6], [0, 2, 21])])
def test_a_coarse_grid_of_a_sound_table_passes(table: MagneticTable, gaps: list[int], currents: list[int]) -> None:
    cut = np.ix_(gaps, currents)
    nodes = {name: values[cut] for name, values in table.nodes.items()}
    assert MagneticTable(table.gap[gaps], table.current[currents], nodes).surface is not None


def test_noise_of_a_measured_table_passes(table: MagneticTable) -> None:
    noise = np.random.default_rng(1)
    largest = {name: np.abs(values).max() for name, values in table.nodes.items()}
    nodes = {
        name: values + 0.003 * largest[name] * noise.standard_normal(values.shape) * (table.current > 0) * (values > 0)
        for name, values in table.nodes.items()
        if name in ("coenergy", "flux_linkage", "force")
    }
    nodes["force"] = np.maximum(nodes["force"], 0.0)
    assert MagneticTable(table.gap, table.current, dict(table.nodes) | nodes) is not None
