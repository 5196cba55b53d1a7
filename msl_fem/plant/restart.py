"""A run put to another start on its way, its history kept: what the next stretch of a record begins from."""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.plant.effects.electrical import N_QUEUE
from msl_fem.plant.layout import (
    ANCHOR_X,
    COIL_1,
    COIL_2,
    HELD,
    I1,
    LAG_1,
    LAG_2,
    N_STATE,
    OUTPUT_1,
    OUTPUT_2,
    PHASE_COSINE,
    PHASE_SINE,
    QUEUE_1,
    QUEUE_2,
    SENSOR,
    SLEW_1,
    SLEW_2,
    V,
    X,
)

_OF_TIME = np.zeros(N_STATE, dtype=bool)
"""Rows that time and commands alone move."""
_OF_TIME[[PHASE_COSINE, PHASE_SINE, OUTPUT_1, OUTPUT_2, SLEW_1, SLEW_2, LAG_1, LAG_2]] = True
for _begin in (QUEUE_1, QUEUE_2):
    _OF_TIME[_begin : _begin + N_QUEUE + 1] = True


def restarted(state: Array, kept: Array, starts: Array) -> None:
    """Puts states (N_STATE,) or (N_STATE, LANES) to starts (4,) or (4, LANES): currents, position, velocity.

    Where a stretch has left table or range, its state is taken from `kept`, the states at the begin of that stretch;
    phases and commands that wait have gone on. Sensor and friction's memory are moved with the position, for which that
    is no motion; magnetising currents with those of the coils.
    """
    lost = ~np.isfinite(state[X] + state[V] + state[COIL_1] + state[COIL_2])
    of_time = (_OF_TIME if state.ndim == 1 else _OF_TIME[:, None]) & np.isfinite(state)
    state[:] = np.where(lost & ~of_time, kept, state)
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
