"""The command `export`: tables, maps and actuators in the formats of other tools."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result, say
from msl_fem.cli.sweeping import table_for
from msl_fem.errors import InputError
from msl_fem.export.formats import ACTUATOR, MAP, TABLE, find_format
from msl_fem.operating_map import OperatingMap, operating_map, read_map
from msl_fem.table import MagneticTable, read_table
from msl_fem.whole_file import check_target

_HDF5 = b"\x89HDF"
Source = Actuator | MagneticTable | OperatingMap


def command(
    source: Annotated[Path, typer.Argument(metavar="TABLE|ACTUATOR|MAP", help="Table, actuator file or map.")],
    to: Annotated[str, typer.Option("--to", metavar="FORMAT", help="c or csv.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")],
    what: Annotated[str | None, typer.Option(metavar="PART", help="guard or table; without, what SOURCE is.")] = None,
    name: Annotated[str | None, typer.Option(help="Beginning of C names; without, the actuator's name.")] = None,
    json: Json = False,
) -> None:
    """Write a table or a guard for other tools: a C99 header, or comma-separated values."""
    kind = _kind(source)
    wanted = find_format(to, what, kind)
    check_target(output)
    if output.exists() and source.exists() and output.samefile(source):
        raise InputError(f"{output} is the source itself; name another file with -o")
    files = wanted.write(_record(source, kind, wanted.needs), output, name=name)
    fields: dict[str, Any] = {"files": [str(path) for path in files]}
    print_result(fields, as_json=json, title=f"{source} as {to}, {wanted.what}")


def _kind(path: Path) -> str:
    """What a file holds: an actuator by its name, a table by its first bytes or name, else a map."""
    if path.suffix == ".toml":
        return ACTUATOR
    if path.suffix == ".nc":
        return TABLE
    try:
        with path.open("rb") as stream:
            return TABLE if stream.read(len(_HDF5)) == _HDF5 else MAP
    except OSError as err:
        raise InputError(f"{path}: cannot be read ({err.strerror}); give a table, an actuator file or a map") from err


def _record(path: Path, kind: str, needs: str) -> Source:
    """The record that a format needs, made of the source where it is not the source itself."""
    if kind == MAP:
        return read_map(path)
    if needs == ACTUATOR:
        return load_actuator(path)
    table = read_table(path) if kind == TABLE else _table_of(load_actuator(path))
    if needs == TABLE:
        return table
    made = operating_map(table)
    for warning in (*made.warnings, *made.not_reached()):
        say(f"note: {warning}")
    return made


def _table_of(actuator: Actuator) -> MagneticTable:
    table = table_for(actuator, None)
    if table is None:
        raise InputError(f"{actuator.name} has no [magnet], so there is no table to export")
    return table
