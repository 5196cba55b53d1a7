"""The command `diagnose`: what the simulation gets wrong on a record, by which cause, and a better model."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from msl_fem.cli.options import Json, TableFile
from msl_fem.cli.output import ERRORS, print_columns, print_result, say
from msl_fem.cli.sweeping import table_for
from msl_fem.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.record import Record, load_record
from msl_fem.report.diagnosis_page import DIAGNOSIS, FILES, REPORT, write_diagnosis
from msl_fem.report.diagnosis_words import (
    channel_name,
    estimate_text,
    floors,
    next_steps,
    one_of,
    sure_rows,
    verdict_sentence,
)


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of diagnosis.json, report.html and extended_model.toml."
        ),
    ] = None,
    table: TableFile = None,
    json: Json = False,
) -> None:
    """What the simulation gets wrong on a record, which effects cause it, and the model with them.

    Without a folder the outcome is printed alone.
    """
    measured = load_record(record)
    with sole_run(output):
        _diagnose(measured, output, table=table, json=json)


def _diagnose(record: Record, output: Path | None, *, table: Path | None, json: bool) -> None:
    if output is not None:
        for name in FILES:
            check_target(output / name)
    for warning in record.warnings:
        say(f"note: {warning}")
    magnet_table = table_for(record.actuator, table)
    with tried_line() as tell:
        found = diagnose(record, DiagnosisSettings(table=magnet_table, threads=os.cpu_count() or 1, progress=tell))
    fields = found.to_json()
    if output is not None:
        write_diagnosis(record, found, output, table=magnet_table)
        fields |= {"files": [str(output / name) for name in FILES if (output / name).is_file()]}
    if json:
        print_result(fields, as_json=True, title="")
        return
    print_diagnosis(found)
    if output is not None:
        say(f"report: {output / REPORT}; numbers: {output / DIAGNOSIS}")


@contextlib.contextmanager
def tried_line() -> Iterator[Callable[[str], None]]:
    """A line on stderr that says what is being tried and counts; where no one watches, a line for each."""
    if not ERRORS.is_terminal:
        yield lambda text: say(f"trying: {text}")
        return
    columns = (SpinnerColumn(), TextColumn("{task.completed}"), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=ERRORS, transient=True) as progress:
        task = progress.add_task("reading", total=None)

        def tell(text: str) -> None:
            progress.update(task, description=text.replace("[", "("), advance=1)

        yield tell


def print_diagnosis(found: Diagnosis) -> None:
    """The outcome for people."""
    print_columns({"": [found.reason]}, title=verdict_sentence(found))
    if found.causes:
        causes: dict[str, list[str]] = {"cause": [], "parameter": [], "value (95 %)": []}
        for cause in found.causes:
            for name, estimate in cause.parameters.items():
                causes["cause"].append(one_of(cause))
                causes["parameter"].append(name)
                causes["value (95 %)"].append(estimate_text(cause.effect, name, estimate))
        print_columns(causes, title="Causes")
    if found.threshold == found.threshold:
        print_result(dict(sure_rows(found)), as_json=False, title="How sure")
    if found.accuracy:
        errors = [floors(one) for one in found.accuracy]
        names = ("as believed", "re-fitted", "with what was found")[: 3 if found.causes else 2]
        shown = {
            "run": [f"{a.nominal.run}{' *' if a.nominal.role == 'held-out' else ''}" for a in found.accuracy],
            "channel": [channel_name(a.nominal.channel) for a in found.accuracy],
        }
        shown |= {name: [f"{e[k]:.4g}" for e in errors] for k, name in enumerate(names)}
        print_columns(shown, title="RMS error over the noise; * held-out")
    for why, what_to_do in next_steps(found):
        say(f"{why}: {what_to_do}")
    for note in found.notes:
        say(f"note: {note}")
