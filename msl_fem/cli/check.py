"""The command `check`: what a record or a raw table says against itself, before anything is made of it."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result
from msl_fem.errors import InputError
from msl_fem.record import load_record
from msl_fem.record.columns import read_columns
from msl_fem.record.doubts import doubtful_signals, too_slow
from msl_fem.record.label_doubts import doubtful_table
from msl_fem.record.log_signals import read_log


def command(
    source: Annotated[Path, typer.Argument(metavar="RECORD|FILE", help="A record's folder, a log, or a table.")],
    labels: Annotated[
        str, typer.Option(help='Columns of a table that were set, not measured, like "position_m,t_on_s".')
    ] = "",
    ordered: Annotated[bool, typer.Option("--ordered", help="The rows stand in equal steps of time.")] = False,
    json: Json = False,
) -> None:
    """What data say against themselves: copies, look-ups, exchanged labels, samples too slow."""
    if (source / "rig.toml").exists():
        doubts = list(load_record(source).warnings)
    else:
        doubts = doubts_of_file(source, [name.strip() for name in labels.split(",") if name.strip()], ordered=ordered)
    fields = {"doubts": doubts, "count": len(doubts)}
    print_result(fields, as_json=json, title=f"{source}: {len(doubts) or 'no'} doubts")


def doubts_of_file(path: Path, labels: list[str], *, ordered: bool = False) -> list[str]:
    """What a file's columns say against themselves, and its readings against its labels; columns with holes are left
    out.

    Raises
    ------
    InputError : the file cannot be read, or has no such label
    """
    read = read_columns(path) if path.suffix == ".csv" else read_log(path)
    columns = {name: v for name, v in read.items() if v.ndim == 1 and (v.dtype.kind != "f" or np.isfinite(v).all())}
    missing = [name for name in labels if name not in columns]
    if missing:
        raise InputError(f"{path}: no column '{missing[0]}'; there are {', '.join(columns)}")
    measured = {name: v for name, v in columns.items() if name not in labels and v.dtype.kind == "f"}
    doubts = [*doubtful_signals(measured), *(too_slow(measured) if ordered else [])]
    if labels:
        doubts += doubtful_table({name: columns[name] for name in labels}, measured)
    return doubts
