"""Plants that a robust design keeps stable beside the believed one: with a second mass, with a force that lags more."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from msl_fem.computing.statespace import StateSpace
from msl_fem.control.believed_plant import BelievedPlant


@dataclass(frozen=True)
class Deviation:
    """How a plant differs from the believed one.

    Attributes
    ----------
    mass_share, frequency, damping_ratio : of the mass that hangs on a spring (structural_mode); Hz of the share alone
    lag : s, time constant of a first-order lag between command and force (eddy currents, amplifier, delay)
    gain : force that a command gives, over the believed one
    """

    mass_share: float = 0.0
    frequency: float = 400.0
    damping_ratio: float = 0.01
    lag: float = 0.0
    gain: float = 1.0


@lru_cache(maxsize=512)
def deviating_plant(plant: BelievedPlant, deviation: Deviation, magnet_stiffness: float) -> StateSpace:
    """Position over commanded force as `BelievedPlant.sampled`, of a plant that deviates.

    With q the second mass against the first, mu its share, w its frequency alone (Den Hartog, Mechanical Vibrations,
    4th ed., ch. 3): (1 - mu) m x'' = f - c x' - (k - kappa) x + mu m (w^2 q + 2 zeta w q'), q'' = -x'' - w^2 q - ...
    """
    d, lags = deviation, [1.0 / tau for tau in (deviation.lag,) if tau > 0]
    rates = lags + ([] if math.isinf(plant.lag) else [plant.lag])
    n = 4 + len(rates)  # position, velocity, second mass against the first, its rate, then the chain of lags to a force
    a, b = np.zeros((n, n)), np.zeros((n, 1))
    w, ratio = 2 * math.pi * d.frequency, d.mass_share / (1 - d.mass_share)
    a[0, 1] = a[2, 3] = 1.0
    a[1, :4] = (
        -(plant.stiffness - magnet_stiffness) / plant.mass / (1 - d.mass_share),
        -plant.damping / plant.mass / (1 - d.mass_share), ratio * w**2, ratio * 2 * d.damping_ratio * w,
    )  # fmt: skip
    push = d.gain / plant.mass / (1 - d.mass_share)
    if rates:
        a[1, -1] = push
    else:
        b[1] = push
    for k, rate in enumerate(rates):
        a[4 + k, 4 + k] = -rate
        if k:
            a[4 + k, 3 + k] = rate
        else:
            b[4] = rate
    a[3], b[3] = -a[1], -b[1]
    a[3, 2:4] += -(w**2), -2 * d.damping_ratio * w
    moving = StateSpace(a, b, np.eye(1, n), np.zeros((1, 1))).sampled(plant.period)
    return _delayed(moving, plant)


def _delayed(moving: StateSpace, plant: BelievedPlant) -> StateSpace:
    """The sampled motion whose input acts the delay later."""
    n, delay = moving.A.shape[0], plant.delay
    a, b = np.zeros((n + delay, n + delay)), np.zeros((n + delay, 1))
    a[:n, :n] = moving.A
    if delay:
        a[:n, n : n + 1] = moving.B
        a[n : n + delay - 1, n + 1 :] = np.eye(delay - 1)
        b[-1] = 1.0
    else:
        b[:] = moving.B
    return StateSpace(a, b, np.eye(1, n + delay), np.zeros((1, 1)), plant.period)
