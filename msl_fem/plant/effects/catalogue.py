"""The catalogue of effects, in the order of the file formats, and the order of all its parameters in one vector."""

from msl_fem.errors import InputError
from msl_fem.plant.effects.electrical import ELECTRICAL
from msl_fem.plant.effects.entry import Effect, Parameter
from msl_fem.plant.effects.magnetic import MAGNETIC
from msl_fem.plant.effects.mechanical import MECHANICAL
from msl_fem.plant.effects.sensing import SENSING

CATALOGUE: dict[str, Effect] = {effect.name: effect for effect in MAGNETIC + ELECTRICAL + MECHANICAL + SENSING}

POSITION: dict[tuple[str, str], int] = {
    key: n for n, key in enumerate((e.name, p.name) for e in CATALOGUE.values() for p in e.parameters)
}
"""Where the parameter (effect, name) stands in a vector of all parameters."""
N_PARAMETER = len(POSITION)


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
