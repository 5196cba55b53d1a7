"""What is believed of a plant beside the numbers of its actuator file and its table: effects, how large, from where."""

from dataclasses import dataclass
from typing import Any, Final, Literal

from msl_fem.plant.effects import EffectValues, find_parameter

AS_DESIGNED: Final = "as-designed"
PLAIN: Final = "plain"


@dataclass(frozen=True)
class BelievedValue:
    """A parameter of an effect that is known before anything is measured.

    Attributes
    ----------
    value, sigma : SI units; one sigma of how well it is known
    source : where it comes from, in words
    """

    effect: str
    parameter: str
    value: float
    sigma: float
    source: str

    @property
    def key(self) -> tuple[str, str]:
        return self.effect, self.parameter

    @property
    def name(self) -> str:
        """As a believed parameter of a fit is called."""
        return f"{self.effect}.{self.parameter}"

    def to_json(self) -> dict[str, Any]:
        unit = find_parameter(*self.key).unit
        told = {"value": self.value, "unit": unit, "sigma": self.sigma, "source": self.source}
        return {"effect": self.effect, "parameter": self.parameter, **told}


@dataclass(frozen=True)
class Belief:
    """What the plain model is believed to have beside it.

    Attributes
    ----------
    name : `as-designed` or `plain`
    left_out : what could not be told, and why
    """

    name: Literal["as-designed", "plain"] = PLAIN
    values: tuple[BelievedValue, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def effects(self) -> EffectValues | None:
        """The effects at their believed values; None where there are none."""
        stated: dict[str, dict[str, float]] = {}
        for one in self.values:
            stated.setdefault(one.effect, {})[one.parameter] = one.value
        return EffectValues(stated) if stated else None

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "values": [one.to_json() for one in self.values],
            "left_out": list(self.left_out),
        }


PLAIN_BELIEF = Belief()
