"""What is believed of a plant, and the plant that follows when some of it is a little different."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.believed import Belief
from msl_fem.plant.effects import PARAMETER_INDEX, EffectValues, find_parameter, kernel_coefficients, neutral_vector
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE
from msl_fem.plant.poles import FAST
from msl_fem.plant.preparation import check_effects, small_signal_inductance
from msl_fem.plant.step_count import default_substeps
from msl_fem.prediction.nuisances import ADDITIVE, NUISANCES, nuisances_of, together, with_nuisances
from msl_fem.prediction.run_data import RunData
from msl_fem.prediction.scheduling import LEVEL, schedule_sigmas
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import MagneticTable

HEAVY = 1e15
"""Times the mass: a locked mover, which 1 kN moves by less than a nanometre in ten seconds."""
STEP_OF_FASTEST = 0.25
"""A step times the fastest rate: Runge-Kutta errs by 1e-5 of a signal, a hundredth of the instruments' noise."""
LONGEST = 1.3
"""Time constants of a current loop that a step is long at most where the loop is taken in closed form."""
BELIEVED = (
    "moving_mass",
    "stiffness",
    "damping",
    "coil_resistance",
    "nominal_gap",
    "position_gain",
    "magnetic_scale",
)
"""Parameters known within a tolerance. `position_gain` is reading over position, `magnetic_scale` coenergy over the
table's (both are 1 as believed)."""
OF_THE_PLANT = BELIEVED[:5]
UNITS = {"moving_mass": "kg", "stiffness": "N/m", "damping": "N s/m", "coil_resistance": "ohm", "nominal_gap": "m"} | {
    name: nuisance.unit for name, nuisance in NUISANCES.items()
}


@dataclass(frozen=True, eq=False)
class ModelHypothesis:
    """An actuator with its table and effects, and factors by which believed parameters differ from its files.

    Attributes
    ----------
    actuator, table : as in the record; no table for a rig that a force drives
    effects : of an extended model; None for the plain one
    factors : parameter of `BELIEVED` to value over believed value, gain of `NUISANCES` to its value (not stated: 1),
        zero or share of an inductance to its value (not stated: 0)
    known : of effects that are believed before anything is measured, "effect.parameter" to one sigma relative
    """

    actuator: Actuator
    table: MagneticTable | None
    effects: EffectValues | None = None
    factors: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, actuator: Actuator, table: MagneticTable | None, belief: Belief) -> "ModelHypothesis":
        """The model of a belief; none of its amounts without a tolerance, shapes with none."""
        known = {
            one.name: one.sigma / abs(one.value)
            for one in belief.values
            if one.value and one.sigma and not find_parameter(*one.key).shape
        }
        return cls(actuator, table, belief.effects, known=known)


@dataclass(frozen=True, eq=False)
class KernelPlant:
    """What the compiled kernel takes for runs of one sampling rate.

    Attributes
    ----------
    effects : (N_COEFFICIENT,) of the kernel, None for the plain model
    readings : (N_PARAMETER,) of the catalogue, for what the instruments do
    gain : position reading over position
    instruments : factors of gains and zeros of the other readings
    substeps, step : Runge-Kutta steps a sample, and their size in s
    """

    surface: Surface
    parameters: PlantParameters
    effects: Array | None
    readings: Array
    gain: float
    rate: float
    substeps: int
    instruments: Mapping[str, float] = field(default_factory=dict)

    @property
    def step(self) -> float:
        return 1.0 / (self.rate * self.substeps)

    @property
    def model(self) -> tuple[Surface, PlantParameters, Array | None]:
        """The first arguments of the kernel's functions."""
        return self.surface, self.parameters, self.effects

    @property
    def timing(self) -> tuple[float, int]:
        return self.step, self.substeps


def free_parameters(belief: ModelHypothesis, tolerance: Tolerance, *, runs: Sequence[RunData] = ()) -> dict[str, float]:
    """Parameters that the plant has and that are not known exactly, with one sigma relative; of `runs` also those of
    their instruments, with one sigma relative or in SI units (`NUISANCES`)."""
    p = plant_parameters(belief.actuator)
    absent = set()
    if not p.sides:
        absent |= {"coil_resistance", "nominal_gap", "magnetic_scale"}
    if not p.stiffness:
        absent.add("stiffness")
    if not p.damping:
        absent.add("damping")
    sigmas = {name: float(getattr(tolerance, name)) for name in BELIEVED if name not in absent}
    known = {name: sigma for name, sigma in sigmas.items() if sigma > 0}
    known |= belief.known
    for run in runs:
        known |= schedule_sigmas(run.schedules)
        channels = tuple(run.measured)
        known |= nuisances_of(p, tolerance, channels=channels, ideal_current=run.ideal_current)
    return known


def fitted_factor(name: str, sigma: float, z: float) -> float:
    """The factor of a parameter at z of its prior's sigmas: exp(sigma z), of a zero or a share sigma z."""
    return float(sigma * z if name in ADDITIVE else np.exp(sigma * z))


def effect_and_parameter(name: str) -> tuple[str, str]:
    """(effect, parameter) of a believed parameter that is called "effect.parameter"; ("", name) of any other."""
    effect, _, parameter = name.rpartition(".")
    return effect, parameter


def unit_of_believed(name: str) -> str:
    """The unit of a parameter of `BELIEVED`, `NUISANCES` or "effect.parameter"; "" of a pure number."""
    if LEVEL in name:
        return ""
    return find_parameter(*effect_and_parameter(name)).unit if "." in name else UNITS.get(name, "")


def times_factors(vector: Array, factors: Mapping[str, float]) -> Array:
    """All parameters of the catalogue (n_parameter,), those that have a factor, "effect.parameter", times it."""
    found = vector.copy()
    for name, value in factors.items():
        place = PARAMETER_INDEX.get(effect_and_parameter(name))
        if place is not None:
            found[place] *= value
    return found


