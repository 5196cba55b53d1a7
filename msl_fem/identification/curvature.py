"""The objective's exact second derivatives, for the cases where Gauss-Newton's dropped term matters.

Given C, the errors are linear in A, B and the offset, so J'J is exact for those; the rows of C come from differences
of the gradient. The term that Gauss-Newton drops matters when C's zeros are within about 1/n of the unit circle,
where the objective is far from quadratic in them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.prediction_error import (
    PredictionErrors,
    cost_gradient,
    log_determinant_gradient,
    prediction_errors,
)
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
    runs: Sequence[FloatArray],
    polynomials: Polynomials,
    orders: ArmaxOrders,
    *,
    factor: ScaledFactor,
    gradient: FloatArray,
) -> QuadraticModel:
    """Second-order model of half the objective around `polynomials`, whose Gauss-Newton model is `factor`."""
    hessian = factor.gram()
    for i in range(orders.nc):
        step = np.zeros(orders.nc + 1)
        step[i + 1] = GRADIENT_STEP
        ahead, behind = (
            objective_gradient(runs, replace(polynomials, c=polynomials.c + move), orders) for move in (step, -step)
        )
        row = orders.n_parameters - orders.nc + i
        hessian[row, :] = hessian[:, row] = (ahead - behind) / (2.0 * GRADIENT_STEP)
    corner = hessian[-orders.nc :, -orders.nc :]
    hessian[-orders.nc :, -orders.nc :] = 0.5 * (corner + corner.T)
    scaled = hessian / np.outer(factor.scale, factor.scale)
    eigenvalues, eigenvectors = np.linalg.eigh(scaled)
    return QuadraticModel(factor.scale, eigenvalues, eigenvectors, eigenvectors.T @ (gradient / factor.scale))


def objective_gradient(
    runs: Sequence[FloatArray],
    polynomials: Polynomials,
    orders: ArmaxOrders,
    *,
    evaluated: Sequence[PredictionErrors] | None = None,
) -> FloatArray:
    """Gradient of half the cost plus the determinant's share, cost/(2n) log det(H'H); shape (n_parameters,)."""
    if evaluated is None:
        evaluated = [prediction_errors(signals, polynomials, orders) for signals in runs]
    gradient = np.zeros(orders.n_parameters)
    for signals, run in zip(runs, evaluated, strict=True):
        gradient += cost_gradient(signals, polynomials, orders, errors=run.errors)
    if orders.nc:
        cost = sum(run.cost for run in evaluated)
        n_equations = sum(run.n_equations for run in evaluated)
        slopes = sum(log_determinant_gradient(polynomials.c, run.errors.size) for run in evaluated)
        gradient[-orders.nc :] += slopes * cost / (2.0 * n_equations)
    return gradient
