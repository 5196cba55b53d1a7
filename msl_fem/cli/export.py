"""The command `export`: tables, maps and actuators in the formats of other tools."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.cli.believed import model_with_belief
from msl_fem.cli.controller_maps import maps_for
from msl_fem.cli.controllers import DesignOptions, design_of
from msl_fem.cli.currents_commanded import currents_commanded
from msl_fem.cli.given_map import given_map
from msl_fem.cli.options import (
    Bandwidth,
    BeliefName,
    Bias,
    CurrentLoop,
    DesignName,
    DiagnosisFolder,
    Feedforward,
    GuardedAmbient,
    GuardedRise,
    Json,
    Known,
    MapFile,
    Overlap,
    PeakSensitivity,
    Preview,
    TableFile,
    ThermalResistance,
)
from msl_fem.cli.output import print_result, say
from msl_fem.cli.sweeping import table_for, table_of_model
from msl_fem.errors import InputError
from msl_fem.export.c_controller import ControllerSource
from msl_fem.export.fmu import platforms
from msl_fem.export.formats import (
    ACTUATOR,
    CONTROLLER,
    MAP,
    MODEL,
    PAIR_MAP,
    PAIR_TABLE,
    TABLE,
    ModelSource,
    find_format,
)
from msl_fem.files.schema import reason, refuse_what_never_ends
from msl_fem.files.whole_file import check_target
from msl_fem.identification import ArmaxModel
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.maps.pair_limits import PairMap
from msl_fem.maps.pair_map_file import is_pair_map, read_pair_map
from msl_fem.plant.believed import PLAIN_BELIEF
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model
from msl_fem.table.magnetic_table import MagneticTable, read_table
from msl_fem.table.pair_table import PairTable, is_pair_table, read_pair_table

_HDF5 = b"\x89HDF"
Source = Actuator | MagneticTable | PairTable | OperatingMap | PairMap | ModelSource | ControllerSource


def command(
    source: Annotated[
        Path, typer.Argument(metavar="TABLE|ACTUATOR|MAP", help="Table, actuator file, extended model or map.")
    ],
    to: Annotated[
        str, typer.Option("--to", metavar="FORMAT", help="c, csv, mat, modelica, simulink, dxf, femm, fmu or fmu3.")
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="File to write.")],
    what: Annotated[
        str | None,
        typer.Option(metavar="PART", help="guard, table, controller, section or model; without, what SOURCE is."),
    ] = None,
    table: TableFile = None,
    map_file: MapFile = None,
    model: Known = "table",
    diagnosis: DiagnosisFolder = None,
    design: DesignName = "lqr",
    bandwidth: Bandwidth = None,
    peak_sensitivity: PeakSensitivity = None,
    feedforward: Feedforward = True,
    preview: Preview = True,
    bias: Bias = None,
    overlap: Overlap = "0 N",
    current_loop: CurrentLoop = None,
    temperature_rise: GuardedRise = None,
    ambient: GuardedAmbient = None,
    thermal_resistance: ThermalResistance = None,
    belief: BeliefName = None,
    name: Annotated[str | None, typer.Option(help="Beginning of C names; without, the actuator's name.")] = None,
    json: Json = False,
) -> None:
    """Write a table, a guard or the coupled model for other tools.

    A table as CSV, C99 header, MAT-file for Simscape, Simulink model or text for Modelica; a guard as C99 header, and
    so the whole controller of an actuator or an extended model, as `control` designs it with the same options (--what
    controller); the coupled model of an actuator, or of an extended model with its effects, as FMU for co-simulation
    (fmu: FMI 2.0, fmu3: FMI 3.0); the section of a magnet as DXF or as a problem of FEMM.
    """
    options = DesignOptions(
        model, design, bandwidth, peak_sensitivity, feedforward, preview, bias, overlap, current_loop, temperature_rise,
        ambient, thermal_resistance,
    )  # fmt: skip
    options.thermal_limit()
    options.choice()
    kind = _kind(source)
    wanted = find_format(to, what, kind)
    check_target(output, apart_from=[] if table is None else [table])
    if output.exists() and source.exists() and output.samefile(source):
        raise InputError(f"{output} is the source itself; name another file with -o")
    if table is not None and kind != ACTUATOR:
        raise InputError(f"--table goes with an actuator file; {source} holds a {kind}, leave it out")
    stated = options.stated + [name for name, file in (("--map", map_file), ("--from", diagnosis)) if file is not None]
    stated += [] if belief is None else ["--belief"]
    if stated and wanted.needs != CONTROLLER:
        raise InputError(f"{stated[0]} is of a controller's design; add --what controller, or leave it out")
    if wanted.needs == CONTROLLER:
        told = options.told(diagnosis, table)
        known = options.known() if told is None else told.model
        model_file = currents_commanded(load_extended_model(source), current_loop)
        files_given = _Files(table, map_file)
        record: Source = _controller(model_file, options, known=known, files=files_given, belief=belief)
    else:
        record = _record(source, kind, wanted.needs, table=table)
    files = wanted.write(record, output, name=name)
    fields: dict[str, Any] = {"files": [str(path) for path in files]}
    if wanted.needs == MODEL:
        fields["platforms"] = platforms(output)
        if not fields["platforms"]:
            say("note: no gcc here for 64-bit Linux, so the FMU holds its sources alone; see sources/build.txt in it")
    print_result(fields, as_json=json, title=f"{source} as {to}, {wanted.what}")


@dataclass(frozen=True)
class _Files:
    """The table and the map that a controller is designed with, where they are given."""

    table: Path | None
    map: Path | None


def _kind(path: Path) -> str:
    """What a file holds: an actuator by its name, a table by its first bytes or name, else a map."""
    if path.suffix == ".toml":
        return ACTUATOR
    if path.suffix == ".nc":
        return PAIR_TABLE if is_pair_table(path) else TABLE
    try:
        refuse_what_never_ends(path)
        with path.open("rb") as stream:
            if stream.read(len(_HDF5)) == _HDF5:
                return PAIR_TABLE if is_pair_table(path) else TABLE
        return PAIR_MAP if is_pair_map(path) else MAP
    except (OSError, ValueError) as err:
        raise InputError(f"{path}: cannot be read ({reason(err)}); give a table, an actuator file or a map") from err


def _record(path: Path, kind: str, needs: str, *, table: Path | None) -> Source:
    """The record that a format needs, made of the source where it is not the source itself."""
    if kind == MAP:
        return given_map(path)
    if kind == PAIR_MAP:
        return read_pair_map(path)
    if kind == PAIR_TABLE:
        return read_pair_table(path)
    if needs == ACTUATOR:
        return load_actuator(path)
    if needs == MODEL:
        model = load_extended_model(path)
        effects = model.effects if model.effects.present else None
        return ModelSource(model.actuator, table_for(model.actuator, table), effects)
    magnet = read_table(path) if kind == TABLE else _table_of(load_actuator(path), table)
    if needs == TABLE:
        return magnet
    made = operating_map(magnet)
    for warning in (*made.warnings, *made.not_reached()):
        say(f"note: {warning}")
    return made


def _controller(
    model: ExtendedModel,
    options: DesignOptions,
    *,
    known: ExtendedModel | ArmaxModel | None,
    files: _Files,
    belief: str | None,
) -> ControllerSource:
    """The controller that `control` designs with these options, of what is believed, effects among it."""
    actuator = model.actuator
    if lacking := actuator.lacking("magnet", "controller"):
        raise InputError(f"{actuator.name} has no {lacking}; a controller needs [magnet] and [controller]")
    own = table_of_model(known.actuator, None) if isinstance(known, ExtendedModel) else None
    magnet = table_for(actuator, files.table) if own is None else own
    assert magnet is not None
    believed = PLAIN_BELIEF
    if known is None:
        known = model if model.effects.present else None
        _, believed = model_with_belief(belief, model, magnet)
    maps = maps_for(actuator, magnet, map_file=files.map, table_file=files.table)
    return ControllerSource(design_of(options, known, actuator, magnet, maps, belief=believed), maps.one_side)


def _table_of(actuator: Actuator, given: Path | None) -> MagneticTable:
    table = table_for(actuator, given)
    if table is None:
        raise InputError(f"{actuator.name} has no [magnet], so there is no table to export")
    if table.shared is not None:
        raise InputError(
            f"{given or 'the table'} is of two magnets with one armature and this is of one magnet alone: give its "
            "table, or export the pair's own table (mat, csv, c) and its map (c)"
        )
    return table
