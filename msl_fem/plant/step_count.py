"""How many Runge-Kutta steps a sample takes: by the rates of currents, excitation, motion and effects.

A step times the fastest rate is at most a stated share. Poles of drive and sensor are exact at any step (`poles.py`)
and count only where a few more steps resolve the current loop, which effects in the circuit want.
"""

import math
import warnings

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import CostWarning, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.effects.expressions import DECLARED, steepest
from msl_fem.plant.effects.mechanisms import N_STOP
from msl_fem.plant.plant import CURRENT_DRIVE, VOLTAGE_DRIVE, PlantParameters, own_stiffness
from msl_fem.plant.poles import FAST
from msl_fem.table.magnetic_table import MagneticTable

STEP_OF_FASTEST = 0.065
MANY_STEPS = 50
"""Steps a sample above which a warning names what asks for them."""
MOST_SUBSTEPS = 100_000
_FEW_STEPS = 12  # that resolve a current loop rather than take it in closed form
_SLOPE = "the slope of the magnets' force over motion.moving_mass"
_FORCE_CONSTANT = "the magnets' force constant over motion.moving_mass"
_DAMPING, _SPRING = "motion.damping over motion.moving_mass", "motion.stiffness over motion.moving_mass"
_LEAST_INDUCTANCE = "drive.coil_resistance over the least inductance"
_EXCITATION = "the largest voltage over the inductance"
_LIMIT = "write drive.current_limit as large as the run needs it, no larger"
_ADVICE = {
    _SLOPE: _LIMIT,
    _FORCE_CONSTANT: _LIMIT,
    _LEAST_INDUCTANCE: _LIMIT,
    _EXCITATION: "write drive.voltage_limit, or a smaller amplitude",
    _DAMPING: "look at motion.damping and motion.moving_mass",
    _SPRING: "look at motion.stiffness and motion.moving_mass",
}
_OF_EFFECT = "write a slower effect, or none"
_CELLS = 1.2  # of the table's current, over which a step error of the excitation is as that of a rate of 1


def plant_rates(
    plant: PlantParameters, table: MagneticTable | None, *, commands: Array | None = None
) -> dict[str, float]:
    """Rates in rad/s that a step has to resolve, by the keys that make them.

    In voltage drive R/L_inc where it is largest, the exchange of energy between coil and mover, dF/di over sqrt(L m),
    and the excitation: how many cells of the table its largest voltage, of `commands` (n_sample, n_side), drives the
    current through in a second; damping over mass; the mover on its spring, and on the slope of the magnets' force at
    the nominal gap, whatever the current.
    """
    rates = {
        _DAMPING: plant.damping / plant.mass,
        _SPRING: math.sqrt(plant.stiffness / plant.mass),
    }
    if table is None or not plant.sides:
        return rates
    reach = table.current <= max(plant.current_limit * plant.current_share, table.current[1])
    magnet = table.evaluate(table.current[reach], plant.nominal_gap)
    slope = plant.magnets * plant.sides * float(np.abs(magnet["force_gap_slope"]).max())
    rates[_SLOPE] = math.sqrt(slope / plant.mass)
    if plant.drive == VOLTAGE_DRIVE:
        linked = plant.magnets * plant.current_share
        inductance = linked * plant.current_share * magnet["incremental_inductance"]
        pull = linked * magnet["force_current_slope"]
        rates[_LEAST_INDUCTANCE] = plant.resistance / float(inductance.min())
        exchange = float((plant.sides * pull**2 / inductance).max())
        rates[_FORCE_CONSTANT] = math.sqrt(exchange / plant.mass)
        if commands is not None:
            cell = _CELLS * float(np.median(np.diff(table.current))) / plant.current_share
            largest = min(float(np.abs(commands).max()), plant.voltage_limit)
            rates[_EXCITATION] = largest / (float(inductance[0]) * cell)
    return rates


def rates_of_effects(plant: PlantParameters, effects: EffectValues) -> dict[str, float]:
    """Rates in rad/s that effects add to those of the plain model, by effect."""
    present = effects.present
    rates: dict[str, float] = {}
    if "structural_mode" in present:
        kept = 1.0 - effects.get("structural_mode", "mass_share")
        rates["structural_mode"] = 2 * math.pi * effects.get("structural_mode", "frequency") / math.sqrt(kept)
    if "support_compliance" in present:
        rates["support_compliance"] = 2 * math.pi * effects.get("support_compliance", "frequency")
    stiffness = plant.stiffness
    if "flexure_relaxation" in present:
        rates["flexure_relaxation"] = 1.0 / effects.get("flexure_relaxation", "time_constant")
        relaxes = effects.get("flexure_relaxation", "strength") + effects.get("flexure_relaxation", "slow_strength")
        stiffness += relaxes * own_stiffness(plant)
    if "coulomb_friction" in present:
        friction, of_stops = _friction_rate(plant, effects)
        stiffness += of_stops
        rates["coulomb_friction"] = max(friction, math.sqrt(stiffness / plant.mass))
    if "periodic_disturbance" in present:
        turns = 2 * math.pi * effects.get("periodic_disturbance", "frequency")
        third = any(effects.get("periodic_disturbance", name) != 0 for name in ("third_cosine", "third_sine"))
        rates["periodic_disturbance"] = 3 * turns if third else turns
    for one in DECLARED.values():
        if one.effect in present and one.equation == "force":
            slopes = steepest(one, plant, {p.name: effects.get(one.effect, p.name) for p in one.parameters})
            sprung = math.sqrt((plant.stiffness + slopes.get("x", 0.0)) / plant.mass)
            rates[one.effect] = max(slopes.get("v", 0.0) / plant.mass, sprung)
    rates["motion.stiffness with the effects over motion.moving_mass"] = math.sqrt(stiffness / plant.mass)
    return rates


