"""The array that the compiled kernel works on beside the state, and what stands where in it.

One array of rows, since compiled code passes it on as one argument and never counts references to parts of it.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import LANES
from msl_fem.plant.cell import N_BLOCK
from msl_fem.plant.state import N_INTEGRATED

Array = NDArray[np.float64]

# The cells of both sides, the four slopes of Runge-Kutta, the integrated states at which slopes are taken
BLOCKS = 0
SLOPES = BLOCKS + 2 * N_BLOCK
Y = SLOPES + 4 * N_INTEGRATED
# What acts on the plant at begin, middle and end of a step: what a current loop aims at (A), what a voltage or force
# drive gives (V, N), forces from outside (N)
INPUTS = Y + N_INTEGRATED
TARGET_1, TARGET_2, OUTPUT_OF_1, OUTPUT_OF_2, PUSH = range(5)
N_INPUT = 5
# Whether a side met its voltage limit (0 or 1); commands of the call, clipped, and those before them; where amplifier
# and periodic disturbance stand at the end of a step
LIMITED_1 = INPUTS + 3 * N_INPUT
COMMAND_1, FORMER_1 = LIMITED_1 + 2, LIMITED_1 + 4
SLEW_END_1, LAG_END_1, PHASE_COSINE_END, PHASE_SINE_END = (LIMITED_1 + n for n in (6, 8, 10, 11))
# Weights of the position sensor's lag over a step (`lag_weights`), what is left of the drive's after half and a whole
SENSOR_WEIGHTS = LIMITED_1 + 12
DRIVE_HALF, DRIVE_WHOLE = SENSOR_WEIGHTS + 5, SENSOR_WEIGHTS + 6
# A side's circuit: incremental inductance (H), back-EMF (V), magnetising current with memory and eddy part (A),
# resistance (ohm); then what `solve_circuits` finds: du/dt (A/s), voltage (V), current of the coil (A); loss of the
# modes of the eddy currents (W)
CIRCUITS = DRIVE_WHOLE + 1
INDUCTANCE, EMF, MMF, RESISTANCE, SLOPE, VOLTAGE, COIL_CURRENT, MODE_LOSS = range(8)
N_CIRCUIT = 8
CIRCUIT_1, CIRCUIT_2 = CIRCUITS, CIRCUITS + N_CIRCUIT
# Cells of both sides at either end of a face that is not parallel: side 1's lower and upper gap, then side 2's
TILTED = CIRCUITS + 2 * N_CIRCUIT
N_WORK = TILTED + 4 * N_BLOCK


@compiled
def workspace() -> Array:
    """Rows for one run."""
    work = np.zeros(N_WORK)
    work[CIRCUIT_2 + INDUCTANCE] = 1.0  # of a side that is not there
    return work


@compiled
def lane_workspace() -> Array:
    """Rows for `LANES` runs."""
    work = np.zeros((N_WORK, LANES))
    work[CIRCUIT_2 + INDUCTANCE] = 1.0
    return work
