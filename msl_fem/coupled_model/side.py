"""One side of the actuator: its equal magnets and their connection, seen from the side's terminals."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from msl_fem.coenergy_surface import evaluate
from msl_fem.coupled_model.plant import PlantParameters, Surface

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def side_slopes(
    surface: Surface, p: PlantParameters, current: float, gap: float, magnet: Array
) -> tuple[bool, float, float, float]:
    """(inside the table, force N, dlambda/di H, dlambda/dgap Wb/m) of a side at its current; `magnet` (6,) is scratch.

    The slope of the flux over the gap is minus that of the force over the current, since both are second derivatives
    of one coenergy.
    """
    inside = evaluate(surface.gap, surface.current, surface.coefficients, p.current_share * current, gap, magnet)
    linkages = p.magnets * p.current_share
    return inside, p.magnets * magnet[2], linkages * p.current_share * magnet[3], -linkages * magnet[4]


@njit(cache=True, error_model="numpy")
def side_flux(
    surface: Surface, p: PlantParameters, current: float, gap: float, magnet: Array
) -> tuple[bool, float, float]:
    """(inside the table, flux linkage Wb, field energy lambda i - W' in J) of a side; `magnet` (6,) is scratch."""
    inside = evaluate(surface.gap, surface.current, surface.coefficients, p.current_share * current, gap, magnet)
    flux = p.magnets * p.current_share * magnet[1]
    return inside, flux, flux * current - p.magnets * magnet[0]
