"""Commands of the field half: solve, table, lookup."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, cast

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Current, Gap, Json, read_option, read_options
from msl_fem.cli.output import print_result, progress_bar, say
from msl_fem.errors import InputError
from msl_fem.magnet_field import LEVELS, Accuracy, PointResult
from msl_fem.sweep import SweepSettings, default_grid, sweep
from msl_fem.table import read_table, write_table


def checked_accuracy(text: str) -> Accuracy:
    """The accuracy level of that name; InputError otherwise."""
    if text not in LEVELS:
        raise InputError(f"accuracy '{text}' is unknown; choose one of {', '.join(LEVELS)}")
    return cast(Accuracy, text)


def default_workers() -> int:
    """One process a core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def solve(
    actuator: ActuatorFile,
    current: Current,
    gap: Gap,
    accuracy: AccuracyLevel = "normal",
    picture: Annotated[Path | None, typer.Option(help="Write a PNG of |B| and flux lines.")] = None,
    vtu: Annotated[Path | None, typer.Option(help="Write the field for ParaView.")] = None,
    json: Json = False,
) -> None:
    """One field solution of one magnet: force by two routes, flux linkage, coenergy, flux density on sections."""
    from msl_fem.export.vtu import write_vtu
    from msl_fem.magnet_field import solve_with_field
    from msl_fem.report.field_picture import draw_field, save_picture

    it = load_actuator(actuator)
    result, field, solution = solve_with_field(
        it, read_option("--current", current, "A"), read_option("--gap", gap, "m"), accuracy=checked_accuracy(accuracy)
    )
    if picture is not None:
        save_picture(draw_field(field, solution, title=f"{it.name}: {current}, gap {gap}"), picture)
    if vtu is not None:
        write_vtu(field, solution, vtu)
    for note in result.notes:
        say(f"note: {note}")
    print_result(solve_fields(result), as_json=json, title=f"{it.name}: one magnet at {current}, gap {gap}")


def solve_fields(result: PointResult) -> dict[str, Any]:
    """The JSON fields of `solve`."""
    q = result.quantities
    return {
        "current_A": result.current,
        "gap_m": result.gap,
        "force_N": q.force,
        "force_stress_tensor_N": q.force_stress_tensor,
        "flux_linkage_Wb": q.flux_linkage,
        "coenergy_J": q.coenergy,
        "incremental_inductance_H": q.incremental_inductance,
        "force_error_estimate": result.force_error_estimate,
        "flux_density_T": {name: {"mean": b.mean, "max": b.max} for name, b in q.flux_density.items()},
        "unknowns": result.unknowns,
        "newton_iterations": result.newton_iterations,
        "notes": list(result.notes),
    }


def table(
    actuator: ActuatorFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="NetCDF file to write.")],
    currents: Annotated[str | None, typer.Option(help='Like "0.5,1,2 A".')] = None,
    gaps: Annotated[str | None, typer.Option(help='Like "0.1,0.2 mm".')] = None,
    accuracy: AccuracyLevel = "normal",
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
    resume: Annotated[bool, typer.Option(help="Take finished rows of an interrupted run.")] = False,
    json: Json = False,
) -> None:
    """The force/flux table over gap and current; without grids, from the actuator's ranges."""
    it = load_actuator(actuator)
    if (currents is None) != (gaps is None):
        raise InputError("give both --currents and --gaps, or neither for the default grid")
    if gaps is not None and currents is not None:
        grid = read_options("--gaps", gaps, "m"), read_options("--currents", currents, "A")
    else:
        default = default_grid(it)
        grid = default[0].tolist(), default[1].tolist()
    settings = SweepSettings(
        accuracy=checked_accuracy(accuracy),
        workers=workers or default_workers(),
        cache=output.with_name(f".{output.name}.rows"),
        resume=resume,
    )
    with progress_bar("field solutions, rows") as progress:
        made, report = sweep(it, *grid, settings=settings, progress=progress)
    write_table(made, output)
    clear_cache(settings)
    for note in report.notes:
        say(f"note: {note}")
    print_result({"table": str(output), **asdict(report)}, as_json=json, title=f"{it.name}: table {output}")


def clear_cache(settings: SweepSettings) -> None:
    """Remove the finished rows of a sweep whose table is written."""
    from msl_fem.sweep_cache import RowCache

    if settings.cache is not None:
        RowCache(settings.cache).clear()


def lookup(
    table: Annotated[Path, typer.Argument(metavar="TABLE", help="Table (NetCDF).")],
    current: Current,
    gap: Gap,
    json: Json = False,
) -> None:
    """Force, flux linkage and inductance from a table; outside it is an error."""
    values = read_table(table).evaluate(read_option("--current", current, "A"), read_option("--gap", gap, "m"))
    fields = {
        "force_N": float(values["force"]),
        "flux_linkage_Wb": float(values["flux_linkage"]),
        "incremental_inductance_H": float(values["incremental_inductance"]),
        "coenergy_J": float(values["coenergy"]),
        "force_current_slope_N_per_A": float(values["force_current_slope"]),
        "force_gap_slope_N_per_m": float(values["force_gap_slope"]),
    }
    print_result(fields, as_json=json, title=f"{table} at {current}, gap {gap}")
