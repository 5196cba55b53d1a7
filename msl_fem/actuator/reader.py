"""Actuator files (TOML) to records; what is wrong is said in one line with the file and the key path."""

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from msl_fem.actuator.actuator import Actuator
from msl_fem.errors import ActuatorError
from msl_fem.files.schema import bare_number, first_complaint, has_unknown_key, read_toml

PURE_NUMBERS = frozenset({
    "schema", "turns", "fill_factor", "stacking_factor", "core_stacking_factor", "armature_stacking_factor",
    "count", "magnets_per_side", "delay_samples", "sets", "bh_polarisation", "bh_field_strength",
    "end_stop_restitution",
})  # fmt: skip
"""Keys of an actuator's sections whose numbers have no unit."""


def load_actuator(path: str | Path) -> Actuator:
    """The actuator that a TOML file describes.

    Raises
    ------
    ActuatorError : no such file, not TOML, an unknown or a missing key, a wrong unit, a value out of its range;
        the message names the file and the key path
    """
    content = read_toml(path, error=ActuatorError, wanted="an actuator file")
    return parse_actuator(content, file=Path(path))


def parse_actuator(content: dict[str, Any], *, file: Path | None = None) -> Actuator:
    """The actuator that a parsed TOML document describes; raises as `load_actuator`."""
    if "file" in content:
        raise ActuatorError(f"{file or 'actuator'}: file: unknown key; remove it")
    complaint = bare_number(content, PURE_NUMBERS)
    try:
        actuator = Actuator.model_validate({**content, "file": file})
    except ValidationError as err:
        if complaint is None or has_unknown_key(err):  # the number of a misspelt key needs a name first, then a unit
            complaint = first_complaint(err, unions=("magnet",))
        raise ActuatorError(f"{file or 'actuator'}: {complaint}") from err
    if complaint:
        raise ActuatorError(f"{file or 'actuator'}: {complaint}")
    return actuator
