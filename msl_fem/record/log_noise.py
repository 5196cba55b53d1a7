"""Noise of a log's signals from the signals alone, as a stand-in for data sheets."""

import numpy as np

from msl_fem.computing.arrays import Array

ORDERS = (2, 3, 4, 5)
SUM_OF_SQUARES = {2: 6.0, 3: 20.0, 4: 70.0, 5: 252.0}
"""Of the coefficients of a difference of this order, (2 n)!/(n!)^2."""
MEDIAN_OF_NORMAL = 0.6745


def estimated_noise(values: Array) -> float:
    """One sigma of white noise on a signal (n_sample,), at least that of its resolution; 0 of a constant signal.

    The median of the differences of an order over what white noise of sigma 1 makes of them; the signal itself
    only adds, so the least of the orders 2 to 5 counts. It stays too large where the signal reaches half the rate.
    Source: J. von Neumann, Ann. Math. Stat. 12 (1941) 367, with the median for robustness.
    """
    estimates = []
    for order in ORDERS:
        if values.size > 4 * order:
            differences = np.abs(np.diff(values, order))
            estimates.append(float(np.median(differences)) / MEDIAN_OF_NORMAL / np.sqrt(SUM_OF_SQUARES[order]))
    return max(min(estimates, default=0.0), resolution_of(values) / np.sqrt(12.0))


def resolution_of(values: Array) -> float:
    """The step on which all values stand; 0 where they stand on none that is wider than a ten-thousandth of them."""
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    gaps = np.diff(levels)
    step = float(gaps[gaps > 1e-9 * np.abs(levels).max()].min(initial=np.inf))
    if not np.isfinite(step) or (levels.size < 3 and values.size > 100):
        return 0.0
    multiples = (levels - levels[0]) / step
    on_grid = np.abs(multiples - np.round(multiples)).max() < 0.05
    return step if on_grid and step * 1e4 > float(np.ptp(levels)) else 0.0
