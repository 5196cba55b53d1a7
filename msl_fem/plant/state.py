"""The state of the coupled model: what stands where, and how a run can end."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.plant.coefficients import N_EDDY, N_QUEUE, N_STOP
from msl_fem.plant.plant import FORCE_DRIVE, PlantParameters

Array = NDArray[np.float64]

# What `advance` and `run` return
OK, OUTSIDE_TABLE, NOT_FINITE, OUTSIDE_RANGE = 0, 1, 2, 3

# What Runge-Kutta integrates: magnetising currents of the sides (A; the coils' own without hysteresis and eddy
# currents), position (m), velocity (m/s); energies since the start (J): electrical input, copper loss, damping loss
# (and film), work of forces that are not the plant's own (disturbance, constant force, force drive); volt-seconds of
# the sides since the last call of `advance` began (N s in force drive).
I1, I2, X, V = 0, 1, 2, 3
ENERGY_ELECTRICAL, ENERGY_COPPER, ENERGY_DAMPING, ENERGY_EXTERNAL = 4, 5, 6, 7
VOLT_SECONDS_1, VOLT_SECONDS_2 = 8, 9
N_PLAIN = 10
# With effects also: relative rise of the sides' resistances; the relaxed length of the flexure (m); second mass against
# the armature (m, m/s); force that the base has given way to (N, N/s); losses of eddy currents, and of flexure, second
# mass and base (J)
HEAT_1, HEAT_2, CREEP, MODE, MODE_RATE, BASE, BASE_RATE, ENERGY_EDDY, ENERGY_INTERNAL = range(10, 19)
# Relative rise that the core's temperature stands for, of the sides
CORE_1 = 19
# Flux linkages that the modes of the eddy currents follow (Wb), of side 1, then of side 2; the last, since without
# eddy currents in sheets they are not integrated
EDDY_FLUX_1 = CORE_1 + 2
N_INTEGRATED = EDDY_FLUX_1 + 2 * N_EDDY
# What is known in closed form over a step: position as its sensor gives it, before noise (m); the drive's outputs
# (V, or N in force drive). Then counts of the calls of `advance` in which a limit of the drive was reached.
SENSOR, OUTPUT_1, OUTPUT_2 = range(N_INTEGRATED, N_INTEGRATED + 3)
AT_CURRENT_LIMIT_1, AT_CURRENT_LIMIT_2, AT_VOLTAGE_LIMIT_1, AT_VOLTAGE_LIMIT_2 = range(OUTPUT_2 + 1, OUTPUT_2 + 5)
# The end stop that the mover lies on (-1, 0, 1), energy lost at end stops (J)
HELD, ENERGY_IMPACT = AT_VOLTAGE_LIMIT_2 + 1, AT_VOLTAGE_LIMIT_2 + 2
# Currents of the coils (A) and their slopes (A/s) behind the last step and within the first one of the last call
COIL_1, COIL_2, COIL_SLOPE_1, COIL_SLOPE_2, COIL_START_1, COIL_START_2 = range(ENERGY_IMPACT + 1, ENERGY_IMPACT + 7)
# The amplifier: command behind its slew limit, behind its lag
SLEW_1, SLEW_2, LAG_1, LAG_2 = range(COIL_START_2 + 1, COIL_START_2 + 5)
# Phase of the periodic disturbance
PHASE_COSINE, PHASE_SINE = LAG_2 + 1, LAG_2 + 2
# Memory: where the stops stand that follow (Wb, Wb, m), losses of hysteresis and friction (J), whether the eddy
# currents have settled at the start (0 before the first evaluation), then the stops
ANCHOR_1, ANCHOR_2, ANCHOR_X, ENERGY_HYSTERESIS, ENERGY_FRICTION, ANCHORED = range(PHASE_SINE + 1, PHASE_SINE + 7)
STOPS_1 = ANCHORED + 1
STOPS_2, STOPS_X = STOPS_1 + N_STOP, STOPS_1 + 2 * N_STOP
# Commands that have not acted yet, the latest first, of side 1 and of side 2
QUEUE_1 = STOPS_1 + 3 * N_STOP
QUEUE_2 = QUEUE_1 + N_QUEUE + 1
N_STATE = QUEUE_2 + N_QUEUE + 1


def initial_state(
    parameters: PlantParameters, current_1: float, current_2: float, position: float, velocity: float
) -> Array:
    """The state (N_STATE,) with the sensor settled, drive outputs that hold the currents, energies and counts zero.

    The iron was demagnetised before the currents rose to these, the flexure is relaxed at its present length, all else
    that effects bring at rest.
    """
    state = np.zeros(N_STATE)
    state[I1], state[I2], state[X], state[V] = current_1, current_2, position, velocity
    state[COIL_1], state[COIL_2] = current_1, current_2
    state[SENSOR] = state[CREEP] = state[ANCHOR_X] = position
    state[PHASE_COSINE] = 1.0
    held = parameters.drive != FORCE_DRIVE
    for j in range(2):
        current = state[I1 + j]
        state[OUTPUT_1 + j] = parameters.resistance * current if held else 0.0
        hold = current if parameters.drive == 0 else state[OUTPUT_1 + j]
        state[SLEW_1 + j] = state[LAG_1 + j] = hold
        state[QUEUE_1 + j * (N_QUEUE + 1) : QUEUE_1 + (j + 1) * (N_QUEUE + 1)] = hold
    return state
