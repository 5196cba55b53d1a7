"""What an entry of the catalogue holds: all that the rooms of the program have to know of an effect."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from msl_fem.computing.arrays import Array
from msl_fem.plant.plant import PlantParameters

Group = Literal["magnetic", "electrical", "mechanical", "sensing and timing"]
Need = Literal["magnets", "two sides", "drive lag"]
Scale = Literal["", "own_frequency", "position", "velocity", "current", "lines"]


Values = Mapping[tuple[str, str], float]
"""Every parameter of the catalogue, by effect and name."""


class Setting(NamedTuple):
    """What coefficients depend on beside the effects: the plant, and the steps of its integration."""

    plant: PlantParameters
    inductance: float  # H, of a side at the nominal gap without current; any number without magnets
    step: float  # s
    n_step: int  # steps a sample


SetCoefficients = Callable[[Array, Values, Setting], None]
"""Sets an effect's rows of the kernel's coefficients."""


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
    tried : of a shape, the values at which a search starts, in units of what `over` names in a record (its RMS
        position, velocity or current, the mover's own frequency, the lines of the residual's spectrum); "": SI
    width : of a shape, one sigma of its logarithm about a value that is tried
    belongs_to : of a shape, the one amount that it is about; "": all of them
    alone : an amount that is tried without its effect's shapes too
    """

    name: str
    unit: str
    neutral: float
    bounds: tuple[float, float]
    scale: float
    meaning: str
    shape: bool = False
    tried: tuple[float, ...] = ()
    over: Scale = ""
    width: float = 1.0
    belongs_to: str = ""
    alone: bool = False


@dataclass(frozen=True)
class Part:
    """How much of an effect a part of the program takes.

    Attributes
    ----------
    parameters : those amounts that it takes
    declined : why it does without the others, in one sentence; "" where there are none
    """

    parameters: tuple[str, ...] = ()
    declined: str = ""


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
    design : what a controller's design believes of it
    inverse : what the inverse dynamics of a rig without magnets undo of it
    static : what a magnet at rest shows of it
    advice : what an engineer looks at who finds it
    coefficients : sets what the kernel's equations take of it; effects of one mechanism share it; None: it acts on
        readings alone
    needs : what a plant must have for it: magnets (and a gap), two sides, a current drive that lags
    sets : amounts that a search tries together; (): one set, all of them
    separating : the static measurement that tells it from the other effects of a magnet at rest; "": it is not looked
        for there
    """

    name: str
    group: Group
    sentence: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    design: Part
    inverse: Part
    static: Part
    advice: str
    coefficients: SetCoefficients | None = None
    needs: tuple[Need, ...] = ()
    sets: tuple[tuple[str, ...], ...] = ()
    separating: str = ""

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError where there is none."""
        return {p.name: p for p in self.parameters}[name]

    @property
    def amounts(self) -> tuple[str, ...]:
        """Names of the parameters that switch it on."""
        return tuple(p.name for p in self.parameters if not p.shape)


NO_MAGNETS = Part(declined="it is an effect of magnets, which a rig that a force drives has not")
NOT_AT_REST = Part(declined="a magnet at rest, measured point after point, does not show it")
