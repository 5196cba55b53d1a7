"""What manufacturing tolerances do: sensitivities of force, flux and map currents, and the map's band."""

from msl_fem.design.tolerances.manufactured import NAMES
from msl_fem.design.tolerances.sensitivity import RowRun, Sensitivity
from msl_fem.design.tolerances.study import TableBand, ToleranceSettings, ToleranceStudy, tolerance_study

__all__ = ["NAMES", "RowRun", "Sensitivity", "TableBand", "ToleranceSettings", "ToleranceStudy", "tolerance_study"]
