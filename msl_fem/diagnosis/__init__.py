"""Diagnosis: what the simulation gets wrong, by which cause, and how much better it becomes.

`diagnose` takes a record and returns a `Diagnosis`; the other names are what its settings and its answer are made of.
"""

from msl_fem.diagnosis.decision import Rule
from msl_fem.diagnosis.driver import DiagnosisSettings, diagnose
from msl_fem.diagnosis.estimates import Estimate
from msl_fem.diagnosis.kind import PredictionError, Size
from msl_fem.diagnosis.outside import Dependence
from msl_fem.diagnosis.result import (
    Accuracy,
    Cause,
    ChannelResiduals,
    Diagnosis,
    Evidence,
    TriedVariant,
    Unexplained,
    Verdict,
)

__all__ = [
    "Accuracy",
    "Cause",
    "ChannelResiduals",
    "Dependence",
    "Diagnosis",
    "DiagnosisSettings",
    "Estimate",
    "Evidence",
    "PredictionError",
    "Rule",
    "Size",
    "TriedVariant",
    "Unexplained",
    "Verdict",
    "diagnose",
]
