"""The catalogue of effects that a real actuator may have beside the plain model: names, parameters, sources.

The equations live in `coupled_model`; here is what a file, a search or a report must know of an effect.
"""

from msl_fem.plant.effects.catalogue import CATALOGUE, N_PARAMETER, POSITION, find_effect, find_parameter
from msl_fem.plant.effects.entry import Effect, Parameter
from msl_fem.plant.effects.values import EffectValues, from_vector, neutral_vector

__all__ = [
    "CATALOGUE",
    "N_PARAMETER",
    "POSITION",
    "Effect",
    "EffectValues",
    "Parameter",
    "find_effect",
    "find_parameter",
    "from_vector",
    "neutral_vector",
]
