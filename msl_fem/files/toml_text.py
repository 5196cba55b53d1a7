"""Values to TOML text that a person can read and that reads back to the same numbers."""

import json
import re
from collections.abc import Mapping
from typing import Any

from msl_fem.errors import QuantityError
from msl_fem.files.quantity import format_quantity, parse_quantity

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def quantity_text(value: float, unit: str) -> str:
    """A text that parses back to `value`: with a prefix where that is short ("50 nm", to 5e-16 of it), else exactly."""
    for digits in (4, 7, 10):
        text = format_quantity(value, unit, digits=digits)
        try:
            if abs(parse_quantity(text, unit) - value) <= 5e-16 * abs(value):
                return text
        except QuantityError:  # no prefix fits this unit: "kkg"
            break
    return f"{float(value)!r} {unit}".rstrip()


def toml_text(content: Mapping[str, Any]) -> str:
    """A parsed TOML document as text: keys in order, then tables, then arrays of tables.

    Raises
    ------
    TypeError : a value that TOML has no word for
    """
    return "\n".join(_lines(content, ())) + "\n"


def _lines(content: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines, tables = [], []
    for key, value in content.items():
        here = (*path, key)
        if isinstance(value, Mapping):
            tables += ["", f"[{_dotted(here)}]", *_lines(value, here)]
        elif isinstance(value, list | tuple) and value and all(isinstance(v, Mapping) for v in value):
            for element in value:
                tables += ["", f"[[{_dotted(here)}]]", *_lines(element, here)]
        else:
            lines.append(f"{_dotted((key,))} = {_value(value)}")
    return lines + tables


def _dotted(path: tuple[str, ...]) -> str:
    return ".".join(key if _BARE_KEY.fullmatch(key) else _value(key) for key in path)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007F")
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, int):
        return str(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(v) for v in value)}]"
    raise TypeError(f"{type(value).__name__} has no TOML form")
