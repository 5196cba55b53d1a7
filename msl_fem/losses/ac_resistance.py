"""Resistance of a winding to alternating current: skin and proximity effect in a slot."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import ECore
from msl_fem.errors import InputError
from msl_fem.losses.winding import Winding
from msl_fem.materials.constants import MU_0, REFERENCE_TEMPERATURE, resistivity

Array = NDArray[np.float64]
NEGLIGIBLE = 0.01  # of the resistance: what the copper's own tolerance hides


@dataclass(frozen=True)
class SlotRows:
    """The winding as the one-dimensional slot sees it: `rows` of `abreast` wires, from the yoke to the pole faces."""

    rows: int
    abreast: float
    breadth: float
    """Of the slot across which the leakage field runs, in m."""
    diameter: float


def slot_rows(winding: Winding, magnet: ECore) -> SlotRows:
    """The rows of a winding in an E-core's window.

    The window is a slot between two legs that opens at the pole faces. Its leakage field runs across, from leg to leg,
    and grows from nothing at the yoke to N i / w at the last row (Field 1905; Emde 1908): what Dowell calls a layer
    is here one row of wires across the window, and there are as many rows as turns in a layer along the leg.
    """
    rows = max(winding.layers)
    return SlotRows(rows, winding.turns / rows, magnet.window_width, winding.wire.diameter)


def skin_depth(frequency: ArrayLike, temperature: float = REFERENCE_TEMPERATURE) -> Array:
    """delta in m at frequencies in Hz: sqrt(rho / (pi f mu_0)); inf at 0."""
    f = np.asarray(frequency, dtype=float)
    with np.errstate(divide="ignore"):
        return np.asarray(np.sqrt(resistivity(temperature) / (math.pi * MU_0 * f)))


def resistance_factor(rows: SlotRows, frequency: ArrayLike, *, temperature: float = REFERENCE_TEMPERATURE) -> Array:
    """R_ac/R_dc at frequencies in Hz, of the shape given; 1 at 0.

    Each row of round wires becomes a foil of the same section, of height h = d sqrt(pi)/2 and of the conductivity
    times eta = abreast h / breadth; with D = h sqrt(eta)/delta and p rows (Dowell, Proc. IEE 113, 1966, eq. 10)

        F = D [ (sinh 2D + sin 2D)/(cosh 2D - cos 2D) + 2 (p^2 - 1)/3 (sinh D - sin D)/(cosh D + cos D) ].

    The fringe of the air gap is not in it: turns close to the pole faces have more.

    Raises
    ------
    InputError : a negative frequency or one that is not a number
    """
    f = np.asarray(frequency, dtype=float)
    if not (f >= 0).all() or not np.isfinite(f).all():
        raise InputError(f"frequencies must be finite and not negative, these are {np.unique(f)[:3].tolist()} Hz")
    height = rows.diameter * math.sqrt(math.pi) / 2
    porosity = min(rows.abreast * height / rows.breadth, 1.0)
    x = np.minimum(
        height * math.sqrt(porosity) / skin_depth(f, temperature), 300.0
    )  # cosh 600 is near the end of floats
    low = x < 0.05  # the quotients lose digits there: their series to x^4, exact to 1e-9
    y = np.where(low, 1.0, x)
    skin = y * (np.sinh(2 * y) + np.sin(2 * y)) / (np.cosh(2 * y) - np.cos(2 * y))
    proximity = y * (np.sinh(y) - np.sin(y)) / (np.cosh(y) + np.cos(y))
    skin = np.where(low, 1 + 4 * x**4 / 45, skin)
    proximity = np.where(low, x**4 / 6, proximity)
    return np.asarray(skin + 2 * (rows.rows**2 - 1) / 3 * proximity)


def negligible_below(rows: SlotRows, *, temperature: float = REFERENCE_TEMPERATURE, share: float = NEGLIGIBLE) -> float:
    """The frequency in Hz up to which R_ac exceeds R_dc by less than `share`."""
    low, high = 1e-3, 1e9
    for _ in range(80):
        middle = math.sqrt(low * high)
        if float(resistance_factor(rows, middle, temperature=temperature)) - 1 < share:
            low = middle
        else:
            high = middle
    return low