def believed_value(belief: ModelHypothesis, name: str) -> float:
    """A parameter of `BELIEVED` or `NUISANCES` in SI units, the belief's factor in it."""
    if name in ADDITIVE:
        return belief.factors.get(name, 0.0)
    if "." in name and LEVEL not in name and belief.effects is not None:
        return belief.effects.get(*effect_and_parameter(name)) * belief.factors.get(name, 1.0)
    if name not in OF_THE_PLANT:
        return belief.factors.get(name, 1.0)
    motion = belief.actuator.motion
    if belief.actuator.drive is None and motion is not None and name == "nominal_gap":  # a magnet on a bench
        return float(motion.nominal_gap or 0.0) * belief.factors.get(name, 1.0)
    p = plant_parameters(belief.actuator)
    values = {
        "moving_mass": p.mass,
        "stiffness": p.stiffness,
        "damping": p.damping,
        "coil_resistance": p.resistance,
        "nominal_gap": p.nominal_gap,
    }
    return values.get(name, 1.0) * belief.factors.get(name, 1.0)


def closed_form_steps(plant: KernelPlant, belief: ModelHypothesis) -> int | None:
    """Steps a sample that resolve all but the current loops; None where they are not taken in closed form."""
    p, rate = plant.parameters, plant.rate
    if p.drive != CURRENT_DRIVE or not p.sides or not np.isfinite(p.bandwidth):
        return None
    ideal = p._replace(bandwidth=np.inf)
    steps = default_substeps(ideal, belief.table, rate=rate, effects=belief.effects, largest_step=STEP_OF_FASTEST)
    steps = max(steps, int(np.ceil(p.bandwidth / (LONGEST * rate))))
    return steps if is_closed_form(plant, steps) else None


def is_closed_form(plant: KernelPlant, steps: int) -> bool:
    """Whether a current loop is so fast that it is not integrated in so many steps a sample."""
    return plant.parameters.bandwidth > FAST * plant.rate * steps


def with_factors(p: PlantParameters, factors: Mapping[str, float], *, ideal_current: bool = False) -> PlantParameters:
    """Parameters of `BELIEVED` that a plant states itself, each times its factor, and what instruments do to its
    inputs; neutral where none is stated. `ideal_current`: measured currents drive it."""
    p = with_nuisances(p, factors, ideal_current=ideal_current)
    return p._replace(
        mass=p.mass * factors.get("moving_mass", 1.0),
        stiffness=p.stiffness * factors.get("stiffness", 1.0),
        damping=p.damping * factors.get("damping", 1.0),
        resistance=p.resistance * factors.get("coil_resistance", 1.0),
        nominal_gap=p.nominal_gap * factors.get("nominal_gap", 1.0),
    )


def plant_in_run(p: PlantParameters, data: RunData) -> PlantParameters:
    """The plant as it is in a run: where the mover is locked, too heavy for anything to move it; commands that were
    recorded behind the drive's limit are not limited once more, as what reads them makes them larger than they were."""
    if data.mover == "locked":
        p = p._replace(mass=HEAVY * p.mass, end_stop=None)
    if p.drive == CURRENT_DRIVE and data.are_limited(p.current_limit):
        p = p._replace(current_limit=np.inf)
    elif p.drive == VOLTAGE_DRIVE and data.are_limited(p.voltage_limit):
        p = p._replace(voltage_limit=np.inf)
    return p


def plant_of_run(belief: ModelHypothesis, data: RunData) -> KernelPlant:
    """The plant of a belief at a run's rate, with what a second input makes of it there; raises as `kernel_plant`, and
    InputError where that input changes."""
    factors = data.standing(belief.factors)
    return kernel_plant(belief, rate=data.rate, factors=factors, ideal_current=data.ideal_current)


def kernel_plant(
    belief: ModelHypothesis, *, rate: float, factors: Mapping[str, float] | None = None, ideal_current: bool = False,
    commands: Array | None = None,
) -> KernelPlant:  # fmt: skip
    """The plant of a belief whose parameters are further `factors` times the believed ones.

    `commands` (n_sample, n_side) of a voltage drive count in the number of steps. With `ideal_current` the drive of a
    current-driven plant makes its commands without a lag: for records that hold currents and no commands.

    Raises
    ------
    InputError : the actuator lacks a section, or cannot have an effect
    """
    further = factors or {}
    f = dict.fromkeys(BELIEVED, 1.0) | together(belief.factors, further)
    p = plant_parameters(belief.actuator)
    if ideal_current:
        p = p._replace(bandwidth=np.inf)
    substeps = default_substeps(  # as believed: steps that changed with the factors would be jumps of a fit
        p, belief.table, rate=rate, effects=belief.effects, commands=commands, largest_step=STEP_OF_FASTEST
    )
    surface = surface_of(belief.table if p.sides else None)
    p = p._replace(inductance=small_signal_inductance(p, surface))
    p = with_factors(p, f, ideal_current=ideal_current)
    vector = neutral_vector()
    if belief.effects is not None:
        check_effects(p, belief.effects)
        vector = times_factors(belief.effects.vector(), f)
    if f["magnetic_scale"] != 1.0:
        surface = surface._replace(coefficients=surface.coefficients * f["magnetic_scale"])
    effects = None
    if belief.effects is not None:
        inductance = small_signal_inductance(p, surface)
        step = 1.0 / (rate * substeps)
        effects = kernel_coefficients(p, vector, inductance=inductance, step=step, n_step=substeps)
    instruments = {name: value for name, value in f.items() if name in NUISANCES}
    return KernelPlant(surface, p, effects, vector, f["position_gain"], rate, substeps, instruments)
