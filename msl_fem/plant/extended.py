"""A plant with effects: what they need, and their coefficients for a run."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.plant.effects import CATALOGUE, EffectValues, kernel_coefficients
from msl_fem.plant.plant import PlantParameters, Surface, drive_lags
from msl_fem.table.coenergy_surface import CoenergySurface

Array = NDArray[np.float64]

LAGGING = (("time_delay", "command"), ("early_saturation", "low_field_current"), ("early_saturation", "knee_excess"))
"""Parameters that need a drive whose current cannot jump, of effects that do without."""
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
