"""The command `lookup`: a table's values at a point."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.options import Current, Gap, Json, read_option
from msl_fem.cli.output import print_result
from msl_fem.table.magnetic_table import read_table


def command(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="Table (NetCDF).")],
    current: Current,
    gap: Gap,
    json: Json = False,
) -> None:
    """Force, flux linkage and inductance from a table; outside it is an error."""
    values = read_table(table).evaluate(read_option("--current", current, "A"), read_option("--gap", gap, "m"))
    fields = {
        "force_N": float(values["force"]),
        "flux_linkage_Wb": float(values["flux_linkage"]),
        "incremental_inductance_H": float(values["incremental_inductance"]),
        "coenergy_J": float(values["coenergy"]),
        "force_current_slope_N_per_A": float(values["force_current_slope"]),
        "force_gap_slope_N_per_m": float(values["force_gap_slope"]),
    }
    print_result(fields, as_json=json, title=f"{table} at {current}, gap {gap}")
