"""A zero that wanders: in its channel a density that rises towards low frequencies stands beside the noise's.

The path of a run is a process, of which the parameters of the effect are the even course; what is left of it has no
form of its own. Its spectrum is taken as A/f^2 + B/f^4, of a random walk, or of the ends of a path that do not meet,
and of one of its rate. A and B are estimated with the densities of the noise by multiplicative steps: each sets a
density times the root of what the residual asks of it over what it has, and none makes the likelihood less (Fevotte,
Bertin, Durrieu, Neural Computation 21, 2009, 793-830). Noise alone is never that loud at low frequencies (`noise`).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.noise import PRIOR, NoiseWeights

FALLS = np.array([[2.0], [4.0]])
"""The powers of the frequency with which a wander's density falls."""
COST = 6.0
"""Nats of A and B: some ten decades of each before, what a few lines tell afterwards."""
STEPS = 40
QUIETEST = 1e-12  # of the white density, at the frequency of one line


@dataclass(frozen=True, eq=False)
class WanderLines:
    """Where a zero's wander shows: places of its channel's numbers (n,), their frequencies in Hz, as differences of
    samples have them, rate/pi sin(pi f/rate); the mean has that of half a line."""

    places: NDArray[np.intp]
    frequency: Array


def with_wander(
    plain: NoiseWeights, residual: Array, labels: NDArray[np.intp], limits: Array, spent: Array, lines: WanderLines
) -> NoiseWeights:
    """The most probable densities of a residual (n_number,) with a wander, where `plain` are those without.

    Parameters
    ----------
    labels : (n_number,) the band of each number
    limits, spent : (n_label,) the largest density of a band, and how many of its numbers went into starts
    """
    own, band = np.unique(labels[lines.places], return_inverse=True)
    squares, size_of_band = residual[lines.places] ** 2, np.bincount(band)
    counts = (1 - spent[own] / size_of_band)[band]
    before = plain.density[own]
    shapes = (lines.frequency / lines.frequency.min()) ** -FALLS
    density, slow = _densities(shapes, np.minimum(before, 1.0), squares, counts, band, limits[own])
    whole = density[band] + slow
    every, root, share = plain.density.copy(), plain.root.copy(), np.zeros(residual.size)
    every[own], root[lines.places], share[lines.places] = density, 1 / np.sqrt(whole), slow / whole
    gain = _nats(before[band], before, squares, counts) - _nats(whole, density, squares, counts)
    return replace(plain, density=every, root=root, nats=plain.nats - gain + COST, wander=share)


def _densities(
    shapes: Array, density: Array, squares: Array, counts: Array, band: NDArray[np.intp], limits: Array
) -> tuple[Array, Array]:
    """(the noise's density of each band, the wander's of each number)."""
    lowest = shapes >= shapes.max(axis=1, keepdims=True) / 100
    sizes = np.maximum(np.sum(squares / shapes, axis=1, where=lowest) / lowest.sum(axis=1), QUIETEST)
    for _ in range(STEPS):
        whole = density[band] + sizes @ shapes
        asked, has = squares / whole**2, counts / whole
        sizes *= np.sqrt((shapes @ asked) / (shapes @ has))
        ratio = (np.bincount(band, asked) + PRIOR / density**2) / (np.bincount(band, has) + PRIOR / density)
        density = np.minimum(density * np.sqrt(ratio), limits)
    return density, sizes @ shapes


def _nats(whole: Array, density: Array, squares: Array, counts: Array) -> float:
    """Minus the log likelihood of numbers of these densities, and the prior of the noise's."""
    return float(np.sum(counts * np.log(whole) + squares / whole) + PRIOR * np.sum(np.log(density) + 1 / density)) / 2
