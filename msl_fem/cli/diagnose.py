"""The command `diagnose`: what the simulation gets wrong on a record, by which cause, and a better model."""

import contextlib
import json as json_text
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from msl_fem.cli.believed import belief_about, stated_belief
from msl_fem.cli.closing import diagnosis_closing
from msl_fem.cli.options import BeliefName, Causes, Json, TableFile
from msl_fem.cli.output import ERRORS, print_closing, print_columns, print_result, say
from msl_fem.cli.stated_causes import read_causes
from msl_fem.cli.sweeping import table_for
from msl_fem.diagnosis import Diagnosis, DiagnosisSettings, diagnose
from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.impedances import diagnose_impedance
from msl_fem.errors import InputError
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target, whole_file
from msl_fem.plant.believed import Belief
from msl_fem.record import Record, load_record
from msl_fem.record.impedance import IMPEDANCE_FILE, is_impedance_alone, read_impedance
from msl_fem.report.diagnosis_page import DIAGNOSIS, FILES, REPORT, write_diagnosis
from msl_fem.report.diagnosis_words import (
    channel_name,
    estimate_text,
    floors,
    headline_word,
    next_steps,
    one_of,
    sure_rows,
)
from msl_fem.table.magnetic_table import MagneticTable

STATE = "diagnosis_state.json"
"""What an interrupted diagnosis leaves in its folder."""


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of diagnosis.json, report.html and extended_model.toml."
        ),
    ] = None,
    table: TableFile = None,
    effect: Causes = None,
    belief: BeliefName = None,
    resume: Annotated[bool, typer.Option(help="Go on where an interrupted diagnosis ended (needs -o).")] = False,
    json: Json = False,
) -> None:
    """What the simulation gets wrong on a record, which effects cause it, and the model with them.

    Without a folder the outcome is printed alone.
    """
    if resume and output is None:
        raise InputError("--resume needs the folder of the interrupted diagnosis: state -o DIR")
    if (record / IMPEDANCE_FILE).is_file() and is_impedance_alone(record):
        _diagnose_impedance(record, output, json=json)
        return
    measured = load_record(record)
    measured = replace(measured, causes=(*measured.causes, *read_causes(effect)))
    measured = measured if belief is None else replace(measured, belief=stated_belief(belief))
    with sole_run(output):
        _diagnose(measured, output, table=table, resume=resume, json=json)


def _diagnose_impedance(folder: Path, output: Path | None, *, json: bool) -> None:
    """An impedance map by itself: no page and no extended model, a verdict and its numbers."""
    if output is not None:
        check_target(output / DIAGNOSIS)
    fields = diagnose_impedance(read_impedance(folder / IMPEDANCE_FILE)).to_json()
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
        with whole_file(output / DIAGNOSIS) as partial:
            partial.write_text(json_text.dumps(fields, indent=1), encoding="utf-8")
        fields |= {"files": [str(output / DIAGNOSIS)]}
    print_result(fields, as_json=json, title=f"{folder}: {fields['verdict']}")


def _diagnose(record: Record, output: Path | None, *, table: Path | None, resume: bool, json: bool) -> None:
    if output is not None:
        for name in (*FILES, STATE):
            check_target(output / name)
    for warning in record.warnings:
        say(f"note: {warning}")
    magnet_table = table_for(record.actuator, table)
    found = diagnosis_into(output, record, magnet_table, belief_about(record, magnet_table), resume=resume)
    fields = found.to_json()
    if output is not None:
        fields |= {"files": [str(output / name) for name in FILES if (output / name).is_file()]}
    if json:
        print_result(fields, as_json=True, title="")
        return
    print_diagnosis(found)
    if output is not None:
        say(f"report: {output / REPORT}; numbers: {output / DIAGNOSIS}")


def diagnosis_into(
    folder: Path | None, record: Record, table: MagneticTable | None, belief: Belief, *, resume: bool
) -> Diagnosis:
    """The diagnosis of a record, its files in a folder where there is one; progress is told on stderr."""
    memory = FitMemory() if folder is None else memory_in(folder, fingerprint(record, table), resume=resume)
    threads = os.cpu_count() or 1
    with tried_line() as tell:
        settings = DiagnosisSettings(table, threads=threads, progress=tell, memory=memory, belief=belief)
        found = diagnose(record, settings)
    if folder is not None:
        write_diagnosis(record, found, folder, table=table)
        (folder / STATE).unlink(missing_ok=True)
    return found


def memory_in(folder: Path, mark: str, *, resume: bool) -> FitMemory:
    """The memory of a diagnosis whose state is kept in a folder, of an interrupted one of the same record to go on."""
    path = folder / STATE
    known = {}
    if resume and path.is_file():
        try:
            state = json_text.loads(path.read_text(encoding="utf-8"))
            known = {str(name): [float(z) for z in end] for name, end in state["fits"].items()}
            known = known if state["record"] == mark else {}
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as err:
            raise InputError(f"{path}: is no state of a diagnosis ({err}); leave --resume out to begin anew") from err
        if not known:
            say(f"note: {path} is of another record or table; it is diagnosed anew")

    def keep(ends: Mapping[str, Sequence[float]]) -> None:
        with whole_file(path) as part:
            part.write_text(json_text.dumps({"record": mark, "fits": ends}), encoding="utf-8")

    return FitMemory(known, keep)


def fingerprint(record: Record, table: MagneticTable | None) -> str:
    """What tells records and their beliefs apart."""
    told = sha256(
        f"{record.actuator.digest}{record.tolerance!r}{record.noise!r}{record.sampling!r}{record.causes!r}"
        f"{record.belief}".encode()
    )
    if table is not None:
        told.update(np.ascontiguousarray(table.nodes["coenergy"]).tobytes())
    for run in record.runs:
        told.update(f"{run.name} {run.role}".encode())
        for name in sorted(run.columns):
            told.update(np.ascontiguousarray(run.columns[name]).tobytes())
    return told.hexdigest()[:16]


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
    print_columns({"": [found.reason]}, title=headline_word(found))
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
    for why, what_to_do in next_steps(found)[1:]:
        say(f"{why}: {what_to_do}")
    for note in found.notes:
        say(f"note: {note}")
    print_closing(diagnosis_closing(found), as_json=False)
