"""Covariance of the coefficients: that of Gauss-Newton, with the true curvature of C where zeros lie near the circle.

The asymptotic covariance takes the record as long against the memory of 1/C. Where it is not (white sensor noise on a
lightly damped, oversampled mode), the information on C at the estimate says too much: it grows without end as the zeros
near the unit circle. There the restricted likelihood, maximised over A, B and the offset, is looked at a step of
`STEP` standard errors around the estimate, and its curvature takes the place of Gauss-Newton's in C's part. C's errors
reach A and B through their correlation, so their intervals widen with it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msl_fem.identification.data import FloatArray
from msl_fem.identification.evaluation import Evaluation, evaluate
from msl_fem.identification.problem import Problem
from msl_fem.identification.regression import ScaledFactor, r_factor, scaled_factor

STEP = 0.5  # standard errors
MEMORIES = 1000  # of 1/C in a record from which the asymptotic covariance is as good as exact


def covariance(problem: Problem, evaluation: Evaluation, *, factor: ScaledFactor | None = None) -> FloatArray:
    """Covariance of the coefficients at the end of a search, shape (n_parameters, n_parameters).

    `factor` may hold the Jacobian with further columns behind those of the coefficients (a gap offset); the covariance
    then has their rows too.
    """
    assert evaluation.factors is not None
    own = scaled_factor(evaluation.factors.total)
    whole = evaluation.noise_variance * (factor or own).inverse_gram()
    nc, n_linear = problem.orders.nc, problem.orders.n_linear
    if nc == 0 or own.kept.min() == 0.0 or _memories(evaluation) > MEMORIES:
        return whole
    block = slice(n_linear, n_linear + nc)
    gauss_newton = evaluation.noise_variance * own.inverse_gram()[block, block]
    root = np.asarray(np.linalg.cholesky(gauss_newton), dtype=float)
    curvature = _curvature(problem, evaluation, root)
    if not np.linalg.eigvalsh(curvature).min() > 0.0:
        return whole
    inverse = np.asarray(np.linalg.inv(root), dtype=float)
    excess = inverse.T @ (curvature - np.eye(nc)) @ inverse
    into = whole[:, block]
    return whole - into @ np.linalg.solve(np.eye(nc) + excess @ whole[block, block], excess @ into.T)


def _curvature(problem: Problem, evaluation: Evaluation, root: FloatArray) -> FloatArray:
    """Second differences of minus the log restricted likelihood along the columns of `root`, shape (nc, nc)."""
    steps = STEP * root.T
    centre = _profile(problem, evaluation, np.zeros(steps.shape[1]))
    single = np.array([[_profile(problem, evaluation, sign * step) for sign in (1, -1)] for step in steps])
    around = single.sum(axis=1)
    curvature = np.diag(around - 2.0 * centre)
    for i in range(steps.shape[0]):
        for j in range(i):
            both = sum(_profile(problem, evaluation, sign * (steps[i] + steps[j])) for sign in (1, -1))
            curvature[i, j] = curvature[j, i] = 0.5 * (both - around[i] - around[j] + 2.0 * centre)
    return curvature / STEP**2


def _profile(problem: Problem, evaluation: Evaluation, step: FloatArray) -> float:
    """Minus the log restricted likelihood with C moved by `step` and A, B, offset at their best."""
    polynomials = evaluation.polynomials
    moved = evaluate(problem, replace(polynomials, c=polynomials.c + np.append(0.0, step)))
    if moved.factors is None:
        return float("inf")
    linear = [*range(problem.orders.n_linear), moved.factors.total.shape[1] - 1]
    cost = float(r_factor(moved.factors.total[:, linear])[-1, -1] ** 2)
    return 0.5 * moved.degrees_of_freedom * float(np.log(moved.objective * cost / moved.cost))


def _memories(evaluation: Evaluation) -> float:
    """How many times the slowest mode of 1/C forgets within the records."""
    slowest = float(np.max(np.abs(np.roots(evaluation.polynomials.c)), initial=0.0))
    return evaluation.n_equations * max(1.0 - slowest, 0.0)
