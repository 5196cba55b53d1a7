"""The command `import`: a log of another program becomes a run of a record."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import Json, read_option
from msl_fem.cli.output import print_columns, print_result, say
from msl_fem.cli.readable import readable_name, readable_number
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target, whole_file
from msl_fem.record import Run, check_record_folder, load_record
from msl_fem.record.columns import UNITS, Quantity
from msl_fem.record.log_columns import ColumnSource, column_sources, describe
from msl_fem.record.log_import import LogTiming, RunLabel, import_into, imported_run, unstated_noise
from msl_fem.record.log_proposal import proposal_text, proposed_columns
from msl_fem.record.reader import known_columns
from msl_fem.record.rig_file import RIG_FILE
from msl_fem.report.pictures import run_picture

_NAME = re.compile(r"[A-Za-z0-9_.-]+")


def command(
    log: Annotated[
        Path, typer.Argument(metavar="FILE", help="A log: .mat, .csv, oscilloscope CSV, .xlsx, .tdms, .mf4.")
    ],
    columns: Annotated[
        str,
        typer.Option(
            help='Which columns mean what, like "time_s=t,position_m=q:unit=mm:scale=-1:offset=14 mm", or a TOML file.'
        ),
    ] = "",
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Record folder, new or there.")] = None,
    actuator: Annotated[Path | None, typer.Option(help="Actuator file, for a new record.")] = None,
    name: Annotated[str, typer.Option(help="Name of the run; without, the log's.")] = "",
    role: Annotated[Literal["fit", "held-out"], typer.Option(help="What the run is for.")] = "fit",
    excitation: Annotated[str, typer.Option(help="What moved the rig, in words.")] = "",
    mover: Annotated[
        Literal["free", "locked", "imposed", "absent"],
        typer.Option(help="Locked: held; imposed: moved by hand or machine; absent: taken away."),
    ] = "free",
    rate: Annotated[str, typer.Option(help='Sampling rate, like "10 kHz"; goes before a rounded time column.')] = "",
    resampled: Annotated[
        str, typer.Option("--resample", help='Bring irregular or several clocks to this rate, like "1 kHz".')
    ] = "",
    propose: Annotated[
        Path | None, typer.Option(help="Write a file of columns from a look at the log, and import nothing.")
    ] = None,
    start: Annotated[str, typer.Option("--from", help='Take the log from here, like "1 s".')] = "",
    end: Annotated[str, typer.Option("--to", help="Take the log up to here.")] = "",
    picture: Annotated[Path | None, typer.Option(help="PNG of what was understood.")] = None,
    json: Json = False,
) -> None:
    """A log of another program becomes a run of a record, with a picture of what was understood."""
    if propose is not None:
        _propose(log, propose, actuator, as_json=json)
        return
    if output is None:
        raise InputError("Missing option '-o'; name the record's folder, or let --propose write a file of columns")
    if not columns:
        raise InputError("Missing option '--columns'; --propose columns.toml writes a file of them from the log")
    sources = column_sources(columns)
    label = _label(name or re.sub(r"[^A-Za-z0-9_.-]+", "_", log.stem), role, excitation, start, end)
    label = replace(label, mover=mover)
    timing = LogTiming(_positive("--rate", rate), _positive("--resample", resampled))
    with sole_run(output):
        check_record_folder(output)
        picture = picture or output.parent / f"{output.name}_{label.name}.png"
        check_target(picture)
        there = (output / "rig.toml").exists()
        believed = load_record(output).actuator if there else load_actuator(_named(actuator, output))
        imported = imported_run(log, sources, believed, label=label, timing=timing)
        run = imported.run
        drawing = run_picture(run, made_of={it.column: _origin(it) for it in sources})
        own_rate = timing.resampled or timing.rate
        import_into(output, imported, actuator=believed, rate=own_rate)  # just before the picture: both, or none
        drawn = _written(drawing, picture)
        estimated = unstated_noise(imported, believed)
        for warning in (*imported.remarks, *_noise_told(estimated, there, output), *load_record(output).warnings):
            say(f"note: {warning}")
    columns_read = _figures(run, sources)
    fields = {
        "record": str(output),
        "run": run.file,
        "samples": run.time.size,
        "rate_Hz": float(f"{1 / run.sampling_period:.9g}"),
        "columns": columns_read,
        "noise": {name: {"value": sigma, "unit": UNITS[name]} for name, sigma in estimated.items()},
        "picture": str(picture) if drawn else None,
    }
    if json:
        print_result(fields, as_json=True, title="")
        return
    print_result(
        {k: fields[k] for k in fields if k != "columns"}, as_json=False, title=f"{log}: run {run.name} of {output}"
    )
    print_columns(_for_people(columns_read), title="Columns")


def _propose(log: Path, target: Path, actuator: Path | None, *, as_json: bool) -> None:
    """A file of columns from a look at a log."""
    check_target(target)
    believed = load_actuator(actuator) if actuator is not None else None
    columns = proposed_columns(log, believed)
    text = proposal_text(log, columns, known_columns(believed) if believed is not None else list(columns))
    with whole_file(target) as partial:
        partial.write_text(text, encoding="utf-8")
    fields = {
        "columns_file": str(target),
        "columns": {name: {"source": it.source, "unit": it.unit, "scale": it.scale} for name, it in columns.items()},
        "remarks": [f"{name}: {remark}" for name, it in columns.items() for remark in it.remarks],
    }
    print_result(fields, as_json=as_json, title=f"{log}: columns proposed")


def _positive(option: str, text: str) -> float | None:
    """The rate that an option gives in Hz, None where it is not given."""
    if not text:
        return None
    value = read_option(option, text, "Hz")
    if not value > 0:
        raise InputError(f"{option} {text} is not allowed; a rate is above 0 Hz")
    return value


def _noise_told(estimated: Mapping[Quantity, float], there: bool, output: Path) -> list[str]:
    """What noise the log shows where no data sheet states it, and where it was written."""
    if not estimated:
        return []
    shown = ", ".join(f"{name} {format_quantity(sigma, UNITS[name], digits=2)}" for name, sigma in estimated.items())
    kept = "[noise] of the record stays as it is" if there else f"written to [noise] of {output / RIG_FILE}"
    return [f"the log's samples show a noise of {shown} (one sigma, at most); {kept}"]


def _written(drawing: bytes, picture: Path) -> bool:
    """Whether the picture could be written: the run is in the record then, and stays there."""
    try:
        with whole_file(picture) as partial:
            partial.write_bytes(drawing)
    except (InputError, ComputationError, OSError) as err:
        say(f"note: the run is in the record, its picture is not there: {err}")
        return False
    return True


def _label(name: str, role: Literal["fit", "held-out"], excitation: str, start: str, end: str) -> RunLabel:
    if not _NAME.fullmatch(name) or name.startswith("."):
        raise InputError(f"--name {name!r}: use letters, digits, - and _ only")
    first = read_option("--from", start, "s") if start else -np.inf
    last = read_option("--to", end, "s") if end else np.inf
    return RunLabel(name, excitation or "as logged", role, first, last)


def _named(actuator: Path | None, output: Path) -> Path:
    if actuator is None:
        raise InputError(f"{output}: is no record yet; name its actuator with --actuator")
    return actuator


def _origin(it: ColumnSource) -> str:
    """In words: where a column came from."""
    scale = "" if it.scale == 1 else f"{it.scale:g} "
    return f"{scale}{it.source}" + (f" {it.offset:+g}" if it.offset else "")


def _figures(run: Run, sources: tuple[ColumnSource, ...]) -> dict[str, Any]:
    said = describe(sources)
    return {
        name: {**said.get(name, {"source": "--rate"}), "min": float(values.min()), "max": float(values.max())}
        for name, values in run.columns.items()
    }


def _for_people(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, list[str]]:
    """A row for each column: which of the log's it is, what one and zero of that mean, and its range."""
    table: dict[str, list[str]] = {"": [], "in the log": [], "one is": [], "zero is": [], "least": [], "largest": []}
    for name, it in figures.items():
        unit = str(it.get("unit", ""))
        meant = [format_quantity(float(it[key]), unit, digits=4) if key in it else "" for key in ("scale", "offset")]
        ends = [readable_number(it[end], name) for end in ("min", "max")]
        for cells, text in zip(table.values(), (readable_name(name), str(it["source"]), *meant, *ends), strict=True):
            cells.append(text)
    return table
