"""Comparative model accuracy: how far each model is from a record, where, and against which floor."""

from msl_fem.comparison.accuracy import Bands, ModelAccuracy, Spread, by_band, nrmse, octaves, over_variable
from msl_fem.comparison.compare import CompareSettings, Comparison, StaticError, compare, static_errors
from msl_fem.comparison.models import analytic_table

__all__ = [
    "Bands",
    "CompareSettings",
    "Comparison",
    "ModelAccuracy",
    "Spread",
    "StaticError",
    "analytic_table",
    "by_band",
    "compare",
    "nrmse",
    "octaves",
    "over_variable",
    "static_errors",
]
