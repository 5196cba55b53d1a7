"""The command `calibrate`: how often a diagnosis names something on records of this rig in which nothing is hidden."""

import json as json_text
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError
from scipy.stats import beta

from msl_fem.bench.likeness import REFERENCE, alike
from msl_fem.bench.running import BenchController
from msl_fem.cli.diagnose import fingerprint, tried_line
from msl_fem.cli.options import Json, TableFile
from msl_fem.cli.output import print_result, say, write_json
from msl_fem.cli.simulate import usual_loop
from msl_fem.cli.sweeping import table_for
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.result import Verdict
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.schema import first_complaint, reason, small_text
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target
from msl_fem.record import Record, load_record
from msl_fem.table.magnetic_table import MagneticTable

ROWS, SUMMARY = "calibration.jsonl", "calibration.json"
MOST = 10_000
LEVEL = 0.95
Row = dict[str, Any]


class CalibrationLine(BaseModel):
    """A line of calibration.jsonl: a record by its fingerprint, one like it by its seed, and what was diagnosed."""

    model_config = ConfigDict(strict=True)
    record: str
    seed: Annotated[int, Field(ge=0, lt=MOST)]
    verdict: Verdict | Literal["failed"]
    names: list[str]
    nats: FiniteFloat | None
    reason: str = ""


def command(
    record: Annotated[Path, typer.Argument(metavar="RECORD", help="Record folder.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder of calibration.json, and of a line for each record."
        ),
    ] = None,
    records: Annotated[int, typer.Option(metavar="N", help="How many records are simulated and diagnosed.")] = 20,
    resume: Annotated[bool, typer.Option(help="Take finished records of an interrupted run (needs -o).")] = False,
    table: TableFile = None,
    json: Json = False,
) -> None:
    """How often a diagnosis names something on records like this one in which nothing is hidden.

    The virtual bench simulates the record's inputs on rigs that lie within its tolerances, instruments included, and
    each record is diagnosed in full.
    """
    if not 1 <= records <= MOST:
        raise InputError(f"--records {records} is not allowed; it must be 1 ... {MOST}")
    if resume and output is None:
        raise InputError("--resume needs the folder of the interrupted run: state -o DIR")
    measured = load_record(record)
    with sole_run(output):
        fields = _calibrated(measured, output, records, resume=resume, table=table)
    print_result(fields, as_json=json, title=f"{measured.actuator.name}: false names by chance")


def _calibrated(record: Record, output: Path | None, count: int, *, resume: bool, table: Path | None) -> Row:
    magnet_table = table_for(record.actuator, table)
    mark = fingerprint(record, magnet_table)
    known: dict[int, Row] = {}
    if output is not None:
        for name in (ROWS, SUMMARY):
            check_target(output / name)
        output.mkdir(parents=True, exist_ok=True)
        if resume:
            known = known_rows(output / ROWS, mark)
            _end_line(output / ROWS)
        else:
            (output / ROWS).write_text("", encoding="utf-8")
    rows = [known[seed] for seed in range(count) if seed in known]
    controller = _controller(record, magnet_table)
    for seed in range(count):
        if seed in known:
            continue
        say(f"record {len(rows) + 1} of {count}")
        row = {"record": mark} | diagnosed(record, magnet_table, seed, controller)
        rows.append(row)
        if output is not None:
            with (output / ROWS).open("a", encoding="utf-8") as out:
                out.write(json_text.dumps(row) + "\n")
    fields = summary(rows)
    if output is not None:
        write_json(fields, output / SUMMARY)
    return fields


def diagnosed(record: Record, table: MagneticTable | None, seed: int, controller: BenchController | None) -> Row:
    """A record like the given one, diagnosed: verdict, names and what the best effect brought."""
    made = alike(record, table, seed=seed, controller=controller)
    with tried_line() as tell:
        settings = DiagnosisSettings(table=table, threads=os.cpu_count() or 1, progress=tell)
        try:
            found = diagnose(made, settings)
        except ComputationError as err:
            return {"seed": seed, "verdict": "failed", "names": [], "nats": None, "reason": str(err)}
    best = found.statistics[0][0][1] if found.statistics and found.statistics[0] else None
    return {"seed": seed, "verdict": found.verdict, "names": list(found.names), "nats": best, "reason": found.reason}


def summary(rows: list[Row]) -> Row:
    """Records, how many were given a name, the share and its interval (Clopper and Pearson, Biometrika 26, 1934)."""
    named, total = sum(bool(row["names"]) for row in rows), len(rows)
    tail = (1 - LEVEL) / 2
    low = float(beta.ppf(tail, named, total - named + 1)) if named else 0.0
    high = float(beta.ppf(1 - tail, named + 1, total - named)) if named < total else 1.0
    verdicts = sorted({row["verdict"] for row in rows})
    nats = [row["nats"] for row in rows if row["nats"] is not None]
    return {
        "records": total,
        "named": named,
        "rate": named / total,
        "interval": [low, high],
        "verdicts": {verdict: sum(row["verdict"] == verdict for row in rows) for verdict in verdicts},
        "largest_statistic": float(np.max(nats)) if nats else None,
    }


def known_rows(path: Path, mark: str) -> dict[int, Row]:
    """By seed the rows of this record that an interrupted run has left. Raises as `finished`."""
    return {row["seed"]: row for row in finished(path) if row["record"] == mark}


def finished(path: Path) -> Iterator[Row]:
    """The whole lines of an interrupted run.

    Raises
    ------
    InputError : the file cannot be read, or a whole line is of another form; names the line and the key
    """
    if not path.is_file():
        return
    try:
        lines = small_text(path).splitlines()
    except (OSError, ValueError) as err:
        raise InputError(f"{path}: cannot be read ({reason(err)}); leave --resume out to begin anew") from err
    for n, line in enumerate(lines, start=1):
        try:
            yield CalibrationLine.model_validate_json(line).model_dump()
        except ValidationError as err:
            if err.errors()[0]["type"] == "json_invalid":  # cut off
                continue
            raise InputError(
                f"{path}: line {n}: {first_complaint(err)}; remove the line, or leave --resume out to begin anew"
            ) from err


def _end_line(path: Path) -> None:
    """Ends a line that was cut off: the next row has one of its own."""
    if path.is_file() and path.read_bytes()[-1:] not in (b"", b"\n"):
        with path.open("a", encoding="utf-8") as out:
            out.write("\n")


def _controller(record: Record, table: MagneticTable | None) -> BenchController | None:
    """The believed controller, where a run holds a reference for it."""
    closed = any(REFERENCE in run.columns for run in record.runs)
    return usual_loop(record.actuator, table).controller if closed else None
