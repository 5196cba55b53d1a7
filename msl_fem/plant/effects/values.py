"""Values of effects: which are there, and how large."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.plant.effects.catalogue import CATALOGUE, N_PARAMETER, POSITION, find_effect, find_parameter

Array = NDArray[np.float64]


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
        """All parameters of the catalogue, (N_PARAMETER,), in the order of `POSITION`."""
        return np.array([self.get(effect, name) for effect, name in POSITION])

    @property
    def present(self) -> tuple[str, ...]:
        """The stated effects of which a parameter that is no shape differs from its neutral value."""
        return tuple(
            effect
            for effect in self.stated
            if any(not p.shape and self.get(effect, p.name) != p.neutral for p in CATALOGUE[effect].parameters)
        )


def neutral_vector() -> Array:
    """All parameters at their neutral values, (N_PARAMETER,)."""
    return EffectValues().vector()


def from_vector(vector: Array) -> EffectValues:
    """The values of a vector of all parameters (N_PARAMETER,); effects at their neutral values are left out.

    Raises
    ------
    InputError : it has another length; a value outside its bounds
    """
    if np.shape(vector) != (N_PARAMETER,):
        raise InputError(f"a vector of effects has {N_PARAMETER} entries, this one the shape {np.shape(vector)}")
    found: dict[str, dict[str, float]] = {}
    for (effect, name), n in POSITION.items():
        if float(vector[n]) != CATALOGUE[effect].parameter(name).neutral:
            found.setdefault(effect, {})[name] = float(vector[n])
    return EffectValues(found)


def _check(effect: str, name: str, value: float) -> None:
    parameter = find_parameter(effect, name)
    low, high = parameter.bounds
    if not (math.isfinite(value) and low <= value <= high):
        unit = f" {parameter.unit}" if parameter.unit else ""
        raise InputError(f"{effect}.{name}: {value:g}{unit} is not allowed; it must be {low:g} ... {high:g}{unit}")
