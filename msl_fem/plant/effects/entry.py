"""What an entry of the catalogue holds."""

from dataclasses import dataclass
from typing import Literal

Group = Literal["magnetic", "electrical", "mechanical", "sensing and timing"]
Need = Literal["magnets", "two sides", "drive lag"]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    Attributes
    ----------
    unit : SI, as the files write it; "" for a pure number
    neutral : the value that switches the effect off; of a shape parameter, the value where none is stated
    bounds : lowest and highest value allowed
    scale : a size that is usual in practice; steps of a search or of a difference are parts of it
    meaning : in a few words
    shape : it says how, not how much: at the other parameters' neutral values it changes nothing
    """

    name: str
    unit: str
    neutral: float
    bounds: tuple[float, float]
    scale: float
    meaning: str
    shape: bool = False


@dataclass(frozen=True)
class Effect:
    """One effect of the catalogue.

    Attributes
    ----------
    name : as the file formats use it
    sentence : what it is
    equation : what it adds to the plain model; symbols as in docs/coupled_model.md
    source : author, title, year
    parameters : those that switch it on, then its shape
    needs : what a plant must have for it: magnets (and a gap), two sides, a current drive that lags
    """

    name: str
    group: Group
    sentence: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    needs: tuple[Need, ...] = ()

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError where there is none."""
        return {p.name: p for p in self.parameters}[name]
