"""The command `table`: the force/flux table over gap and current."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from msl_fem.actuator import Actuator, MagnetKind, load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Json, read_options
from msl_fem.cli.output import print_result, progress_bar, say
from msl_fem.cli.sweeping import checked_accuracy, checked_end_effects, default_workers
from msl_fem.computing.row_cache import RowCache
from msl_fem.errors import InputError
from msl_fem.files.whole_file import check_target
from msl_fem.magnetics.field.magnet_field import check_grid
from msl_fem.magnetics.sweep.pair_grid import default_pair_grid
from msl_fem.magnetics.sweep.pair_sweep import pair_sweep
from msl_fem.magnetics.sweep.solid_lift import lifted_sweep
from msl_fem.magnetics.sweep.table_sweep import SweepReport, SweepSettings, default_grid, sweep
from msl_fem.record import load_record
from msl_fem.record.loop_table import is_at_one_gap, law_of_loops, table_of_loops, told_of
from msl_fem.table.magnetic_table import write_table
from msl_fem.table.origin import ANOTHER_UNIT, inductance_ratio
from msl_fem.table.pair_table import write_pair_table

SIDES = ("one", "both")


def command(
    actuator: ActuatorFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="NetCDF file to write.")],
    currents: Annotated[
        str | None, typer.Option(help='Currents of the table, like "0.5,1,2 A"; without, up to the drive\'s limit.')
    ] = None,
    gaps: Annotated[
        str | None, typer.Option(help='Gaps of the table, like "0.1,0.2 mm"; without, over the travel.')
    ] = None,
    accuracy: AccuracyLevel = "normal",
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Solve on a dask.distributed cluster.")
    ] = None,
    resume: Annotated[bool, typer.Option(help="Take finished rows of an interrupted run.")] = False,
    end_effects: Annotated[
        str | None,
        typer.Option(
            metavar="none|section|3d",
            help="Flux that bulges out at the stack's ends: section by a correction of the section (the default, where "
            "the kind has such ends and the file does not say none), 3d by a few solutions in three dimensions (needs "
            "pyamg) that lift the table.",
        ),
    ] = None,
    sides: Annotated[str, typer.Option(help="one, or both with the armature they share.")] = "one",
    positions: Annotated[
        str | None,
        typer.Option(help='Positions of the armature, like "0,0.1,0.2 mm", for both directions; with --sides both.'),
    ] = None,
    measured: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Fit the table to the static.csv of this record; no fields are solved."),
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Solve every point in full, none by a reduced field.")] = False,
    json: Json = False,
) -> None:
    """The force/flux table over gap and current; without grids, from the actuator's ranges.

    With --sides both, over the armature's position and the currents of both magnets, which share its iron.

    With --measured, one coenergy surface is fitted to the measured forces and flux linkages of one magnet, weighted by
    the noise that rig.toml states; the table spans the measured gaps and currents and never more.
    """
    it = load_actuator(actuator)
    check_target(output, apart_from=[actuator])
    corrected = checked_end_effects(end_effects, ("none", "section", "3d"))
    if measured is not None:
        if scheduler is not None or workers or resume or end_effects is not None or full:
            raise InputError(
                "--measured solves no fields: leave out --workers, --scheduler, --resume, --end-effects and --full"
            )
        _fit_measured(it, measured, output, gaps=gaps, currents=currents, json=json)
        return
    if scheduler is not None and workers:
        raise InputError("give --workers or --scheduler, not both")
    cache = RowCache(output.with_name(f".{output.name}.rows"))
    settings = SweepSettings(
        accuracy=checked_accuracy(accuracy),
        workers=workers or default_workers(),
        scheduler=scheduler,
        cache=cache.folder,
        resume=resume,
        end_effects=corrected,
        full=full,
    )
    if sides not in SIDES:
        raise InputError(f"--sides {sides} is not known; choose one or both")
    lift: dict[str, object] = {}
    if sides == "both":
        if end_effects == "3d":
            raise InputError("a table of both sides is not lifted by three dimensions; give --end-effects section")
        report = _sweep_both(it, output, settings, positions=positions, gaps=gaps, currents=currents)
    else:
        if positions is not None:
            raise InputError("--positions belong to --sides both; one magnet takes --gaps")
        grid = _grid_of_one(it, gaps=gaps, currents=currents)
        if end_effects == "3d":
            report, lift = _sweep_lifted(it, output, settings, grid)
        else:
            report = _sweep_one(it, output, settings, grid)
    cache.clear()
    for note in report.notes:
        say(f"note: {note}")
    print_result({"table": str(output), **asdict(report), **lift}, as_json=json, title=f"{it.name}: table {output}")


Grid = tuple[list[float], list[float]]


def _grid_of_one(it: Actuator, *, gaps: str | None, currents: str | None) -> Grid:
    """Gaps in m and currents in A, as given or from the actuator's ranges."""
    if (currents is None) != (gaps is None):
        raise InputError("give both --currents and --gaps, or neither for the default grid")
    if gaps is not None and currents is not None:
        grid = read_options("--gaps", gaps, "m"), read_options("--currents", currents, "A")
    else:
        default = default_grid(it)
        grid = default[0].tolist(), default[1].tolist()
    if isinstance(it.magnet, MagnetKind):
        check_grid(it, *grid)
    return grid


