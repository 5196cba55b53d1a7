"""The catalogue of effects that a real actuator may have beside the plain model, and values of their parameters.

Each effect is told once, in the file of its group: names, parameters and source, the coefficients that it sets in the
kernel, what the other rooms take of it and why not the rest. What needs the order of the equations stands in
`plant.equations` and `plant.drive`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.laws import LawExpression
from msl_fem.errors import InputError
from msl_fem.plant.effects import expressions, thermal
from msl_fem.plant.effects.electrical import ELECTRICAL, check_delay
from msl_fem.plant.effects.entry import FINE, DesignChange, Effect, KernelSetting, MoverMotion, Parameter, Part, Values
from msl_fem.plant.effects.magnetic import MAGNETIC
from msl_fem.plant.effects.mechanical import MECHANICAL
from msl_fem.plant.effects.sensing import SENSING
from msl_fem.plant.effects.stray_flux import STRAY_FLUX
from msl_fem.plant.effects.thermal import THERMAL
from msl_fem.plant.plant import PlantParameters

__all__ = [
    "CATALOGUE",
    "FINE",
    "LAGGING",
    "N_COEFFICIENT",
    "PARAMETER_INDEX",
    "ByName",
    "DesignChange",
    "Effect",
    "EffectValues",
    "KernelSetting",
    "MoverMotion",
    "Parameter",
    "Part",
    "declare",
    "declared",
    "design_change",
    "find_effect",
    "find_parameter",
    "from_vector",
    "kernel_coefficients",
    "needed_force",
    "neutral_vector",
    "stated_causes",
]

_GROUPS = (MAGNETIC, STRAY_FLUX, ELECTRICAL, THERMAL, MECHANICAL, SENSING)
CATALOGUE: dict[str, Effect] = {effect.name: effect for group in _GROUPS for effect in group}

PARAMETER_INDEX: dict[tuple[str, str], int] = {
    key: n for n, key in enumerate((e.name, p.name) for e in CATALOGUE.values() for p in e.parameters)
}
"""Where the parameter (effect, name) stands in a vector of all parameters; those of declared causes are the last."""
LAGGING = tuple((e.name, p.name) for e in CATALOGUE.values() for p in e.parameters if p.lagging)
"""Parameters that need a drive whose current cannot jump, of effects that do without."""
RULES = (
    *dict.fromkeys(e.coefficients for e in CATALOGUE.values() if e.coefficients is not None),
    expressions.set_laws,
)
"""What sets the kernel's coefficients; effects of one mechanism share a rule."""
N_COEFFICIENT = thermal.LAYOUT.size
"""Rows of the kernel's coefficients that the groups of effects have named."""


def declare(*causes: LawExpression) -> None:
    """Adds causes that users state to the catalogue of this process; one that is there already is left.

    Raises
    ------
    InputError : a cause of that name has another law; all laws together have too many parameters
    """
    new = {one.name: one.bare for one in causes if expressions.DECLARED.get(one.name) != one.bare}
    for name in new:
        if name in expressions.DECLARED:
            raise InputError(
                f"'{name}' is declared already as {expressions.DECLARED[name].text}; give the other cause another name"
            )
    expressions.check_room(expressions.DECLARED | new)
    for one in new.values():
        expressions.DECLARED[one.name] = one
        effect = CATALOGUE[one.effect] = expressions.effect_of(one)
        for parameter in effect.parameters:
            PARAMETER_INDEX[one.effect, parameter.name] = len(PARAMETER_INDEX)


@contextmanager
def declared(*causes: LawExpression) -> Iterator[None]:
    """The causes are in the catalogue inside a `with`, and gone behind it if they were not there before."""
    kept = len(expressions.DECLARED)
    try:
        declare(*causes)
        yield
    finally:
        for name in list(expressions.DECLARED)[kept:]:
            effect = CATALOGUE.pop(expressions.DECLARED.pop(name).effect)
            for parameter in effect.parameters:
                del PARAMETER_INDEX[effect.name, parameter.name]


