"""Identification: MISO ARMAX models with rational magnetic inputs, by the prediction-error method."""

from msl_fem.identification.armax import fit_armax
from msl_fem.identification.data import SampledRun
from msl_fem.identification.fit_figures import RunFit, fit_figures, fit_percent
from msl_fem.identification.free_run import FreeRun, simulate
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.gauss_newton import Convergence, SearchSettings
from msl_fem.identification.model import ArmaxModel
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.prediction import predict, residuals
from msl_fem.identification.prior import OscillatorPrior, discretised_oscillator
from msl_fem.identification.rational import RationalInputs, RationalTerm, rational_term
from msl_fem.identification.record_model import Identification, ModelChoice, identify, sampled_run
from msl_fem.identification.residual_tests import CorrelationTest, residual_tests, whiteness_test
from msl_fem.identification.serialisation import model_from_json, model_to_json

__all__ = [
    "ArmaxModel",
    "ArmaxOrders",
    "Convergence",
    "CorrelationTest",
    "DeltaSearch",
    "FreeRun",
    "Identification",
    "ModelChoice",
    "OscillatorPrior",
    "Polynomials",
    "RationalInputs",
    "RationalTerm",
    "RunFit",
    "SampledRun",
    "SearchSettings",
    "discretised_oscillator",
    "fit_armax",
    "fit_figures",
    "fit_percent",
    "identify",
    "identify_rational",
    "model_from_json",
    "model_to_json",
    "predict",
    "rational_term",
    "residual_tests",
    "residuals",
    "sampled_run",
    "simulate",
    "whiteness_test",
]
