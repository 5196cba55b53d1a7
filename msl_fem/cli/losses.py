"""The command `losses`: wire, copper loss, iron loss and temperature of one magnet in an operation."""

from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import typer

from msl_fem.actuator import Actuator, MagnetKind, load_actuator
from msl_fem.cli.options import (
    DEFAULT_AMBIENT,
    DEFAULT_RISE,
    ActuatorFile,
    Ambient,
    HeatDuty,
    HeatPeriod,
    Json,
    TableFile,
    TemperatureRise,
    ThermalResistance,
    read_option,
)
from msl_fem.cli.output import print_result, say
from msl_fem.cli.sweeping import table_for
from msl_fem.errors import InputError, QuantityError
from msl_fem.files.quantity import parse_temperature
from msl_fem.losses import (
    ContinuousCurrent,
    Cooling,
    Cycle,
    Grade,
    Heating,
    IronLoss,
    Packing,
    PeriodicOperation,
    Series,
    ThermalLimit,
    ThermalRunaway,
    WireChoice,
    choose_wire,
    continuous_current,
    iron_loss,
    mean_period,
    negligible_below,
    resistance_factor,
    sine_operation,
    slot_rows,
    steady_rise,
)
from msl_fem.losses.copper_loss import CopperLoss, copper_loss, copper_loss_of_period
from msl_fem.materials.constants import resistance_ratio
from msl_fem.record import load_record


class _Sine(NamedTuple):
    """The operation's options as they were written."""

    current: str | None
    amplitude: str
    gap: str | None
    gap_amplitude: str
    frequency: str | None


class _RecordedRun(NamedTuple):
    """Which side's current of which run."""

    record: Path
    run: str | None
    side: int


def command(
    actuator: ActuatorFile,
    current: Annotated[
        str | None, typer.Option(help='Current of one magnet\'s coil, or the bias of a sine, like "2 A".')
    ] = None,
    amplitude: Annotated[str, typer.Option(help="Amplitude of a sine of current about --current.")] = "0 A",
    gap: Annotated[str | None, typer.Option(help='Air gap, like "0.5 mm"; without, the nominal one.')] = None,
    gap_amplitude: Annotated[
        str, typer.Option(help="Amplitude of a sine of the gap, which is smallest where the current is largest.")
    ] = "0 mm",
    frequency: Annotated[str | None, typer.Option(help="Frequency of the sine, or of a record's excitation.")] = None,
    table: TableFile = None,
    record: Annotated[Path | None, typer.Option(help="Record folder, in place of a sine.")] = None,
    run: Annotated[
        str | None, typer.Option(help="Run of the record, by name; may be left out where there is one.")
    ] = None,
    side: Annotated[int, typer.Option(min=1, max=2, help="Side of the record whose current is taken.")] = 1,
    sheet: Annotated[str | None, typer.Option(help='Thickness of the sheets, like "0.36 mm".')] = None,
    temperature: Annotated[str, typer.Option(help="Temperature of the winding, for the copper loss.")] = "20 degC",
    wire: Annotated[str, typer.Option(help="Series of the wire's diameters: metric or awg.")] = "metric",
    grade: Annotated[int, typer.Option(help="Grade of the wire's insulation, 1 or 2.")] = 1,
    packing: Annotated[str, typer.Option(help="How the turns lie: square or orthocyclic.")] = "square",
    temperature_rise: TemperatureRise = DEFAULT_RISE,
    ambient: Ambient = DEFAULT_AMBIENT,
    duty: HeatDuty = 1.0,
    period: HeatPeriod = None,
    thermal_resistance: ThermalResistance = None,
    json: Json = False,
) -> None:
    """The wire that fits, copper and iron loss of one magnet, its temperature and the continuous current."""
    it = load_actuator(actuator)
    limit = thermal_limit(ThermalTexts(temperature_rise, ambient, duty, period, thermal_resistance))
    warmth = read_temperature("--temperature", temperature)
    thickness = None if sheet is None else read_option("--sheet", sheet, "m")
    notes: list[str] = []
    if record is None:
        rms, operation = _sine_operation(it, _Sine(current, amplitude, gap, gap_amplitude, frequency))
    else:
        _refuse_beside_record(current, gap, amplitude, gap_amplitude)
        operation = _recorded_operation(it, _RecordedRun(record, run, side), frequency, notes)
        rms = operation.current_rms
    choice = chosen_wire(it, cast(WireOptions, (wire, grade, packing)), notes)
    copper = _copper(it, rms, operation, choice, warmth)
    iron = None if operation is None else _iron(it, table, operation, thickness)
    notes += iron.notes if iron else ("direct current, which has no iron loss; --frequency makes it a sine",)
    fields: dict[str, Any] = {"current_rms_A": rms, "frequency_Hz": operation.frequency if operation else None}
    fields |= {**copper_to_json(copper), **iron_to_json(iron), "wire": wire_to_json(choice, it, warmth)}
    fields["thermal"] = thermal_limit_to_json(it, limit, rms, iron=iron, notes=notes)
    for note in notes:
        say(f"note: {note}")
    if json:
        print_result(fields | {"notes": notes}, as_json=True, title="")
        return
    thermal = fields["thermal"] or {}
    for note in thermal.pop("notes", []):
        say(f"note: {note}")
    print_result(fields, as_json=False, title=f"losses of one magnet of {it.name}")


