"""The command `identify`: ARMAX with rational inputs from a record."""

from pathlib import Path
from typing import Annotated

import typer

from msl_fem.cli.options import Json
from msl_fem.cli.output import print_result, say, write_json
from msl_fem.errors import InputError
from msl_fem.identification import ArmaxOrders, ModelChoice, identify, model_to_json
from msl_fem.record import load_record
from msl_fem.whole_file import check_target


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="JSON file of the model.")] = None,
    terms: Annotated[str, typer.Option(help='Rational inputs, like "i1^2/g1^2,i2^2/g2^2".')] = "",
    orders: Annotated[str, typer.Option(help="na,nb,nc[,nk] of ARMAX.")] = "",
    json: Json = False,
) -> None:
    """ARMAX with rational inputs, fitted on the record's fit runs and judged on all."""
    if output is not None:
        check_target(output)
    it = load_record(record)
    for warning in it.warnings:
        say(f"note: {warning}")
    choice = ModelChoice(orders=_orders(orders), terms=tuple(t.strip() for t in terms.split(",") if t.strip()))
    found = identify(it, choice=choice)
    if output is not None:
        write_json(model_to_json(found.model), output)
    print_result(found.fields(), as_json=json, title=f"ARMAX of {record}")


def _orders(text: str) -> ArmaxOrders | None:
    if not text:
        return None
    try:
        numbers = [int(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 4):
        raise InputError(f"--orders {text!r}: write na,nb,nc or na,nb,nc,nk, like 2,2,2")
    na, nb, nc, *delay = numbers
    return ArmaxOrders(na, nb, nc, delay[0] if delay else 1)
