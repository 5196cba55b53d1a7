"""Where the mover will be when a command acts: the believed plant moved on from what is estimated and under way.

A command acts by delay, half the hold and the drive's lag later, and the currents are to fit the gap of then. Until
then the mover goes on with its velocity, under the disturbance, the drive's force, the commands that wait and the one
that is computed now (the prediction of a plant with delay: Smith, Chem. Eng. Prog. 53, 1957; Astrom and Wittenmark,
Computer-Controlled Systems, 3rd ed., sec. 12.2).
"""

from functools import lru_cache

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.linear_plant import LinearPlant

_NOTHING = 1e-12  # of a period


@lru_cache(maxsize=256)
def position_after(plant: LinearPlant, lead: float) -> Array:
    """(n + 2,) the position `lead` s on, over position, velocity, disturbance, the further states, the command of now.

    The further states are those of `LinearPlant.sampled` from the third on; the last command is held.
    """
    a, b = plant.motion()
    n_motion = a.shape[0]
    n_row = plant.sampled().A.shape[0] + 2
    push = np.eye(n_motion)[1] / plant.mass
    rows = np.eye(n_row)
    moved = rows[[0, 1, 3][:n_motion]]  # the third entry is the disturbance
    disturbance = rows[2]
    inputs = rows[n_motion + 1 :]  # the queue, the next to act first, then the command of now
    left = lead
    for held in (*inputs, *[inputs[-1]] * int(lead / plant.period + 1)):
        step = min(left, plant.period)
        if step <= _NOTHING * plant.period:
            break
        both = StateSpace(a, np.column_stack([b[:, 0], push]), np.eye(n_motion), np.zeros((n_motion, 2))).sampled(step)
        moved = both.A @ moved + np.outer(both.B[:, 0], held) + np.outer(both.B[:, 1], disturbance)
        left -= step
    return np.ascontiguousarray(moved[0])
