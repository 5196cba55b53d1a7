"""One side of the actuator: its equal magnets and their connection, seen from the side's terminals."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.coenergy_surface import evaluate, evaluate_slopes
from msl_fem.compiled import compiled
from msl_fem.coupled_model.plant import PlantParameters, Surface

Array = NDArray[np.float64]


@compiled
def side_slopes(surface: Surface, p: PlantParameters, current: float, gap: float) -> tuple[bool, float, float, float]:
    """(inside the table, force N, dlambda/di H, dlambda/dgap Wb/m) of a side at its current.

    The slope of the flux over the gap is minus that of the force over the current, since both are second derivatives
    of one coenergy.
    """
    inside, force, inductance, force_slope = evaluate_slopes(
        surface.gap, surface.current, surface.coefficients, p.current_share * current, gap
    )
    linkages = p.magnets * p.current_share
    return inside, p.magnets * force, linkages * p.current_share * inductance, -linkages * force_slope


@compiled
def side_flux(
    surface: Surface, p: PlantParameters, current: float, gap: float, magnet: Array
) -> tuple[bool, float, float]:
    """(inside the table, flux linkage Wb, field energy lambda i - W' in J) of a side; `magnet` (6,) is scratch."""
    inside = evaluate(surface.gap, surface.current, surface.coefficients, p.current_share * current, gap, magnet)
    flux = p.magnets * p.current_share * magnet[1]
    return inside, flux, flux * current - p.magnets * magnet[0]
