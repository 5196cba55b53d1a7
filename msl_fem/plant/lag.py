"""A first-order lag over one step, exact in time: no bandwidth, however high, limits the integrator's step."""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows


@compiled
def lag_weights(bandwidth: float, step: float, rows: Rows, start: int) -> None:
    """Puts the weights of (y0, x0, x0', x1, x1') in y1 into five rows from `start`; y' = w (x - y), x a cubic between.

    With z = w step and I_k = z int_0^1 exp(-z (1 - s)) s^k ds: y1 = exp(-z) y0 + sum over Hermite's basis, whose
    powers of s give I_0 ... I_3. I_0 = 1 - exp(-z); by parts I_k = 1 - k I_(k-1)/z, run upwards for z > 1 and
    downwards from I_20 = 0 below, where the upward recursion cancels. An infinite bandwidth gives y1 = x1.
    """
    z = bandwidth * step
    decay = np.exp(-z)
    if z > 1.0:
        i_0 = 1.0 - decay
        i_1 = 1.0 - i_0 / z
        i_2 = 1.0 - 2.0 * i_1 / z
        i_3 = 1.0 - 3.0 * i_2 / z
    else:
        i_k = 0.0
        for k in range(20, 3, -1):
            i_k = z / k * (1.0 - i_k)
        i_3 = i_k
        i_2 = z / 3.0 * (1.0 - i_3)
        i_1 = z / 2.0 * (1.0 - i_2)
        i_0 = z * (1.0 - i_1)
    rows[start] = decay
    rows[start + 1] = i_0 - 3.0 * i_2 + 2.0 * i_3
    rows[start + 2] = step * (i_1 - 2.0 * i_2 + i_3)
    rows[start + 3] = 3.0 * i_2 - 2.0 * i_3
    rows[start + 4] = step * (i_3 - i_2)
