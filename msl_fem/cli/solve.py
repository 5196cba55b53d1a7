"""The command `solve`: one field solution."""

from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import Actuator, MeshMagnet, load_actuator
from msl_fem.cli.options import AccuracyLevel, ActuatorFile, Current, Json, SectionEnds, read_option
from msl_fem.cli.output import print_result, progress_bar, say
from msl_fem.cli.polarity import what_a_polarity_costs
from msl_fem.cli.sweeping import checked_accuracy, checked_end_effects
from msl_fem.errors import InputError
from msl_fem.export.vtu import write_solid_vtu, write_vtu
from msl_fem.files.whole_file import check_target
from msl_fem.magnetics.field.accuracy import Accuracy, PointResult
from msl_fem.magnetics.field.magnet_field import MagnetField, chosen_ends, solve_with_field
from msl_fem.magnetics.field.two_sided import TwoSidedResult, solve_two_sided
from msl_fem.magnetics.field.two_sided_section import TwoSidedPosition
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.magnetics.sweep.rows import stated_ends
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.magnet_point import SolidPoint, solve_solid
from msl_fem.magnetics.three_d.pair_point import SolidPairPoint, solve_solid_pair
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution
from msl_fem.report.scene import render_scene


def command(
    actuator: ActuatorFile,
    current: Current,
    gap: Annotated[
        str | None, typer.Option(help='Air gap, like "0.5 mm"; a magnet given by a mesh has its own.')
    ] = None,
    current_2: Annotated[str | None, typer.Option("--current-2", help="Coil current of side 2: both magnets.")] = None,
    gap_2: Annotated[str | None, typer.Option("--gap-2", help="Air gap of side 2: both magnets.")] = None,
    tilt: Annotated[str | None, typer.Option(help='Tilt of the armature between both magnets, like "1 mrad".')] = None,
    accuracy: AccuracyLevel = "normal",
    picture: Annotated[Path | None, typer.Option(help="Write a PNG of |B| and flux lines.")] = None,
    vtu: Annotated[Path | None, typer.Option(help="Write the field for ParaView.")] = None,
    scene: Annotated[
        Path | None, typer.Option(help="Write a PNG of the solid magnet (needs --vtu, pyvista, GL).")
    ] = None,
    end_effects: SectionEnds = None,
    dimension: Annotated[
        int, typer.Option(metavar="2|3", help="3: with the end turns, or all around a pot core (needs pyamg).")
    ] = 2,
    json: Json = False,
) -> None:
    """One field solution of one magnet, or with --current-2 and --gap-2 of both and the armature they share.

    Force by two routes, flux linkage, coenergy, flux density on sections.
    """
    it, level = load_actuator(actuator), checked_accuracy(accuracy)
    for target in (picture, vtu, scene):
        if target is not None:
            check_target(target, apart_from=[actuator])
    amperes, metres = read_option("--current", current, "A"), _read_gap("--gap", gap)
    _check_dimension(dimension, tilt=tilt, scene=scene)
    two_sided = (current_2, gap_2, tilt) != (None, None, None)
    corrected = checked_end_effects(end_effects)
    if corrected is not None and dimension == 3:
        raise InputError("--end-effects are of a section; leave it out: three dimensions have the ends")
    if scene is not None and vtu is None:
        raise InputError("--scene draws what --vtu writes; give both")
    if two_sided and dimension == 2 and (picture or vtu):
        raise InputError("--picture and --vtu draw both magnets with --dimension 3; add it, or leave them out")
    title = f"{it.name}: one magnet at {current}" + (f", gap {gap}" if gap else "")
    if two_sided:
        position, currents = _position(metres, gap_2, tilt), (amperes, _current_2(current_2))
        if dimension == 3:
            _solve_solid_pair(it, currents, position, level, picture=picture, vtu=vtu, json=json)
            return
        found = solve_two_sided(it, currents, position, accuracy=level, end_effects=corrected)
        _say_notes(found.notes)
        if position.tilt and chosen_ends(it, corrected):
            say("note: a tilted armature is solved in the plane section, without the ends of the stacks")
        costs = what_a_polarity_costs(it, currents, position, accuracy=level, end_effects=corrected)
        stated = stated_ends(it.magnet_kind(), found.ends)
        print_result(two_sided_to_json(found) | stated | costs, as_json=json, title=f"{it.name}: both magnets")
        return
    if metres is None and isinstance(it.magnet, MeshMagnet):
        metres = it.magnet.gap
    if metres is None:
        raise InputError('--gap is missing; give the air gap, like --gap "0.5 mm"')
    if dimension == 3:
        _solve_solid(it, amperes, metres, level, picture=picture, vtu=vtu, title=title, json=json)
        return
    result, field, solution = solve_with_field(it, amperes, metres, accuracy=level, end_effects=corrected)
    if picture is not None:
        _draw(field, solution, f"{it.name}: {current}, gap {metres * 1e3:g} mm", picture)
    if vtu is not None:
        write_vtu(field, solution, vtu)
    if scene is not None and vtu is not None:
        reason = render_scene(vtu, scene, depth=field.section.depth)
        if reason:
            say(f"note: {reason}")
    _say_notes(result.notes)
    stated = stated_ends(field.magnet, field.ends)
    print_result(point_to_json(result) | stated, as_json=json, title=title)


