"""A run put to another start on its way, its history kept: what the next stretch of a record begins from."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.plant.layout import ANCHOR_X, COIL_1, COIL_2, HELD, I1, SENSOR, V, X


def restarted(state: Array, kept: Array, starts: Array) -> None:
    """Puts states (N_STATE,) or (N_STATE, LANES) to starts (4,) or (4, LANES): currents, position, velocity.

    Where a state is not finite, a stretch having left table or range, it is taken from `kept`, the states at the begin
    of that stretch. Sensor and friction's memory are moved with the position, for which that is no motion;
    magnetising currents with those of the coils.
    """
    lost = ~np.isfinite(state[X] + state[V] + state[COIL_1] + state[COIL_2])
    state[:] = np.where(lost, kept, state)
    for side in range(2):
        by = starts[side] - state[COIL_1 + side]
        state[I1 + side] += by
        state[COIL_1 + side] += by
    by = starts[2] - state[X]
    state[SENSOR] += by
    state[ANCHOR_X] += by
    state[X] = starts[2]
    state[V] = starts[3]
    state[HELD] = 0.0
