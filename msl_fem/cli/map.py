"""The command `map`: the operating map of a magnet."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import AccuracyLevel, Json, read_options
from msl_fem.cli.output import print_columns, print_result, progress_bar, say
from msl_fem.cli.sweeping import checked_accuracy, default_workers
from msl_fem.errors import InputError
from msl_fem.operating_map import map_to_json, operating_map, write_map
from msl_fem.sweep import SweepSettings, default_grid, sweep
from msl_fem.table import MagneticTable, read_table
from msl_fem.whole_file import check_target


def command(
    source: Annotated[Path, typer.Argument(metavar="ACTUATOR|TABLE", help="Actuator file or table.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="JSON file to write.")] = None,
    levels: Annotated[str, typer.Option(help="Flux densities in the iron.")] = "1.2,1.6 T",
    criterion: Annotated[str, typer.Option(help="mean: the section mean of the most loaded section.")] = "mean",
    accuracy: AccuracyLevel = "normal",
    json: Json = False,
) -> None:
    """For each gap the current that brings each flux density in the most loaded section."""
    if criterion != "mean":
        raise InputError(f"criterion '{criterion}' is not available from a table; use mean")
    wanted = read_options("--levels", levels, "T")
    if output is not None:
        check_target(output)
    made = operating_map(_table_of(source, accuracy), levels=wanted)
    if output is not None:
        write_map(made, output)
    for warning in (*made.warnings, *made.not_reached()):
        say(f"note: {warning}")
    if json:
        print_result(map_to_json(made), as_json=True, title="")
        return
    columns = {"gap in mm": [f"{g * 1e3:.4g}" for g in made.gap]}
    for level, row, section in zip(made.levels, made.current, made.section, strict=True):
        columns[f"{level:g} T in A"] = ["not reached" if np.isnan(i) else f"{i:.3f}" for i in row]
        columns[f"{level:g} T in the"] = [name.replace("_", " ") for name in section]
    print_columns(columns, title=f"operating map of {source}, criterion {made.criterion}")


def _table_of(source: Path, accuracy: str) -> MagneticTable:
    """The table in a file, or that of an actuator's default grid."""
    if source.suffix != ".toml":
        return read_table(source)
    actuator = load_actuator(source)
    settings = SweepSettings(accuracy=checked_accuracy(accuracy), workers=default_workers())
    with progress_bar("field solutions, rows") as progress:
        return sweep(actuator, *default_grid(actuator), settings=settings, progress=progress)[0]
