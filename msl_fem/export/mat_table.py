"""A table as a MAT-file whose variables are the parameters of Simscape's FEM-Parameterized Linear Actuator.

Order and signs are those of the block's page in the documentation of Simscape Electrical ("FEM-Parameterized Linear
Actuator"): matrices Phi(i,x), dPhi(i,x)/di, dPhi(i,x)/dx and F(i,x), rows over the current, columns over the
displacement. A solenoid's x is the air gap between case C and plunger R, and its tabulated force is negative. For a
vector of positive currents alone the first current, its flux and its slope of the flux over x are zero, since
Phi(-i,x) = -Phi(i,x) is assumed. The page's rule of consistency is F = int_0^i dPhi/dx di, which derivatives of one
coenergy obey.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from msl_fem.export.refined_grid import refined_grid
from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import MagneticTable

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

    v, provenance = grid.values, dict(table.provenance)
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
        "actuator": str(provenance.get("actuator") or "not known"),
        "digest": str(provenance.get("actuator_sha256") or "not known"),
        "mesh_error": table.mesh_error,
        "interpolation_error": table.interpolation_error,
        "linear_interpolation_error": max(grid.linear_error.values()),
    }


def write(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written (MAT-file level 5). Raises InputError where the folder cannot be written."""
    variables = mat_variables(table)
    with whole_file(target) as partial:
        savemat(partial, variables, appendmat=False, oned_as="row")
    return (target,)
