"""First-order lags of the sensor's electronics over one step, from values and slopes at its two ends."""

import numpy as np

from msl_fem.computing.compiled import compiled


@compiled
def lagged(rate: float, step: float, before: float, x0: float, d0: float, x1: float, d1: float) -> float:
    """y at the end of a step (s), where y' = rate (x - y), y = `before` at its start, x the cubic of its end slopes.

    A polynomial input has the particular answer p = x - x'/w + x''/w^2 - x'''/w^3, so y1 = p1 + exp(-w h)(y0 - p0). An
    endless rate gives x1.
    """
    if np.isinf(rate):
        return x1
    third = (6.0 * (d0 + d1) * step - 12.0 * (x1 - x0)) / (step * step * step)
    second_0 = (6.0 * (x1 - x0) - (4.0 * d0 + 2.0 * d1) * step) / (step * step)
    second_1 = second_0 + third * step
    p0 = x0 - (d0 - (second_0 - third / rate) / rate) / rate
    p1 = x1 - (d1 - (second_1 - third / rate) / rate) / rate
    return p1 + np.exp(-rate * step) * (before - p0)
