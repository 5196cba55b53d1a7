"""Plants that a diagnosis leaves possible: its fitted parameters and effects, each within its interval.

The file of a diagnosis states an interval for each parameter and the correlations of their errors, so parameters are
drawn together: jointly normal, 95 % of each inside its interval. A combination that the record bounds better than its
parts (stiffness over mass by the resonance, a gap by its offset and nominal value) stays as well bounded as it is. An
older file has no correlations; its parameters are drawn apart, and such combinations spread wider than they may.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydantic import ValidationError

from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import PlantUnderTest
from msl_fem.control.stated_posterior import Correlated, Ends, StatedPosterior
from msl_fem.control.unseen_plants import with_more
from msl_fem.errors import InputError
from msl_fem.files.schema import LARGEST, first_complaint
from msl_fem.plant.effects import EffectValues, find_parameter

_OF_MOTION = ("moving_mass", "stiffness", "damping", "nominal_gap")
_ABOVE_ZERO = ("moving_mass", "nominal_gap", "coil_resistance", "position_gain", "magnetic_scale")
_NORMAL_95 = 1.959964
_CUT = 3.0  # sigma


@dataclass(frozen=True)
class Posterior:
    """One sigma of what was fitted.

    Attributes
    ----------
    parameters : by believed parameter, of the fitted value over it
    effects : by effect and parameter, SI units
    names, root : numbers that go together, effects' as "effect.parameter", and (n, n) a root of their correlation
    """

    parameters: Mapping[str, float]
    effects: Mapping[str, Mapping[str, float]]
    names: tuple[str, ...] = ()
    root: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def draw(self, plant: PlantUnderTest, generator: np.random.Generator) -> PlantUnderTest:
        """A plant about the fitted one; amounts stay within their bounds of the catalogue."""
        actuator = plant.actuator
        if actuator.motion is None or actuator.drive is None:
            raise InputError(f"{actuator.name} has no [motion] or no [drive]; plants of a posterior need both")
        drawn = self._drawn(generator)
        factors = {name: 1 + sigma * drawn[name] for name, sigma in self.parameters.items()}
        moved = {
            name: max(getattr(actuator.motion, name) * factors[name], 0.0)
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
        effects = with_more(self._effects(plant.effects, factors, drawn), shares)
        return PlantUnderTest(actuator.model_copy(update=changed), plant.table, effects)

    def _drawn(self, generator: np.random.Generator) -> dict[str, float]:
        """Errors of all numbers in sigmas, those that go together drawn together."""
        every = sorted(
            [*self.parameters, *(f"{effect}.{name}" for effect in self.effects for name in self.effects[effect])]
        )
        drawn = {name: _normal(generator) for name in every}
        together = self.root @ np.array([_normal(generator) for _ in self.names])
        return drawn | dict(zip(self.names, together.tolist(), strict=True))

    def _effects(
        self, fitted: EffectValues | None, factors: Mapping[str, float], drawn: Mapping[str, float]
    ) -> EffectValues:
        stated = {} if fitted is None else {name: dict(values) for name, values in fitted.stated.items()}
        for effect, values in stated.items():
            sigmas = self.effects.get(effect, {})
            for name in values:
                key = f"{effect}.{name}"
                moved = values[name] * factors.get(key, 1.0) + sigmas.get(name, 0.0) * drawn.get(key, 0.0)
                if moved != values[name]:
                    values[name] = float(np.clip(moved, *find_parameter(effect, name).bounds))
        return EffectValues(stated)


def posterior_of(diagnosis: Mapping[str, Any]) -> Posterior:
    """The posterior that the content of diagnosis.json states.

    Raises
    ------
    InputError : the file has not the form of a diagnosis
    """
    try:
        stated = StatedPosterior.model_validate(diagnosis)
        parameters = {name: _sigma(one.ci95) / abs(one.fitted) for name, one in stated.parameters.items() if one.fitted}
        _check_spread(parameters)
        effects = {
            cause.effect: {name: _sigma(one.ci95) for name, one in cause.parameters.items()} for cause in stated.causes
        }
        names, root = _together(stated.correlation)
    except ValidationError as err:
        raise _none(first_complaint(err)) from err
    except ValueError as err:
        raise _none(str(err)) from err
    return Posterior(parameters, effects, names, root)


def _none(why: str) -> InputError:
    return InputError(
        f"no diagnosis: its parameters or causes are missing or of another form ({why}); give what "
        "'msl-fem diagnose -o' wrote"
    )


def _check_spread(sigmas: Mapping[str, float]) -> None:
    """ValueError where a plant drawn with these relative sigmas may be none."""
    for name, sigma in sigmas.items():
        if name in _ABOVE_ZERO and not _CUT * sigma < 1:
            raise ValueError(
                f"parameters.{name}.ci95: one sigma is {sigma:.3g} times the fitted value, so that plants without "
                "any would be drawn; it must be below a third"
            )
        if not sigma <= LARGEST:
            raise ValueError(f"parameters.{name}.ci95: is out of proportion to the fitted value")


def _together(correlation: Correlated | None) -> tuple[tuple[str, ...], Array]:
    """(names, a root of the correlation matrix) of a file's entry; none of an older file.

    Raises
    ------
    ValueError : the matrix is none of these names
    """
    if correlation is None:
        return (), np.zeros((0, 0))
    values, vectors = np.linalg.eigh(correlation.checked())
    return tuple(correlation.names), vectors * np.sqrt(np.maximum(values, 0.0))


def _sigma(interval: Ends) -> float:
    """One sigma of a 95 % interval; 0 where an end is open."""
    low, high = interval
    return 0.0 if low is None or high is None else abs(high - low) / (2 * _NORMAL_95)


def _normal(generator: np.random.Generator) -> float:
    return float(np.clip(generator.normal(), -_CUT, _CUT))
