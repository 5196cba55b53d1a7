"""Identification: MISO ARMAX models with rational magnetic inputs, by the prediction-error method."""

from msl_fem.identification.armax import ArmaxModel, fit_armax, model_from_json
from msl_fem.identification.box_jenkins import BoxJenkinsModel, BoxJenkinsOrders, fit_box_jenkins
from msl_fem.identification.data import RationalInputs, RationalTerm, SampledRun, rational_term
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.likelihood import InformationCriterion
from msl_fem.identification.model import (
    ArmaxFreeRun,
    Convergence,
    FitFigures,
    fit_figures,
    fit_percent,
    predict,
    prediction_residuals,
    simulate_armax,
)
from msl_fem.identification.oscillator import (
    KnownMass,
    OscillatorPrior,
    OscillatorTolerance,
    PhysicalParameter,
    discretised_oscillator,
    physical_parameters,
)
from msl_fem.identification.prediction_error import ArmaxOrders, Polynomials
from msl_fem.identification.record_model import Identification, ModelChoice, identify, sampled_run
from msl_fem.identification.residual_tests import (
    CorrelationTest,
    feedback_note,
    feedback_tests,
    residual_tests,
    whiteness_test,
)
from msl_fem.identification.search import EstimationSettings
from msl_fem.identification.selection import (
    OrderLimits,
    OrderSelection,
    TermSearch,
    TermSelection,
    candidate_terms,
    select_orders,
    select_terms,
)

__all__ = [
    "ArmaxFreeRun",
    "ArmaxModel",
    "ArmaxOrders",
    "BoxJenkinsModel",
    "BoxJenkinsOrders",
    "Convergence",
    "CorrelationTest",
    "DeltaSearch",
    "EstimationSettings",
    "FitFigures",
    "Identification",
    "InformationCriterion",
    "KnownMass",
    "ModelChoice",
    "OrderLimits",
    "OrderSelection",
    "OscillatorPrior",
    "OscillatorTolerance",
    "PhysicalParameter",
    "Polynomials",
    "RationalInputs",
    "RationalTerm",
    "SampledRun",
    "TermSearch",
    "TermSelection",
    "candidate_terms",
    "discretised_oscillator",
    "feedback_note",
    "feedback_tests",
    "fit_armax",
    "fit_box_jenkins",
    "fit_figures",
    "fit_percent",
    "identify",
    "identify_rational",
    "model_from_json",
    "physical_parameters",
    "predict",
    "prediction_residuals",
    "rational_term",
    "residual_tests",
    "sampled_run",
    "select_orders",
    "select_terms",
    "simulate_armax",
    "whiteness_test",
]
