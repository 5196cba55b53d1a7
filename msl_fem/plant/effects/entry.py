"""What an entry of the catalogue holds: all that the rooms of the program have to know of an effect."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

from msl_fem.computing.arrays import Array
from msl_fem.plant.effects.mechanisms import NEVER
from msl_fem.plant.plant import PlantParameters

FINE = 1000
"""Times the steps that do where a current loop is known in closed form, that stand for those by which it is integrated,
however many these are."""

Group = Literal["magnetic", "electrical", "mechanical", "sensing and timing"]
Need = Literal["magnets", "two sides", "drive lag"]
Scale = Literal["", "own_frequency", "position", "velocity", "current", "peak", "command", "lines", "loops"]
Quantity = Literal["gap", "travel", "mass", "force", "current", "period"]
OF_ANY_PLANT = 100.0
"""How much larger than the reference servo's a quantity of another plant may be."""


Values = Mapping[tuple[str, str], float]
"""Every parameter of the catalogue, by effect and name."""


class KernelSetting(NamedTuple):
    """What coefficients depend on beside the effects: the plant, and the steps of its integration."""

    plant: PlantParameters
    inductance: float  # H, of a side at the nominal gap without current; any number without magnets
    step: float  # s
    n_step: int  # steps a sample


class MoverMotion(NamedTuple):
    """How a mover goes, and a second mass against it: (n_sample,) each, SI units."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    mode_acceleration: Array


@dataclass
class DesignChange:
    """What effects do to the plant that a controller's design believes in, all together.

    Attributes
    ----------
    sides : of the plant
    gap_1, gap_2 : m, by which the gaps are wider
    current_scale, depth, growth : of a magnet's coenergy, W'(i, g) -> (depth + growth g) W'(current_scale i, g)
    stiffness : N/m, beside the suspension's
    cubic : N/m^3, of the spring
    constant_force : N, along +x
    damping : N s/m
    bandwidth : of the drive, over the stated one
    lag : s, of a chain of lags the sum
    delay : s, of the command
    """

    sides: int
    gap_1: float = 0.0
    gap_2: float = 0.0
    current_scale: float = 1.0
    depth: float = 1.0
    growth: float = 0.0
    stiffness: float = 0.0
    cubic: float = 0.0
    constant_force: float = 0.0
    damping: float = 0.0
    bandwidth: float = 1.0
    lag: float = 0.0
    delay: float = 0.0


SetCoefficients = Callable[[Array, Values, KernelSetting], None]
"""Sets an effect's rows of the kernel's coefficients."""
Believe = Callable[[DesignChange, Values], None]
"""Puts what a design believes of an effect into the change."""
NeededForce = Callable[[Values, PlantParameters, MoverMotion], Array | float]
"""The force along +x (N) that a motion takes because of an effect."""


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
        position, velocity, current or command, the highest current, the mover's own frequency, the
        lines of the residual's spectrum), in SI over ""; over "loops" it is searched for in measured loops alone and
        elsewhere has its neutral value
    resonant : of a shape, whether it is tried at the peaks of a residual's spectrum as well
    width : of a shape, one sigma of its logarithm about a value that is tried
    instead : of a shape, those in whose place it is tried: two forms of one effect
    optional : of a shape, whether it is tried and left at its neutral value: two forms as well
    belongs_to : of a shape, the one amount that it is about; "": all of them
    ends : of such a shape, values at which forms are farthest from each other; none: the highest one
    alone : an amount that is tried without its effect's shapes too
    root_of : of an amount, a shape with whose square root it goes where most else stays as it is: a fit holds it over
        that root, which is no bent valley
    lagging : it needs a drive whose current cannot jump, though its effect does not
    of : the plant's own quantities and their powers that `scale` and `bounds` go with; stated are those of the
        reference servo (`plant.own_scales`)
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
    resonant: bool = False
    width: float = 1.0
    instead: tuple[str, ...] = ()
    optional: bool = False
    belongs_to: str = ""
    ends: tuple[float, ...] = ()
    alone: bool = False
    root_of: str = ""
    lagging: bool = False
    of: tuple[tuple[Quantity, float], ...] = ()

    @property
    def allowed(self) -> tuple[float, float]:
        """Lowest and highest value that any plant may have."""
        low, high = self.bounds
        of_size = self.of and ("period", 1) not in self.of
        wide = OF_ANY_PLANT ** max(1.0, *(abs(power) for _, power in self.of)) if of_size else 1.0
        return low * wide, high * wide


def bending_current(
    name: str, meaning: str, tried: float, *, over: Scale = "current", optional: bool = False, belongs_to: str = ""
) -> Parameter:
    """The shape of a form that bends: a current (A), where none is stated one that is never reached."""
    return Parameter(
        name,
        "A",
        NEVER,
        (1e-3, 2 * NEVER),
        10.0,
        meaning,
        shape=True,
        tried=(tried,),
        over=over,
        optional=optional,
        belongs_to=belongs_to,
    )


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
    believe : changes the plant of a design; effects of one mechanism share it
    needed_force : what the inverse dynamics add to the force that a motion takes; what acts on commands and readings
        is undone there in its order
    needs : what a plant must have for it: magnets (and a gap), two sides, a current drive that lags
    sets : amounts that a search tries together; (): one set, all of them
    separating : the static measurement that tells it from the other effects of a magnet at rest; "": it is not looked
        for there
    wanders : the reading whose zero it moves by a path of each run's own, of which its parameters are the even course;
        "": it acts alike in every run
    deviation_of : effects from whose form a real one deviates as if a little of this one were there, and the share of
        what they bring up to which it is no cause of its own
    one_form : whether its equation is next to all there is of it, so that a real one leaves no rest for another cause;
        not so of loops, diffusion, knees, slip, stops and wander, of which there are as many forms as rigs
    steps : times as many a sample as do where a current loop is known in closed form, that it wants; `FINE`: those by
        which such a loop is integrated, since it changes when the loop's target comes, or moves as fast
    coarse : amounts that do without more
    turns : the shape that says how often a second it does (Hz), "": it has none; it wants the more steps the faster
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
    believe: Believe | None = None
    needed_force: NeededForce | None = None
    needs: tuple[Need, ...] = ()
    sets: tuple[tuple[str, ...], ...] = ()
    separating: str = ""
    wanders: str = ""
    deviation_of: Mapping[str, float] = field(default_factory=dict)
    one_form: bool = False
    steps: int = 1
    coarse: tuple[str, ...] = ()
    turns: str = ""

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; KeyError where there is none."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {p.name: p for p in self.parameters}

    @property
    def amounts(self) -> tuple[str, ...]:
        """Names of the parameters that switch it on."""
        return tuple(p.name for p in self.parameters if not p.shape)


NO_MAGNETS = Part(declined="it is an effect of magnets, which a rig that a force drives has not")
NOT_AT_REST = Part(declined="a magnet at rest, measured point after point, does not show it")
