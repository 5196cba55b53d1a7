"""Bertotti's coefficients from measured losses of a sheet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from msl_fem.errors import MaterialError
from msl_fem.losses.bertotti import sinusoidal_loss
from msl_fem.materials.core_loss_data import LossCoefficients, LossPoints, Sheet

Array = NDArray[np.float64]
FEWEST = 12  # points for three coefficients
OUTLIER = 0.1  # relative error from which a point counts less: printed tables have misprints


@dataclass(frozen=True)
class FittedRange:
    """The highest frequency in Hz that a fit uses, the sheet's density in kg/m3 and the data's source."""

    frequency_max: float
    density: float
    source: str


def fit_losses(points: LossPoints, sheet: Sheet, use: FittedRange) -> LossCoefficients:
    """Hysteresis and excess coefficients that fit measured losses, the eddy-current term being that of the sheet.

    Least squares of the relative error, points beyond 10 % counting less (Huber 1964). The eddy-current term is not
    fitted: conductivity and thickness fix it.

    Raises
    ------
    MaterialError : fewer than 12 points up to the highest frequency, or a sheet without thickness or conductivity
    """
    use_rows = points.frequency <= use.frequency_max
    if use_rows.sum() < FEWEST or np.unique(points.frequency[use_rows]).size < 3:
        raise MaterialError(
            f"{int(use_rows.sum())} loss points up to {use.frequency_max:g} Hz are too few; "
            f"give {FEWEST} or more at three or more frequencies"
        )
    if sheet.thickness is None or sheet.conductivity is None:
        raise MaterialError(f"{sheet.iron}: a fit needs the sheet's thickness and conductivity")
    f, b, p = (a[use_rows] for a in (points.frequency, points.flux_density, points.loss))

    def coefficients(x: Array, error: Array | None = None) -> LossCoefficients:
        e = np.zeros(1) if error is None else error
        return LossCoefficients(
            hysteresis=float(np.exp(x[0])), exponent=float(x[1]), excess=float(x[2] ** 2), density=use.density,
            frequency_max=use.frequency_max, flux_density_min=float(b.min()), flux_density_max=float(b.max()),
            rms_error=float(np.sqrt(np.mean(e**2))), largest_error=float(np.abs(e).max()), source=use.source,
        )  # fmt: skip

    def error(x: Array) -> Array:
        return np.asarray(sum(sinusoidal_loss(coefficients(x), sheet, f, b)) / use.density / p - 1)

    found = least_squares(error, [np.log(0.02), 1.8, 0.02], loss="huber", f_scale=OUTLIER, xtol=1e-12, ftol=1e-12)
    return coefficients(found.x, error(found.x))
