"""The fixed step of a run, from the plant's fastest rate."""

import math

import numpy as np

from msl_fem.errors import InputError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.effects.mechanisms import N_STOP
from msl_fem.plant.plant import VOLTAGE_DRIVE, PlantParameters
from msl_fem.table.magnetic_table import MagneticTable

STEP_OF_FASTEST = 0.065
MOST_SUBSTEPS = 100_000


def fastest_rate(plant: PlantParameters, table: MagneticTable | None) -> float:
    """The fastest rate in rad/s that the step has to resolve.

    The drive's bandwidth; in voltage drive R/L_inc where it is largest; the mover on its spring, and on the slope of
    the magnets' force at the nominal gap, whatever the current. The position sensor is exact at any step.
    """
    rates = [plant.bandwidth] if math.isfinite(plant.bandwidth) else []
    stiffness = plant.stiffness
    if table is not None and plant.sides:
        reach = table.current <= max(plant.current_limit * plant.current_share, table.current[1])
        magnet = table.evaluate(table.current[reach], plant.nominal_gap)
        stiffness = max(stiffness, plant.magnets * plant.sides * float(np.abs(magnet["force_gap_slope"]).max()))
        if plant.drive == VOLTAGE_DRIVE:
            inductance = plant.magnets * plant.current_share**2 * float(magnet["incremental_inductance"].min())
            rates.append(plant.resistance / inductance)
    rates += [math.sqrt(stiffness / plant.mass), plant.damping / plant.mass]
    return max(rates)


def fastest_rate_of_effects(plant: PlantParameters, effects: EffectValues) -> float:
    """The fastest rate in rad/s that effects add to those of the plain model; 0 where they add none."""
    present, rates = effects.present, [0.0]
    if "amplifier_bandwidth" in present and math.isfinite(plant.bandwidth):
        rates.append(plant.bandwidth * (1.0 + effects.get("amplifier_bandwidth", "bandwidth_error")))
    if "structural_mode" in present:
        kept = 1.0 - effects.get("structural_mode", "mass_share")
        rates.append(2 * math.pi * effects.get("structural_mode", "frequency") / math.sqrt(kept))
    if "support_compliance" in present:
        rates.append(2 * math.pi * effects.get("support_compliance", "frequency"))
    stiffness = plant.stiffness
    if "flexure_relaxation" in present:
        rates.append(1.0 / effects.get("flexure_relaxation", "time_constant"))
        stiffness *= 1.0 + effects.get("flexure_relaxation", "strength")
    if "coulomb_friction" in present:
        friction = effects.get("coulomb_friction", "force") / effects.get("coulomb_friction", "presliding")
        stiffness += 2 * N_STOP / (N_STOP + 1) * friction
    rates.append(math.sqrt(stiffness / plant.mass))
    if "periodic_disturbance" in present:
        rates.append(2 * math.pi * effects.get("periodic_disturbance", "frequency"))
    return max(rates)


def default_substeps(
    plant: PlantParameters, table: MagneticTable | None, *, rate: float, effects: EffectValues | None = None
) -> int:
    """Runge-Kutta steps a sample such that a step times the fastest rate is at most 0.065.

    For the reference actuator at 10 kHz these are 10 steps: position and currents within 1e-7 of full scale of an
    adaptive reference, the energy ledger within 1e-6. A sample in which the voltage limit begins or ceases to act can
    leave 1e-4 of full scale in its current and voltage, see `kernel.py`; the current loop forgets it.
    """
    fastest = fastest_rate(plant, table)
    if effects is not None:
        fastest = max(fastest, fastest_rate_of_effects(plant, effects))
    return steps_a_sample(fastest, rate=rate, largest_step=STEP_OF_FASTEST)


def steps_a_sample(fastest: float, *, rate: float, largest_step: float) -> int:
    """Steps a sample such that a step times the fastest rate (rad/s) is at most `largest_step`.

    Raises
    ------
    InputError : more than `MOST_SUBSTEPS`: no run would come to an end
    """
    wanted = fastest / (rate * largest_step)
    if not wanted <= MOST_SUBSTEPS:
        raise InputError(
            f"the fastest rate, {fastest:.3g} rad/s, needs {wanted:.3g} steps a sample at {rate:g} samples a second; "
            f"at most {MOST_SUBSTEPS} are taken: look at mass, stiffness, damping, bandwidth and the table, or sample "
            "faster"
        )
    return max(1, math.ceil(wanted - 1e-9))
