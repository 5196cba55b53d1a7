"""A table in formats of other programs: CSV, MAT-file, Modelica; the last two hold a refined grid, read linearly."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from msl_fem.export.c_text import c_comment
from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import EXTRAS, NODES, SECTION, MagneticTable
from msl_fem.table.pair_table import PairTable

_FIRST = ("force", "flux_linkage")


def csv_columns(table: MagneticTable) -> dict[str, tuple[float, ...]]:
    """Name with unit -> values (n_gap n_current,), all currents of the first gap before those of the next.

    gap_m, current_A, force_N, flux_linkage_Wb, then the other quantities of a table and the flux densities of its
    sections. Units are written with _per_ for the stroke: force_gap_slope_N_per_m.
    """
    units = {name: unit for name, (unit, _) in (NODES | EXTRAS).items()}
    arrays = {name: table.nodes[name] for name in (*_FIRST, *(n for n in NODES if n not in _FIRST))} | dict(
        table.extras
    )
    columns = {
        "gap_m": tuple(float(g) for g in table.gap for _ in table.current),
        "current_A": tuple(float(i) for _ in table.gap for i in table.current),
    }
    for name, values in arrays.items():
        unit = "T" if name.startswith(SECTION) else units[name]
        columns[f"{name}_{unit.replace('/', '_per_')}"] = tuple(values.ravel().tolist())
    return columns


def write_csv(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written. Raises InputError where the folder cannot be written."""
    return write_csv_columns(csv_columns(table), target)


def write_csv_columns(columns: Mapping[str, Sequence[float]], target: Path) -> tuple[Path, ...]:
    """The CSV file written, each number so that it reads back to the last bit."""
    with whole_file(target) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows([repr(v) for v in row] for row in zip(*columns.values(), strict=True))
    return (target,)


Array = NDArray[np.float64]
_AT_REST = (
    "coenergy",
    "flux_linkage",
    "force",
    "force_current_slope",
)  # what vanishes without current, to the last bit
PARTS = 4  # of each interval between the table's nodes: linear interpolation between the points errs 16 times less


@dataclass(frozen=True, eq=False)
class RefinedGrid:
    """Values of the coenergy surface and its derivatives on a grid that holds all of the table's nodes.

    Attributes
    ----------
    gap, current : (n_gap,) m and (n_current,) A, increasing; the first current is 0
    values : arrays (n_gap, n_current) of the quantities of a table
    linear_error : largest error in the cells' middles of linear interpolation of `force` and `flux_linkage`, each over
        the largest value
    """

    gap: Array
    current: Array
    values: dict[str, Array]
    linear_error: dict[str, float]


def refined_grid(table: MagneticTable, *, parts: int = PARTS) -> RefinedGrid:
    """The table's surface with every interval of gap and current cut into `parts`."""
    gap, current = cut(table.gap, parts), cut(table.current, parts)
    values = table.evaluate(*np.meshgrid(current, gap))
    for name in _AT_REST:
        values[name] = np.where(current == 0.0, 0.0, values[name])
    middle = table.evaluate(*np.meshgrid(_middles(current), _middles(gap)))
    errors = {}
    for name in ("force", "flux_linkage"):
        corners = 0.5 * (values[name][:-1] + values[name][1:])
        linear = 0.5 * (corners[:, :-1] + corners[:, 1:])
        errors[name] = float(np.abs(linear - middle[name]).max() / np.abs(values[name]).max())
    return RefinedGrid(gap, current, {name: values[name] for name in NODES}, errors)


def cut(nodes: Array, parts: int) -> Array:
    """The nodes themselves, to the last bit, and `parts` - 1 points between any two."""
    shares = np.arange(parts) / parts
    inner = nodes[:-1, None] + shares * np.diff(nodes)[:, None]
    return np.r_[inner.ravel(), nodes[-1]]


def _middles(points: Array) -> Array:
    return np.asarray(0.5 * (points[:-1] + points[1:]))


RULE = (
    "One magnet of the full stack depth, SI units. Rows: current i (A); columns: air gap x (m) between case C and "
    "moving part R. F = -(attractive force): negative pulls R towards C, as the block FEM-Parameterized Linear "
    "Actuator wants it. dPhi_dx is negative as well, and F = integral from 0 to i of dPhi_dx di. Currents begin at 0 "
    "and Phi(-i,x) = -Phi(i,x), dPhi_dx(-i,x) = -dPhi_dx(i,x), F(-i,x) = F(i,x)."
)


