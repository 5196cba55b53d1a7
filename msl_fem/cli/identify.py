"""The command `identify`: ARMAX with rational inputs from a record."""

from pathlib import Path
from typing import Annotated, Literal, cast, get_args

import typer

from msl_fem.cli.closing import identify_closing
from msl_fem.cli.options import Json
from msl_fem.cli.output import print_closing, print_columns, print_result, say, write_json
from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target
from msl_fem.identification import ArmaxOrders, Identification, ModelChoice, identify
from msl_fem.identification.record_model import Structure
from msl_fem.record import load_record


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="JSON file of the model.")] = None,
    terms: Annotated[
        str, typer.Option(help='Rational inputs, like "i1^2/g1^2,i2^2/g2^2"; auto, or auto:LIST to choose from a list.')
    ] = "",
    orders: Annotated[str, typer.Option(help="na,nb,nc[,nk] of ARMAX, or auto.")] = "",
    criterion: Annotated[str, typer.Option(help="bic or aicc: what auto decides by.")] = "bic",
    prior: Annotated[
        bool, typer.Option("--prior", help="Count the believed mass, damping and stiffness with their tolerances.")
    ] = False,
    structure: Annotated[
        str, typer.Option(help="armax, output-error (white noise on the position) or box-jenkins.")
    ] = "armax",
    json: Json = False,
) -> None:
    """ARMAX with rational inputs, fitted on the record's fit runs and judged on all."""
    if output is not None:
        check_target(output)
    if criterion not in ("bic", "aicc"):
        raise InputError(f"--criterion {criterion!r}: give bic or aicc")
    if structure not in get_args(Structure):
        raise InputError(f"--structure {structure!r}: give {', '.join(get_args(Structure))}")
    measured = load_record(record)
    for warning in measured.warnings:
        say(f"note: {warning}")
    listed, automatic = _terms(terms)
    choice = ModelChoice(
        orders=_orders(orders),
        terms=listed,
        select_terms=automatic,
        prior=prior,
        criterion="bic" if criterion == "bic" else "aicc",
        structure=cast(Structure, structure),
    )
    identified = identify(measured, choice=choice)
    if output is not None:
        write_json(identified.model.to_json(), output)
    title = f"{structure.replace('armax', 'ARMAX')} of {record}"
    if json:
        print_result(identified.to_json(), as_json=True, title=title)
        return
    print_model(identified, title=title)
    print_closing(identify_closing(identified), as_json=False)


def print_model(found: Identification, *, title: str) -> None:
    """Fits, physical parameters and residual tests as tables; the coefficients go into the file of -o and --json."""
    shown = {
        "run": [fit.run for fit in found.fits],
        "role": list(found.roles),
        "one step ahead": [f"{fit.one_step:.2f} %" for fit in found.fits],
        "free run": ["left all bounds" if fit.free_run is None else f"{fit.free_run:.2f} %" for fit in found.fits],
    }
    print_columns(shown, title=title)
    if found.physical:
        parameters = {
            "parameter": [name.replace("_", " ") for name in found.physical],
            "value": [f"{p.value:.4g} {'' if p.unit == '1' else p.unit}".rstrip() for p in found.physical.values()],
            "95 % interval": [f"{p.interval[0]:.4g} ... {p.interval[1]:.4g}" for p in found.physical.values()],
        }
        print_columns(parameters, title="Physical parameters")
    tests = {
        "residuals against": ["themselves" if t.name == "residuals" else t.name for t in found.residual_tests],
        "inside the band": ["yes" if t.inside_band else "no" for t in found.residual_tests],
        "p value": [f"{t.p_value:.2g}" for t in found.residual_tests],
    }
    print_columns(tests, title="Are the residuals noise?")
    for note in found.notes:
        say(f"note: {note}")


def _terms(text: str) -> tuple[tuple[str, ...], bool]:
    """The terms that are listed, and whether to choose among them."""
    name, colon, rest = text.partition(":")
    automatic = name.strip() == "auto"
    listed = tuple(term.strip() for term in (rest if automatic else text).split(",") if term.strip())
    if automatic and colon and not listed:
        raise InputError(f'--terms {text!r}: list the candidates after the colon, like "auto:i1^2/g1^2,i1/g1"')
    return listed, automatic


def _orders(text: str) -> ArmaxOrders | Literal["auto"] | None:
    if not text:
        return None
    if text.strip() == "auto":
        return "auto"
    try:
        numbers = [int(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 4):
        raise InputError(f"--orders {text!r}: write na,nb,nc or na,nb,nc,nk, like 2,2,2, or auto")
    na, nb, nc, *delay = numbers
    return ArmaxOrders(na, nb, nc, delay[0] if delay else 1)