def _draw(field: MagnetField, solution: FieldSolution, title: str, picture: Path) -> None:
    from msl_fem.report.field_picture import draw_field, save_picture  # here: who wants numbers waits for no plotter

    save_picture(draw_field(field, solution, title=title), picture)


def _draw_solid(model: BoxModel, solution: PotentialSolution, title: str, picture: Path) -> None:
    from msl_fem.report.field_picture import save_picture
    from msl_fem.report.solid_picture import draw_solid_field

    save_picture(draw_solid_field(model, solution, title=title), picture)


def _check_dimension(dimension: int, *, tilt: str | None, scene: Path | None) -> None:
    if dimension not in (2, 3):
        raise InputError(f"--dimension {dimension} is not known; choose 2 or 3")
    if dimension == 3 and (tilt is not None or scene is not None):
        raise InputError("--dimension 3 knows neither --tilt nor --scene; leave them out")


def _solve_solid(
    it: Actuator,
    current: float,
    gap: float,
    accuracy: Accuracy,
    *,
    picture: Path | None,
    vtu: Path | None,
    title: str,
    json: bool,
) -> None:
    with progress_bar("field in three dimensions, per cent") as progress:
        point, model, solution = solve_solid(it, current, gap, accuracy=accuracy, progress=progress)
    if picture is not None:
        _draw_solid(model, solution, title, picture)
    if vtu is not None:
        write_solid_vtu(model, solution, vtu)
    _say_notes(point.notes)
    print_result(solid_to_json(point), as_json=json, title=title)


def _solve_solid_pair(
    it: Actuator,
    currents: tuple[float, float],
    position: TwoSidedPosition,
    accuracy: Accuracy,
    *,
    picture: Path | None,
    vtu: Path | None,
    json: bool,
) -> None:
    gaps = position.gap_1, position.gap_2
    with progress_bar("field in three dimensions, per cent") as progress:
        point, model, solution = solve_solid_pair(it, currents, gaps, accuracy=accuracy, progress=progress)
    title = f"{it.name}: both magnets"
    if picture is not None:
        at = (f"{current:g} A at {gap * 1e3:g} mm" for current, gap in zip(currents, gaps, strict=True))
        _draw_solid(model, solution, f"{title}, {' and '.join(at)}", picture)
    if vtu is not None:
        write_solid_vtu(model, solution, vtu)
    _say_notes(point.notes)
    print_result(solid_pair_to_json(point), as_json=json, title=title)


def _read_gap(name: str, text: str | None) -> float | None:
    return None if text is None else read_option(name, text, "m")


