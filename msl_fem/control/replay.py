"""Recorded currents fed through the believed model, to see whether it reproduces the plant (the paper's Fig. 10).

A free run of the whole model from the currents alone would leave at once: with held currents the mover is unstable over
most of the travel. So the force is the believed one of the recorded currents at the recorded position, and suspension
and mass answer to it:  m x'' + c x' + k x + cubic x^3 = F_1(i_1, g_1(y)) - F_2(i_2, g_2(y)) + F_const.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.statespace import StateSpace
from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.control.design import ControllerDesign
from msl_fem.control.inverse import magnet_force, side_gap, side_surface

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Replay:
    """What the model makes of a run's currents.

    Attributes
    ----------
    position : (n_sample,) m, the model's
    force : (n_sample,) N of the believed magnets; nan outside their table
    nrmse : RMS of position - measured over the standard deviation of measured
    """

    position: Array
    force: Array
    nrmse: float


def replay(design: ControllerDesign, run: ClosedLoopRun) -> Replay:
    """The model's answer to the currents as they were read, from the first sample on.

    Between samples the force runs straight; what it does there is not in the record.
    """
    p, motion = design.parameters, design.belief.motion
    assert motion is not None
    force = np.zeros(run.time.size)
    for side in range(p.inverse.sides):
        surface, toward = side_surface(p.inverse, side), 1.0 - 2.0 * side
        for k in range(run.time.size):
            current = abs(run.current_read[k, side]) * p.inverse.current_share
            gap = side_gap(p.inverse, side, run.measured[k])
            force[k] += toward * p.inverse.magnets * magnet_force(surface, current, gap)
    push = force + p.constant_force - p.cubic * run.measured**3
    a = np.array([[0.0, 1.0], [-design.suspension / p.mass, -p.damping / p.mass]])
    held = StateSpace(a, np.array([[0.0], [1.0 / p.mass]]), np.eye(2), np.zeros((2, 1)))
    moving = held.sampled(float(run.time[1] - run.time[0]))
    state, found = np.array([run.measured[0], 0.0]), np.empty(run.time.size)
    for k in range(run.time.size):
        found[k] = state[0]
        later = push[min(k + 1, run.time.size - 1)]
        state = moving.A @ state + moving.B[:, 0] * 0.5 * (push[k] + later)
    error = found - run.measured
    return Replay(found, force, float(np.sqrt(np.mean(error**2)) / np.std(run.measured)))
