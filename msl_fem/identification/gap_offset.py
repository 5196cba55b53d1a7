"""ARMAX with rational inputs, the gap offset delta found on the profile of the prediction-error cost.

delta is the only coefficient of i^p/(g + delta)^q that is not linear. The objective, minimised over all the others,
is a function of delta alone: a bounded scalar search on an excerpt finds its valley, Gauss-Newton steps of the joint
Jacobian on all data find its floor. The terms hold the measured position: its sensor noise enters the inputs, one
sample old at the least (nk >= 1), so the predictor stays causal; noise that is not small against the gap biases the
coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.identification.armax import EXCERPT_SAMPLES, best_search, fit_armax, model_of
from msl_fem.identification.armax_model import ArmaxModel
from msl_fem.identification.data import FloatArray, SampledRun, check_runs
from msl_fem.identification.gauss_newton import SearchResult, SearchSettings
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.prediction_error import jacobian_factors
from msl_fem.identification.prior import OscillatorPrior, oscillator_belief
from msl_fem.identification.problem import Belief, Problem
from msl_fem.identification.rational import RationalInputs
from msl_fem.identification.regression import ScaledFactor, scaled_factor
from msl_fem.identification.start import Start, excerpts
from msl_fem.identification.uncertainty import covariance

DELTA_NAME = "delta"
OPEN_SHARE = 0.1  # of the smallest measured gap that the offset must leave open


@dataclass(frozen=True)
class DeltaSearch:
    """Bounds of delta in m and how closely it is sought.

    Without bounds: from minus half the nominal gap (but a tenth of the smallest measured gap stays open) to plus the
    nominal gap. The scalar search stops at `coarse` of the width, the steps after it at `step_tolerance` standard
    errors.
    """

    bounds: tuple[float, float] | None = None
    coarse: float = 0.02
    step_tolerance: float = 0.01
    max_steps: int = 15


@one_blas_thread
def identify_rational(
    runs: Sequence[SampledRun],
    orders: ArmaxOrders,
    *,
    rational: RationalInputs,
    prior: OscillatorPrior | None = None,
    search: DeltaSearch | None = None,
) -> ArmaxModel:
    """The ARMAX model from rational terms, and plain inputs, to the position; with `search`, delta is estimated too.

    `runs` hold the position (m) as output and the channels that `rational` names: currents "i1", "i2" (A) and the plain
    ones. Without `search`, delta stays what `rational` says. InputError for data, terms or orders that cannot be
    identified. Source: H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (1)-(4).
    """
    check_runs(runs)
    orders = orders.for_inputs(len(rational.input_names))
    _check_delays(orders, rational)
    if search is None or not rational.needs_gap:
        held = fit_armax(_evaluated(runs, rational), orders, prior=prior)
        return replace(held, rational=rational, input_slopes=rational.mean_slopes(runs))
    bounds = _bounds(runs, rational, search)
    rational = rational.with_delta(min(max(rational.delta, bounds[0]), bounds[1]))
    guess = None if prior is None else replace(prior, tolerance=None)
    first = fit_armax(_evaluated(runs, rational), orders, prior=guess)
    profile = Profile(tuple(runs), orders, rational)
    delta, polynomials = _valley(profile, first.polynomials, bounds=bounds, coarse=search.coarse)
    floor = _floor(profile, delta, polynomials, bounds=bounds, search=search)
    if prior is not None and prior.tolerance is not None:
        evaluation = floor.result.evaluation
        belief = oscillator_belief(
            prior,
            orders,
            names=rational.input_names,
            sampling_period=first.sampling_period,
            noise_variance=evaluation.noise_variance,
        )
        profile = replace(profile, belief=belief)
        floor = _floor(profile, floor.delta, evaluation.polynomials, bounds=bounds, search=search)
    return _model(first, floor, profile=profile)


@dataclass(frozen=True, eq=False)
class Profile:
    """Runs, orders, terms and belief whose objective is looked at as a function of delta."""

    runs: tuple[SampledRun, ...]
    orders: ArmaxOrders
    rational: RationalInputs
    belief: Belief | None = None

    def signals(self, delta: float) -> list[FloatArray]:
        """Output, inputs and ones of every run with the terms at this delta."""
        return [run.signals for run in _evaluated(self.runs, self.rational.with_delta(delta))]

    def problem(self, delta: float) -> Problem:
        """What is minimised at this delta."""
        return Problem(self.signals(delta), self.orders, self.belief)

    def fitted(self, delta: float, start: Polynomials, *, excerpt: bool = False) -> SearchResult:
        """The search at this delta from the coefficients at a neighbouring one."""
        problem = self.problem(delta)
        if excerpt:
            problem = replace(
                problem, runs=excerpts(problem.runs, EXCERPT_SAMPLES, longest_lag=self.orders.longest_lag)
            )
        return best_search(problem, starts=[Start("delta search", start)], settings=SearchSettings())

    def joint_factor(self, delta: float, result: SearchResult) -> ScaledFactor:
        """Decomposed Jacobian with a last column for delta, whose right side is the gradient along the profile."""
        evaluation = result.evaluation
        terms = self.rational.with_delta(delta)
        extra = [
            _equation_slope(terms.delta_derivatives(run), evaluation.polynomials, self.orders) for run in self.runs
        ]
        factors = jacobian_factors(
            self.signals(delta), evaluation.polynomials, self.orders, errors=evaluation.errors, extra=extra
        )
        if self.belief is not None:
            of_delta = np.zeros(evaluation.believed.size)
            factors = factors.with_rows(np.column_stack([self.belief.weight, of_delta, evaluation.believed]))
        factor = factors.total
        gradient = np.zeros(factor.shape[1] - 1)
        gradient[-1] = factor[:, -2] @ factor[:, -1]
        return scaled_factor(factor).with_gradient(gradient)


@dataclass(frozen=True, eq=False)
class Floor:
    """The end of the delta search: the fit there, its joint Jacobian, and what is to be said about it."""

    delta: float
    result: SearchResult
    factor: ScaledFactor
    notes: tuple[str, ...]


def _valley(
    profile: Profile, start: Polynomials, *, bounds: tuple[float, float], coarse: float
) -> tuple[float, Polynomials]:
    """delta near the minimum of the objective on an excerpt, and the coefficients there."""
    best_delta, best = profile.rational.delta, profile.fitted(profile.rational.delta, start, excerpt=True)

    def objective(delta: float) -> float:
        nonlocal best_delta, best
        result = profile.fitted(float(delta), best.evaluation.polynomials, excerpt=True)
        if result.evaluation.objective < best.evaluation.objective:
            best_delta, best = float(delta), result
        return result.evaluation.objective

    tolerance = coarse * (bounds[1] - bounds[0])
    minimize_scalar(objective, bounds=bounds, method="bounded", options={"xatol": tolerance})
    return best_delta, best.evaluation.polynomials


def _floor(
    profile: Profile, delta: float, start: Polynomials, *, bounds: tuple[float, float], search: DeltaSearch
) -> Floor:
    """delta at the minimum of the objective on all data, by steps of the joint Jacobian, halved until downhill."""
    result = profile.fitted(delta, start)
    notes: tuple[str, ...] = (f"the search for delta did not settle in {search.max_steps} steps",)
    factor = profile.joint_factor(delta, result)
    for _ in range(search.max_steps):
        step, error = _delta_step(result, factor)
        target = min(max(delta - step, bounds[0]), bounds[1])
        if abs(step) < search.step_tolerance * error:
            notes = ()
            break
        if target == delta:
            notes = (f"delta ended at its bound {delta:.4g} m: widen the bounds if that is not physical",)
            break
        trial = profile.fitted(target, result.evaluation.polynomials)
        while trial.evaluation.objective > result.evaluation.objective:
            target = 0.5 * (target + delta)
            if abs(target - delta) < search.step_tolerance * error:
                break
            trial = profile.fitted(target, result.evaluation.polynomials)
        delta, result = target, trial
        factor = profile.joint_factor(delta, result)
    return Floor(delta, result, factor, notes)


def _delta_step(result: SearchResult, factor: ScaledFactor) -> tuple[float, float]:
    """Gauss-Newton step of delta (to be subtracted) and delta's standard error, both in m."""
    variance = result.evaluation.noise_variance
    return float(factor.solution()[-1]), float(np.sqrt(variance * factor.inverse_gram()[-1, -1]))


