"""Wire, losses and temperatures of a magnet as JSON fields; what is not known is null, and a note says why."""

from typing import Any

from msl_fem.actuator import Actuator, ECore
from msl_fem.errors import InputError
from msl_fem.losses import (
    ContinuousCurrent,
    Grade,
    Heating,
    IronLoss,
    Packing,
    Series,
    ThermalLimit,
    ThermalRunaway,
    WireChoice,
    choose_wire,
    continuous_current,
    negligible_below,
    resistance_factor,
    slot_rows,
    steady_rise,
)
from msl_fem.losses.copper_loss import CopperLoss
from msl_fem.materials.constants import resistance_ratio

WireOptions = tuple[Series, Grade, Packing]


def chosen_wire(actuator: Actuator, options: WireOptions, notes: list[str]) -> WireChoice | None:
    """The thickest wire that fits, or None with a note: no E-core, or no wire that fits."""
    if not isinstance(actuator.magnet, ECore):
        notes.append(f"{actuator.name}: no wire is chosen; that needs the window of an E-core")
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


def wire_fields(choice: WireChoice | None, actuator: Actuator, temperature: float) -> dict[str, Any] | None:
    """The wire, its layers, fill factor and resistance by two routes, and from where alternating current matters."""
    if choice is None:
        return None
    w = choice.winding
    rows = slot_rows(w, actuator.e_core())
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


def copper_fields(copper: CopperLoss) -> dict[str, Any]:
    """Resistance and copper loss at the winding's temperature."""
    return {
        "temperature_K": copper.temperature,
        "resistance_ohm": copper.resistance,
        "copper_loss_W": copper.loss,
        "alternating_share": copper.alternating_share,
    }


def iron_fields(iron: IronLoss | None) -> dict[str, Any]:
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


def thermal_fields_of(
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
