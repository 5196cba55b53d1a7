"""What a kind of magnet knows of its stack's ends: lengths, and the factors of the correction with their errors."""

import math
from dataclasses import dataclass
from typing import TypeVar

from msl_fem.computing.arrays import Array

T = TypeVar("T", float, Array)


@dataclass(frozen=True)
class StackEnds:
    """Where flux bulges out at both ends of a plane section's stack; lengths in m (see `magnetics.field.end_effects`).

    Attributes
    ----------
    depth : of the stack
    reach : height of the pole's end face that counts
    window_width : between two legs
    regions : of the section that lie in the window
    legs : what one leg and the other are wide, the second as far as a plane of symmetry in its middle if `mirror`
    """

    depth: float
    reach: float
    window_width: float
    legs: tuple[float, float]
    mirror: bool
    regions: tuple[str, ...] = ("window", "coil")


def mean_height(begin: float, end: float) -> float:
    """The geometric mean of the heights between two, the permeance of an edge being a logarithm of the height."""
    mean_log = math.log(end) - 1 + begin / (end - begin) * (math.log(end / begin) if begin else 0.0)
    return math.exp(mean_log)


@dataclass(frozen=True)
class EndFactors:
    """What solutions in three dimensions make of the correction: see `magnetics.sweep.solid_lift`.

    Attributes
    ----------
    gap, window : the additional depth over that of the closed form and of the section across the legs
    outer : the additional depth of all other air, over the stack's
    leakage : H, of the end turns: flux that passes neither gap nor window, and adds to the flux linkage alone
    """

    gap: float = 1.0
    window: float = 1.0
    outer: float = 0.0
    leakage: float = 0.0


def leaked(inductance: float, current: T) -> dict[str, T | float]:
    """What an inductance (H) in series adds at a current (A): flux that passes no iron and does not know the gap."""
    return {
        "coenergy": inductance * current**2 / 2,
        "flux_linkage": inductance * current,
        "incremental_inductance": inductance,
    }


DERIVED = EndFactors()
"""Of the correction as the formulas have it."""


@dataclass(frozen=True)
class KnownEnds:
    """The factors of a kind's end effects, and what is left of the error with them.

    Attributes
    ----------
    force_error, flux_error : largest relative difference from solutions in three dimensions that were not fitted
    share : of the ends that is missed, as one sigma
    source : where the factors come from, in words
    """

    factors: EndFactors = DERIVED
    force_error: float = 0.05
    flux_error: float = 0.05
    share: float = 0.3
    source: str = "air that is deeper than the stack, as derived"
