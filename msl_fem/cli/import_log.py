"""The command `import`: a log of another program becomes a run of a record."""

import re
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import Json, read_option
from msl_fem.cli.output import print_result, say
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.sole_run import sole_run
from msl_fem.files.whole_file import check_target, whole_file
from msl_fem.record import Run, check_record_folder, load_record
from msl_fem.record.log_import import ColumnSource, RunLabel, column_sources, describe, import_into, imported_run
from msl_fem.report.pictures import run_picture

_NAME = re.compile(r"[A-Za-z0-9_.-]+")


def command(
    log: Annotated[Path, typer.Argument(metavar="FILE", help="A .mat or CSV log.")],
    columns: Annotated[
        str, typer.Option(help='Like "time_s=t,position_m=q:unit=mm:scale=-1:offset=14 mm", or a TOML file.')
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Record folder, new or there.")],
    actuator: Annotated[Path | None, typer.Option(help="Actuator file, for a new record.")] = None,
    name: Annotated[str, typer.Option(help="Of the run; without, the log's.")] = "",
    role: Annotated[Literal["fit", "held-out"], typer.Option(help="What the run is for.")] = "fit",
    excitation: Annotated[str, typer.Option(help="What moved the rig, in words.")] = "",
    rate: Annotated[str, typer.Option(help='Samples a second, like "10 kHz", where the log has no time.')] = "",
    start: Annotated[str, typer.Option("--from", help='Take the log from here, like "1 s".')] = "",
    end: Annotated[str, typer.Option("--to", help="Take the log up to here.")] = "",
    picture: Annotated[Path | None, typer.Option(help="PNG of what was understood.")] = None,
    json: Json = False,
) -> None:
    """A MATLAB or CSV log becomes a run of a record, with a picture of what was understood."""
    sources = column_sources(columns)
    label = _label(name or re.sub(r"[^A-Za-z0-9_.-]+", "_", log.stem), role, excitation, start, end)
    sampled = read_option("--rate", rate, "Hz") if rate else None
    with sole_run(output):
        check_record_folder(output)
        picture = picture or output.parent / f"{output.name}_{label.name}.png"
        check_target(picture)
        there = (output / "rig.toml").exists()
        believed = load_record(output).actuator if there else load_actuator(_named(actuator, output))
        run = imported_run(log, sources, believed, label=label, rate=sampled)
        drawing = run_picture(run, made_of={it.column: _origin(it) for it in sources})
        import_into(output, run, actuator=believed, rate=sampled)  # just before the picture: both, or none
        drawn = _written(drawing, picture)
        for warning in load_record(output).warnings:
            say(f"note: {warning}")
    fields = {
        "record": str(output),
        "run": run.file,
        "samples": run.time.size,
        "rate_Hz": float(f"{1 / run.sampling_period:.9g}"),
        "columns": _figures(run, sources),
        "picture": str(picture) if drawn else None,
    }
    print_result(fields, as_json=json, title=f"{log}: run {run.name} of {output}")


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
