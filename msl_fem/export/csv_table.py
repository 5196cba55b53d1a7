"""A table as comma-separated values, one row a point, every number to its last digit."""

import csv
from pathlib import Path

from msl_fem.files.whole_file import whole_file
from msl_fem.table.magnetic_table import EXTRAS, NODES, SECTION, MagneticTable

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


def write(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The file written. Raises InputError where the folder cannot be written."""
    columns = csv_columns(table)
    with whole_file(target) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        rows = csv.writer(stream, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows([repr(v) for v in row] for row in zip(*columns.values(), strict=True))
    return (target,)
