"""A position that is held while a test signal is added to its reading, so that the loop can be measured."""

from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.plant.excitation import Reference, reference
from msl_fem.plant.excitation_kinds import Excitation

_APPROACH = 0.1  # s, from the middle to the position
_REST = 0.15  # s, there before the signal begins


@dataclass(frozen=True, eq=False)
class Injection:
    """A reference that goes to a position and rests, and the test signal (n_sample,) m that begins then."""

    reference: Reference
    signal: Array


def held_under_test(excitation: Excitation, *, rate: float) -> Injection:
    """The test signal of an excitation in m about its bias, the position that is held; raises as `reference`."""
    signal = reference(excitation, rate=rate).position - excitation.bias
    before = round((_APPROACH + _REST) * rate)
    time = np.arange(before + signal.size) / rate
    path = least_jerk(time, excitation.bias, within=_APPROACH)
    return Injection(Reference(time, *path), np.concatenate([np.zeros(before), signal]))


def least_jerk(time: Array, position: float, *, within: float) -> Array:
    """(3, n_sample) position, velocity, acceleration on the way of least jerk from 0 to a position within a time in s.

    Flash and Hogan, J. Neuroscience 5, 1985.
    """
    s = np.minimum(time / within, 1.0)
    return position * np.array(
        [
            10 * s**3 - 15 * s**4 + 6 * s**5,
            (30 * s**2 - 60 * s**3 + 30 * s**4) / within,
            (60 * s - 180 * s**2 + 120 * s**3) / within**2,
        ]
    )
