"""The objective of the search at one set of coefficients, its curvature, and what follows from both.

The objective is the restricted likelihood's: the linear coefficients (A, B, the offset) fit part of the noise, most of
all where 1/C has a resonance and the regressors have power, and the plain likelihood takes what they removed for a
deeper zero of C, in the extreme for one on the unit circle. With the linear coefficients integrated out the bias goes
(H. D. Patterson and R. Thompson, Biometrika 58, 1971; for moving averages with regressors N. Shephard, J. Time Series
Anal. 14, 1993): log det(X'PX) is added, X the sensitivities to the linear coefficients and P the projection off the
response H to the unknown first errors, and as many equations fewer are counted.

Given C, the errors are linear in A, B and the offset, so J'J is exact for those; the rows of C come from differences of
the gradient. The term that Gauss-Newton drops matters when C's zeros are within about 1/n of the unit circle, where the
objective is far from quadratic in them.

The asymptotic covariance takes the record as long against the memory of 1/C. Where it is not (white sensor noise on a
lightly damped, oversampled mode), the information on C at the estimate says too much: it grows without end as the zeros
near the unit circle. There the restricted likelihood, maximised over A, B and the offset, is looked at a step of `STEP`
standard errors around the estimate, and its curvature takes the place of Gauss-Newton's in C's part. C's errors reach A
and B through their correlation, so their intervals widen with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.identification.prediction_error import (
    ArmaxOrders,
    JacobianFactors,
    Polynomials,
    PredictionErrors,
    cost_gradient,
    jacobian_factors,
    prediction_errors,
    reflected,
    sensitivity_columns,
    sensitivity_signals,
    twice_filtered,
)
from msl_fem.identification.regression import ScaledFactor, lagged_blocks, r_factor, scaled_factor

DEPENDENT = 1e-12  # a linear column with less than this part of its own carries no determinant
GRADIENT_STEP = 1e-8  # of C's coefficients
STEP = 0.5  # standard errors
MEMORIES = 1000  # of 1/C in a record from which the asymptotic covariance is as good as exact


@dataclass(frozen=True, eq=False)
class CoefficientPrior:
    """A Gaussian prior of the coefficients as further equations, weight @ coefficients = target, each with unit weight.

    `weight` has shape (n_believed, n_parameters) and is scaled so that the residual of a coefficient that is one
    standard deviation off is one standard deviation of the innovations: then it counts in the cost like an error.
    """

    weight: Array
    target: Array

    def residual(self, coefficients: Array) -> Array:
        """weight @ coefficients - target, shape (n_believed,)."""
        return self.weight @ coefficients - self.target


@dataclass(frozen=True, eq=False)
class EstimationProblem:
    """Signals of every run (SampledRun.signals), orders with nb and nk for each input, and a belief or none."""

    runs: Sequence[Array]
    orders: ArmaxOrders
    belief: CoefficientPrior | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Polynomials with the prediction errors of every run and the factors of the Jacobian there.

    `believed` holds the residuals of the prior's equations, which count like errors. `factors` is None where the
    errors are not finite. `reference` is log det of the linear coefficients' unfiltered columns taken as
    orthogonal: without it the objective would depend on the signals' units.
    """

    polynomials: Polynomials
    runs: tuple[PredictionErrors, ...]
    believed: Array
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
    def errors(self) -> list[Array]:
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


def evaluated(problem: EstimationProblem, polynomials: Polynomials) -> Evaluation:
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


def evaluated_reflected(problem: EstimationProblem, polynomials: Polynomials) -> Evaluation:
    """As `evaluated`, with C's unstable zeros reflected first."""
    return evaluated(problem, replace(polynomials, c=reflected(polynomials.c)))


def objective_gradient(problem: EstimationProblem, evaluation: Evaluation) -> Array:
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


def linear_log_determinant(total: Array, n_linear: int) -> float:
    """log det(X'PX) from the triangular factor of [X, ...], without directions that carry none of their own."""
    diagonal = np.abs(np.diag(_linear_factor(total, n_linear)[0]))
    return 2.0 * float(np.sum(np.log(diagonal)))


def _linear_factor(total: Array, n_linear: int) -> tuple[Array, np.ndarray]:
    """Triangular factor of the columns of X that are independent, and which these are."""
    factor = total[:n_linear, :n_linear]
    own = np.abs(np.diag(factor)) > DEPENDENT * np.linalg.norm(factor, axis=0)
    return (factor, own) if own.all() else (r_factor(factor[:, own]), own)


