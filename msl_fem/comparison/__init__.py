"""Comparative model accuracy: how far each model is from a record, where, and against which floor."""

from msl_fem.comparison.accuracy import Bands, Spread, by_band, nrmse, octaves, over_variable
from msl_fem.comparison.compare import CompareSettings, Comparison, compare
from msl_fem.comparison.judged import ModelAccuracy
from msl_fem.comparison.models import analytic_table
from msl_fem.comparison.static_map import StaticError, static_errors

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
