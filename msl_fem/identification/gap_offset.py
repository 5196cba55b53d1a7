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

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.gauss_newton import HALVING, DescentSettings, descend, halved
from msl_fem.errors import InputError
from msl_fem.identification.armax import EXCERPT_SAMPLES, ArmaxModel, best_search, estimated_model, fit_armax
from msl_fem.identification.data import RationalInputs, SampledRun, check_runs
from msl_fem.identification.likelihood import CoefficientPrior, EstimationProblem, covariance
from msl_fem.identification.oscillator import OscillatorPrior, oscillator_belief
from msl_fem.identification.prediction_error import ArmaxOrders, Polynomials, jacobian_factors
from msl_fem.identification.regression import ScaledFactor, scaled_factor
from msl_fem.identification.search import EstimationSettings, FirstGuess, LikelihoodFit, excerpts

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
    floor, factor = _floor(profile, delta, polynomials, bounds=bounds, search=search)
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
        floor, factor = _floor(profile, floor.delta, evaluation.polynomials, bounds=bounds, search=search)
    return _model(first, floor, factor, profile=profile)


@dataclass(frozen=True, eq=False)
class Profile:
    """Runs, orders, terms and belief whose objective is looked at as a function of delta."""

    runs: tuple[SampledRun, ...]
    orders: ArmaxOrders
    rational: RationalInputs
    belief: CoefficientPrior | None = None

    def signals(self, delta: float) -> list[Array]:
        """Output, inputs and ones of every run with the terms at this delta."""
        return [run.signals for run in _evaluated(self.runs, self.rational.with_delta(delta))]

    def problem(self, delta: float) -> EstimationProblem:
        """What is minimised at this delta."""
        return EstimationProblem(self.signals(delta), self.orders, self.belief)

    def fitted(self, delta: float, start: Polynomials, *, excerpt: bool = False) -> LikelihoodFit:
        """The search at this delta from the coefficients at a neighbouring one."""
        problem = self.problem(delta)
        if excerpt:
            problem = replace(
                problem, runs=excerpts(problem.runs, EXCERPT_SAMPLES, longest_lag=self.orders.longest_lag)
            )
        return best_search(problem, starts=[FirstGuess("delta search", start)], settings=EstimationSettings())

    def joint_factor(self, delta: float, result: LikelihoodFit) -> ScaledFactor:
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


def _valley(
    profile: Profile, start: Polynomials, *, bounds: tuple[float, float], coarse: float
) -> tuple[float, Polynomials]:
    """delta near the minimum of the objective on an excerpt, and the coefficients there."""
    from scipy.optimize import minimize_scalar

    best_delta = profile.rational.delta
    best = profile.fitted(profile.rational.delta, start, excerpt=True)

    def objective(delta: float) -> float:
        nonlocal best_delta, best
        result = profile.fitted(float(delta), best.evaluation.polynomials, excerpt=True)
        if result.evaluation.objective < best.evaluation.objective:
            best_delta = float(delta)
            best = result
        return result.evaluation.objective

    tolerance = coarse * (bounds[1] - bounds[0])
    minimize_scalar(objective, bounds=bounds, method="bounded", options={"xatol": tolerance})
    return best_delta, best.evaluation.polynomials


@dataclass(frozen=True, eq=False)
class Floor:
    """The fit at a gap offset; at the end of the search with what is to be said about it."""

    delta: float
    result: LikelihoodFit
    notes: tuple[str, ...] = ()

    @property
    def objective(self) -> float:
        """Of the fit."""
        return self.result.evaluation.objective


class _DeltaStep:
    """Gauss-Newton's step of delta in m, by the joint Jacobian of delta and all coefficients."""

    stale = False

    def __init__(self, factor: ScaledFactor, noise_variance: float) -> None:
        self.factor = factor
        self.whole = -float(factor.solution()[-1])
        error = float(np.sqrt(noise_variance * factor.inverse_gram()[-1, -1]))
        self.promised = (self.whole / error) ** 2 / 2  # of half the objective over the noise's variance

    def step(self, damping: float) -> tuple[Array, float]:
        return halved(np.array([self.whole]), damping), self.promised


class _BoundedProfile:
    """The profile within the bounds of delta."""

    def __init__(self, profile: Profile, bounds: tuple[float, float]) -> None:
        self.profile, self.bounds = profile, bounds

    def moved(self, point: Floor, move: Array) -> Floor:
        delta = min(max(point.delta + float(move[0]), self.bounds[0]), self.bounds[1])
        if delta == point.delta:
            return point
        return Floor(delta, self.profile.fitted(delta, point.result.evaluation.polynomials))

    def model(self, point: Floor, neighbour: _DeltaStep | None) -> _DeltaStep:
        factor = self.profile.joint_factor(point.delta, point.result)
        return _DeltaStep(factor, point.result.evaluation.noise_variance)


def _floor(
    profile: Profile, delta: float, start: Polynomials, *, bounds: tuple[float, float], search: DeltaSearch
) -> tuple[Floor, ScaledFactor]:
    """delta at the minimum of the objective on all data with its joint Jacobian, by steps halved until downhill."""
    first = Floor(delta, profile.fitted(delta, start))
    settings = DescentSettings(
        replace(HALVING, most=64.0),
        search.step_tolerance**2 / 2,
        most_trials=10 * search.max_steps,
        most_steps=search.max_steps,
    )
    end = descend(_BoundedProfile(profile, bounds), first, settings)
    notes: tuple[str, ...] = (f"the search for delta did not settle in {search.max_steps} steps",)
    at = end.point.delta
    if end.ending == "converged":
        notes = ()
    elif at in bounds and (end.model.whole > 0.0) == (at == bounds[1]):
        notes = (f"delta ended at its bound {at:.4g} m: widen the bounds if that is not physical",)
    return replace(end.point, notes=notes), end.model.factor


def _model(first: ArmaxModel, floor: Floor, factor: ScaledFactor, *, profile: Profile) -> ArmaxModel:
    rational = profile.rational.with_delta(floor.delta)
    problem = profile.problem(floor.delta)
    model = estimated_model(
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
        covariance=covariance(problem, floor.result.evaluation, factor=factor),
        condition_number=factor.condition_number,
        notes=(*model.notes, *floor.notes),
    )


def _evaluated(runs: Sequence[SampledRun], rational: RationalInputs) -> list[SampledRun]:
    return [rational.evaluated(run) for run in runs]


def _equation_slope(input_slopes: Array, polynomials: Polynomials, orders: ArmaxOrders) -> Array:
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
