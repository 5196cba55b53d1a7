"""How a run begins: what its effects need of the plant, their coefficients, the first state, the step."""

import math

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import keep, rows_of
from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE, LAGGING, EffectValues, electrical, kernel_coefficients, magnetic
from msl_fem.plant.effects.mechanisms import N_STOP, SUM_OF_WIDTHS
from msl_fem.plant.equations import series_iron
from msl_fem.plant.layout import COIL_1, CORE_1, HEAT_1, HEAT_2, I1, workspace
from msl_fem.plant.plant import VOLTAGE_DRIVE, PlantParameters, Surface, drive_lags
from msl_fem.plant.side import cells_of, side_gap, side_with_effects
from msl_fem.plant.step import look_at
from msl_fem.table.coenergy_surface import CoenergySurface
from msl_fem.table.magnetic_table import MagneticTable

_LACKING = {
    "magnets": "magnets, this plant is a mechanical rig",
    "two sides": "two sides, this plant has one",
    "drive lag": "a drive whose current cannot jump; state drive.bandwidth",
}


def check_effects(plant: PlantParameters, effects: EffectValues) -> None:
    """Returns where the plant can have the effects.

    Raises
    ------
    InputError : an effect needs what the plant has not; names both
    """
    has = {"magnets": plant.sides > 0, "two sides": plant.sides == 2, "drive lag": drive_lags(plant)}
    for name in effects.present:
        for need in CATALOGUE[name].needs:
            if not has[need]:
                raise InputError(f"{name} needs {_LACKING[need]}, or leave the effect out")
    for effect, name in LAGGING:
        if effects.get(effect, name) and not has["drive lag"]:
            raise InputError(f"{effect}.{name} needs {_LACKING['drive lag']}, or leave it out")


def small_signal_inductance(plant: PlantParameters, surface: Surface) -> float:
    """The inductance of a side at the nominal gap without current, in H; 1 for a rig without magnets."""
    if plant.sides == 0:
        return 1.0
    magnet = CoenergySurface(*surface)(np.zeros(1), np.array([plant.nominal_gap]))[:, 0]
    return plant.magnets * plant.current_share**2 * float(magnet[3])


def effect_coefficients(
    plant: PlantParameters, surface: Surface, effects: EffectValues, *, step: float, n_step: int
) -> Array:
    """The kernel's coefficients of a plant with effects; raises as `check_effects` and `kernel_coefficients`."""
    check_effects(plant, effects)
    inductance = small_signal_inductance(plant, surface)
    return kernel_coefficients(plant, effects.vector(), inductance=inductance, step=step, n_step=n_step)


def start_effects(surface: Surface, plant: PlantParameters, coefficients: Array, state: Array) -> None:
    """Puts into a state (N_STATE,) of `initial_state` what effects (N_COEFFICIENT,) add to the beginning.

    The currents have risen from nothing in demagnetised iron, so that its memory takes all it can (of currents beyond
    the reversal's; at smaller ones the first sample errs by a part of the coercive current).
    """
    state[HEAT_1] = state[HEAT_2] = coefficients[electrical.HEAT_START]
    state[CORE_1] = state[CORE_1 + 1] = 0.0
    pinned = coefficients[magnetic.HYSTERESIS_SLOPE] * coefficients[magnetic.HYSTERESIS_WIDTH] * SUM_OF_WIDTHS
    for j in range(2):
        own, other = state[COIL_1 + j], state[COIL_1 + 1 - j]
        state[I1 + j] = own + coefficients[magnetic.SHARE] * other - np.sign(own) * pinned
    if plant.sides and (coefficients[magnetic.IRON_LOW] or coefficients[magnetic.IRON_KNEE]):
        _share(surface, plant._replace(end_stop=None), coefficients, state)


@compiled
def _share(surface: Surface, p: PlantParameters, coefficients: Array, state: Array) -> None:
    """Takes from the magnetising currents of a state what iron in series needs, by bisection: that grows with them."""
    memory = workspace()
    e, rows, work, cells = rows_of(coefficients), rows_of(state), rows_of(memory), cells_of(surface)
    look_at(e, rows, work)
    for j in range(p.sides):
        whole, gap = state[I1 + j], side_gap(p, e, work, j)
        low, high = min(whole, 0.0), max(whole, 0.0)
        for _ in range(80):
            u = 0.5 * (low + high)
            inside, _, _, _, flux, _ = side_with_effects(cells, p, e, work, j, u, gap)
            if not inside or u + series_iron(e, flux) > whole:
                high = u
            else:
                low = u
        state[I1 + j] = 0.5 * (low + high)
    keep(memory)


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
