"""Prediction-error estimate of a MISO ARMAX model from one or several runs.

L. Ljung, System Identification, 2nd ed., chs. 7 and 10; H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998,
eqs. (4)-(14). Data recorded under feedback are sound when there is an external excitation and a delay around the loop
(nk >= 1 or a delay in the controller): the one-step predictor uses past data only, and A is never stabilised.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError
from msl_fem.identification.armax_model import ArmaxModel
from msl_fem.identification.data import SampledRun, check_length, check_runs
from msl_fem.identification.evaluation import evaluate
from msl_fem.identification.excitation import check_excitation, check_feedback
from msl_fem.identification.gauss_newton import SearchResult, SearchSettings, search
from msl_fem.identification.polynomials import ArmaxOrders
from msl_fem.identification.prior import OscillatorPrior, oscillator_belief
from msl_fem.identification.problem import Problem
from msl_fem.identification.start import Start, excerpts, first_guesses
from msl_fem.identification.uncertainty import covariance

SAMPLES_PER_PARAMETER = 10
EXCERPT_SAMPLES = 40_000  # the first guess and the way to its minimum are sought on no more than this
NEARLY_COLLINEAR = 1e4  # condition number of the inputs from which the model says so


@one_blas_thread
def fit_armax(
    runs: Sequence[SampledRun],
    orders: ArmaxOrders,
    *,
    prior: OscillatorPrior | None = None,
    settings: SearchSettings | None = None,
) -> ArmaxModel:
    """The ARMAX model with the smallest sum of squared one-step prediction errors over all runs.

    The search begins at the cheapest of the starts (long ARX; with `prior` also the believed oscillator) and, if it
    does not converge there, goes on to the next. A prior with a tolerance then counts as further data, weighed by the
    noise that was found without it. InputError for data or orders that cannot be identified;
    ComputationError if no start has a finite cost. `convergence` says how the search ended.
    """
    check_runs(runs)
    names = tuple(runs[0].inputs)
    orders = orders.for_inputs(len(names))
    _check_size(runs, orders)
    signals = [run.signals for run in runs]
    condition = check_excitation(signals, orders, names)
    check_feedback(signals, orders, names)
    settings = settings or SearchSettings()
    period = runs[0].sampling_period
    problem = Problem(signals, orders)
    part = Problem(excerpts(signals, EXCERPT_SAMPLES, longest_lag=orders.longest_lag), orders)
    starts = first_guesses(part.runs, orders, prior, sampling_period=period, names=names)
    found = best_search(part, starts=starts, settings=settings)
    if part.runs is not signals:
        start = Start(f"{found.convergence.start} on an excerpt", found.evaluation.polynomials)
        found = best_search(problem, starts=[start, *starts], settings=settings)
    if prior is not None and prior.tolerance is not None:
        variance = found.evaluation.noise_variance
        belief = oscillator_belief(prior, orders, names=names, sampling_period=period, noise_variance=variance)
        problem = replace(problem, belief=belief)
        start = Start(f"{found.convergence.start}, without the prior's weight", found.evaluation.polynomials)
        found = best_search(problem, starts=[start, *starts], settings=settings)
    return model_of(problem, found, names=names, sampling_period=period, input_condition_number=condition)


def best_search(problem: Problem, *, starts: Sequence[Start], settings: SearchSettings) -> SearchResult:
    """The search from the cheapest start; if that one does not converge, the lowest end of all that were tried."""
    evaluations = [(start.name, evaluate(problem, start.polynomials)) for start in starts]
    usable = sorted(
        (pair for pair in evaluations if np.isfinite(pair[1].objective)), key=lambda pair: pair[1].objective
    )
    if not usable:
        raise ComputationError(
            f"no start ({', '.join(start.name for start in starts)}) has a finite prediction error: "
            "check the scaling of the data, lower the orders, or give a prior"
        )
    results: list[SearchResult] = []
    for name, evaluation in usable:
        results.append(search(problem, start=evaluation, name=name, settings=settings))
        if results[-1].convergence.converged:
            break
    return min(results, key=lambda result: result.evaluation.objective)


def model_of(
    problem: Problem,
    found: SearchResult,
    *,
    names: tuple[str, ...],
    sampling_period: float,
    input_condition_number: float,
) -> ArmaxModel:
    """The search's result as a model with covariance."""
    evaluation, orders = found.evaluation, problem.orders
    notes = []
    if input_condition_number > NEARLY_COLLINEAR:
        notes.append(
            f"the inputs are nearly collinear (condition number {input_condition_number:.2g}): their separate "
            "coefficients are uncertain, their sum is not; a larger motion separates them"
        )
    if not found.convergence.converged:
        notes.append(f"the search did not converge: {found.convergence.reason}")
    if found.factor.kept.min() == 0.0:
        notes.append("some coefficients cannot be told apart from these data: their standard errors mean nothing")
    return ArmaxModel(
        orders=orders,
        polynomials=evaluation.polynomials,
        input_names=names,
        sampling_period=sampling_period,
        parameter_names=orders.parameter_names(names),
        covariance=covariance(problem, evaluation),
        noise_variance=evaluation.noise_variance,
        condition_number=found.factor.condition_number,
        input_condition_number=input_condition_number,
        n_samples=evaluation.n_equations,
        convergence=found.convergence,
        notes=tuple(notes),
    )


def _check_size(runs: Sequence[SampledRun], orders: ArmaxOrders) -> None:
    needed = SAMPLES_PER_PARAMETER * (orders.n_parameters + orders.nc * len(runs))
    check_length(runs, samples_needed=needed, longest_lag=orders.longest_lag)
