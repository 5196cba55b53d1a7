"""Over which gaps a map runs, and how far along the current."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.kinds.e_core import check_grid, check_point

Array = NDArray[np.float64]
LARGEST_DENSITY = 1e8  # A/m2 in the copper: to there a level is looked for, unless the drive reaches farther
PREFERRED_NUMBERS = (
    1.0, 1.12, 1.25, 1.4, 1.6, 1.8, 2.0, 2.24, 2.5, 2.8, 3.15, 3.55, 4.0, 4.5, 5.0, 5.6, 6.3, 7.1, 8.0, 9.0,
)  # fmt: skip
"""The series R20 of ISO 3, twenty a decade: a curve is within 0.1 % of the chords between."""
NO_RANGE = 1 / 200, 1 / 16  # default gaps of a magnet without a range, of the core's half width


def default_gaps(actuator: Actuator) -> Array:
    """Gaps (m) over an actuator's range with a margin: both ends, the nominal gap, and preferred numbers between.

    From half the smallest gap to a sixth of the nominal gap beyond the largest, as a table's; for a magnet without a
    range from a two hundredth to a sixteenth of the core's half width.
    """
    motion = actuator.motion
    ends: list[float]
    if motion is None or motion.nominal_gap is None or motion.range is None:
        half = actuator.e_core().half_width
        ends, wanted = [half * share for share in NO_RANGE], []
    else:
        ends = [(motion.nominal_gap - motion.range) / 2, motion.nominal_gap * 7 / 6 + motion.range]
        wanted = [motion.nominal_gap]
    decades = range(math.floor(math.log10(ends[0])), math.ceil(math.log10(ends[1])))
    inner = [number * 10.0**decade for decade in decades for number in PREFERRED_NUMBERS]
    near = 1.05  # two gaps closer than this are one
    kept = [
        g for g in inner if ends[0] * near < g < ends[1] / near and all(not 1 / near < g / w < near for w in wanted)
    ]
    return np.array(sorted({*ends, *wanted, *(float(f"{g:.6g}") for g in kept)}))


def checked_gaps(actuator: Actuator, gap: ArrayLike) -> Array:
    """The gaps (m), increasing; InputError unless they are at least two, allowed, and apart."""
    gaps = np.unique(np.asarray(gap, dtype=float))
    for g in gaps:
        check_point(actuator, 0.0, float(g))
    if gaps.size < 2:
        raise InputError(f"a map needs at least 2 different gaps, {gaps.size} given")
    check_grid(actuator, gaps.tolist(), [])
    return gaps


def drive_limit(actuator: Actuator) -> float | None:
    """The drive's current limit for one magnet's coil, in A; None where none is stated."""
    drive, sides = actuator.drive, actuator.sides
    if drive is None or not drive.current_limit:
        return None
    parallel = sides.magnets_per_side if sides is not None and sides.connection == "parallel" else 1
    return float(drive.current_limit) / parallel


def largest_current(actuator: Actuator, gaps: Array, asked: float | None) -> float:
    """The current in A up to which levels are looked for; InputError where the one asked for is not allowed."""
    if asked is not None:
        if not asked > 0:
            raise InputError(f"the largest current must be positive, {asked:g} A is not")
        check_point(actuator, asked, float(gaps[0]))
        return asked
    magnet = actuator.e_core()
    copper = LARGEST_DENSITY * magnet.coil.fill_factor * magnet.coil_section / magnet.coil.turns
    return max(copper, drive_limit(actuator) or 0.0)
