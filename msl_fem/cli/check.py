"""The command `check`: what a record or a raw table says against itself, before anything is made of it."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result
from msl_fem.errors import InputError
from msl_fem.record import load_record
from msl_fem.record.file_doubts import doubts_of_file


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
    elif source.suffix == ".toml":
        raise InputError(f"{source} is no data; an actuator file is read and drawn by 'msl-fem draw {source}'")
    else:
        doubts = doubts_of_file(source, [name.strip() for name in labels.split(",") if name.strip()], ordered=ordered)
    fields = {"doubts": doubts, "count": len(doubts)}
    print_result(fields, as_json=json, title=f"{source}: {len(doubts) or 'no'} doubts")
