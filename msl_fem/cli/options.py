"""Arguments that several commands share, and how their texts become numbers."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.errors import QuantityError
from msl_fem.files.quantity import parse_quantities

ActuatorFile = Annotated[Path, typer.Argument(metavar="ACTUATOR", help="Actuator file (TOML).")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]
AccuracyLevel = Annotated[str, typer.Option("--accuracy", help="fast, normal or fine.")]
TableFile = Annotated[Path | None, typer.Option("--table", help="Table of the magnet; without, it is computed.")]
Current = Annotated[str, typer.Option("--current", help='Coil current, like "5 A".')]
Gap = Annotated[str, typer.Option("--gap", help='Air gap, like "0.5 mm".')]


def read_option(name: str, text: str, unit: str) -> float:
    """The SI value of an option's text; the error names the option."""
    return read_options(name, text, unit)[0] if "," not in text else _refuse_list(name, text)


def read_options(name: str, text: str, unit: str) -> list[float]:
    """The SI values of an option's list; the error names the option."""
    try:
        return parse_quantities(text, unit)
    except QuantityError as err:
        raise QuantityError(f"{name}: {err}") from err


def _refuse_list(name: str, text: str) -> float:
    raise QuantityError(f"{name}: {text!r} is a list; give one value")
