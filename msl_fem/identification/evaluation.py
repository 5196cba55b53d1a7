"""The objective that the search minimises, at one set of coefficients.

The objective is the restricted likelihood's: the linear coefficients (A, B, the offset) fit part of the noise, most of
all where 1/C has a resonance and the regressors have power, and the plain likelihood takes what they removed for a
deeper zero of C, in the extreme for one on the unit circle. With the linear coefficients integrated out the bias goes
(H. D. Patterson and R. Thompson, Biometrika 58, 1971; for moving averages with regressors N. Shephard, J. Time Series
Anal. 14, 1993): log det(X'PX) is added, X the sensitivities to the linear coefficients and P the projection off the
response H to the unknown first errors, and as many equations fewer are counted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import Polynomials, reflected
from msl_fem.identification.prediction_error import (
    JacobianFactors,
    PredictionErrors,
    cost_gradient,
    jacobian_factors,
    prediction_errors,
    sensitivity_columns,
    sensitivity_signals,
    twice_filtered,
)
from msl_fem.identification.problem import Problem
from msl_fem.identification.regression import lagged_blocks, r_factor

DEPENDENT = 1e-12  # a linear column with less than this part of its own carries no determinant


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Polynomials with the prediction errors of every run and the factors of the Jacobian there.

    `believed` holds the residuals of the prior's equations, which count like errors. `factors` is None where the
    errors are not finite. `reference` is log det of the linear coefficients' unfiltered columns taken as
    orthogonal: without it the objective would depend on the signals' units.
    """

    polynomials: Polynomials
    runs: tuple[PredictionErrors, ...]
    believed: FloatArray
    factors: JacobianFactors | None
    n_parameters: int
    n_linear: int
    reference: float

    @property
    def cost(self) -> float:
        """Sum of squared errors over all runs, and of the prior's residuals."""
        return sum(run.cost for run in self.runs) + float(self.believed @ self.believed)

    @property
    def objective(self) -> float:
        """Cost times (det(H'H) det(X'PX))^(1/degrees of freedom), by restricted likelihood; inf when not finite."""
        if self.factors is None:
            return float("inf")
        log_determinant = sum(run.log_determinant for run in self.runs) - self.reference
        log_determinant += linear_log_determinant(self.factors.total, self.n_linear)
        return _finite(self.cost * float(np.exp(log_determinant / self.degrees_of_freedom)))

    @property
    def likelihood_cost(self) -> float:
        """Cost times det(H'H)^(1/n): n/2 times its logarithm is minus the exact log likelihood, up to a constant."""
        log_determinant = sum(run.log_determinant for run in self.runs)
        return _finite(self.cost * float(np.exp(log_determinant / self.n_equations)))

    @property
    def errors(self) -> list[FloatArray]:
        """Prediction errors run by run."""
        return [run.errors for run in self.runs]

    @property
    def n_equations(self) -> int:
        """Number of full equations over all runs, the prior's included."""
        return sum(run.n_equations for run in self.runs) + self.believed.size

    @property
    def degrees_of_freedom(self) -> int:
        """Equations less linear coefficients."""
        return self.n_equations - self.n_linear

    @property
    def noise_variance(self) -> float:
        """Cost over equations less coefficients."""
        return self.cost / (self.n_equations - self.n_parameters)


def evaluated(problem: Problem, polynomials: Polynomials) -> Evaluation:
    """Prediction errors and Jacobian of all runs at these polynomials as they are."""
    orders, belief = problem.orders, problem.belief
    believed = np.zeros(0) if belief is None else belief.residual(polynomials.vector(orders))
    with np.errstate(over="ignore", invalid="ignore"):
        errors = tuple(prediction_errors(signals, polynomials, orders) for signals in problem.runs)
        factors = None
        if np.isfinite(sum(run.cost for run in errors)):
            factors = jacobian_factors(problem.runs, polynomials, orders, errors=[run.errors for run in errors])
    if factors is not None and belief is not None:
        factors = factors.with_rows(np.column_stack([belief.weight, believed]))
    return Evaluation(
        polynomials, errors, believed, factors, orders.n_parameters, orders.n_linear, reference=_reference(problem)
    )


