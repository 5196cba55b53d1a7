"""The power amplifier as it is: second order with a slew limit, and a crossover between its two halves."""

import numpy as np

from msl_fem.bench.plant import Amplifier
from msl_fem.computing.compiled import compiled


@compiled
def amplifier_rates(a: Amplifier, command: float, output: float, speed: float) -> tuple[float, float]:
    """(d output/dt, d speed/dt): z' = w^2 (u - y) - 2 d w z and y' = S tanh(z/S), with z the speed asked for.

    The output never moves faster than the slew limit S, which the stage reaches softly; without one y' = z.
    """
    push = a.frequency * (a.frequency * (command - output) - 2.0 * a.damping_ratio * speed)
    if np.isinf(a.slew):
        return speed, push
    return a.slew * np.tanh(speed / a.slew), push


@compiled
def crossover(a: Amplifier, voltage: float) -> float:
    """The voltage left after the zone in which neither half of the output stage conducts well: v - c tanh(v/w)."""
    return voltage - a.crossover * np.tanh(voltage / a.crossover_width)
