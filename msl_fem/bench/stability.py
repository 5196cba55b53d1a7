"""How far the open loop is stable, and whether a run lets the mover be."""

import math

import numpy as np

from msl_fem.bench.plant import Array
from msl_fem.bench.rig import Rig
from msl_fem.bench.running import Response
from msl_fem.errors import InputError


def stability_limit(rig: Rig) -> float:
    """The side current (A, the same on all sides) up to which x = 0 is stable at constant currents; inf: all of them.

    There the magnets' negative stiffness has used up the spring.
    """
    magnets = rig.plant.magnets
    if rig.table is None or not magnets.sides:
        return math.inf
    current = np.linspace(0.0, float(rig.table.current[-1]), 2001)
    slope = rig.table.evaluate(current, magnets.nominal_gap)["force_gap_slope"]
    left = rig.plant.motion.stiffness + magnets.per_side * magnets.sides * slope
    gone = np.flatnonzero(left <= 0)
    if not gone.size:
        return math.inf
    n = int(gone[0])
    if n == 0:
        return 0.0
    share = left[n - 1] / (left[n - 1] - left[n])
    return float((current[n - 1] + share * (current[n] - current[n - 1])) / magnets.share)


def check_stable(rig: Rig, response: Response) -> None:
    """Returns where the mean plant of every stretch as long as a natural period is stable, else raises.

    Force and its slope go with the square of the current (below saturation), and the mover averages them over its
    natural period: its stiffness is the spring's and the magnets' at the RMS currents and the mean gaps of a stretch.
    A run of equal currents on both sides would stay at x = 0 whatever they are; no bench would.

    Raises
    ------
    InputError : names the limit
    """
    magnets, motion = rig.plant.magnets, rig.plant.motion
    if rig.table is None or not magnets.sides or motion.stiffness <= 0:
        return
    window = min(
        max(1, round(2 * math.pi * math.sqrt(motion.mass / motion.stiffness) * response.rate)), len(response.position)
    )
    rms = np.sqrt(_means(response.current**2, window))
    mean = _means(response.position[:, None], window)[:, 0]
    left = np.full(mean.size, motion.stiffness)
    for j in range(magnets.sides):
        gap = magnets.nominal_gap - (1 - 2 * j) * mean
        left += magnets.per_side * rig.table.evaluate(magnets.share * rms[:, j], gap)["force_gap_slope"]
    if left.min() <= 0:
        worst = int(np.argmin(left))
        currents = ", ".join(f"{one:.3g} A" for one in rms[worst])
        raise InputError(
            f"{rig.name}: from t = {worst * window / response.rate:.4g} s the inputs make {currents} RMS over "
            f"{window / response.rate * 1e3:.3g} ms; at x = 0 it is stable up to {stability_limit(rig):.3g} A on all "
            "sides: lower the amplitude or the bias"
        )


def _means(values: Array, window: int) -> Array:
    """Means (n_window, n_column) over stretches of `window` rows, one behind the other."""
    whole = values.shape[0] // window
    return values[: whole * window].reshape(whole, window, -1).mean(axis=1)
