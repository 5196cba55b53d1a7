"""A run put to another start on its way, its history kept: what the next stretch of a record begins from."""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, choose
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


@compiled
def restart(state: Rows, kept: Rows, starts: Rows) -> None:
    """Puts a state (N_STATE rows) to a start (4 rows): currents, position, velocity.

    Where a stretch has left table or range, its state is taken from `kept`, the state at the begin of that stretch;
    phases and commands that wait have gone on. Sensor and friction's memory are moved with the position, for which that
    is no motion; magnetising currents with those of the coils.
    """
    known = state[X] + state[V] + state[COIL_1] + state[COIL_2]
    stands = known - known == 0.0
    for n in range(N_STATE):
        value = choose(stands, state[n], kept[n])
        if _OF_TIME[n]:
            value = choose(state[n] - state[n] == 0.0, state[n], value)
        state[n] = value
    for side in range(2):
        by = starts[side] - state[COIL_1 + side]
        state[I1 + side] = state[I1 + side] + by
        state[COIL_1 + side] = state[COIL_1 + side] + by
    by = starts[2] - state[X]
    state[SENSOR] = state[SENSOR] + by
    state[ANCHOR_X] = state[ANCHOR_X] + by
    state[X] = starts[2]
    state[V] = starts[3]
    state[HELD] = 0.0
