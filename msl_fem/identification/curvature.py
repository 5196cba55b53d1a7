"""The objective's exact second derivatives, for the cases where Gauss-Newton's dropped term matters.

Given C, the errors are linear in A, B and the offset, so J'J is exact for those; the rows of C come from differences
of the gradient. The term that Gauss-Newton drops matters when C's zeros are within about 1/n of the unit circle,
where the objective is far from quadratic in them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msl_fem.identification.data import FloatArray
from msl_fem.identification.evaluation import Evaluation, evaluated, objective_gradient
from msl_fem.identification.problem import Problem
from msl_fem.identification.regression import ScaledFactor

GRADIENT_STEP = 1e-8  # of C's coefficients


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Eigenvalues and -vectors of the scaled Hessian, and the scaled gradient in their basis."""

    scale: FloatArray
    eigenvalues: FloatArray
    eigenvectors: FloatArray
    gradient: FloatArray

    @property
    def explained(self) -> float:
        """Predicted decrease of the cost by the full step, doubled: comparable to ScaledFactor.explained."""
        return float(np.sum(self.gradient**2 / np.maximum(np.abs(self.eigenvalues), 1e-300)))

    def solution(self, damping: float = 0.0) -> FloatArray:
        """Damped Newton step (to be subtracted); negative curvature counts by its size, so it leads downhill."""
        sizes = np.abs(self.eigenvalues)
        step = self.gradient / np.maximum(sizes + damping * sizes.max(), 1e-300)
        return (self.eigenvectors @ step) / self.scale


def quadratic_model(
    problem: Problem, evaluation: Evaluation, *, factor: ScaledFactor, gradient: FloatArray
) -> QuadraticModel:
    """Second-order model of half the objective around an evaluation, whose Gauss-Newton model is `factor`."""
    orders, polynomials = problem.orders, evaluation.polynomials
    hessian = factor.gram()
    for i in range(orders.nc):
        step = np.zeros(orders.nc + 1)
        step[i + 1] = GRADIENT_STEP
        ahead, behind = (
            objective_gradient(problem, evaluated(problem, replace(polynomials, c=polynomials.c + move)))
            for move in (step, -step)
        )
        row = orders.n_linear + i
        hessian[row, :] = hessian[:, row] = (ahead - behind) / (2.0 * GRADIENT_STEP)
    corner = hessian[-orders.nc :, -orders.nc :]
    hessian[-orders.nc :, -orders.nc :] = 0.5 * (corner + corner.T)
    scaled = hessian / np.outer(factor.scale, factor.scale)
    eigenvalues, eigenvectors = np.linalg.eigh(scaled)
    return QuadraticModel(factor.scale, eigenvalues, eigenvectors, eigenvectors.T @ (gradient / factor.scale))
