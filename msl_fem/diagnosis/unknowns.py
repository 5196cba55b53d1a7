"""What a fit does not know, in units of its prior: believed parameters, the table's error, starts of runs, effects.

A believed parameter is its believed value times 1 + sigma z (exp(sigma z) where sigma is large), z standard normal. The
amount of an effect is its neutral value plus `WIDE` of the catalogue's usual scales times z, and z has Cauchy's
distribution: an effect may be far larger than usual at the cost of a few nats. A shape is its centre times exp(width
z), z standard normal.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.plant.effects import CATALOGUE, PARAMETER_INDEX, neutral_vector
from msl_fem.prediction.hypothesis import ModelHypothesis, times_factors
from msl_fem.prediction.nuisances import ADDITIVE

WIDE = 10.0
LINEAR = 0.1  # relative tolerance up to which a parameter is linear in z
STEP = 1e-5
STEP_OF_AMOUNTS = 1e-7
WIDTHS = 3.0  # of a shape about its centre, at most
CAUCHY = float(np.log(2 / np.pi) / 2)  # log of 1/pi over that of the normal distribution's 1/sqrt(2 pi)


def factor(sigma: float, z: float) -> float:
    """A parameter over its believed value. An exponential would bend the lines along which a parameter and an effect
    that acts as it does make up for each other."""
    return float(1 + sigma * z if sigma <= LINEAR and sigma * z > -0.9 else np.exp(sigma * z))


@dataclass(frozen=True)
class EffectUnknown:
    """A parameter of an effect that is searched for.

    Attributes
    ----------
    centre : of a shape, its value at z = 0
    width : of a shape, one sigma of its logarithm; 0 for a parameter that is no shape
    size : of an amount, the plant's scale over that of the catalogue (`plant.own_scales`)
    believed : of an amount, what is believed of it before; None: nothing, it is neutral
    """

    effect: str
    name: str
    centre: float = 0.0
    width: float = 0.0
    size: float = 1.0
    believed: float | None = None

    @property
    def base(self) -> float:
        """The value of an amount at z = 0."""
        return CATALOGUE[self.effect].parameter(self.name).neutral if self.believed is None else self.believed

    @property
    def place(self) -> int:
        """In the vector of all parameters."""
        return PARAMETER_INDEX[self.effect, self.name]

    @property
    def one_sided(self) -> bool:
        """Whether the neutral value is the lowest allowed."""
        parameter = CATALOGUE[self.effect].parameter(self.name)
        return not parameter.shape and parameter.neutral == parameter.bounds[0]

    @property
    def bounds(self) -> tuple[float, float]:
        """Of z: a shape stays within `WIDTHS` of its centre, what is one-sided above nothing."""
        if self.width:
            return -WIDTHS, WIDTHS
        if not self.one_sided:
            return -np.inf, np.inf
        return self.z_of(CATALOGUE[self.effect].parameter(self.name).neutral), np.inf

    def value(self, z: Array) -> Array:
        """SI values at z, within the bounds."""
        parameter = CATALOGUE[self.effect].parameter(self.name)
        if self.width:
            return np.clip(self.centre * np.exp(self.width * z), *parameter.bounds)
        least, most = parameter.allowed
        low, high = (min(max(self.size * bound, least), most) for bound in parameter.bounds)
        return np.clip(self.base + WIDE * self.size * parameter.scale * z, low, high)

    def z_of(self, value: float) -> float:
        parameter = CATALOGUE[self.effect].parameter(self.name)
        if self.width:
            return float(np.log(value / self.centre) / self.width)
        return (value - self.base) / (WIDE * self.size * parameter.scale)


def fixed_of(belief: ModelHypothesis) -> tuple[tuple[int, float], ...]:
    """(place, value) of the parameters of effects that a model is believed to have."""
    stated = {} if belief.effects is None else belief.effects.stated
    return tuple((PARAMETER_INDEX[effect, name], v) for effect, of in stated.items() for name, v in of.items())


@dataclass(frozen=True)
class Unknowns:
    """The order of a fit's numbers: believed, table, starts of each run, effects.

    Attributes
    ----------
    believed : parameter and the sigma of its logarithm
    n_table : modes of the table's error
    starts : how many numbers the start of each run has
    effects : parameters searched for
    fixed : values of further parameters of effects, by place: those believed before anything is measured, times the
        factor of the believed parameter that has their name, "effect.parameter"
    slow : Hz, up to which an effect that turns does without fine steps
    """

    believed: tuple[tuple[str, float], ...]
    n_table: int
    starts: tuple[int, ...]
    effects: tuple[EffectUnknown, ...] = ()
    fixed: tuple[tuple[int, float], ...] = field(default=())
    slow: float = 0.0

    @property
    def n_nuisance(self) -> int:
        return len(self.believed) + self.n_table + sum(self.starts)

    @property
    def size(self) -> int:
        return self.n_nuisance + len(self.effects)

    @property
    def table_rows(self) -> slice:
        return slice(len(self.believed), len(self.believed) + self.n_table)

    def start_rows(self, run: int) -> slice:
        first = len(self.believed) + self.n_table + sum(self.starts[:run])
        return slice(first, first + self.starts[run])

    def factors(self, z: Array) -> dict[str, float]:
        """Believed parameters over their believed values; of zeros and shares what is added to them."""
        return {
            name: float(sigma * z[n]) if name in ADDITIVE else factor(sigma, z[n])
            for n, (name, sigma) in enumerate(self.believed)
        }

    def effect_vector(self, z: Array) -> Array:
        """All parameters of the catalogue (N_PARAMETER,)."""
        vector = neutral_vector()
        for place, believed in self.fixed:
            vector[place] = believed
        vector = times_factors(vector, self.factors(z))
        for n, one in enumerate(self.effects):
            value, before = one.value(z[self.n_nuisance + n]), vector[one.place]
            vector[one.place] = value if one.width or before == one.base else value + (before - one.base)
        for one in self.effects:
            parameter = CATALOGUE[one.effect].parameter(one.name)
            shape = next((s for s in self.effects if (s.effect, s.name) == (one.effect, parameter.root_of)), None)
            if shape is not None:
                amount = one.base + np.sqrt(vector[shape.place] / shape.centre) * (vector[one.place] - one.base)
                vector[one.place] = min(amount, parameter.allowed[1])
        return vector

    @property
    def wanders(self) -> str:
        """The reading whose zero wanders by one of the effects; "": none."""
        return next((CATALOGUE[one.effect].wanders for one in self.effects if CATALOGUE[one.effect].wanders), "")

    @property
    def plain(self) -> bool:
        return not self.effects and not self.fixed

    @property
    def times_steps(self) -> int:
        """Times as many steps as coarse ones that the effects want which are searched for or believed."""
        fixed = dict(self.fixed)
        believed = {(effect, name): fixed[at] for (effect, name), at in PARAMETER_INDEX.items() if at in fixed}
        shapes = believed | {(one.effect, one.name): one.centre for one in self.effects if one.width}
        amounts = [*believed, *((one.effect, one.name) for one in self.effects if not one.width)]
        return max((self.times_steps_of(*amount, shapes) for amount in amounts), default=1)

    def times_steps_of(self, effect: str, name: str, shapes: Mapping[tuple[str, str], float]) -> int:
        """The same of an amount, by the centres of shapes, (effect, name) to SI value."""
        entry = CATALOGUE[effect]
        if name in entry.coarse:
            return 1
        turns = shapes.get((effect, entry.turns), np.inf)
        return int(np.ceil(turns / self.slow)) if turns < entry.steps * self.slow else entry.steps

    @property
    def amounts(self) -> NDArray[np.intp]:
        """Places of the effects' amounts."""
        places = [n for n, unknown in enumerate(self.effects, self.n_nuisance) if not unknown.width]
        return np.array(places, dtype=np.intp)

    @property
    def steps(self) -> Array:
        """Of differences: near a sharp resonance a longer one is a secant."""
        found = np.full(self.size, STEP)
        found[self.amounts] = STEP_OF_AMOUNTS
        return found

    def prior(self, z: Array) -> tuple[float, Array, Array]:
        """(minus its log in nats up to normal distributions' constants, its slope, its curvature or a bound)."""
        slope, curvature = z.copy(), np.ones(z.size)
        at = self.amounts
        wide = z[at]
        slope[at], curvature[at] = 2 * wide / (1 + wide**2), 2 / (1 + wide**2)
        rest = np.delete(z, at)
        return float(rest @ rest / 2 + np.log1p(wide**2).sum()) - CAUCHY * at.size, slope, curvature

    def allowed(self, z: Array) -> Array:
        """z with one-sided effects no further than at nothing, shapes within three widths."""
        kept = np.array(z, dtype=float)
        for n, one in enumerate(self.effects):
            row = self.n_nuisance + n
            kept[row] = np.clip(kept[row], *one.bounds)
        return kept
