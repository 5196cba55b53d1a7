"""The command `solve`: one field solution."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Current, Gap, Json, read_option
from msl_fem.cli.output import print_result, say
from msl_fem.cli.sweeping import checked_accuracy
from msl_fem.export.vtu import write_vtu
from msl_fem.magnet_field import PointResult, solve_with_field
from msl_fem.report.field_picture import draw_field, save_picture


def command(
    actuator: ActuatorFile,
    current: Current,
    gap: Gap,
    accuracy: AccuracyLevel = "normal",
    picture: Annotated[Path | None, typer.Option(help="Write a PNG of |B| and flux lines.")] = None,
    vtu: Annotated[Path | None, typer.Option(help="Write the field for ParaView.")] = None,
    json: Json = False,
) -> None:
    """One field solution of one magnet: force by two routes, flux linkage, coenergy, flux density on sections."""
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
