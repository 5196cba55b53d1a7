"""Numbers of records as JSON values."""

import math
from collections.abc import Mapping
from typing import Any


def json_value(value: Any) -> Any:
    """Lists, dicts, numbers and texts: arrays become lists, records what their `to_json` says, nan and inf None."""
    if isinstance(value, Mapping):
        return {str(key): json_value(element) for key, element in value.items()}
    if isinstance(value, list | tuple):
        return [json_value(element) for element in value]
    if isinstance(value, float):  # numpy's doubles too
        return float(value) if math.isfinite(value) else None
    if isinstance(value, bool | int | str | None):
        return value
    if hasattr(value, "to_json"):
        return json_value(value.to_json())
    return json_value(value.tolist()) if hasattr(value, "tolist") else str(value)
