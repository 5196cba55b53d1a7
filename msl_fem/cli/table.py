"""The command `table`: the force/flux table over gap and current."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Json, read_options
from msl_fem.cli.output import print_result, progress_bar, say
from msl_fem.cli.sweeping import checked_accuracy, default_workers
from msl_fem.errors import InputError
from msl_fem.sweep import SweepSettings, default_grid, sweep
from msl_fem.sweep_cache import RowCache
from msl_fem.table import write_table


def command(
    actuator: ActuatorFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="NetCDF file to write.")],
    currents: Annotated[str | None, typer.Option(help='Like "0.5,1,2 A".')] = None,
    gaps: Annotated[str | None, typer.Option(help='Like "0.1,0.2 mm".')] = None,
    accuracy: AccuracyLevel = "normal",
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Solve on a dask.distributed cluster.")
    ] = None,
    resume: Annotated[bool, typer.Option(help="Take finished rows of an interrupted run.")] = False,
    json: Json = False,
) -> None:
    """The force/flux table over gap and current; without grids, from the actuator's ranges."""
    it = load_actuator(actuator)
    if scheduler is not None and workers:
        raise InputError("give --workers or --scheduler, not both")
    if (currents is None) != (gaps is None):
        raise InputError("give both --currents and --gaps, or neither for the default grid")
    if gaps is not None and currents is not None:
        grid = read_options("--gaps", gaps, "m"), read_options("--currents", currents, "A")
    else:
        default = default_grid(it)
        grid = default[0].tolist(), default[1].tolist()
    cache = RowCache(output.with_name(f".{output.name}.rows"))
    settings = SweepSettings(
        accuracy=checked_accuracy(accuracy),
        workers=workers or default_workers(),
        scheduler=scheduler,
        cache=cache.folder,
        resume=resume,
    )
    with progress_bar("field solutions, rows") as progress:
        made, report = sweep(it, *grid, settings=settings, progress=progress)
    write_table(made, output)
    cache.clear()
    for note in report.notes:
        say(f"note: {note}")
    print_result({"table": str(output), **asdict(report)}, as_json=json, title=f"{it.name}: table {output}")
