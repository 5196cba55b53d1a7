"""Plants that a diagnosis leaves possible: its fitted parameters and effects, each within its interval.

The file of a diagnosis states an interval for each parameter and none of their correlations, so parameters are drawn
apart: normal, 95 % of each inside its interval. A combination that the record bounds better than its parts (stiffness
over mass, by the resonance) is spread wider by that than the record allows.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.control.closed_loop import PlantUnderTest
from msl_fem.control.unseen_plants import with_more
from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues, find_parameter

_OF_MOTION = ("moving_mass", "stiffness", "damping", "nominal_gap")
_NORMAL_95 = 1.959964
_CUT = 3.0  # sigma


@dataclass(frozen=True)
class Posterior:
    """One sigma of what was fitted.

    Attributes
    ----------
    parameters : by believed parameter, of the fitted value over it
    effects : by effect and parameter, SI units
    """

    parameters: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]]

    def draw(self, plant: PlantUnderTest, generator: np.random.Generator) -> PlantUnderTest:
        """A plant about the fitted one; amounts stay within their bounds of the catalogue."""
        actuator = plant.actuator
        if actuator.motion is None or actuator.drive is None:
            raise InputError(f"{actuator.name} has no [motion] or no [drive]; plants of a posterior need both")
        factors = {name: 1 + sigma * _normal(generator) for name, sigma in sorted(self.parameters.items())}
        moved = {
            name: getattr(actuator.motion, name) * factors[name]
            for name in _OF_MOTION
            if name in factors and getattr(actuator.motion, name) is not None
        }
        resistance = actuator.coil_resistance() * factors.get("coil_resistance", 1.0)
        changed = {
            "motion": actuator.motion.model_copy(update=moved),
            "drive": actuator.drive.model_copy(update={"coil_resistance": resistance}),
        }
        shares = {
            "position_sensor_nonlinearity": {"gain_error": factors.get("position_gain", 1.0) - 1},
            "fringing": {"depth_error": factors.get("magnetic_scale", 1.0) - 1},
        }
        effects = with_more(self._effects(plant.effects, generator), shares)
        return PlantUnderTest(actuator.model_copy(update=changed), plant.table, effects)

    def _effects(self, fitted: EffectValues | None, generator: np.random.Generator) -> EffectValues:
        stated = {} if fitted is None else {name: dict(values) for name, values in fitted.stated.items()}
        for effect, sigmas in sorted(self.effects.items()):
            for name, sigma in sorted(sigmas.items()):
                if name in stated.get(effect, {}):
                    low, high = find_parameter(effect, name).bounds
                    drawn = stated[effect][name] + sigma * _normal(generator)
                    stated[effect][name] = float(np.clip(drawn, low, high))
        return EffectValues(stated)


def posterior_of(diagnosis: Mapping[str, Any]) -> Posterior:
    """The posterior that the content of diagnosis.json states.

    Raises
    ------
    InputError : the file has not the form of a diagnosis
    """
    try:
        parameters = {
            name: _sigma(entry["ci95"]) / abs(entry["fitted"])
            for name, entry in diagnosis["parameters"].items()
            if entry["fitted"]
        }
        effects = {
            cause["effect"]: {name: _sigma(entry["ci95"]) for name, entry in cause["parameters"].items()}
            for cause in diagnosis["causes"]
        }
    except (KeyError, TypeError, AttributeError, ValueError) as err:
        raise InputError(
            f"no diagnosis: its parameters or causes are missing or of another form ({err!r}); give what "
            "'msl-fem diagnose -o' wrote"
        ) from err
    return Posterior(parameters, effects)


def _sigma(interval: list[float | None]) -> float:
    """One sigma of a 95 % interval; 0 where an end is open."""
    low, high = interval
    return 0.0 if low is None or high is None else abs(float(high) - float(low)) / (2 * _NORMAL_95)


def _normal(generator: np.random.Generator) -> float:
    return float(np.clip(generator.normal(), -_CUT, _CUT))
