"""The state of the coupled model: what stands where, and how a run can end."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.compiled import compiled
from msl_fem.coupled_model.plant import FORCE_DRIVE, PlantParameters

Array = NDArray[np.float64]

# What `advance` and `run` return
OK, OUTSIDE_TABLE, NOT_FINITE, OUTSIDE_RANGE = 0, 1, 2, 3

# What Runge-Kutta integrates: currents of the sides (A), position (m), velocity (m/s); energies since the start (J):
# electrical input, copper loss, damping loss, work of forces that are not the plant's own (disturbance, constant force,
# force drive); volt-seconds of the sides since the last call of `advance` began (N s in force drive).
I1, I2, X, V = 0, 1, 2, 3
ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPING, ENERGY_EXTERNAL = 4, 5, 6, 7
VOLT_SECONDS_1, VOLT_SECONDS_2 = 8, 9
N_INTEGRATED = 10
# What is known in closed form over a step: position as its sensor gives it, before noise (m); the drive's outputs
# (V, or N in force drive). Then counts of the calls of `advance` in which a limit of the drive was reached.
SENSOR, OUTPUT_1, OUTPUT_2 = 10, 11, 12
AT_CURRENT_LIMIT_1, AT_CURRENT_LIMIT_2, AT_VOLTAGE_LIMIT_1, AT_VOLTAGE_LIMIT_2 = 13, 14, 15, 16
N_STATE = 17


@compiled
def initial_state(
    parameters: PlantParameters, current_1: float, current_2: float, position: float, velocity: float
) -> Array:
    """The state (N_STATE,) with the sensor settled, drive outputs that hold the currents, energies and counts zero."""
    state = np.zeros(N_STATE)
    state[I1], state[I2], state[X], state[V] = current_1, current_2, position, velocity
    state[SENSOR] = position
    if parameters.drive != FORCE_DRIVE:
        state[OUTPUT_1], state[OUTPUT_2] = parameters.resistance * current_1, parameters.resistance * current_2
    return state
