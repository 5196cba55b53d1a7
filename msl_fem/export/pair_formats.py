"""The table of a pair in formats of other programs: CSV, and a MAT-file for three-dimensional lookups (Simscape)."""

from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from msl_fem.computing.arrays import Array
from msl_fem.export.table_formats import cut, origin, write_csv_columns
from msl_fem.files.whole_file import whole_file
from msl_fem.table.pair_table import PAIR_NODES, PairTable

PARTS = 2  # of each interval between the table's nodes, of what is interpolated linearly elsewhere
RULE = (
    "One magnet on either side of an armature, full stack depth, SI units. Arrays (x, i_1, i_2): position x of the "
    "armature towards side 1 (m), currents of the coils (A). Equal signs of the currents aid: their fluxes go straight "
    "through the armature. F is the force on the armature towards side 1. Nothing is known outside these points: let "
    "the lookups clip or end there."
)
_NAMES = {
    "force": "F",
    "flux_linkage_1": "Phi_1",
    "flux_linkage_2": "Phi_2",
    "incremental_inductance_1": "dPhi_1_di_1",
    "incremental_inductance_2": "dPhi_2_di_2",
    "mutual_inductance": "dPhi_1_di_2",
    "force_current_slope_1": "dPhi_1_dx",
    "force_current_slope_2": "dPhi_2_dx",
    "coenergy": "coenergy",
}


def write_pair_csv(table: PairTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written, a row a node, position outermost. Raises InputError where the folder cannot be written."""
    axes = np.meshgrid(*table.axes, indexing="ij")
    columns = dict(zip(("position_m", "current_1_A", "current_2_A"), axes, strict=True))
    for quantity, (unit, _) in PAIR_NODES.items():
        columns[f"{quantity}_{unit.replace('/', '_per_')}"] = table.nodes[quantity]
    columns |= {f"{quantity}_T": values for quantity, values in table.extras.items()}
    return write_csv_columns({name: values.ravel().tolist() for name, values in columns.items()}, target)


def write_pair_mat(table: PairTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written (MAT-file level 5). Raises InputError where the folder cannot be written."""
    variables = pair_mat_variables(table)
    with whole_file(target) as partial:
        savemat(partial, variables, appendmat=False, oned_as="row", do_compression=True)
    return (target,)


def pair_mat_variables(table: PairTable, *, parts: int = PARTS) -> dict[str, Any]:
    """Variable to value: x, i_1, i_2 (1, n), arrays (n_x, n_1, n_2) and what they mean.

    `linear_interpolation_error` is the largest one in the middles of the cells, of force and of flux linkage, each over
    the largest value.
    """
    axes = [cut(nodes, parts) for nodes in table.axes]
    values = table.evaluate(*np.meshgrid(*axes, indexing="ij"))
    middles = table.evaluate(*np.meshgrid(*((a[1:] + a[:-1]) / 2 for a in axes), indexing="ij"))
    errors = [
        float(np.abs(_linear(values[name]) - middles[name]).max() / np.abs(values[name]).max())
        for name in ("force", "flux_linkage_1")
    ]
    return dict(zip(("x", "i_1", "i_2"), (a[None, :] for a in axes), strict=True)) | {
        **{short: values[quantity] + 0.0 for quantity, short in _NAMES.items()},
        "rule": RULE,
        "units": "x: m, i: A, F: N, Phi: Wb, dPhi_di: H, dPhi_dx: Wb/m, coenergy: J",
        "gap_sum": table.gap_sum,
        **origin(table, linear_error=max(errors)),
    }


def _linear(values: Array) -> Array:
    """What linear interpolation gives in the middles of the cells."""
    for axis in range(3):
        first, last = (np.take(values, range(k, values.shape[axis] - 1 + k), axis=axis) for k in (0, 1))
        values = 0.5 * (first + last)
    return values