def _sine_operation(actuator: Actuator, texts: _Sine) -> tuple[float, PeriodicOperation | None]:
    """RMS current, and the period of a sine; None for direct current."""
    if texts.current is None:
        raise InputError('--current is missing; give one, like --current "2 A", or a --record')
    current, amplitude = read_option("--current", texts.current, "A"), read_option("--amplitude", texts.amplitude, "A")
    swing = read_option("--gap-amplitude", texts.gap_amplitude, "m")
    if amplitude < 0 or swing < 0:
        raise InputError("--amplitude and --gap-amplitude must not be negative")
    if texts.frequency is None:
        if amplitude or swing:
            raise InputError('--frequency is missing; a sine needs one, like --frequency "50 Hz"')
        return abs(current), None
    nominal = actuator.motion.nominal_gap if actuator.motion else None
    if texts.gap is None and nominal is None:
        raise InputError(f'{actuator.name} states no nominal gap; give --gap, like --gap "0.5 mm"')
    gap = nominal if texts.gap is None else read_option("--gap", texts.gap, "m")
    assert gap is not None
    frequency = read_option("--frequency", texts.frequency, "Hz")
    operation = sine_operation(current, gap, frequency=frequency, amplitude=amplitude, gap_amplitude=swing)
    return operation.current_rms, operation


def _refuse_beside_record(current: str | None, gap: str | None, amplitude: str, gap_amplitude: str) -> None:
    if current is not None or gap is not None or (amplitude, gap_amplitude) != ("0 A", "0 mm"):
        raise InputError("--record brings current and gap with it; leave --current, --gap and their amplitudes out")


def _recorded_operation(
    actuator: Actuator, which: _RecordedRun, frequency: str | None, notes: list[str]
) -> PeriodicOperation:
    """The mean period of a run's last half, for one magnet of a side."""
    if frequency is None:
        raise InputError('--frequency is missing; give that of the run\'s excitation, like --frequency "50 Hz"')
    record = load_record(which.record)
    if which.run is None and len(record.runs) != 1:
        raise InputError(f"--run is missing; the record has {', '.join(r.name for r in record.runs) or 'none'}")
    run = record.runs[0] if which.run is None else record.run(which.run)
    motion, sides = actuator.motion, actuator.sides
    if motion is None or motion.nominal_gap is None or sides is None:
        raise InputError(f"{actuator.name}: a record's run needs [motion] nominal_gap and [sides]")
    share = 1 / sides.magnets_per_side if sides.connection == "parallel" else 1.0
    towards = run["position_m"] if which.side == 1 else -run["position_m"]
    operation, apart = mean_period(
        run.time, share * run[f"current_{which.side}_A"], motion.nominal_gap - towards,
        frequency=read_option("--frequency", frequency, "Hz"),
    )  # fmt: skip
    notes.append(f"run {run.name}, side {which.side}: mean of its last half's periods, which deviate by {apart:.1%}")
    return operation


