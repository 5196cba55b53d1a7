"""Options of the thermal limit that commands share, and the limit as fields of the map's JSON."""

from pathlib import Path
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from msl_fem.actuator import load_actuator
from msl_fem.cli.options import DEFAULT_AMBIENT, DEFAULT_RISE, read_option
from msl_fem.errors import InputError, QuantityError
from msl_fem.files.quantity import parse_temperature
from msl_fem.losses import Cooling, Cycle, ThermalLimit, thermal_curve, thermal_curve_with_iron
from msl_fem.table.magnetic_table import MagneticTable


class ThermalTexts(NamedTuple):
    """The options as they were written."""

    rise: str = DEFAULT_RISE
    ambient: str = DEFAULT_AMBIENT
    duty: float = 1.0
    period: str | None = None
    resistance: str | None = None
    frequency: str | None = None


class ThermalRequest(NamedTuple):
    """The limit, and the frequency in Hz of a sine whose iron loss counts; None where the copper's alone does."""

    limit: ThermalLimit
    frequency: float | None


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


def thermal_request(texts: ThermalTexts) -> ThermalRequest:
    """What the options ask for; raises as `thermal_limit`."""
    frequency = None if texts.frequency is None else read_option("--frequency", texts.frequency, "Hz")
    if frequency is not None and frequency <= 0:
        raise InputError(f"--frequency {texts.frequency} is not allowed; it must be above 0 Hz")
    return ThermalRequest(thermal_limit(texts), frequency)


def thermal_fields(
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
    rows = {"bears in A": fields.get("continuous_current_A")}
    if fields.get("thermal", {}).get("duty", 1.0) < 1:
        rows["at duty in A"] = fields.get("duty_current_A")
    return {
        name: ["not known" if i is None else f"{i:.3f}" for i in row] for name, row in rows.items() if row is not None
    }


def thermal_notes(fields: dict[str, Any]) -> list[str]:
    """What the limit rests on, or why there is none, as notes for people."""
    thermal = fields.get("thermal", {})
    return thermal.get("notes", []) + ([f"no thermal limit: {thermal['reason']}"] if "reason" in thermal else [])
