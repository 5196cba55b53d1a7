"""The command `guard`: judges a command by an operating map."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.options import Json, read_option
from msl_fem.cli.output import print_result
from msl_fem.operating_map import Guard, read_map


def command(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="Operating map (JSON).")],
    current: Annotated[str, typer.Option("--current", help='Like "4 A"; nan is judged too.')],
    gap: Annotated[str, typer.Option("--gap", help='Like "0.3 mm"; nan is judged too.')],
    json: Json = False,
) -> None:
    """Judge a command: preferred, discouraged or unacceptable, with the limits at that gap."""
    judgement = Guard(read_map(map_file)).judge(_or_nan("--current", current, "A"), _or_nan("--gap", gap, "m"))
    print_result(judgement.to_json(), as_json=json, title=f"{current} at gap {gap}")


def _or_nan(name: str, text: str, unit: str) -> float:
    """A quantity, or nan where the text says so: a controller's command can be one."""
    number, _, unit_text = text.strip().partition(" ")
    if number.lower() != "nan":
        return read_option(name, text, unit)
    return float("nan") * read_option(name, f"1 {unit_text or unit}", unit)
