"""The permeance that a stack's end adds to the window between two legs: solved sections, as a polynomial.

It depends on the two ratios of leg to window alone. Chebyshev's polynomials in their logarithms keep what sections
solved at 121 pairs of ratios say (`benchmarks/between_legs.py`): within 4e-4 of twelve others with a mirror, whose
mesh's own error is about 1e-4, and within 2.4e-3 without one (median 2e-4). Solving such a section takes longer than a
field of the magnet.
"""

import math

import numpy as np
from numpy.polynomial import chebyshev

REACH = 3.2
"""Of the logarithm of either ratio: from 1/24 to 24."""

MIRRORED = (
    (0.82467, 0.49010, 0.05559, -0.03262, -0.00727, 0.00257, 0.00070, -0.00026, -0.00007),
    (0.11204, 0.14071, 0.05257, 0.00598, -0.00363, -0.00168, -0.00008, 0.00012, 0.00001),
    (0.00648, 0.01995, 0.01502, 0.00645, 0.00085, -0.00061, -0.00035, -0.00005, 0.00001),
    (-0.01057, -0.01247, -0.00236, 0.00208, 0.00168, 0.00039, -0.00013, -0.00013, -0.00003),
    (-0.00200, -0.00505, -0.00318, -0.00075, 0.00055, 0.00054, 0.00016, -0.00004, -0.00006),
    (0.00085, 0.00063, -0.00062, -0.00079, -0.00023, 0.00022, 0.00024, 0.00007, -0.00003),
    (0.00030, 0.00074, 0.00030, -0.00015, -0.00026, -0.00006, 0.00015, 0.00014, 0.00004),
    (-0.00004, 0.00005, 0.00016, 0.00009, -0.00006, -0.00010, 0.00001, 0.00012, 0.00011),
    (-0.00003, -0.00008, -0.00001, 0.00004, 0.00002, -0.00005, -0.00005, 0.00002, 0.00011),
)

PLAIN = (
    (1.15516, 0.24101, 0.03605, -0.01435, -0.00515, 0.00064, 0.00038, -0.00012, -0.00006),
    (0.24101, 0.11974, 0.03697, -0.00069, -0.00467, -0.00126, 0.00013, 0.00004, -0.00008),
    (0.03605, 0.03697, 0.01699, 0.00349, -0.00115, -0.00116, -0.00039, -0.00006, -0.00004),
    (-0.01435, -0.00069, 0.00349, 0.00416, 0.00159, -0.00042, -0.00065, -0.00028, -0.00005),
    (-0.00515, -0.00467, -0.00115, 0.00159, 0.00233, 0.00097, -0.00029, -0.00046, -0.00019),
    (0.00064, -0.00126, -0.00116, -0.00042, 0.00097, 0.00160, 0.00072, -0.00022, -0.00036),
    (0.00038, 0.00013, -0.00039, -0.00065, -0.00029, 0.00072, 0.00124, 0.00056, -0.00018),
    (-0.00012, 0.00004, -0.00006, -0.00028, -0.00046, -0.00022, 0.00056, 0.00103, 0.00050),
    (-0.00006, -0.00008, -0.00004, -0.00005, -0.00019, -0.00036, -0.00018, 0.00050, 0.00090),
)


def excess_between(upper: float, lower: float, *, mirror: bool) -> float | None:
    """The permeance per unit width and mu_0 beyond the end, of legs that are so many windows wide.

    None where a ratio is outside of what was solved. With `mirror` the second leg is a half, up to its middle plane.
    """
    places = math.log(upper) / REACH, math.log(lower) / REACH
    if max(map(abs, places)) > 1:
        return None
    return float(chebyshev.chebval2d(*places, np.array(MIRRORED if mirror else PLAIN)))
