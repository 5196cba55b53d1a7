"""A table as text for Modelica.Blocks.Tables.CombiTable2Ds and CombiTable2Dv.

The format is that of the Modelica Standard Library's documentation of these blocks: "#1" alone on the first line, then
for each matrix a line "double name(rows, columns)" and its elements row by row; the first column holds the grid of u1,
the first row the grid of u2, the element in the corner is not used; what follows a "#" is a comment.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.export.c_text import c_comment
from msl_fem.export.refined_grid import RefinedGrid, refined_grid
from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import NODES, MagneticTable

Array = NDArray[np.float64]
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


def _matrix(grid: RefinedGrid, name: str) -> list[str]:
    sign = -1.0 if name in ODD else 1.0
    values = grid.values[name].T
    both = np.vstack([sign * values[:0:-1], values]) + 0.0
    current = np.r_[-grid.current[:0:-1], grid.current]
    head = f"double {name}({current.size + 1},{grid.gap.size + 1}) # {NODES[name][1]}, {NODES[name][0]}"
    rows = [np.r_[0.0, grid.gap], *np.column_stack([current, both])]
    return [head, *(" ".join(repr(float(v)) for v in row) for row in rows)]


def write(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written. Raises InputError where the folder cannot be written."""
    text = modelica_text(table)
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return (target,)
