"""Texts with units ("0.6 mm") to SI numbers and back, at the places where people read or write."""

import math
import re
from functools import lru_cache
from typing import Any

from msl_fem.errors import QuantityError

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?"
_QUANTITY = re.compile(rf"\s*({_NUMBER})\s*([A-Za-zµμΩ%][A-Za-zµμΩ0-9 */^.·()-]{{0,40}})?\s*")
_BEARS_PREFIX = re.compile(r"(?!kg\b|deg)[A-Za-zΩ]+(?![\w^]|\*\*)")  # its first factor does: no power, no prefix yet
_POWER = re.compile(r"(\^|\*\*)\s*(?!-?\d{1,2}(?![\d.]|\s*(\^|\*\*)))")  # not of one or two digits alone
_EXAMPLES = {"": "0.96", "m": "0.6 mm", "A": "5 A", "T": "1.2 T", "Hz": "2.5 kHz", "s": "4 s"}


_PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9}
_BEARERS = (
    "A", "m", "T", "N", "Hz", "s", "V", "W", "Wb", "H", "K", "J", "ohm", "Ω", "m/s", "N/m", "N s/m", "N/s", "K/W",
)  # fmt: skip
PLAIN = {f"{prefix}{unit}": (factor, unit.replace("Ω", "ohm")) for unit in _BEARERS
         for prefix, factor in _PREFIXES.items()} | {
    "%": (0.01, ""), "g": (1e-3, "kg"), "kg": (1.0, "kg"), "kg m^2": (1.0, "kg m^2"), "kg/m^3": (1.0, "kg/m^3"),
    "N/mm": (1e3, "N/m"), "A/m^2": (1.0, "A/m^2"), "A/mm^2": (1e6, "A/m^2"), "W/(m^2 K)": (1.0, "W/(m^2 K)"),
}  # fmt: skip
"""Units with their factor and SI unit, read without pint, whose import costs more than all else of a look-up."""
_SCALES = {"K": 0.0, "degC": 273.15}  # K at their zero


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@lru_cache(maxsize=512)
def _factor(unit_text: str, unit: str) -> float:
    """The factor from the unit written to the unit wanted."""
    factor, plain_unit = PLAIN.get(unit_text, (math.nan, None))
    return factor if plain_unit == unit else _factor_by_pint(unit_text, unit)


def _factor_by_pint(unit_text: str, unit: str) -> float:
    import pint

    if _POWER.search(unit_text):
        raise QuantityError(f"'{unit_text}' has a power that no unit has; expected a unit like '{unit}'")
    registry = _registry()
    try:
        quantity = registry.Quantity(1.0, registry.parse_units(unit_text.replace("·", "*")))
        if not quantity._is_multiplicative:
            raise QuantityError(f"unit '{unit_text}' has an offset; use '{unit}'")
        _check_counted(registry, quantity, unit_text, unit)
        return float(quantity.to(unit or "dimensionless").magnitude)
    except QuantityError:
        raise
    except pint.DimensionalityError as err:
        expected = f"a unit like '{unit}'" if unit else "a number without a unit"
        raise QuantityError(f"unit '{unit_text}' has the wrong dimension; expected {expected}") from err
    except Exception as err:  # pint raises errors of many kinds on a text that is no unit
        raise QuantityError(f"'{unit_text}' is not a unit; expected one like '{unit}'") from err


def _check_counted(registry: Any, quantity: Any, unit_text: str, unit: str) -> None:
    """QuantityError for angles, turns and counts where none are meant: 1 rpm is 2 pi/60 rad/s, and 1/60 Hz."""
    expected = _counted(registry, registry.Quantity(1.0, unit or "dimensionless"))
    extra = _counted(registry, quantity) - expected
    if not extra:
        return
    way_out = 'give turns a second in "Hz"' if unit == "Hz" else f"use '{unit}'" if unit else "give a pure number"
    raise QuantityError(f"unit '{unit_text}' counts {' and '.join(sorted(extra))}; {way_out}")


