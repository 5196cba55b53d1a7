"""How large each cause of the catalogue is likely to be, before anything is measured.

In this order: what the drawing tells (`comparison.as_designed`), what the tolerances leave open, what the iron's data
say, and else the size that is usual in practice, which is the catalogue's scale for a plant of this size.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import MaterialError
from msl_fem.materials.core_loss_data import sheet_of
from msl_fem.plant.believed import Belief
from msl_fem.plant.effects import CATALOGUE, EffectValues, Parameter
from msl_fem.plant.own_scales import over_reference, own_quantities
from msl_fem.plant.plant import PlantParameters, drive_lags, plant_parameters
from msl_fem.record import Tolerance

DRAWING, SIGMA = "the drawing", "one sigma of the drawing"
USUAL = "usual in practice: the catalogue's scale"
MAJOR = 1.0  # T: amplitude of the loop whose loss tells the coercive field
OVER_OWN = 3.0
"""A second mode of a mover on flexures over its own frequency, where no drawing tells it."""

Told = tuple[Mapping[str, float], str]
"""Parameters of an effect with their expected values in SI units, the leading one first; and where they come from."""


@dataclass(frozen=True)
class ExpectedCause:
    """A cause at the size that is likely before a measurement.

    Attributes
    ----------
    values : parameters and their values in SI units, the leading one first
    source : where the size comes from, in words
    """

    effect: str
    values: Mapping[str, float]
    source: str

    @property
    def leading(self) -> str:
        """The parameter whose value is its size."""
        return next(iter(self.values))

    @property
    def size(self) -> float:
        return self.values[self.leading]

    def by_signs(self) -> "tuple[ExpectedCause, ...]":
        """The cause; of one that each side has, where the drawing does not tell the signs, also with that of side 2
        turned."""
        second = f"{self.leading.removesuffix('_1')}_2"
        if second not in self.values or self.drawn:
            return (self,)
        return self, replace(self, values={**self.values, second: -self.values[second]})

    @property
    def amounts(self) -> tuple[str, ...]:
        """Its parameters that say how much."""
        return tuple(name for name in self.values if not CATALOGUE[self.effect].parameter(name).shape)

    @property
    def of_amounts(self) -> "ExpectedCause":
        """Without amounts that are nothing."""
        return replace(self, values={name: v for name, v in self.values.items() if v or name not in self.amounts})

    def only(self, amount: str) -> "ExpectedCause":
        """With one of its amounts alone, and its shapes."""
        left_out = set(self.amounts) - {amount}
        return replace(self, values={name: v for name, v in self.values.items() if name not in left_out})

    def most(self, amount: str) -> tuple[float, float]:
        """Between which multiples an amount is allowed."""
        low, high = (bound / self.values[amount] for bound in CATALOGUE[self.effect].parameter(amount).allowed)
        return min(low, high), max(low, high)

    def times(self, multiples: Sequence[float] | Array) -> "ExpectedCause":
        """With each of its amounts times a factor of its own; shapes stay."""
        factors = dict(zip(self.amounts, multiples, strict=True))
        return replace(self, values={name: float(v * factors.get(name, 1.0)) for name, v in self.values.items()})

    def beside(self, believed: EffectValues | None) -> EffectValues:
        """What is believed, and the cause beside it: amounts add up, a shape that is believed stays."""
        stated = {} if believed is None else {name: dict(of) for name, of in believed.stated.items()}
        own = stated.setdefault(self.effect, {})
        for name, value in self.values.items():
            parameter = CATALOGUE[self.effect].parameter(name)
            own[name] = own.get(name, value) if parameter.shape else own.get(name, 0.0) + value
        return EffectValues(stated)

    @property
    def drawn(self) -> bool:
        """Whether its size is the drawing's."""
        return self.source.startswith((DRAWING, SIGMA))

    @property
    def unit(self) -> str:
        return CATALOGUE[self.effect].parameter(self.leading).unit


def expected_causes(
    actuator: Actuator, drawn: Belief, *, tolerance: Tolerance, rate: float, known: bool = False
) -> tuple[ExpectedCause, ...]:
    """Every effect that the plant can have, at its expected size; those that are `unexpected` apart.

    Parameters
    ----------
    drawn : what the drawing tells
    rate : samples a second, Hz
    known : the drawn values are believed already: what is left of them is one sigma each

    Raises
    ------
    ActuatorError : [motion] or [drive] is missing
    """
    plant = plant_parameters(actuator)
    told = (
        _usual(plant, rate) | _of_tolerances(plant, tolerance) | _of_iron(actuator, plant) | _of_drawing(drawn, known)
    )
    without = unexpected(plant)
    return tuple(ExpectedCause(name, *told[name]) for name in _possible(plant) if name not in without)


def unexpected(plant: PlantParameters) -> dict[str, str]:
    """Effects that nothing makes likely, and why."""
    found = {
        "drive_limit": "the runs stay below the drive's limits",
        "thermal_history": "what was done before a run is not in the drawing",
    }
    if plant.stiffness > 0:
        found["coulomb_friction"] = "a mover that hangs on its spring touches nothing"
    return found


