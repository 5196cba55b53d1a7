"""What a fit found, in SI units with intervals, and the model that other commands take."""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.problem import FitProblem
from msl_fem.diagnosis.table_error import corrected, scaled
from msl_fem.diagnosis.unknowns import EffectUnknown, factor
from msl_fem.plant.effects import PARAMETER_INDEX, EffectValues, find_parameter, from_vector
from msl_fem.prediction import ModelHypothesis
from msl_fem.prediction.hypothesis import believed_value
from msl_fem.prediction.nuisances import ADDITIVE, NUISANCES, together
from msl_fem.prediction.scheduling import LEVEL

INTERVAL = 1.96
STEP_OF_SLOPES = 1e-4
_READ = (
    ("position_sensor_nonlinearity", "quadratic"),
    ("position_sensor_nonlinearity", "cubic"),
    ("sensor_drift", "rate"),
    ("sensor_drift", "acceleration"),
    ("sensor_drift", "jerk"),
    ("sensor_drift", "offset"),
    ("position_sensor_crosstalk", "per_current_1"),
    ("position_sensor_crosstalk", "per_current_2"),
    ("periodic_disturbance", "position_cosine"),
    ("periodic_disturbance", "position_sine"),
)


@dataclass(frozen=True)
class Estimate:
    """A fitted number in SI units with its 95 % interval; `tolerances` is how many of its own a believed one moved."""

    value: float
    low: float
    high: float
    believed: float | None = None
    tolerances: float | None = None


def extended_belief(belief: ModelHypothesis, problem: FitProblem, found: Fit) -> ModelHypothesis:
    """The belief with everything at its fitted value: what other commands take as the model.

    The sensor's gain becomes an error of the reading, the scale of the magnets and the table's error a table. A fit
    that lacks a cause may have a gain that no sensor has: it is there to be compared with, held at the nearest allowed.
    """
    factors = found.unknowns.factors(found.z)
    table = belief.table
    scale = factors.get("magnetic_scale", 1.0)
    if table is not None and problem.table_error is not None:
        table = corrected(table, problem.table_error, found.z[found.unknowns.table_rows], scale=scale)
    elif table is not None and scale != 1.0:
        table = scaled(table, scale)
    vector = found.unknowns.effect_vector(found.z)
    gain = factors.get("position_gain", 1.0)
    place = PARAMETER_INDEX["position_sensor_nonlinearity", "gain_error"]
    vector[place] = gain * (1.0 + vector[place]) - 1.0
    for key in _READ:
        vector[PARAMETER_INDEX[key]] *= gain
    for key in (("position_sensor_nonlinearity", "gain_error"), *_READ):
        vector[PARAMETER_INDEX[key]] = np.clip(vector[PARAMETER_INDEX[key]], *find_parameter(*key).allowed)
    instruments = together(belief.factors, {n: v for n, v in factors.items() if n in NUISANCES or LEVEL in n})
    kept = {name: value for name, value in instruments.items() if name in NUISANCES or LEVEL in name}
    return ModelHypothesis(fitted_actuator(belief.actuator, factors), table, effects_present(vector), kept)


def effects_present(vector: Array) -> EffectValues | None:
    """The effects that are there; shapes alone are none."""
    every = from_vector(vector)
    present = {name: every.stated[name] for name in every.present}
    return EffectValues(present) if present else None


def fitted_actuator(actuator: Actuator, factors: dict[str, float]) -> Actuator:
    """The actuator with believed parameters times these factors."""
    motion, drive = actuator.motion, actuator.drive
    assert motion is not None
    assert drive is not None
    changed: dict[str, float | None] = {
        name: value * factors.get(name, 1.0)
        for name in ("moving_mass", "stiffness", "damping", "nominal_gap")
        if (value := getattr(motion, name)) is not None
    }
    if motion.flexure is not None and "stiffness" in factors:
        changed["flexure"] = None  # its stiffness is no longer what its leaves say
    update: dict[str, object] = {"motion": motion.model_copy(update=changed)}
    if "coil_resistance" in factors:
        resistance = actuator.coil_resistance() * factors["coil_resistance"]
        update["drive"] = drive.model_copy(update={"coil_resistance": resistance})
    return actuator.model_copy(update=update)


def believed_estimates(belief: ModelHypothesis, found: Fit) -> dict[str, Estimate]:
    """The believed parameters after a fit."""
    error = found.likelihood.standard_errors(found)
    made = {}
    for n, (name, sigma) in enumerate(found.unknowns.believed):
        if LEVEL in name:
            continue
        z, value = float(found.z[n]), believed_value(belief, name)
        at = [z + k * INTERVAL * error[n] for k in (-1, 0, 1)]
        low, middle, high = (value + sigma * a if name in ADDITIVE else value * factor(sigma, a) for a in at)
        low, high = sorted((low, high))  # a value below zero falls as its factor grows
        made[name] = Estimate(middle, low, high, believed=value, tolerances=z)
    return made


def effect_estimates(found: Fit) -> dict[str, dict[str, Estimate]]:
    """The parameters of the effects of a fit, by effect and name."""
    error = found.likelihood.standard_errors(found)
    made: dict[str, dict[str, Estimate]] = {}
    for n, one in enumerate(found.unknowns.effects):
        row = found.unknowns.n_nuisance + n
        if find_parameter(one.effect, one.name).root_of:
            low, value, high = _interval_beside_shape(found, one)
        else:
            low, value, high = _interval(one, float(found.z[row]), INTERVAL * float(error[row]))
        made.setdefault(one.effect, {})[one.name] = Estimate(value, low, high)
    return made


def _interval(one: EffectUnknown, z: float, half: float) -> tuple[float, float, float]:
    low, value, high = (float(one.value(np.array(z + k * half))) for k in (-1, 0, 1))
    return low, value, high


def _interval_beside_shape(found: Fit, one: EffectUnknown) -> tuple[float, float, float]:
    """Of an amount that goes with a shape: by the slopes of its value."""
    rows = found.z + STEP_OF_SLOPES * np.eye(found.z.size)
    value, *moved = (float(found.unknowns.effect_vector(z)[one.place]) for z in (found.z, *rows))
    slopes = (np.array(moved) - value) / STEP_OF_SLOPES
    half = INTERVAL * float(found.likelihood.standard_errors(found, slopes[None])[0])
    low, high = find_parameter(one.effect, one.name).allowed
    return max(value - half, low), value, min(value + half, high)


def unit_of(effect: str, name: str) -> str:
    return find_parameter(effect, name).unit