def _copper(
    actuator: Actuator, rms: float, operation: PeriodicOperation | None, choice: WireChoice | None, temperature: float
) -> CopperLoss:
    """With skin and proximity effect where there is a wire and an alternating current."""
    if operation is None or choice is None:
        return copper_loss(actuator, rms, temperature=temperature)
    return copper_loss_of_period(
        actuator, operation.current, frequency=operation.frequency, winding=choice.winding, temperature=temperature
    )


def _iron(
    actuator: Actuator, table: Path | None, operation: PeriodicOperation, thickness: float | None
) -> IronLoss | None:
    """The iron loss; a rig without dimensions has its own complaint."""
    actuator.magnet_kind("the iron loss")
    magnet_table = table_for(actuator, table)
    assert magnet_table is not None  # a magnet by its dimensions has one
    return iron_loss(magnet_table, actuator, operation=operation, thickness=thickness)


WireOptions = tuple[Series, Grade, Packing]


def chosen_wire(actuator: Actuator, options: WireOptions, notes: list[str]) -> WireChoice | None:
    """The thickest wire that fits, or None with a note: no dimensions, or no wire that fits."""
    if not isinstance(actuator.magnet, MagnetKind) or actuator.magnet.own_mesh() is not None:
        notes.append(f"{actuator.name}: no wire is chosen; that needs the window of a magnet by its dimensions")
        return None
    series, grade, packing = options
    try:
        choice = choose_wire(actuator, series=series, grade=grade, packing=packing)
    except InputError as err:
        if "do not fit" not in str(err):
            raise
        notes.append(f"no wire is chosen: {err}")
        return None
    stated, wound = actuator.coil_resistance(), choice.winding.resistance()
    if abs(stated / wound - 1) > 0.1:
        notes.append(
            f"the losses take the actuator's {stated:.4g} ohm at 20 degC; the thickest wire that fits would have "
            f"{wound:.4g} ohm"
        )
    if choice.fill_factor_ratio < 1:
        notes.append(
            f"the stated fill factor {choice.stated_fill_factor:g} is more than a layer winding of {series} wire of "
            f"grade {grade} reaches, {choice.winding.fill_factor:.3g}"
        )
    return choice


def wire_to_json(choice: WireChoice | None, actuator: Actuator, temperature: float) -> dict[str, Any] | None:
    """The wire, its layers, fill factor and resistance by two routes, and from where alternating current matters."""
    if choice is None:
        return None
    w = choice.winding
    rows = slot_rows(w, actuator.magnet_kind())
    drive = actuator.drive
    bandwidth = None if drive is None else drive.bandwidth
    at_bandwidth = None if bandwidth is None else float(resistance_factor(rows, bandwidth, temperature=temperature))
    return {
        "name": w.wire.name,
        "diameter_m": w.wire.diameter,
        "outer_diameter_m": w.wire.outer_diameter,
        "grade": w.wire.grade,
        "packing": w.packing,
        "turns_per_layer": list(w.layers),
        "turns_that_fit": w.capacity,
        "fill_factor": w.fill_factor,
        "stated_fill_factor": choice.stated_fill_factor,
        "length_m": w.length,
        "resistance_ohm": w.resistance(temperature),
        "resistance_by_fill_factor_ohm": w.resistance_by_fill_factor(temperature),
        "alternating_negligible_below_Hz": negligible_below(rows, temperature=temperature),
        "drive_bandwidth_Hz": bandwidth,
        "resistance_factor_at_bandwidth": at_bandwidth,
    }