def _current_2(text: str | None) -> float:
    if text is None:
        raise InputError('--current-2 is missing; give the current of side 2, like --current-2 "0 A"')
    return read_option("--current-2", text, "A")


def _position(gap_1: float | None, gap_2: str | None, tilt: str | None) -> TwoSidedPosition:
    """Where the armature stands; InputError where a gap is missing."""
    second = _read_gap("--gap-2", gap_2)
    if gap_1 is None or second is None:
        raise InputError('both gaps are needed for both magnets; give --gap "0.5 mm" and --gap-2 "0.5 mm"')
    return TwoSidedPosition(gap_1, second, 0.0 if tilt is None else read_option("--tilt", tilt, "rad"))


def _say_notes(notes: tuple[str, ...]) -> None:
    for note in notes:
        say(f"note: {note}")


def two_sided_to_json(result: TwoSidedResult) -> dict[str, Any]:
    """The JSON fields of `solve` with both magnets; the force's error estimate is in N here."""
    q, (current_1, current_2), position = result.quantities, result.currents, result.position
    return {
        "current_1_A": current_1,
        "current_2_A": current_2,
        "gap_1_m": position.gap_1,
        "gap_2_m": position.gap_2,
        "tilt_rad": position.tilt,
        "net_force_N": q.net_force,
        "net_force_stress_tensor_N": q.net_force_stress_tensor,
        "side_force_N": q.side_force,
        "torque_Nm": q.torque,
        "flux_linkage_1_Wb": q.flux_linkage_1,
        "flux_linkage_2_Wb": q.flux_linkage_2,
        "coenergy_J": q.coenergy,
        "net_force_error_estimate_N": result.force_error_estimate,
        "unknowns": result.unknowns,
        "newton_iterations": result.newton_iterations,
        "notes": list(result.notes),
    }


def point_to_json(result: PointResult) -> dict[str, Any]:
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


def solid_pair_to_json(point: SolidPairPoint) -> dict[str, Any]:
    """The JSON fields of `solve --dimension 3` with both magnets; errors of force and flux linkage in N and Wb here."""
    return {
        "current_1_A": point.currents[0],
        "current_2_A": point.currents[1],
        "gap_1_m": point.gaps[0],
        "gap_2_m": point.gaps[1],
        "net_force_N": point.net_force,
        "flux_linkage_1_Wb": point.flux_linkage[0],
        "flux_linkage_2_Wb": point.flux_linkage[1],
        "coenergy_J": point.coenergy,
        "incremental_inductance_1_H": point.incremental_inductance[0],
        "incremental_inductance_2_H": point.incremental_inductance[1],
        "mutual_inductance_H": point.mutual_inductance,
        "net_force_error_estimate_N": point.net_force_error,
        "flux_linkage_error_estimate_Wb": point.flux_error,
        "mutual_inductance_error_estimate": point.mutual_error,
        "unknowns": point.unknowns,
        "newton_iterations": point.newton_iterations,
        "notes": list(point.notes),
    }


def solid_to_json(point: SolidPoint) -> dict[str, Any]:
    """The JSON fields of `solve --dimension 3`: those of `solve`, the flux linkage's error and dF/di."""
    return {
        "current_A": point.current,
        "gap_m": point.gap,
        "force_N": point.force,
        "force_stress_tensor_N": point.force_stress,
        "flux_linkage_Wb": point.flux_linkage,
        "coenergy_J": point.coenergy,
        "incremental_inductance_H": point.incremental_inductance,
        "force_current_slope_N_per_A": point.force_current_slope,
        "force_error_estimate": point.force_error,
        "flux_linkage_error_estimate": point.flux_error,
        "flux_density_T": {name: {"mean": b.mean, "max": b.max} for name, b in point.flux_density.items()},
        "unknowns": point.unknowns,
        "newton_iterations": point.newton_iterations,
        "notes": list(point.notes),
    }
