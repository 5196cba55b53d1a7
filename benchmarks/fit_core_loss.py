"""Fits the loss coefficients of msl_fem/materials/core_loss.json to the data beside it and states the fits' errors.

python benchmarks/fit_core_loss.py            # prints
python benchmarks/fit_core_loss.py --write    # and writes core_loss.json anew
"""

import json
import sys
from dataclasses import asdict, dataclass

import numpy as np
from scipy.optimize import least_squares

from msl_fem.computing.arrays import Array
from msl_fem.errors import MaterialError
from msl_fem.losses import sinusoidal_loss
from msl_fem.materials.core_loss_data import INDEX, LossCoefficients, LossPoints, Sheet, loss_sheets, read_loss_points
from msl_fem.materials.material import LIBRARY

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
            hysteresis=float(np.exp(x[0])),
            exponent=float(x[1]),
            excess=float(x[2] ** 2),
            density=use.density,
            frequency_max=use.frequency_max,
            flux_density_min=float(b.min()),
            flux_density_max=float(b.max()),
            rms_error=float(np.sqrt(np.mean(e**2))),
            largest_error=float(np.abs(e).max()),
            source=use.source,
        )

    def error(x: Array) -> Array:
        return np.asarray(sum(sinusoidal_loss(coefficients(x), sheet, f, b)) / use.density / p - 1)

    best = least_squares(error, [np.log(0.02), 1.8, 0.02], loss="huber", f_scale=OUTLIER, xtol=1e-12, ftol=1e-12)
    return coefficients(best.x, error(best.x))


def refit(name: str) -> LossCoefficients:
    """The coefficients of a sheet of core_loss.json, from its points."""
    entry = loss_sheets()[name]
    sheet = Sheet(name, entry["thickness_m"], entry["conductivity_S_per_m"])
    use = FittedRange(entry["fitted_up_to_Hz"], entry["density_kg_per_m3"], entry["source"])
    return fit_losses(read_loss_points(LIBRARY / entry["data"]), sheet, use)


def main() -> None:
    entries = loss_sheets()
    for name, entry in entries.items():
        found = asdict(refit(name))
        del found["density"], found["source"]
        entry["coefficients"] = {key: float(f"{value:.6g}") for key, value in found.items()}
        print(f"{name:10} " + "  ".join(f"{key} {value:g}" for key, value in entry["coefficients"].items()))
    if "--write" in sys.argv[1:]:
        INDEX.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