def log_determinant_gradient(problem: EstimationProblem, evaluation: Evaluation, *, linear: bool = True) -> Array:
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


def _reference(problem: EstimationProblem) -> float:
    """log det of the unfiltered linear columns as if they were orthogonal."""
    orders = problem.orders
    power = np.sum([np.einsum("ij,ij->i", signals, signals) for signals in problem.runs], axis=0)
    counts = [orders.na, *map(len, orders.input_lags), int(orders.offset)]
    return float(sum(n * np.log(p) for n, p in zip(counts, power, strict=True) if n and p > 0.0))


def _finite(value: float) -> float:
    return value if np.isfinite(value) else float("inf")


@dataclass(frozen=True, eq=False)
class SecondOrderModel:
    """Eigenvalues and -vectors of the scaled Hessian, and the scaled gradient in their basis."""

    scale: Array
    eigenvalues: Array
    eigenvectors: Array
    gradient: Array

    @property
    def explained(self) -> float:
        """Predicted decrease of the cost by the full step, doubled: comparable to ScaledFactor.explained."""
        return float(np.sum(self.gradient**2 / np.maximum(np.abs(self.eigenvalues), 1e-300)))

    def solution(self, damping: float = 0.0) -> Array:
        """Damped Newton step (to be subtracted); negative curvature counts by its size, so it leads downhill."""
        sizes = np.abs(self.eigenvalues)
        step = self.gradient / np.maximum(sizes + damping * sizes.max(), 1e-300)
        return (self.eigenvectors @ step) / self.scale


def quadratic_model(
    problem: EstimationProblem, evaluation: Evaluation, *, factor: ScaledFactor, gradient: Array
) -> SecondOrderModel:
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
    return SecondOrderModel(factor.scale, eigenvalues, eigenvectors, eigenvectors.T @ (gradient / factor.scale))


CriterionName = Literal["bic", "aicc"]


@dataclass(frozen=True)
class InformationCriterion:
    """BIC (G. Schwarz, Ann. Statist. 6, 1978) or AICc (C. M. Hurvich and C.-L. Tsai, Biometrika 76, 1989)."""

    name: CriterionName = "bic"

    def __post_init__(self) -> None:
        if self.name not in ("bic", "aicc"):
            raise InputError(f"criterion {self.name!r}: give bic or aicc")

    def penalty(self, n_coefficients: int, n_equations: int) -> float:
        """What that many coefficients cost."""
        if self.name == "bic":
            return n_coefficients * float(np.log(n_equations))
        return 2.0 * n_coefficients * n_equations / max(n_equations - n_coefficients - 1, 1)

    def value(self, evaluation: Evaluation) -> float:
        """Minus twice the exact log likelihood of the one-step errors, less its constant, plus the penalty."""
        n = evaluation.n_equations
        deviance = n * float(np.log(evaluation.likelihood_cost / n))
        return deviance + self.penalty(evaluation.n_parameters, n)


def covariance(problem: EstimationProblem, evaluation: Evaluation, *, factor: ScaledFactor | None = None) -> Array:
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


def _curvature(problem: EstimationProblem, evaluation: Evaluation, root: Array) -> Array:
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


def _profile(problem: EstimationProblem, evaluation: Evaluation, step: Array) -> float:
    """Minus the log restricted likelihood with C moved by `step` and A, B, offset at their best."""
    polynomials = evaluation.polynomials
    moved = evaluated_reflected(problem, replace(polynomials, c=polynomials.c + np.append(0.0, step)))
    if moved.factors is None:
        return float("inf")
    linear = [*range(problem.orders.n_linear), moved.factors.total.shape[1] - 1]
    cost = float(r_factor(moved.factors.total[:, linear])[-1, -1] ** 2)
    return 0.5 * moved.degrees_of_freedom * float(np.log(moved.objective * cost / moved.cost))


def _memories(evaluation: Evaluation) -> float:
    """How many times the slowest mode of 1/C forgets within the records."""
    slowest = float(np.max(np.abs(np.roots(evaluation.polynomials.c)), initial=0.0))
    return evaluation.n_equations * max(1.0 - slowest, 0.0)
