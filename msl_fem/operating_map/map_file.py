"""Operating maps as JSON files."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.operating_map.level_currents import OperatingMap
from msl_fem.whole_file import whole_file

Array = NDArray[np.float64]
SCHEMA = 1


def map_to_json(operating_map: OperatingMap) -> dict[str, Any]:
    """The JSON object of a map: `levels_T`, `gap_m`, `current_A` (a list a level, null where not reached) and more."""
    m = operating_map
    return {
        "schema": SCHEMA,
        "levels_T": m.levels.tolist(),
        "gap_m": m.gap.tolist(),
        "current_A": [[None if math.isnan(i) else i for i in row] for row in m.current.tolist()],
        "criterion": m.criterion,
        "section": [list(row) for row in m.section],
        "current_error_A": m.error.tolist(),
        "guard_allowance_A": m.allowance.tolist(),
        "current_max_A": m.current_max,
        "not_reached": list(m.not_reached()),
        "warnings": list(m.warnings),
        "actuator": m.actuator,
        "digest": m.digest,
    }


def write_map(operating_map: OperatingMap, path: str | Path) -> Path:
    """The JSON file written; it appears whole or not at all. Raises InputError where the folder cannot be written."""
    target = Path(path)
    with whole_file(target) as partial:
        partial.write_text(json.dumps(map_to_json(operating_map), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return target


def read_map(path: str | Path) -> OperatingMap:
    """The map in a JSON file.

    Raises
    ------
    InputError : no such file, not JSON, a field is missing or contradicts the others; the message names the file
    """
    try:
        content = json.loads(Path(path).read_bytes().decode("utf-8"))
    except OSError as err:
        raise InputError(f"{path}: cannot be read ({err.strerror}); make a map with 'msl-fem map'") from err
    except (ValueError, RecursionError) as err:
        raise InputError(f"{path}: not valid JSON ({err}); make a map with 'msl-fem map'") from err
    try:
        return map_from_json(content)
    except InputError as err:
        raise InputError(f"{path}: {err}") from err


def map_from_json(content: object) -> OperatingMap:
    """The map that a parsed JSON object describes. Raises InputError as `read_map`."""
    if not isinstance(content, dict):
        raise InputError("not an operating map: expected a JSON object with levels_T, gap_m, current_A, criterion")
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"schema is {content.get('schema')!r}, expected {SCHEMA}; make the map anew with 'msl-fem map'"
        )
    section = _required(content, "section")
    if not (isinstance(section, list) and all(isinstance(row, list) for row in section)):
        raise InputError("section must hold one list of names a level")
    warnings = content.get("warnings", [])
    return OperatingMap(
        levels=_numbers(content, "levels_T", 1),
        gap=_numbers(content, "gap_m", 1),
        current=_numbers(content, "current_A", 2),
        section=tuple(tuple(map(str, row)) for row in section),
        error=_numbers(content, "current_error_A", 2),
        allowance=_numbers(content, "guard_allowance_A", 2),
        current_max=float(_numbers(content, "current_max_A", 0)),
        criterion=_text(_required(content, "criterion"), "criterion"),
        actuator=_text(content.get("actuator", ""), "actuator"),
        digest=_text(content.get("digest", ""), "digest"),
        warnings=tuple(map(str, warnings if isinstance(warnings, list) else [warnings])),
    )


_SHAPES = {0: "hold one number", 1: "hold numbers in one list", 2: "hold numbers in 2 levels of lists"}


def _text(value: object, key: str) -> str:
    if not isinstance(value, str):
        raise InputError(f"{key} must be a text, not {value!r}")
    return value


def _required(content: dict[str, Any], key: str) -> Any:
    if key not in content:
        raise InputError(f"{key} is missing; make the map anew with 'msl-fem map'")
    return content[key]


def _numbers(content: dict[str, Any], key: str, dimensions: int) -> Array:
    """The field as an array; null becomes nan (which only `current_A` may hold, and the record checks the rest)."""
    value = _required(content, key)
    try:
        array = np.array(_without_null(value), dtype=float)
    except (TypeError, ValueError, OverflowError, RecursionError) as err:
        raise InputError(f"{key} must {_SHAPES[dimensions]}; make the map anew with 'msl-fem map'") from err
    if array.ndim != dimensions:
        raise InputError(f"{key} must {_SHAPES[dimensions]}; make the map anew with 'msl-fem map'")
    return array


def _without_null(value: object) -> object:
    if isinstance(value, list):
        return [_without_null(element) for element in value]
    if isinstance(value, bool | str):
        raise TypeError
    return math.nan if value is None else value
