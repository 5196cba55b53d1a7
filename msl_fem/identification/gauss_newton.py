"""Minimisation of the exact likelihood's cost by Gauss-Newton with step control.

H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (12)-(14); the step length is controlled by damping
(Levenberg-Marquardt on scaled columns) instead of a fixed factor, and the undamped step is always tried in the end.
Where Gauss-Newton no longer halves its step, the exact second derivatives take over.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.identification.curvature import QuadraticModel, objective_gradient, quadratic_model
from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials, polynomials_of, reflected
from msl_fem.identification.prediction_error import (
    PredictionErrors,
    jacobian_factor,
    prediction_errors,
)
from msl_fem.identification.regression import ScaledFactor, scaled_factor

DAMPINGS = (0.0, 1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4)
NOISE_FREE = 1e-11  # rms prediction error over rms output below which only rounding is left
SLOW, CLOSE = 0.4, 6.0  # second derivatives are worth it if the step shrank by less and is shorter (standard errors)
NEAR_ENOUGH = 0.03  # standard errors; a search that rounding stops within this has converged


@dataclass(frozen=True)
class SearchSettings:
    """When the search ends: a step shorter than `step_tolerance` standard errors, or `max_iterations` steps."""

    step_tolerance: float = 1e-3
    max_iterations: int = 60


@dataclass(frozen=True)
class Convergence:
    """How the search went: where it began, cost after each step, length of each next step in standard errors."""

    converged: bool
    reason: str
    start: str
    costs: tuple[float, ...]
    step_lengths: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Polynomials with the prediction errors of every run."""

    polynomials: Polynomials
    runs: tuple[PredictionErrors, ...]

    @property
    def cost(self) -> float:
        """Sum of squared errors over all runs."""
        return sum(run.cost for run in self.runs)

    @property
    def objective(self) -> float:
        """Cost times det(H'H)^(1/n), what maximum likelihood minimises; inf when it is not finite."""
        log_determinant = sum(run.log_determinant for run in self.runs)
        objective = self.cost * float(np.exp(log_determinant / self.n_equations))
        return objective if np.isfinite(objective) else float("inf")

    @property
    def errors(self) -> list[FloatArray]:
        """Prediction errors run by run."""
        return [run.errors for run in self.runs]

    @property
    def n_equations(self) -> int:
        """Number of full equations over all runs."""
        return sum(run.n_equations for run in self.runs)

    def noise_variance(self, orders: ArmaxOrders) -> float:
        """Cost over the degrees of freedom: equations less coefficients."""
        return self.cost / (self.n_equations - orders.n_parameters)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The last evaluation, its Jacobian's decomposition and the trail."""

    evaluation: Evaluation
    factor: ScaledFactor
    convergence: Convergence


def evaluate(runs: Sequence[FloatArray], polynomials: Polynomials, orders: ArmaxOrders) -> Evaluation:
    """Prediction errors of all runs, with C's unstable zeros reflected first."""
    inverted = replace(polynomials, c=reflected(polynomials.c))
    with np.errstate(over="ignore", invalid="ignore"):
        return Evaluation(inverted, tuple(prediction_errors(signals, inverted, orders) for signals in runs))


def linearised(runs: Sequence[FloatArray], evaluation: Evaluation, orders: ArmaxOrders) -> ScaledFactor:
    """Decomposed Jacobian of the errors at an evaluation, with the errors as right side."""
    return scaled_factor(jacobian_factor(runs, evaluation.polynomials, orders, errors=evaluation.errors))


def search(
    runs: Sequence[FloatArray], orders: ArmaxOrders, *, start: Evaluation, name: str, settings: SearchSettings
) -> SearchResult:
    """Minimiser of the objective from one start, with the reason why the search ended."""
    current = start
    energy = sum(float(signals[0] @ signals[0]) for signals in runs)
    costs: list[float] = [current.cost]
    lengths: list[float] = []
    damping_index, slow = 0, False
    while True:
        factor = linearised(runs, current, orders)
        gradient = objective_gradient(runs, current.polynomials, orders, evaluated=current.runs)
        model: ScaledFactor | QuadraticModel = factor.with_gradient(gradient)
        variance = current.noise_variance(orders)
        length = float(np.sqrt(model.explained / variance)) if variance > 0.0 else 0.0
        converged, reason = False, ""
        if current.cost <= NOISE_FREE**2 * energy:
            converged, reason = True, "the model explains the data to rounding"
        elif length < settings.step_tolerance:
            converged, reason = True, f"the next step is below {settings.step_tolerance:g} standard errors"
        elif len(lengths) >= settings.max_iterations:
            reason = f"{settings.max_iterations} steps were taken; the next one is {length:.2g} standard errors"
        else:
            slow = slow or (len(lengths) > 1 and length > SLOW * lengths[-1])
            if orders.nc and slow and length < CLOSE:
                model = quadratic_model(runs, current.polynomials, orders, factor=factor, gradient=gradient)
            better, damping_index = _downhill(runs, orders, current, model=model, damping_index=damping_index)
            if better is None:
                converged = length < NEAR_ENOUGH
                reason = f"no step lowers the cost; the full one is {length:.2g} standard errors"
            else:
                current = better
                costs.append(current.cost)
        lengths.append(length)
        if reason:
            trail = Convergence(converged, reason, name, tuple(costs), tuple(lengths))
            return SearchResult(current, factor, trail)


def _downhill(
    runs: Sequence[FloatArray],
    orders: ArmaxOrders,
    current: Evaluation,
    *,
    model: ScaledFactor | QuadraticModel,
    damping_index: int,
) -> tuple[Evaluation | None, int]:
    """The first damped step that lowers the objective, beginning one damping below the last; None if none does."""
    vector = current.polynomials.vector(orders)
    for index in range(max(damping_index - 1, 0), len(DAMPINGS)):
        step = model.solution(DAMPINGS[index])
        trial = evaluate(runs, polynomials_of(vector - step, orders), orders)
        if trial.objective < current.objective:
            return trial, index
    return None, 0