def evaluate(problem: Problem, polynomials: Polynomials) -> Evaluation:
    """The same with C's unstable zeros reflected first."""
    return evaluated(problem, replace(polynomials, c=reflected(polynomials.c)))


def objective_gradient(problem: Problem, evaluation: Evaluation) -> FloatArray:
    """Gradient of half the cost plus the determinants' share, cost/(2 freedom) log det; shape (n_parameters,)."""
    orders = problem.orders
    gradient = np.zeros(orders.n_parameters)
    for signals, run in zip(problem.runs, evaluation.runs, strict=True):
        gradient += cost_gradient(signals, evaluation.polynomials, orders, errors=run.errors)
    if problem.belief is not None:
        gradient += problem.belief.weight.T @ evaluation.believed
    if orders.nc:
        slopes = log_determinant_gradient(problem, evaluation)
        gradient[-orders.nc :] += slopes * evaluation.cost / (2.0 * evaluation.degrees_of_freedom)
    return gradient


def linear_log_determinant(total: FloatArray, n_linear: int) -> float:
    """log det(X'PX) from the triangular factor of [X, ...], without directions that carry none of their own."""
    diagonal = np.abs(np.diag(_linear_factor(total, n_linear)[0]))
    return 2.0 * float(np.sum(np.log(diagonal)))


def _linear_factor(total: FloatArray, n_linear: int) -> tuple[FloatArray, np.ndarray]:
    """Triangular factor of the columns of X that are independent, and which these are."""
    factor = total[:n_linear, :n_linear]
    own = np.abs(np.diag(factor)) > DEPENDENT * np.linalg.norm(factor, axis=0)
    return (factor, own) if own.all() else (r_factor(factor[:, own]), own)


def log_determinant_gradient(problem: Problem, evaluation: Evaluation, *, linear: bool = True) -> FloatArray:
    """Derivatives of log det(H'H) + log det(X'PX), the latter if `linear`, by c_1 ... c_nc, shape (nc,).

    With M = [H, X] = QR it is 2 tr(Q' dM R^-1), and dM is M delayed and filtered by -1/C once more.
    """
    assert evaluation.factors is not None
    orders = problem.orders
    nc = orders.nc
    columns = sensitivity_columns(orders)[0]
    linear_factor, own = _linear_factor(evaluation.factors.total, orders.n_linear if linear else 0)
    chosen = [*range(nc), *(nc + np.flatnonzero(own))]
    kept = [columns[i] for i in chosen]
    gradient = np.zeros(nc)
    for signals, run, head in zip(problem.runs, evaluation.runs, evaluation.factors.heads, strict=True):
        rows = sensitivity_signals(signals, evaluation.polynomials, run.errors)
        both = np.vstack([rows, twice_filtered(rows, evaluation.polynomials)])
        factor = np.zeros((len(kept), len(kept)))
        factor[:nc] = head[:, chosen]
        factor[nc:, nc:] = linear_factor
        scale = np.linalg.norm(factor, axis=0)
        inverse = np.linalg.inv(factor / scale) / scale[:, None]
        first = orders.longest_lag - nc
        moved = [(row + rows.shape[0], lag + i) for i in range(1, nc + 1) for row, lag in kept]
        for block in lagged_blocks(both, [*kept, *moved], first=first):
            orthogonal = block[:, : len(kept)] @ inverse
            for i in range(nc):
                part = block[:, (i + 1) * len(kept) : (i + 2) * len(kept)]
                gradient[i] -= 2.0 * float(np.sum(orthogonal * (part @ inverse)))
    return gradient


def _reference(problem: Problem) -> float:
    """log det of the unfiltered linear columns as if they were orthogonal."""
    orders = problem.orders
    power = np.sum([np.einsum("ij,ij->i", signals, signals) for signals in problem.runs], axis=0)
    counts = [orders.na, *map(len, orders.input_lags), int(orders.offset)]
    return float(sum(n * np.log(p) for n, p in zip(counts, power, strict=True) if n and p > 0.0))


def _finite(value: float) -> float:
    return value if np.isfinite(value) else float("inf")