def _sweep_one(it: Actuator, output: Path, settings: SweepSettings, grid: Grid) -> SweepReport:
    with progress_bar("field solutions, rows") as progress:
        made, report = sweep(it, *grid, settings=settings, progress=progress)
    write_table(made, output)
    return report


def _sweep_lifted(
    it: Actuator, output: Path, settings: SweepSettings, grid: Grid
) -> tuple[SweepReport, dict[str, object]]:
    """As `_sweep_one`, lifted by solutions in three dimensions; beside the report what the lift took."""
    with progress_bar("field solutions, rows; then in three dimensions") as progress:
        made, report, lift = lifted_sweep(it, *grid, settings=settings, progress=progress)
    write_table(made, output)
    return report, {"lift": asdict(lift)}


def _sweep_both(
    it: Actuator,
    output: Path,
    settings: SweepSettings,
    *,
    positions: str | None,
    gaps: str | None,
    currents: str | None,
) -> SweepReport:
    if gaps is not None:
        raise InputError("--gaps belong to one magnet; --sides both takes --positions")
    if (currents is None) != (positions is None):
        raise InputError("give both --currents and --positions, or neither for the default grid")
    nominal = it.motion.nominal_gap if it.motion is not None else None
    if nominal is None:
        raise InputError(f"{it.name} states no motion.nominal_gap, half of both gaps together; add it")
    if positions is not None and currents is not None:
        grid = read_options("--positions", positions, "m"), read_options("--currents", currents, "A")
    else:
        default = default_pair_grid(it)
        grid = default[0].tolist(), default[1].tolist()
    with progress_bar("field solutions of both sides, rows") as progress:
        made, report = pair_sweep(it, *grid, gap_sum=2 * nominal, settings=settings, progress=progress)
    write_pair_table(made, output)
    return report


def _fit_measured(
    it: Actuator, folder: Path, output: Path, *, gaps: str | None, currents: str | None, json: bool
) -> None:
    from msl_fem.record.measured_table import table_from_measurements  # here, for what fits takes long to import

    record = load_record(folder)
    if record.static is None:
        raise InputError(f"{folder}: the record has no static.csv to fit a table to")
    if is_at_one_gap(record.static) and gaps is None and currents is None:
        law = law_of_loops(record.static)
        write_table(table_of_loops(record.static, law), output)
        say("note: the rows have one gap; the table is their reversible curve, without a force and alike at every gap")
        fields = {"table": str(output), "points": int(record.static.rows("fit").size), **told_of(law)}
        print_result(fields, as_json=json, title=f"{it.name}: table of loops {output}")
        return
    made, report = table_from_measurements(
        record.static,
        record.noise,
        gaps=read_options("--gaps", gaps, "m") if gaps is not None else None,
        currents=read_options("--currents", currents, "A") if currents is not None else None,
        provenance={
            "actuator": it.name,
            "actuator_sha256": it.digest,
            "record": folder.name,
            "record_actuator": record.actuator.name,
            "origin": record.origin,
        },
    )
    ratio = inductance_ratio(it, made)
    if ratio is not None and not 1 / ANOTHER_UNIT <= ratio <= ANOTHER_UNIT:
        raise InputError(
            f"{folder}: by static.csv the inductance is {ratio:.3g} times what gaps, pole faces and turns of "
            f"{it.name} give; look at the units of gap_m, current_A, force_N and flux_linkage_Wb"
        )
    write_table(made, output)
    for note in report.notes:
        say(f"note: {note}")
    print_result({"table": str(output), **asdict(report)}, as_json=json, title=f"{it.name}: measured table {output}")