def mat_variables(table: MagneticTable) -> dict[str, Any]:
    """Variable to value: i (1, n_current), x (1, n_gap), matrices (n_current, n_gap), and what they mean.

    Raises
    ------
    OutOfTable : never for a table that was read; its own nodes are inside
    """
    grid = refined_grid(table)

    def over_current(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ascontiguousarray(values.T) + 0.0  # no negative zeros

    v = grid.values
    return {
        "i": grid.current[None, :],
        "x": grid.gap[None, :],
        "Phi": over_current(v["flux_linkage"]),
        "dPhi_di": over_current(v["incremental_inductance"]),
        "dPhi_dx": over_current(-v["force_current_slope"]),
        "F": over_current(-v["force"]),
        "coenergy": over_current(v["coenergy"]),
        "rule": RULE,
        "units": "i: A, x: m, Phi: Wb, dPhi_di: H, dPhi_dx: Wb/m, F: N, coenergy: J",
        **origin(table, linear_error=max(grid.linear_error.values())),
    }


def origin(table: MagneticTable | PairTable, *, linear_error: float) -> dict[str, Any]:
    """What a MAT-file says of where a table comes from, and of its errors."""
    provenance = dict(table.provenance)
    return {
        "actuator": str(provenance.get("actuator") or "not known"),
        "digest": str(provenance.get("actuator_sha256") or "not known"),
        "mesh_error": table.mesh_error,
        "interpolation_error": table.interpolation_error,
        "linear_interpolation_error": linear_error,
    }


def write_mat(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written (MAT-file level 5). Raises InputError where the folder cannot be written."""
    variables = mat_variables(table)
    with whole_file(target) as partial:
        savemat(partial, variables, appendmat=False, oned_as="row")
    return (target,)


MATRICES = ("force", "flux_linkage", "incremental_inductance", "force_current_slope", "coenergy")
ODD = {"flux_linkage", "force_current_slope"}
"""What changes its sign with the current; the others are even."""


def modelica_text(table: MagneticTable) -> str:
    """The text: one matrix for each of `MATRICES`, u1 the current of either sign (A), u2 the gap (m).

    The blocks extrapolate silently unless told not to, and know no symmetry: so negative currents are written out.
    """
    grid, provenance = refined_grid(table), dict(table.provenance)
    about = [
        f"actuator: {c_comment(provenance.get('actuator') or 'not known')}",
        f"digest: {c_comment(provenance.get('actuator_sha256') or 'not known')}",
        "one magnet of the full stack depth, SI units",
        "rows: u1 = current of the coil in A; columns: u2 = air gap in m; the corner's 0 is not used",
        "force is positive where it attracts",
        f"linear interpolation between these points errs by up to {max(grid.linear_error.values()):.2g} of the largest",
        "value; Smoothness.ContinuousDerivative errs less. The table ends at its last gap and current: set",
        "extrapolation = Modelica.Blocks.Types.Extrapolation.NoExtrapolation, or a model leaves it unnoticed",
    ]
    lines = ["#1", *(f"# {line}" for line in about)]
    for name in MATRICES:
        lines += _matrix(grid, name)
    return "\n".join(lines) + "\n"


def both_signs(grid: RefinedGrid, name: str) -> tuple[Array, Array]:
    """Currents (n,) A of either sign, increasing, and the values (n, n_gap) of a quantity there."""
    sign = -1.0 if name in ODD else 1.0
    values = grid.values[name].T
    return np.r_[-grid.current[:0:-1], grid.current], np.vstack([sign * values[:0:-1], values]) + 0.0


def _matrix(grid: RefinedGrid, name: str) -> list[str]:
    current, both = both_signs(grid, name)
    head = f"double {name}({current.size + 1},{grid.gap.size + 1}) # {NODES[name][1]}, {NODES[name][0]}"
    rows = [np.r_[0.0, grid.gap], *np.column_stack([current, both])]
    return [head, *(" ".join(repr(float(v)) for v in row) for row in rows)]


def write_modelica(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written. Raises InputError where the folder cannot be written."""
    text = modelica_text(table)
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return (target,)