def _possible(plant: PlantParameters) -> list[str]:
    has = {"magnets": plant.sides > 0, "two sides": plant.sides == 2, "drive lag": drive_lags(plant)}
    return [effect.name for effect in CATALOGUE.values() if all(has[need] for need in effect.needs)]


def _usual(plant: PlantParameters, rate: float) -> dict[str, Told]:
    """Of every effect the first amount at the plant's scale, for both sides alike; a limit of the drive is stated."""
    own = own_quantities(plant, rate=rate)
    frequency = math.sqrt(plant.stiffness / plant.mass) / (2 * math.pi)
    found: dict[str, Told] = {}
    for effect in CATALOGUE.values():
        scales = {p.name: p.scale * over_reference(p, own) for p in effect.parameters}
        named = {name: scales[name] for name in _first_amounts(effect.parameters, plant.sides)}
        shapes = [p for p in effect.parameters if p.shape and p.over == "own_frequency"]
        found[effect.name] = (named | {p.name: OVER_OWN * frequency for p in shapes if frequency}, USUAL)
    return found


def _first_amounts(parameters: tuple[Parameter, ...], sides: int) -> list[str]:
    """The first amount; of one that each side has, those of all sides."""
    first = next(p.name for p in parameters if not p.shape)
    stem, _, side = first.rpartition("_")
    return [f"{stem}_{j}" for j in range(1, sides + 1)] if side == "1" else [first]


def _of_tolerances(plant: PlantParameters, t: Tolerance) -> dict[str, Told]:
    """What one sigma of the tolerances leaves open."""
    sides = range(1, plant.sides + 1)
    reach = plant.travel if math.isfinite(plant.travel) else plant.nominal_gap
    found: dict[str, Told] = {}
    if plant.sides:
        gap = t.nominal_gap * plant.nominal_gap
        found |= {
            "gap_offset": ({"offset": gap}, "tolerance of the nominal gap"),
            "armature_tilt": ({"gap_variance": gap**2 / 3}, "edges off by the tolerance of the nominal gap"),
            "fringing": ({"growth": t.table / reach}, "tolerance of the table over the travel"),
            "leakage_inductance": ({f"share_{j}": t.leakage_inductance for j in sides}, "its tolerance"),
            "mutual_inductance": ({"share": t.mutual_inductance}, "its tolerance"),
            "cross_coupling": ({"share": t.mutual_inductance / 2}, "tolerance of the mutual inductance, at the ends"),
            "current_sensor_error": ({f"gain_{j}": t.current_gain for j in sides}, "tolerance of the current's gain"),
        }
    if plant.stiffness and math.isfinite(plant.travel):
        cubic = t.stiffness * plant.stiffness / plant.travel**2
        found["stiffness_nonlinearity"] = ({"cubic": cubic}, "tolerance of the stiffness, at the end of the travel")
    curvature = ({"quadratic": t.position_gain / reach}, "tolerance of the position's gain, at the end of the travel")
    return found | {
        "position_sensor_nonlinearity": curvature,
        "force_offset": ({"force": t.force_zero}, "tolerance of a force's zero"),
    }


def _of_iron(actuator: Actuator, plant: PlantParameters) -> dict[str, Told]:
    """Coercive and remanent current from the iron's hysteresis loss; nothing where that is not known.

    A loop of the height 2 B_m and the half-width H_c has the area 4 H_c B_m, the loss of a cycle rho k_h B_m^a
    (Bozorth, Ferromagnetism, 1951, ch. 18); along the flux path the coercive fields add up to the current sum H_c l/N.
    """
    magnet = actuator.magnet
    if not isinstance(magnet, MagnetKind) or magnet.circuit is None:
        return {}
    irons = {"core": magnet.iron.core, "armature": magnet.iron.armature}
    drop = 0.0
    for part in magnet.circuit.parts:
        try:
            known = sheet_of(irons[part.region]).coefficients
        except MaterialError:
            known = None
        if known is None:
            return {}
        drop += known.density * known.hysteresis * MAJOR ** (known.exponent - 1) / 4 * part.length
    current = drop / (magnet.turns * plant.current_share)
    source = f"hysteresis loss of the iron at {MAJOR:g} T, along the flux path"
    remanent = {f"current_{j}": current for j in range(1, plant.sides + 1)}
    return {"magnetic_hysteresis": ({"coercive_current": current}, source), "remanent_flux": (remanent, source)}


def _of_drawing(drawn: Belief, known: bool) -> dict[str, Told]:
    """What the drawing tells of each effect: the values, or one sigma of the amounts where they are `known`."""
    found: dict[str, Told] = {}
    for one in drawn.values:
        shape = CATALOGUE[one.effect].parameter(one.parameter).shape
        value = one.sigma if known and not shape else one.value
        values, source = found.get(one.effect, ({}, f"{SIGMA if known else DRAWING}: {one.source}"))
        found[one.effect] = ({**values, one.parameter: value}, source)
    return found
