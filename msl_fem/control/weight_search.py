"""The search for the regulator's weights: the most robust loop that keeps a wish."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from msl_fem.control.believed_plant import BelievedPlant
from msl_fem.control.linear_loop import AtPosition, LinearLaw, bandwidth, grid
from msl_fem.control.lqr import Weights
from msl_fem.errors import ComputationError, InputError

Array = NDArray[np.float64]
LawOf = Callable[[Weights], LinearLaw]

_GRID = 120
_SIMPLEX = np.vstack([np.zeros(3), 0.4 * np.eye(3)]) - 0.1
_OPTIONS = {"maxfev": 120, "xatol": 1e-2, "fatol": 3e-3}
_STARTS = ((1.6, 1.5, 1.0), (0.8, 3.0, 8.0))  # frequency over the bandwidth, velocity and integral weights
_MISSED = 100.0  # a wish missed by its whole counts like a peak sensitivity of this much more
_HOPELESS = 30.0  # an unstable frozen position counts like a peak sensitivity of this, times its spectral radius
_SLACK = 2e-3


@dataclass(frozen=True)
class Wish:
    """What is wished of the feedback.

    Attributes
    ----------
    bandwidth : Hz, -3 dB from reference to position by the integral alone
    peak_sensitivity : bound on max |S| in the middle of the travel; None: none
    """

    bandwidth: float
    peak_sensitivity: float | None


SLOWEST = 1e-6  # of the highest bandwidth: a slower feedback is none


def check_wish(wish: Wish, plant: BelievedPlant) -> None:
    """InputError for what no loop at this rate can be asked for."""
    highest = 0.1 / plant.period
    lowest = SLOWEST * highest
    if not lowest <= wish.bandwidth <= highest:
        raise InputError(
            f"a bandwidth of {wish.bandwidth:g} Hz is out of range: {lowest:g} ... {highest:g} Hz, up to a tenth of "
            "the loop rate; wish for one within, or raise controller.rate"
        )
    if wish.peak_sensitivity is not None and not wish.peak_sensitivity > 1:
        raise InputError(
            f"a peak sensitivity of {wish.peak_sensitivity:g} cannot be: it is above 1 for any loop; wish for 2"
        )


def search_weights(law_of: LawOf, places: Sequence[AtPosition], wish: Wish) -> Weights:
    """The weights of least worst peak sensitivity over frozen positions (the first is the middle) that keep the wish.

    Raises
    ------
    InputError : no weights were found that keep it; the message says what was got
    """
    found = []
    for ratio, velocity, integral in _STARTS:  # the bandwidth jumps where the response dips, so one start may be stuck
        start = np.log([2 * np.pi * ratio * wish.bandwidth, velocity, integral])
        found.append(_descend(law_of, start, places, wish))
    start = min(found, key=lambda end: end[0])[1]
    weights = _weights(_descend(law_of, start, places, wish)[1])  # a fresh simplex where the last one has shrunk
    law = law_of(weights)
    got, peak = feedback_bandwidth(law), law.peak_sensitivity(places[0])
    too_high = wish.peak_sensitivity is not None and not peak <= wish.peak_sensitivity * (1 + _SLACK)
    if too_high or not np.isfinite(peak) or not got >= wish.bandwidth * (1 - _SLACK):
        bound = "" if wish.peak_sensitivity is None else f" and a peak sensitivity of {wish.peak_sensitivity:g}"
        raise InputError(
            f"no weights give a bandwidth of {wish.bandwidth:g} Hz{bound}; the nearest got {got:.4g} Hz and "
            f"{peak:.3g}: lower the bandwidth, allow more peak sensitivity, or raise the loop rate"
        )
    return weights


def feedback_bandwidth(law: LinearLaw, n_grid: int = 400) -> float:
    """-3 dB in Hz from reference to position by the integral alone, on the believed plant."""
    f = grid(law.plant.period, n_grid)
    return bandwidth(law.by_integral_alone().reference_response(f), f)


def _descend(law_of: LawOf, start: Array, places: Sequence[AtPosition], wish: Wish) -> tuple[float, Array]:
    """(badness, logarithms of the weights) downhill from a start."""
    options = {**_OPTIONS, "initial_simplex": start + _SIMPLEX}
    end = minimize(lambda w: _badness(law_of, w, places, wish), start, method="Nelder-Mead", options=options)
    return float(end.fun), np.asarray(end.x)


def _weights(logarithms: Array) -> Weights:
    return Weights(*(float(w) for w in np.exp(np.clip(logarithms, -20, 20))))


def _badness(law_of: LawOf, logarithms: Array, places: Sequence[AtPosition], wish: Wish) -> float:
    try:
        law = law_of(_weights(logarithms))
    except ComputationError:
        return 1e6
    f = grid(law.plant.period, _GRID)
    peaks = [law.peak_sensitivity(place, frequency=f) for place in places]
    if np.isinf(peaks[0]):
        return 1e5
    missed = max(0.0, 1 + 0.5 * _SLACK - feedback_bandwidth(law, _GRID) / wish.bandwidth)
    if wish.peak_sensitivity is not None:
        missed += max(0.0, peaks[0] / wish.peak_sensitivity - 1 + 0.5 * _SLACK)
    worst = 0.0
    for place, peak in zip(places, peaks, strict=True):
        hopeless = _HOPELESS * law.spectral_radius(place) if np.isinf(peak) else 0.0
        worst = max(worst, hopeless or min(peak, _HOPELESS))
    return worst + _MISSED * missed