def find_effect(name: str) -> Effect:
    """The effect of that name.

    Raises
    ------
    InputError : there is none; names those there are
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        raise InputError(f"'{name}' is no effect of the catalogue; there are {', '.join(CATALOGUE)}") from None


def find_parameter(effect: str, name: str) -> Parameter:
    """The parameter of that effect.

    Raises
    ------
    InputError : there is no such effect, or no such parameter of it
    """
    entry = find_effect(effect)
    try:
        return entry.parameter(name)
    except KeyError:
        known = ", ".join(p.name for p in entry.parameters)
        raise InputError(f"'{name}' is no parameter of {effect}; there are {known}") from None


@dataclass(frozen=True)
class EffectValues:
    """Parameters of the effects that are there, by effect and name; what is not stated is neutral.

    Raises
    ------
    InputError : an unknown effect or parameter, a value that is not finite or outside its bounds
    """

    stated: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        kept: dict[str, Mapping[str, float]] = {}
        for effect, parameters in self.stated.items():
            find_effect(effect)
            for name, value in parameters.items():
                _check(effect, name, value)
            kept[effect] = MappingProxyType({name: float(value) for name, value in parameters.items()})
        object.__setattr__(self, "stated", MappingProxyType(kept))

    def get(self, effect: str, name: str) -> float:
        """The stated value, else the neutral one."""
        stated = self.stated.get(effect, {})
        return stated[name] if name in stated else CATALOGUE[effect].parameter(name).neutral

    def vector(self) -> Array:
        """All parameters of the catalogue, (n_parameter,), in the order of `PARAMETER_INDEX`."""
        return np.array([self.get(effect, name) for effect, name in PARAMETER_INDEX])

    @property
    def present(self) -> tuple[str, ...]:
        """The stated effects of which a parameter that is no shape differs from its neutral value."""
        return tuple(
            effect
            for effect in self.stated
            if any(not p.shape and self.get(effect, p.name) != p.neutral for p in CATALOGUE[effect].parameters)
        )


def neutral_vector() -> Array:
    """All parameters at their neutral values, (n_parameter,)."""
    return EffectValues().vector()


def from_vector(vector: Array) -> EffectValues:
    """The values of a vector of all parameters (n_parameter,); effects at their neutral values are left out.

    Raises
    ------
    InputError : it has another length; a value outside its bounds
    """
    if np.shape(vector) != (len(PARAMETER_INDEX),):
        raise InputError(
            f"a vector of effects has {len(PARAMETER_INDEX)} entries, this one the shape {np.shape(vector)}"
        )
    stated: dict[str, dict[str, float]] = {}
    for (effect, name), n in PARAMETER_INDEX.items():
        if float(vector[n]) != CATALOGUE[effect].parameter(name).neutral:
            stated.setdefault(effect, {})[name] = float(vector[n])
    return EffectValues(stated)


def _check(effect: str, name: str, value: float) -> None:
    parameter = find_parameter(effect, name)
    low, high = parameter.allowed
    if not (math.isfinite(value) and low <= value <= high):
        unit = f" {parameter.unit}" if parameter.unit else ""
        raise InputError(f"{effect}.{name}: {value:g}{unit} is not allowed; it must be {low:g} ... {high:g}{unit}")


def kernel_coefficients(
    plant: PlantParameters, effects: Array, *, inductance: float, step: float, n_step: int
) -> Array:
    """The coefficients (N_COEFFICIENT,) of a plant with effects, for n_step steps of `step` seconds a sample.

    Parameters
    ----------
    effects : (n_parameter,) of the catalogue
    inductance : of a side at the nominal gap without current, H; any number without magnets

    Raises
    ------
    InputError : a command that is delayed too much
    """
    coefficients, setting = np.zeros(N_COEFFICIENT), KernelSetting(plant, inductance, step, n_step)
    set_coefficients(coefficients, values_of(effects), setting)
    expressions.set_addresses(coefficients)
    check_delay(coefficients, setting)
    return coefficients


def set_coefficients(e: Array, values: Values, setting: KernelSetting) -> None:
    """Sets all rows of the kernel's coefficients; those that stay zero must be."""
    for rule in RULES:
        rule(e, values, setting)


class ByName(Mapping[tuple[str, str], Any]):
    """Parameters by effect and name of vectors (..., N_PARAMETER) of the catalogue: those alone that are asked for are
    looked at."""

    def __init__(self, vectors: Array) -> None:
        self._vectors = np.asarray(vectors)

    def __getitem__(self, key: tuple[str, str]) -> Any:
        return self._vectors[..., PARAMETER_INDEX[key]]

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(PARAMETER_INDEX)

    def __len__(self) -> int:
        return len(PARAMETER_INDEX)


def values_of(vector: Array) -> dict[tuple[str, str], float]:
    """Every parameter of the catalogue, by effect and name, of a vector (n_parameter,)."""
    return {key: float(vector[n]) for key, n in PARAMETER_INDEX.items()}


def design_change(effects: EffectValues, *, sides: int) -> DesignChange:
    """What the effects do to the plant that a design believes in."""
    change, values = DesignChange(sides), values_of(effects.vector())
    for believe in dict.fromkeys(effect.believe for effect in CATALOGUE.values()):
        if believe is not None:
            believe(change, values)
    return change


def needed_force(plant: PlantParameters, values: Mapping[tuple[str, str], float], motion: MoverMotion) -> Array:
    """The force along +x (N) that a motion takes because of all effects, (n_sample,)."""
    force = np.zeros(motion.time.size)
    for effect in CATALOGUE.values():
        if effect.needed_force is not None:
            force = force + effect.needed_force(values, plant, motion)
    return force


def stated_causes(causes: Sequence[LawExpression], beside: EffectValues | None = None) -> EffectValues:
    """The causes, declared, with their stated values, and the effects `beside`.

    Raises
    ------
    InputError : as `declare`; an amount has no value
    """
    declare(*causes)
    stated = {one.effect: one.needed_values for one in causes}
    return EffectValues({**(beside.stated if beside else {}), **stated})
