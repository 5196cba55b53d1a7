"""Operating maps as JSON files."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value
from msl_fem.files.schema import small_text
from msl_fem.files.whole_file import whole_file
from msl_fem.maps.level_currents import OperatingMap, parse_criterion

SCHEMA = 1
_OPTIONAL = {
    "mesh_error_A": "mesh_error",
    "bh_interpolation_error_A": "bh_error",
    "current_gap_slope_A_per_m": "gap_slope",
}


def map_to_json(operating_map: OperatingMap) -> dict[str, Any]:
    """The JSON object of a map: `levels_T`, `gap_m`, `current_A` (a list a level, null where not reached) and more."""
    m = operating_map
    criterion = parse_criterion(m.criterion)
    content = {
        "schema": SCHEMA,
        "levels_T": m.levels.tolist(),
        "gap_m": m.gap.tolist(),
        "current_A": json_value(m.current),
        "criterion": m.criterion,
        "criterion_meaning": criterion.meaning,
        "corner_radius_m": None if math.isnan(criterion.radius) else criterion.radius,
        "section": [list(row) for row in m.section],
        "current_error_A": json_value(m.error),
        **{name: json_value(getattr(m, field)) for name, field in _OPTIONAL.items()},
        "guard_allowance_A": json_value(m.allowance),
        "current_max_A": m.current_max,
        "rests_on_tail": [list(row) for row in m.on_tail],
        "not_reached": list(m.not_reached()),
        "warnings": list(m.warnings),
        "actuator": m.actuator,
        "digest": m.digest,
        "provenance": None if m.provenance is None else dict(m.provenance),
    }
    return content | ({} if m.decoupling is None else {"decoupling": dict(m.decoupling)})


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
        content = json.loads(small_text(path))
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
    if content.get("sides") == "both":
        raise InputError("this map is of both sides; give --current, --current-2 and --position")
    if content.get("schema") != SCHEMA:
        raise InputError(
            f"schema is {content.get('schema')!r}, expected {SCHEMA}; make the map anew with 'msl-fem map'"
        )
    warnings = content.get("warnings", [])
    return OperatingMap(
        levels=_numbers(content, "levels_T", 1),
        gap=_numbers(content, "gap_m", 1),
        current=_numbers(content, "current_A", 2),
        section=_names(_required(content, "section"), "section"),
        error=_numbers(content, "current_error_A", 2),
        allowance=_numbers(content, "guard_allowance_A", 2),
        current_max=float(_numbers(content, "current_max_A", 0)),
        criterion=_text(_required(content, "criterion"), "criterion"),
        actuator=_text(content.get("actuator", ""), "actuator"),
        digest=_text(content.get("digest", ""), "digest"),
        warnings=tuple(map(str, warnings if isinstance(warnings, list) else [warnings])),
        on_tail=_names(content.get("rests_on_tail", []), "rests_on_tail"),
        provenance=_object(content, "provenance"),
        decoupling=_object(content, "decoupling"),
        **{
            field: None if content.get(name) is None else _numbers(content, name, 2)
            for name, field in _OPTIONAL.items()
        },
    )


_SHAPES = {0: "hold one number", 1: "hold numbers in one list", 2: "hold numbers in 2 levels of lists"}


def _names(value: object, key: str) -> tuple[tuple[str, ...], ...]:
    if not (isinstance(value, list) and all(isinstance(row, list) for row in value)):
        raise InputError(f"{key} must hold one list of names a level")
    return tuple(tuple(map(str, row)) for row in value)


def _object(content: dict[str, Any], key: str) -> dict[str, object] | None:
    value = content.get(key)
    if value is not None and not isinstance(value, dict):
        raise InputError(f"{key} must be a JSON object or left out")
    return value


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
