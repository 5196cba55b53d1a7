"""Minimisation of the restricted likelihood's cost by Gauss-Newton with step control.

H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (12)-(14); the step length is controlled by damping
(Levenberg-Marquardt on scaled columns) instead of a fixed factor, and the undamped step is always tried in the end.
Where Gauss-Newton no longer halves its step, the exact second derivatives take over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msl_fem.identification.curvature import QuadraticModel, quadratic_model
from msl_fem.identification.evaluation import Evaluation, evaluate, objective_gradient
from msl_fem.identification.polynomials import polynomials_of
from msl_fem.identification.problem import Problem
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
class SearchResult:
    """The last evaluation, its Jacobian's decomposition and the trail."""

    evaluation: Evaluation
    factor: ScaledFactor
    convergence: Convergence


def linearised(evaluation: Evaluation) -> ScaledFactor:
    """Decomposed Jacobian of the errors at an evaluation, with the errors as right side."""
    assert evaluation.factors is not None
    return scaled_factor(evaluation.factors.total)


def search(problem: Problem, *, start: Evaluation, name: str, settings: SearchSettings) -> SearchResult:
    """Minimiser of the objective from one start, with the reason why the search ended."""
    current = start
    energy = sum(float(signals[0] @ signals[0]) for signals in problem.runs)
    costs: list[float] = [current.cost]
    lengths: list[float] = []
    damping_index, slow = 0, False
    while True:
        factor = linearised(current)
        gradient = objective_gradient(problem, current)
        model: ScaledFactor | QuadraticModel = factor.with_gradient(gradient)
        variance = current.noise_variance
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
            if problem.orders.nc and slow and length < CLOSE:
                model = quadratic_model(problem, current, factor=factor, gradient=gradient)
            better, damping_index = _downhill(problem, current, model=model, damping_index=damping_index)
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
    problem: Problem,
    current: Evaluation,
    *,
    model: ScaledFactor | QuadraticModel,
    damping_index: int,
) -> tuple[Evaluation | None, int]:
    """The first damped step that lowers the objective, beginning one damping below the last; None if none does."""
    vector = current.polynomials.vector(problem.orders)
    for index in range(max(damping_index - 1, 0), len(DAMPINGS)):
        step = model.solution(DAMPINGS[index])
        trial = evaluate(problem, polynomials_of(vector - step, problem.orders))
        if trial.objective < current.objective:
            return trial, index
    return None, 0