def _model(first: ArmaxModel, floor: Floor, *, profile: Profile) -> ArmaxModel:
    rational = profile.rational.with_delta(floor.delta)
    problem = profile.problem(floor.delta)
    model = model_of(
        problem,
        floor.result,
        names=rational.input_names,
        sampling_period=first.sampling_period,
        input_condition_number=first.input_condition_number,
    )
    return replace(
        model,
        rational=rational,
        input_slopes=rational.mean_slopes(profile.runs),
        parameter_names=(*model.parameter_names, DELTA_NAME),
        covariance=covariance(problem, floor.result.evaluation, factor=floor.factor),
        condition_number=floor.factor.condition_number,
        notes=(*model.notes, *floor.notes),
    )


def _evaluated(runs: Sequence[SampledRun], rational: RationalInputs) -> list[SampledRun]:
    return [rational.evaluated(run) for run in runs]


def _equation_slope(input_slopes: FloatArray, polynomials: Polynomials, orders: ArmaxOrders) -> FloatArray:
    """Derivative of A y - sum B_k u_k by delta, shape (n_samples,); input_slopes (n_inputs, n_samples)."""
    slope = np.zeros(input_slopes.shape[1])
    for row, lags, b in zip(input_slopes, orders.input_lags, polynomials.b, strict=True):
        for lag, coefficient in zip(lags, b, strict=True):
            slope[lag:] -= coefficient * row[: row.size - lag]
    return slope


def _bounds(runs: Sequence[SampledRun], rational: RationalInputs, search: DeltaSearch) -> tuple[float, float]:
    least = -(1.0 - OPEN_SHARE) * rational.smallest_gap(runs)
    if search.bounds is None:
        return max(least, -0.5 * rational.nominal_gap), rational.nominal_gap
    low, high = search.bounds
    if not low < high:
        raise InputError(f"bounds of delta {low:g} ... {high:g} m: the first must be the smaller one")
    if low < least:
        raise InputError(
            f"the lower bound of delta, {low:g} m, would close the smallest measured gap "
            f"({rational.smallest_gap(runs):g} m): give {least:g} m or more"
        )
    return low, high


def _check_delays(orders: ArmaxOrders, rational: RationalInputs) -> None:
    for term, lags in zip(rational.terms, orders.input_lags, strict=False):
        if lags[0] < 1 and term.gap_power:
            raise InputError(
                f"input {str(term)!r} has nk = 0 but holds the position of the same instant: give it nk = 1 or more"
            )
