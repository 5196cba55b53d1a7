"""How a run begins: what its effects need of the plant, their coefficients, the first state."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, keep, rows_of, size
from msl_fem.errors import InputError
from msl_fem.plant.effects import (
    CATALOGUE,
    LAGGING,
    EffectValues,
    electrical,
    kernel_coefficients,
    magnetic,
    sensing,
    stray_flux,
    thermal,
)
from msl_fem.plant.effects.expressions import LAWS
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.effects.mechanisms import N_IRON_STOP
from msl_fem.plant.equations import remanence, series_iron
from msl_fem.plant.layout import COIL_1, COIL_READING, CORE_1, HEAT_1, I1, SENSOR, workspace
from msl_fem.plant.plant import PlantParameters, Surface, drive_lags
from msl_fem.plant.side import Cells, cells_of, side_gap, side_with_effects
from msl_fem.plant.step import look_at
from msl_fem.plant.user_laws import begin_reading
from msl_fem.table.coenergy_surface import CoenergySurface

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
    magnet = CoenergySurface(*surface[:3])(np.zeros(1), np.array([plant.nominal_gap]))[:, 0]
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
    begin_effects(coefficients, state)
    if plant.sides and _depends_on_flux(coefficients):
        _share(surface, plant._replace(end_stop=None), coefficients, state)
    if coefficients[LAWS]:
        begin_reading(plant._replace(end_stop=None), coefficients, state)


def _depends_on_flux(e: Array) -> bool:
    """Whether what the iron takes of a current at the start is another at another flux."""
    fading = e[stray_flux.REMANENCE_FADES] * (abs(e[stray_flux.REMANENT_1]) + abs(e[stray_flux.REMANENT_2]))
    bends = e[magnetic.IRON_LOW] or e[magnetic.IRON_KNEE] or e[magnetic.HYSTERESIS_STRETCH]
    return bool(bends or fading or _missing(e))


@compiled
def _missing(e: Rows) -> float:
    """The current (A) over the flux linkage (Wb) of a run's begin that eddy currents take there."""
    missing = 0.0
    for k in range(N_EDDY):
        missing = missing + e[magnetic.EDDY_MODE + k] * e[magnetic.EDDY_MISSED + k]
    return missing


def begin_effects(e: Array, state: Array) -> None:
    """Heat, and currents of iron that has a memory, into a state of `initial_state`; iron in series is left out."""
    for j in range(2):
        state[HEAT_1 + j] = e[electrical.HEAT_START] + e[thermal.RISE_1 + j]
        state[CORE_1 + j] = e[thermal.CORE_RISE]
    pinned = coercive_current(e)
    for j in range(2):
        own, other = state[COIL_1 + j], state[COIL_1 + 1 - j]
        kept = e[stray_flux.REMANENT_1 + j]
        state[I1 + j] = own + e[magnetic.SHARE] * other - np.sign(own) * pinned + kept
    read = e[sensing.COIL_READING_1] * state[I1] + e[sensing.COIL_READING_2] * state[I1 + 1]
    state[COIL_READING] = read
    state[SENSOR] += read


@compiled
def coercive_current(e: Rows) -> float:
    """What all stops of an iron's memory take of a current, in A, at small flux."""
    pinned = 0.0
    for k in range(N_IRON_STOP):
        pinned = pinned + e[magnetic.HYSTERESIS_SLOPE + k] * e[magnetic.HYSTERESIS_WIDTH + k]
    return pinned


@compiled
def _share(surface: Surface, p: PlantParameters, coefficients: Array, state: Array) -> None:
    memory = workspace()
    share_with_iron(cells_of(surface), p, rows_of(coefficients), rows_of(state), rows_of(memory))
    keep(memory)


@compiled
def share_with_iron(cells: Cells, p: PlantParameters, e: Rows, rows: Rows, work: Rows) -> None:
    """Takes from the magnetising currents of a state what iron in series needs, its memory at that flux beyond the
    coercive current, what is gone of its remanence, and eddy currents that have not faded, by bisection: all grow with
    them."""
    look_at(e, rows, work)
    missing = _missing(e)
    widening = 3.0 * e[magnetic.HYSTERESIS_STRETCH] * coercive_current(e)
    for j in range(p.sides):
        whole, gap = rows[I1 + j], side_gap(p, e, work, j)
        kept = e[stray_flux.REMANENT_1 + j]
        low, high = min(whole, 0.0) - size(kept), max(whole, 0.0) + size(kept)
        for _ in range(80):
            u = 0.5 * (low + high)
            inside, _, _, _, flux, _ = side_with_effects(cells, p, e, work, j, u, gap)
            needed = series_iron(e, flux) + widening * flux * size(flux) + (kept - remanence(e, j, flux))
            needed = needed + missing * flux
            if not inside or u + needed > whole:
                high = u
            else:
                low = u
        rows[I1 + j] = 0.5 * (low + high)
