"""Maps of a pair as JSON files."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.schema import small_text
from msl_fem.files.whole_file import whole_file
from msl_fem.maps.pair_limits import RELATIONS, PairMap

SCHEMA = 1
SIDES = "both"


def pair_map_to_json(record: PairMap) -> dict[str, Any]:
    """The JSON object of a pair's map: `sides` "both", `current_A` by relation, level, position and other current."""
    return {
        "schema": SCHEMA,
        "sides": SIDES,
        "relations": list(RELATIONS),
        "levels_T": record.levels.tolist(),
        "position_m": record.position.tolist(),
        "other_current_A": record.other.tolist(),
        "current_A": record.current.tolist(),
        "guard_allowance_A": record.allowance.tolist(),
        "equal_current_A": record.equal_currents().tolist(),
        "polarity": record.polarity,
        "actuator": record.actuator,
        "digest": record.digest,
        "provenance": None if record.provenance is None else dict(record.provenance),
    }


def write_pair_map(record: PairMap, path: str | Path) -> Path:
    """The JSON file written; it appears whole or not at all."""
    target = Path(path)
    with whole_file(target) as partial:
        partial.write_text(json.dumps(pair_map_to_json(record), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return target


def is_pair_map(path: str | Path) -> bool:
    """Whether a JSON file says that it is of both sides; False where it is none."""
    try:
        content = json.loads(small_text(path))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and content.get("sides") == SIDES


def read_pair_map(path: str | Path) -> PairMap:
    """The map of a pair in a JSON file; raises InputError that names the file and what is wrong."""
    try:
        content = json.loads(small_text(path))
        if not isinstance(content, dict) or content.get("sides") != SIDES:
            raise InputError("it is not of both sides; make one with 'msl-fem map PAIR_TABLE -o FILE'")
        if content.get("schema") != SCHEMA:
            raise InputError(f"schema {content.get('schema')} is not {SCHEMA}, the one this version reads")
        provenance = content.get("provenance")
        return PairMap(
            levels=_array(content, "levels_T"),
            position=_array(content, "position_m"),
            other=_array(content, "other_current_A"),
            current=_array(content, "current_A"),
            allowance=_array(content, "guard_allowance_A"),
            polarity=str(content.get("polarity", "")),
            actuator=str(content.get("actuator", "")),
            digest=str(content.get("digest", "")),
            provenance=provenance if isinstance(provenance, dict) else None,
        )
    except OSError as err:
        raise InputError(f"{path}: cannot be read ({err.strerror}); make a map with 'msl-fem map'") from err
    except InputError as err:
        raise InputError(f"{path}: {err}") from err
    except (ValueError, TypeError, OverflowError, RecursionError) as err:
        raise InputError(f"{path}: not the map of a pair ({str(err)[:200]})") from err


def _array(content: dict[str, Any], key: str) -> Array:
    if key not in content:
        raise InputError(f"'{key}' is missing")
    return np.asarray(content[key], dtype=float)
