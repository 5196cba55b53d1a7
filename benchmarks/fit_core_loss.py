"""Fits the loss coefficients of msl_fem/materials/core_loss.json to the data beside it and states the fits' errors.

python benchmarks/fit_core_loss.py            # prints
python benchmarks/fit_core_loss.py --write    # and writes core_loss.json anew
"""

import json
import sys
from dataclasses import asdict

from msl_fem.losses import FittedRange, fit_losses
from msl_fem.materials.core_loss_data import INDEX, LossCoefficients, Sheet, loss_sheets, read_loss_points
from msl_fem.materials.material import LIBRARY


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