def _friction_rate(plant: PlantParameters, effects: EffectValues) -> tuple[float, float]:
    """Of coulomb_friction the slope over the velocity over the mass, in 1/s, and the stiffness of its stops, N/m."""
    force, transition = (effects.get("coulomb_friction", name) for name in ("force", "transition_velocity"))
    if transition > 0.0:
        rise = effects.get("coulomb_friction", "stribeck_rise")
        return force * (1.0 + rise) / (transition * plant.mass), 0.0
    return 0.0, 2 * N_STOP / (N_STOP + 1) * force / effects.get("coulomb_friction", "presliding")


def _resistance_of_laws(plant: PlantParameters, effects: EffectValues) -> float:
    """The largest slope over the current, in ohm, of users' laws of voltage."""
    total = 0.0
    for one in DECLARED.values():
        if one.equation == "voltage" and one.effect in effects.present:
            slopes = steepest(one, plant, {p.name: effects.get(one.effect, p.name) for p in one.parameters})
            total += slopes.get("i", 0.0)
    return total


def fastest_rate(plant: PlantParameters, table: MagneticTable | None) -> float:
    """The fastest rate in rad/s of the plain model, its current loop's among them, for integrators of other tools."""
    loop = plant.drive == CURRENT_DRIVE and math.isfinite(plant.bandwidth)
    drive = plant.bandwidth if loop else 0.0
    return max(drive, *plant_rates(plant, table).values())


def default_substeps(
    plant: PlantParameters,
    table: MagneticTable | None,
    *,
    rate: float,
    effects: EffectValues | None = None,
    commands: Array | None = None,
    largest_step: float = STEP_OF_FASTEST,
) -> int:
    """Runge-Kutta steps a sample such that a step times the fastest rate is at most `largest_step`.

    At the default, position and currents are within 1e-7 of full scale of an adaptive reference, the energy ledger
    within 1e-6. A sample in which the voltage limit begins or ceases to act can leave 1e-4 of full scale in its current
    and voltage, see `step.py`; the current loop forgets it. `commands` (n_sample, n_side) are those of a voltage drive.

    A current loop that at most 12 steps resolve is resolved; a faster one is taken in closed form. That holds for
    commands that change between steps: one that comes late, and changes within a step, has a loop that 50 steps resolve
    resolved, or else integrated by as many as it takes; beyond 50 currents err by up to some per cent of the change.

    Raises
    ------
    InputError : more than `MOST_SUBSTEPS`: no run would come to an end
    """
    rates = plant_rates(plant, table, commands=commands)
    if effects is not None:
        rates |= rates_of_effects(plant, effects)
        if _LEAST_INDUCTANCE in rates:
            rates[_LEAST_INDUCTANCE] *= 1.0 + _resistance_of_laws(plant, effects) / plant.resistance
    steps = steps_a_sample(rates, rate=rate, largest_step=largest_step)
    if plant.drive != CURRENT_DRIVE or not math.isfinite(plant.bandwidth):
        return steps
    resolved = math.ceil(plant.bandwidth / (rate * largest_step) - 1e-9)
    if effects is not None and effects.get("time_delay", "command") > 0:
        integrated = math.floor(plant.bandwidth / (rate * FAST)) + 1
        return max(steps, next((few for few in (resolved, integrated) if few <= MANY_STEPS), steps))
    fast = plant.bandwidth / (rate * steps) > FAST
    return steps if fast and resolved > _FEW_STEPS else max(steps, resolved)


def steps_a_sample(rates: dict[str, float], *, rate: float, largest_step: float) -> int:
    """Steps a sample such that a step times the fastest of `rates` (rad/s) is at most `largest_step`.

    More than `MANY_STEPS` are a `CostWarning` that names the key.

    Raises
    ------
    InputError : more than `MOST_SUBSTEPS`: no run would come to an end
    """
    key, fastest = max(rates.items(), key=lambda item: item[1])
    steps = fastest / (rate * largest_step)
    sampling = format_quantity(rate, "Hz")
    if not steps <= MOST_SUBSTEPS:
        raise InputError(
            f"{key} makes {fastest:.3g} rad/s, which needs {steps:.3g} steps a sample at {sampling}; at most "
            f"{MOST_SUBSTEPS} are taken: write it as it is, leave it out, or sample faster"
        )
    if steps > MANY_STEPS:
        warnings.warn(
            f"{key} makes {fastest:.3g} rad/s, so each sample at {sampling} takes {math.ceil(steps)} steps, usual are "
            f"{MANY_STEPS} at most; {_ADVICE.get(key, _OF_EFFECT)}, or sample faster than "
            f"{format_quantity(rate * steps / MANY_STEPS, 'Hz', digits=3)}",
            CostWarning,
            stacklevel=2,
        )
    return max(1, math.ceil(steps - 1e-9))
