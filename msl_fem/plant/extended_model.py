"""The extended model's file: an actuator with the effects found on it, `extended_model.toml`.

It is an actuator file with a table more for every effect,

    [effects.eddy_currents]
    time_constant = "0.12 ms"

whose keys are the catalogue's parameters, as quantities with units; a parameter that is left out is neutral, or has its
usual shape. A cause that the user stated is an entry of [[effects.expression]] with its law, and its parameters with
value and range. An actuator file without effects is an extended model with none.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msl_fem.actuator import Actuator, actuator_file, parse_actuator
from msl_fem.computing.laws import expressions_of_table
from msl_fem.errors import ActuatorError, InputError, QuantityError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import document, read_toml
from msl_fem.files.toml_text import quantity_text, toml_text
from msl_fem.files.whole_file import whole_file
from msl_fem.plant.effects import EffectValues, Parameter, declare, find_effect, find_parameter
from msl_fem.plant.effects.expressions import DECLARED


@dataclass(frozen=True)
class ExtendedModel:
    """An actuator and the effects that it has beside the plain model."""

    actuator: Actuator
    effects: EffectValues = field(default_factory=EffectValues)


def load_extended_model(path: str | Path) -> ExtendedModel:
    """The extended model, or plain actuator, that a TOML file describes, or an example of the package by its name.

    Raises
    ------
    ActuatorError : as `load_actuator`; an unknown effect or parameter, a wrong unit, a value outside its bounds; the
        message names the file and the key path
    """
    file = actuator_file(path)
    content = read_toml(file, error=ActuatorError, wanted="an actuator file or an extended model")
    effects = content.pop("effects", {})
    known = effects if isinstance(effects, dict) else {}
    try:
        causes = expressions_of_table(known, where=str(path))
        declare(*causes)
        own = {one.effect: one.needed_values for one in causes}
    except InputError as err:
        raise ActuatorError(str(err)) from err
    named = {name: content for name, content in known.items() if name != "expression"}
    listed = _effects(named if isinstance(effects, dict) else effects, where=str(path))
    return ExtendedModel(parse_actuator(content, file=file), EffectValues({**listed.stated, **own}))


def write_extended_model(model: ExtendedModel, path: str | Path) -> Path:
    """The file written, whole or not at all; names of files in it are made relative to its folder.

    Raises
    ------
    InputError : the file cannot be written
    """
    target = Path(path)
    content = document(model.actuator)
    for section, key in _file_names(content):
        name = model.actuator.folder / section[key]
        section[key] = Path(os.path.relpath(name.resolve(), target.parent.resolve())).as_posix()
    effects, own = _written_effects(model.effects)
    if effects or own:
        content["effects"] = effects | ({"expression": own} if own else {})
    with whole_file(target) as partial:
        partial.write_text(toml_text(content), encoding="utf-8")
    return target


def _written_effects(values: EffectValues) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """(a table for each effect of the catalogue, an entry for each cause that the user stated)."""
    own = {one.effect: one for one in DECLARED.values()}
    listed = {
        effect: _written(effect, stated) for effect, stated in values.stated.items() if stated and effect not in own
    }
    stated = [own[effect].with_values(known).to_toml() for effect, known in values.stated.items() if effect in own]
    return listed, stated


def _effects(content: object, *, where: str) -> EffectValues:
    if not isinstance(content, dict):
        raise ActuatorError(f"{where}: effects is no table; write [effects.<name>] for each effect")
    stated: dict[str, dict[str, float]] = {}
    for effect, parameters in content.items():
        path = f"{where}: effects.{effect}"
        try:
            find_effect(effect)
        except InputError as err:
            raise ActuatorError(f"{where}: effects: {err}") from err
        if not isinstance(parameters, dict):
            raise ActuatorError(f"{path} is no table; write [effects.{effect}] and its parameters below")
        stated[effect] = {name: _number(effect, name, value, path) for name, value in parameters.items()}
    try:
        return EffectValues(stated)
    except InputError as err:
        raise ActuatorError(f"{where}: effects.{err}") from err


def _number(effect: str, name: str, value: object, path: str) -> float:
    """The SI value of a parameter's text, or of a bare number where it has no unit."""
    try:
        parameter = find_parameter(effect, name)
    except InputError as err:
        raise ActuatorError(f"{path}: {err}") from err
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ActuatorError(f"{path}.{name}: {value!r} is no quantity; write {_example(parameter)}")
    if not isinstance(value, str):
        if parameter.unit:
            raise ActuatorError(f"{path}.{name}: {value} has no unit; write {_example(parameter)}")
        return float(value)
    try:
        return parse_quantity(value, parameter.unit)
    except QuantityError as err:
        raise ActuatorError(f"{path}.{name}: {err}") from err


def _example(parameter: Parameter) -> str:
    text = quantity_text(parameter.scale, parameter.unit)
    return f'a text like "{text}"' if parameter.unit else f"a number like {text}"


def _written(effect: str, stated: Mapping[str, float]) -> dict[str, Any]:
    return {name: _text(find_parameter(effect, name), value) for name, value in stated.items()}


def _text(parameter: Parameter, value: float) -> str | float:
    """A text with a prefix where it reads back within the bounds: at a bound, rounding may carry it across."""
    if not parameter.unit:
        return value
    text = quantity_text(value, parameter.unit)
    low, high = parameter.allowed
    return text if low <= parse_quantity(text, parameter.unit) <= high else f"{value!r} {parameter.unit}"


def _file_names(content: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """The places in an actuator's document that name a file beside it."""
    magnet = content.get("magnet", {})
    places = [(magnet, key) for key in ("table", "mesh") if key in magnet]
    iron = magnet.get("iron", {})
    return places + [(iron, key) for key in ("core", "armature") if str(iron.get(key, "")).endswith(".csv")]