def copper_to_json(copper: CopperLoss) -> dict[str, Any]:
    """Resistance and copper loss at the winding's temperature."""
    return {
        "temperature_K": copper.temperature,
        "resistance_ohm": copper.resistance,
        "copper_loss_W": copper.loss,
        "alternating_share": copper.alternating_share,
    }


def iron_to_json(iron: IronLoss | None) -> dict[str, Any]:
    """The iron loss of all sections and of the core, and each section's terms; none with direct current."""
    if iron is None:
        return {"iron_loss_W": 0.0, "core_iron_loss_W": 0.0, "sections": []}
    sections = []
    for s in iron.sections:
        terms = (s.density.hysteresis, s.density.eddy, s.density.excess)
        hysteresis, eddy, excess = (None if term is None else term * s.volume for term in terms)
        sections.append({
            "name": s.section,
            "iron": s.sheet.iron,
            "sheet_m": s.sheet.thickness,
            "volume_m3": s.volume,
            "flux_density_min_T": s.flux_density_min,
            "flux_density_max_T": s.flux_density_max,
            "hysteresis_W": hysteresis,
            "eddy_W": eddy,
            "excess_W": excess,
            "loss_W": s.loss,
        })  # fmt: skip
    return {"iron_loss_W": iron.loss, "core_iron_loss_W": iron.core_loss, "sections": sections}


def thermal_limit_to_json(
    actuator: Actuator, limit: ThermalLimit, current_rms: float, *, iron: IronLoss | None, notes: list[str]
) -> dict[str, Any] | None:
    """The currents that the winding bears, and how warm it gets with this one for ever; null where not known."""
    core_loss = 0.0 if iron is None or iron.core_loss is None else iron.core_loss
    if iron is not None and iron.core_loss is None:
        notes.append("the temperatures leave the iron loss out: that of the core is not known")
    try:
        found = continuous_current(actuator, limit, core_loss=core_loss)
    except InputError as err:
        notes.append(f"no thermal limit: {err}")
        return None
    try:
        rise = _steady_rise(found, Heating(actuator.coil_resistance(), limit.ambient, core_loss), current_rms)
    except (ThermalRunaway, InputError) as err:
        rise = None
        notes.append(str(err))
    warm = None if rise is None else limit.ambient + rise
    return found.to_json() | {"steady_rise_K": rise, "steady_temperature_K": warm}


def _steady_rise(found: ContinuousCurrent, heating: Heating, current_rms: float) -> float:
    """K of the winding; InputError where copper is not known to be straight any more."""
    rise = float(steady_rise(found.network, heating, current_rms)[0])
    resistance_ratio(heating.ambient + rise)
    return rise


class ThermalTexts(NamedTuple):
    """The options as they were written."""

    rise: str = DEFAULT_RISE
    ambient: str = DEFAULT_AMBIENT
    duty: float = 1.0
    period: str | None = None
    resistance: str | None = None
    frequency: str | None = None


def read_temperature(name: str, text: str) -> float:
    """K; the error names the option."""
    try:
        return parse_temperature(text)
    except QuantityError as err:
        raise QuantityError(f"{name}: {err}") from err


def thermal_limit(texts: ThermalTexts) -> ThermalLimit:
    """The limit that the options state; InputError where one of them is not allowed."""
    resistance = None if texts.resistance is None else read_option("--thermal-resistance", texts.resistance, "K/W")
    return ThermalLimit(
        temperature_rise=read_option("--temperature-rise", texts.rise, "K"),
        ambient=read_temperature("--ambient", texts.ambient),
        cycle=Cycle(texts.duty, None if texts.period is None else read_option("--period", texts.period, "s")),
        cooling=Cooling(thermal_resistance=resistance),
    )
