"""The command `map`: the operating map of a magnet."""

import dataclasses
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator, TableMagnet, load_actuator
from msl_fem.cli.losses import ThermalTexts, thermal_limit
from msl_fem.cli.options import (
    DEFAULT_AMBIENT,
    DEFAULT_RISE,
    AccuracyLevel,
    Ambient,
    HeatDuty,
    HeatPeriod,
    IronFrequency,
    Json,
    SectionEnds,
    TemperatureRise,
    ThermalResistance,
    read_option,
    read_options,
)
from msl_fem.cli.output import print_columns, print_result, progress_bar, say, write_json
from msl_fem.cli.polarity import polarity_off_the_middle, polarity_sentence
from msl_fem.cli.sweeping import checked_accuracy, checked_end_effects, default_workers
from msl_fem.computing.row_cache import RowCache
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.whole_file import check_target
from msl_fem.losses import ThermalLimit, thermal_curve, thermal_curve_with_iron
from msl_fem.magnetics.field_map import FieldMapSettings, decoupling_map, decoupling_positions, field_map
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, default_grid, sweep
from msl_fem.maps import MEAN, OperatingMap, map_to_json, operating_map, parse_criterion
from msl_fem.maps.pair_limits import RELATIONS, pair_map
from msl_fem.maps.pair_map_file import pair_map_to_json, write_pair_map
from msl_fem.report.map_page import map_page, pair_map_page
from msl_fem.report.page import write_page
from msl_fem.table.magnetic_table import MagneticTable, read_table
from msl_fem.table.pair_table import is_pair_table, read_pair_table


class FieldOptions(NamedTuple):
    """The options that a map from field solutions has beside those of a map from a table, as they were written."""

    gaps: str | None = None
    current_max: str | None = None
    workers: int = 0
    resume: bool = False
    end_effects: bool | None = None
    decoupling: bool = False


class Targets(NamedTuple):
    """The files to write."""

    output: Path | None
    report: Path | None