def _counted(registry: Any, quantity: Any) -> set[str]:
    """What a unit counts without a dimension: "radian", "count", "bit", "pi"."""
    base = [str(name) for name, _ in quantity.to_base_units().unit_items()]
    counted = {name for name in base if registry.Quantity(1.0, name).dimensionless}
    return counted | {"pi" for name, _ in quantity.unit_items() if name == "pi"}


def parse_quantity(text: str, unit: str) -> float:
    """The SI value of a text such as "0.6 mm".

    Parameters
    ----------
    text : a number and a unit; a dimensionless quantity (`unit` "") may stand without one
    unit : the SI unit that fixes the dimension, such as "m" or "N s/m"

    Raises
    ------
    QuantityError : not a number, no unit, an unknown unit, one of the wrong dimension, or not finite
    """
    match = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
    example = _EXAMPLES.get(unit, f"1 {unit}")
    if match is None:
        raise QuantityError(f'{text!r} is not a quantity; write a number and a unit, like "{example}"')
    number, unit_text = match.groups()
    if unit_text is None and unit:
        raise QuantityError(f'{text!r} has no unit; write one, like "{example}"')
    value = float(number) * (_factor(unit_text.strip(), unit) if unit_text else 1.0)
    if not math.isfinite(value):
        raise QuantityError(f"{text!r} is not finite")
    return value


def parse_temperature(text: str) -> float:
    """The absolute temperature in K of a text such as "20 degC", "20 °C" or "293.15 K".

    Raises
    ------
    QuantityError : not a number, no unit, a unit that is no temperature, or below absolute zero
    """
    match = _QUANTITY.fullmatch(text.replace("°", "deg")) if isinstance(text, str) else None
    if match is None or match.group(2) is None:
        raise QuantityError(f'{text!r} is not a temperature; write a number and a unit, like "20 degC" or "293 K"')
    number, scale = float(match.group(1)), match.group(2).strip()
    value = number + _SCALES[scale] if scale in _SCALES else _temperature_by_pint(text, number, scale)
    if not 0 <= value < math.inf:
        raise QuantityError(f"{text!r} is below absolute zero or not finite; look at its unit")
    return value


def _temperature_by_pint(text: str, number: float, scale: str) -> float:
    if _POWER.search(scale):
        raise QuantityError(f"{text!r} is not a temperature; use degC or K")
    try:
        return float(_registry().Quantity(number, scale).to("K").magnitude)
    except Exception as err:  # pint raises errors of many kinds on a text that is no unit
        raise QuantityError(f"{text!r} is not a temperature; use degC or K") from err


def parse_quantities(text: str, unit: str) -> list[float]:
    """The SI values of a list such as "0.5, 1, 2 A"; an element without a unit takes that of the next one that has one.

    Raises
    ------
    QuantityError : as in `parse_quantity`, or an empty list
    """
    values: list[float] = []
    unit_text = ""
    for element in reversed(text.split(",")):
        match = _QUANTITY.fullmatch(element)
        if match and match.group(2):
            unit_text = match.group(2)
        elif match and unit_text:
            element = f"{element} {unit_text}"
        values.append(parse_quantity(element, unit))
    return values[::-1]


def format_quantity(value: float, unit: str, *, digits: int = 4) -> str:
    """A text for people: 0.0006 m -> "600 µm"; no prefix where a unit bears none: "0.01", "0.25 kg", "1e-05 m^2"."""
    if value == 0 or not math.isfinite(value):
        return f"{value:g} {unit}".rstrip()
    if not 1e-12 <= abs(value) < 1e12 or _BEARS_PREFIX.match(unit) is None:
        return f"{value:.{digits}g} {unit}".rstrip()
    exponent = min(max(math.floor(math.log10(abs(value) * (1 + 1e-12)) / 3) * 3, -9), 6)
    prefix = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}[exponent]
    return f"{value / 10.0**exponent:.{digits}g} {prefix}{unit}".rstrip()
