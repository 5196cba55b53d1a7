"""Identification: MISO ARMAX models with rational magnetic inputs, by the prediction-error method."""

from msl_fem.identification.armax import fit_armax
from msl_fem.identification.armax_model import ArmaxModel
from msl_fem.identification.box_jenkins import BoxJenkinsModel, BoxJenkinsOrders, fit_box_jenkins
from msl_fem.identification.criterion import Criterion
from msl_fem.identification.data import SampledRun
from msl_fem.identification.feedback import feedback_note, feedback_tests
from msl_fem.identification.fit_figures import RunFit, fit_figures, fit_percent
from msl_fem.identification.free_run import FreeRun, simulate
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.gauss_newton import Convergence, SearchSettings
from msl_fem.identification.order_selection import OrderLimits, OrderSelection, select_orders
from msl_fem.identification.physical import Believed, PhysicalParameter, physical_parameters
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.prediction import predict, residuals
from msl_fem.identification.prior import OscillatorPrior, OscillatorTolerance, discretised_oscillator
from msl_fem.identification.rational import RationalInputs, RationalTerm, rational_term
from msl_fem.identification.record_model import Identification, ModelChoice, identify, sampled_run
from msl_fem.identification.residual_tests import CorrelationTest, residual_tests, whiteness_test
from msl_fem.identification.serialisation import model_from_json, model_to_json
from msl_fem.identification.term_selection import TermSearch, TermSelection, candidate_terms, select_terms

__all__ = [
    "ArmaxModel",
    "ArmaxOrders",
    "Believed",
    "BoxJenkinsModel",
    "BoxJenkinsOrders",
    "Convergence",
    "CorrelationTest",
    "Criterion",
    "DeltaSearch",
    "FreeRun",
    "Identification",
    "ModelChoice",
    "OrderLimits",
    "OrderSelection",
    "OscillatorPrior",
    "OscillatorTolerance",
    "PhysicalParameter",
    "Polynomials",
    "RationalInputs",
    "RationalTerm",
    "RunFit",
    "SampledRun",
    "SearchSettings",
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
    "model_to_json",
    "physical_parameters",
    "predict",
    "rational_term",
    "residual_tests",
    "residuals",
    "sampled_run",
    "select_orders",
    "select_terms",
    "simulate",
    "whiteness_test",
]