def command(
    source: Annotated[Path, typer.Argument(metavar="ACTUATOR|TABLE", help="Actuator file or table.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="JSON file to write.")] = None,
    levels: Annotated[str, typer.Option(help="Flux densities in the iron whose currents are mapped.")] = "1.2,1.6 T",
    criterion: Annotated[
        str,
        typer.Option(
            help="mean: of the most loaded section; percentile=95: of the iron's area; max or max=0.5mm: the largest "
            "in the iron, farther than that from its corners."
        ),
    ] = "mean",
    gaps: Annotated[
        str | None, typer.Option(help='Gaps of the map, like "0.1,0.2 mm"; else from the actuator\'s range.')
    ] = None,
    current_max: Annotated[
        str | None, typer.Option(help="Largest current to look for a level; else as far as the levels need.")
    ] = None,
    accuracy: AccuracyLevel = "normal",
    workers: Annotated[int, typer.Option(min=0, max=256, help="Processes; 0: one a core.")] = 0,
    resume: Annotated[bool, typer.Option(help="Take finished gaps of an interrupted run.")] = False,
    end_effects: SectionEnds = None,
    decoupling: Annotated[
        bool, typer.Option("--decoupling", help="Add how far the two sides are independent over the map.")
    ] = False,
    polarity: Annotated[
        str | None, typer.Option(help="opposing or aiding: how positive currents of a pair are to meet.")
    ] = None,
    temperature_rise: TemperatureRise = DEFAULT_RISE,
    ambient: Ambient = DEFAULT_AMBIENT,
    duty: HeatDuty = 1.0,
    period: HeatPeriod = None,
    thermal_resistance: ThermalResistance = None,
    frequency: IronFrequency = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Page to walk about in the map of a table (HTML).")
    ] = None,
    json: Json = False,
) -> None:
    """For each gap the current that brings each flux density in the iron.

    Of an actuator by root finding on field solutions, of a table by interpolation (criterion mean only). Of a table of
    both sides: the current that either side bears, by the armature's position and the other side's current.
    """
    parse_criterion(criterion)
    wanted = read_options("--levels", levels, "T")
    for target in (output, report):
        if target is not None:
            check_target(target, apart_from=[source])
    request = thermal_request(ThermalTexts(temperature_rise, ambient, duty, period, thermal_resistance, frequency))
    corrected = checked_end_effects(end_effects)
    options = FieldOptions(gaps, current_max, workers, resume, corrected, decoupling)
    actuator = load_actuator(source) if source.suffix == ".toml" else None
    if actuator is None and is_pair_table(source):
        targets = Targets(output, report)
        _map_of_both(source, wanted, targets, options, criterion=criterion, polarity=polarity, json=json)
        return
    if polarity is not None:
        raise InputError("--polarity is of a pair's map; give a table made with --sides both")
    if actuator is None or isinstance(actuator.magnet, TableMagnet):
        given = _table_in(source, actuator)
        table: MagneticTable | None = given
        made = _from_table(given, wanted, criterion, options)
        if report is not None:
            write_page(map_page(given, made, str(source)), report)
    else:
        if report is not None:
            raise InputError("--report shows the map of a table: make one with 'msl-fem table', and give its file")
        settings = _settings(options, checked_accuracy(accuracy), output)
        table = _default_table(actuator, settings) if request.frequency is not None else None
        made = _from_fields(actuator, wanted, criterion, options, settings)
    thermal = thermal_to_json(source, made.gap, request, table=table)
    costs = {} if actuator is None else _polarity_costs(actuator, made)
    if output is not None:
        write_json(map_to_json(made) | thermal | costs, output)
        RowCache(_cache(output)).clear()
    for note in (*_notes(made), *made.warnings, *_holes(made), *thermal_notes(thermal)):
        say(f"note: {note}")
    if costs:
        say(f"note: {polarity_sentence(costs['polarity'])}")
    if json:
        print_result(map_to_json(made) | thermal | costs | reported(report), as_json=True, title="")
        return
    print_columns(_columns(made) | thermal_columns(thermal), title=f"operating map of {source}, {made.criterion}")


def _polarity_costs(actuator: Actuator, made: OperatingMap) -> dict[str, Any]:
    """The JSON field `polarity` at the first level's current half the range off the middle; empty if there is none."""
    motion = actuator.motion
    if motion is None or motion.nominal_gap is None or motion.range is None:
        return {}
    gap = motion.nominal_gap - motion.range / 2
    current = float(np.interp(gap, made.gap, made.current[0], left=np.nan, right=np.nan))
    return polarity_off_the_middle(actuator, current, accuracy="fast") if np.isfinite(current) else {}


def _map_of_both(
    source: Path,
    levels: list[float],
    targets: Targets,
    options: FieldOptions,
    *,
    criterion: str,
    polarity: str | None,
    json: bool,
) -> None:
    """The map of a pair, from its table."""
    if parse_criterion(criterion).kind != MEAN:
        raise InputError(f"criterion '{criterion}' is not available for both sides, whose table holds section means")
    for name, given in options._asdict().items():
        if given:
            raise InputError(f"--{name.replace('_', '-')} is not of a pair's map, which is made from its table")
    table = read_pair_table(source)
    made = pair_map(table, levels=levels, polarity=polarity or "opposing")
    if targets.output is not None:
        write_pair_map(made, targets.output)
    if targets.report is not None:
        write_page(pair_map_page(table, made, str(source)), targets.report)
    for level, opposing, aiding in zip(made.levels, *made.equal_currents(), strict=True):
        bear = f"{opposing:.3g} A each opposing, {aiding:.3g} A aiding"
        say(f"note: {level:g} T with the armature in the middle and both sides on: {bear}")
    if json:
        print_result(pair_map_to_json(made) | reported(targets.report), as_json=True, title="")
        return
    shown = sorted({0, *range(0, made.other.size, max(1, made.other.size // 6)), made.other.size - 1})
    columns = {"position in mm": [f"{x * 1e3:.4g}" for x in made.position]}
    for n in shown:
        bears = made.current[RELATIONS.index(made.polarity), 0, :, n]
        columns[f"at {made.other[n]:.3g} A"] = ["none" if i < 0 else f"{i:.3f}" for i in bears]
    title = f"what side 1 bears in A below {made.levels[0]:g} T, by side 2's current, {made.polarity} ({source})"
    print_columns(columns, title=title)


def reported(report: Path | None) -> dict[str, str]:
    """The JSON entry of the page that was written."""
    return {} if report is None else {"report": str(report)}


def _holes(made: OperatingMap) -> list[str]:
    """A line for each level that some gaps' currents do not reach, and what goes further; the file names every gap."""
    of_fields = made.mesh_error is not None
    further = "give a larger --current-max" if of_fields else "make the table with larger currents"
    holes = [(level, made.gap[missing]) for level, missing in zip(made.levels, np.isnan(made.current), strict=True)]
    return [
        f"{level:g} T is not reached below {made.current_max:g} A at {gaps.size} of {made.gap.size} gaps, "
        f"{format_quantity(gaps[0], 'm')} the smallest; {further}"
        for level, gaps in holes
        if gaps.size
    ]


def _table_in(source: Path, actuator: Actuator | None) -> MagneticTable:
    """The table in a file, or the one that an actuator names."""
    if actuator is None or not isinstance(actuator.magnet, TableMagnet):
        return read_table(source)
    return read_table(actuator.folder / actuator.magnet.table)


def _from_table(table: MagneticTable, levels: list[float], criterion: str, options: FieldOptions) -> OperatingMap:
    if parse_criterion(criterion).kind != MEAN:
        raise InputError(
            f"criterion '{criterion}' is not available from a table, which holds section means; use mean, or give the "
            "actuator file"
        )
    for name, given in options._asdict().items():
        if name != "gaps" and given:
            raise InputError(f"--{name.replace('_', '-')} needs field solutions: give an actuator file, not a table")
    gap = None if options.gaps is None else np.unique(read_options("--gaps", options.gaps, "m"))
    return operating_map(table, levels=levels, gap=gap)


def _settings(options: FieldOptions, accuracy: Any, output: Path | None) -> FieldMapSettings:
    if options.resume and output is None:
        raise InputError("--resume takes up what was meant for a file; give the same -o FILE")
    return FieldMapSettings(
        accuracy=accuracy,
        workers=options.workers or default_workers(),
        cache=None if output is None else _cache(output),
        resume=options.resume,
        end_effects=options.end_effects,
        current_max=None if options.current_max is None else read_option("--current-max", options.current_max, "A"),
    )


def _cache(output: Path) -> Path:
    return output.with_name(f".{output.name}.rows")


def _from_fields(
    actuator: Actuator, levels: list[float], criterion: str, options: FieldOptions, settings: FieldMapSettings
) -> OperatingMap:
    gap = None if options.gaps is None else read_options("--gaps", options.gaps, "m")
    if options.decoupling:
        decoupling_positions(actuator)  # that they are there is said before the work
    with progress_bar("field solutions, gaps") as progress:
        made = field_map(actuator, gap, levels=levels, criterion=criterion, settings=settings, progress=progress)
    if not options.decoupling:
        return made
    with progress_bar("both sides, positions") as progress:
        shared = decoupling_map(actuator, levels=levels, settings=settings, progress=progress)
    for finding in shared.findings():
        say(f"decoupling: {finding}")
    return dataclasses.replace(made, decoupling=shared.to_json())


def _default_table(actuator: Actuator, settings: FieldMapSettings) -> MagneticTable:
    """What the iron's loss in the thermal limit is read from."""
    table_settings = SweepSettings(settings.accuracy, settings.workers, end_effects=settings.end_effects)
    with progress_bar("field solutions, rows") as progress:
        return sweep(actuator, *default_grid(actuator), settings=table_settings, progress=progress)[0]


def _notes(made: OperatingMap) -> list[str]:
    noted = (made.provenance or {}).get("notes", [])
    parts = "interpolation" if made.mesh_error is None else "mesh and B-H curve between its points"
    share = made.error[np.isfinite(made.current)] / made.current[np.isfinite(made.current)]
    errors = [f"the currents are within {100 * share.max():.2g} % (stated error: {parts})"] if share.size else []
    return errors + ([str(note) for note in noted] if isinstance(noted, list) else [])


def _columns(made: OperatingMap) -> dict[str, list[str]]:
    columns = {"gap in mm": [f"{g * 1e3:.4g}" for g in made.gap]}
    for level, row, section in zip(made.levels, made.current, made.section, strict=True):
        columns[f"{level:g} T in A"] = ["not reached" if np.isnan(i) else f"{i:.4f}" for i in row]
        columns[f"{level:g} T in the"] = [name.replace("_", " ") for name in section]
    return columns


class ThermalRequest(NamedTuple):
    """The limit, and the frequency in Hz of a sine whose iron loss counts; None where the copper's alone does."""

    limit: ThermalLimit
    frequency: float | None


def thermal_request(texts: ThermalTexts) -> ThermalRequest:
    """What the options ask for; raises as `thermal_limit`."""
    frequency = None if texts.frequency is None else read_option("--frequency", texts.frequency, "Hz")
    if frequency is not None and frequency <= 0:
        raise InputError(f"--frequency {texts.frequency} is not allowed; it must be above 0 Hz")
    return ThermalRequest(thermal_limit(texts), frequency)


def thermal_to_json(
    source: Path, gap: ArrayLike, request: ThermalRequest, *, table: MagneticTable | None
) -> dict[str, Any]:
    """The map's fields `continuous_current_A` and `duty_current_A`, a value a gap, and `thermal`; none for a table.

    With a frequency the current is sinusoidal and its iron loss counts. Where the limit cannot be known (no cooling
    stated for a magnet that is no E-core, no loss data) the currents are null and `thermal` says why.
    """
    if source.suffix != ".toml":
        return {}
    actuator = load_actuator(source)
    limit, frequency = request
    try:
        if frequency is None or table is None:
            return thermal_curve(actuator, gap, limit).to_json()
        return thermal_curve_with_iron(actuator, gap, limit, table=table, frequency=frequency).to_json()
    except InputError as err:
        return {"continuous_current_A": None, "duty_current_A": None, "thermal": {"reason": str(err)}}


def thermal_columns(fields: dict[str, Any]) -> dict[str, list[str]]:
    """The limit as columns of the map's table for people; none where it is not known."""
    rows = {"continuous in A": fields.get("continuous_current_A")}
    if fields.get("thermal", {}).get("duty", 1.0) < 1:
        rows["at duty in A"] = fields.get("duty_current_A")
    return {
        name: ["not known" if i is None else f"{i:.3f}" for i in row] for name, row in rows.items() if row is not None
    }


def thermal_notes(fields: dict[str, Any]) -> list[str]:
    """What the limit rests on, or why there is none, as notes for people."""
    thermal = fields.get("thermal", {})
    return thermal.get("notes", []) + ([f"no thermal limit: {thermal['reason']}"] if "reason" in thermal else [])
