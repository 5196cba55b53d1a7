"""Box-Jenkins and output-error models with one denominator F for all inputs: y = sum_k B_k/F u_k + C/D e + offset.

The inputs of a moving mass share its poles, so one F serves them all. Multiplied out, the model is an ARMAX model with
tied coefficients, A = F D, C' = F C, B_k' = D B_k (G. E. P. Box and G. M. Jenkins, Time Series Analysis, ch. 11; L.
Ljung, System Identification, 2nd ed., eq. (4.31)), and so are its Jacobian, unknown first errors and exact likelihood,
by the chain rule. nc = nd = 0 is output error: white noise on the output, C' = A. F must be stable, since it stands in
the predictor's denominator: for an unstable plant use ARMAX.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.computing.gauss_newton import descend
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification.armax import ArmaxModel, fit_armax
from msl_fem.identification.data import SampledRun, check_runs
from msl_fem.identification.likelihood import EstimationProblem, Evaluation, evaluated, log_determinant_gradient
from msl_fem.identification.model import Convergence
from msl_fem.identification.prediction_error import (
    ArmaxOrders,
    Polynomials,
    polynomials_of,
    prediction_errors,
    reflected,
)
from msl_fem.identification.regression import ScaledFactor, r_factor, scaled_factor
from msl_fem.identification.search import EstimationSettings, how_it_ended, long_arx_start

STABLE = 1.0 - 1e-9  # largest radius of F's poles


@dataclass(frozen=True)
class BoxJenkinsOrders:
    """Numbers of coefficients of F, of each B_k, of C and D, and the delay nk of each input; offset as in ARMAX."""

    nf: int
    nb: int | tuple[int, ...]
    nc: int = 0
    nd: int = 0
    nk: int | tuple[int, ...] = 1
    offset: bool = False

    def armax(self, n_inputs: int) -> ArmaxOrders:
        """Orders of the ARMAX model that it is when multiplied out; InputError if they do not fit."""
        if min(self.nf, self.nc, self.nd) < 0:
            raise InputError(f"orders nf = {self.nf}, nc = {self.nc}, nd = {self.nd}: give 0 or more")
        own = ArmaxOrders(self.nf, self.nb, 0, self.nk, self.offset).for_inputs(n_inputs)
        longer = tuple(len(lags) + self.nd for lags in own.input_lags)
        return ArmaxOrders(self.nf + self.nd, longer, self.nf + self.nc, own.nk, self.offset).for_inputs(n_inputs)


@dataclass(frozen=True, eq=False)
class BoxJenkinsModel:
    """The polynomials with their covariance, and the ARMAX model that they are when multiplied out.

    `covariance` (n_parameter, n_parameter) is in the order f, b of each input, offset, c, d, without the leading ones;
    `armax` predicts, simulates and goes to JSON.
    """

    orders: BoxJenkinsOrders
    f: Array
    b: tuple[Array, ...]
    c: Array
    d: Array
    offset: float
    parameter_names: tuple[str, ...]
    parameters: Array
    covariance: Array
    armax: ArmaxModel

    @property
    def standard_errors(self) -> Array:
        """One standard deviation of each coefficient, in the order of `parameter_names`."""
        return np.sqrt(np.diag(self.covariance))


@one_blas_thread
def fit_box_jenkins(
    runs: Sequence[SampledRun], orders: BoxJenkinsOrders, *, settings: EstimationSettings | None = None
) -> BoxJenkinsModel:
    """The model of largest likelihood; output error with nc = nd = 0. InputError, ComputationError as `fit_armax`."""
    check_runs(runs)
    names = tuple(runs[0].inputs)
    product = _Product(orders, len(names))
    problem = EstimationProblem([run.signals for run in runs], product.multiplied)
    first = fit_armax(runs, replace(product.plain, nc=orders.nf))
    start = product.vector(_stable(first.polynomials.a), first.polynomials.b, first.polynomials.offset)
    settings = settings or EstimationSettings()
    if orders.nc or orders.nd:
        white = fit_box_jenkins(runs, replace(orders, nc=0, nd=0), settings=settings)
        start = product.vector(white.f, white.b, white.offset, *_noise_start(white, runs, orders))
    vector, evaluation, factor, convergence = _search(problem, product, start, settings=settings)
    variance = evaluation.cost / (evaluation.n_equations - vector.size)
    covariance = variance * factor.inverse_gram()
    chain = product.jacobian(vector)
    armax = ArmaxModel(
        orders=product.multiplied,
        polynomials=evaluation.polynomials,
        input_names=names,
        sampling_period=first.sampling_period,
        parameter_names=product.multiplied.parameter_names(names),
        covariance=chain @ covariance @ chain.T,
        noise_variance=variance,
        condition_number=factor.condition_number,
        input_condition_number=first.input_condition_number,
        n_samples=evaluation.n_equations,
        convergence=convergence,
        notes=() if convergence.converged else (f"the search did not converge: {convergence.reason}",),
    )
    f, b, offset, c, d = product.parts(vector)
    return BoxJenkinsModel(orders, f, b, c, d, offset, product.names(names), vector, covariance, armax)


class _Product:
    """The map from the coefficients f, b, offset, c, d to those of the ARMAX model that they make."""

    def __init__(self, orders: BoxJenkinsOrders, n_inputs: int) -> None:
        self.orders = orders
        self.multiplied = orders.armax(n_inputs)
        self.plain = ArmaxOrders(orders.nf, orders.nb, 0, orders.nk, orders.offset).for_inputs(n_inputs)

    def vector(
        self,
        f: Array,
        b: Sequence[Array],
        offset: float,
        c: Array | None = None,
        d: Array | None = None,
    ) -> Array:
        """The free coefficients in one vector."""
        noise = [np.zeros(0) if p is None else p[1:] for p in (c, d)]
        return np.concatenate([f[1:], *b, [offset] if self.orders.offset else [], *noise])

    def parts(self, vector: Array) -> tuple[Array, tuple[Array, ...], float, Array, Array]:
        """F, B, offset, C, D with their leading ones."""
        n_linear = self.plain.n_parameters
        own = polynomials_of(vector[:n_linear], self.plain)
        c, d = np.split(vector[n_linear:], [self.orders.nc])
        return own.a, own.b, own.offset, np.append(1.0, c), np.append(1.0, d)

    def names(self, input_names: Sequence[str]) -> tuple[str, ...]:
        """Names of the free coefficients."""
        own = [name.replace("a", "f") if name[0] == "a" else name for name in self.plain.parameter_names(input_names)]
        noise = [f"{p}{i}" for p, n in (("c", self.orders.nc), ("d", self.orders.nd)) for i in range(1, n + 1)]
        return (*own, *noise)

    def admissible(self, vector: Array) -> Array | None:
        """The vector with C's zeros reflected into the unit circle, None if F is not stable."""
        f, b, offset, c, d = self.parts(vector)
        if np.max(np.abs(np.roots(f)), initial=0.0) > STABLE:
            return None
        return self.vector(f, b, offset, reflected(c), d)

    def polynomials(self, vector: Array) -> Polynomials:
        """A, B', C' multiplied out."""
        f, b, offset, c, d = self.parts(vector)
        return Polynomials(np.convolve(f, d), tuple(np.convolve(d, row) for row in b), np.convolve(f, c), offset)

    def jacobian(self, vector: Array) -> Array:
        """Derivatives of the ARMAX coefficients by the free ones, shape (n_armax, n_free)."""
        f, b, _, c, d = self.parts(vector)
        m, columns = self.multiplied, []

        def column(a: Array, rows: Sequence[Array], offset: float, tail: Array) -> None:
            columns.append(np.concatenate([_fill(a, m.na), *rows, [offset] if m.offset else [], _fill(tail, m.nc)]))

        none = [np.zeros(len(lags)) for lags in m.input_lags]
        empty = np.zeros(1)
        for i in range(1, f.size):
            column(_delayed(d, i), none, 0.0, _delayed(c, i))
        for k, row in enumerate(b):
            for j in range(row.size):
                moved = [_padded(_delayed(d, j), len(z)) if n == k else z for n, z in enumerate(none)]
                column(empty, moved, 0.0, empty)
        if m.offset:
            column(empty, none, 1.0, empty)
        for i in range(1, c.size):
            column(empty, none, 0.0, _delayed(f, i))
        for i in range(1, d.size):
            column(
                _delayed(f, i), [_padded(_delayed(row, i), len(z)) for row, z in zip(b, none, strict=True)], 0.0, empty
            )
        return np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class _Tied:
    """The tied coefficients with the evaluation of the ARMAX model that they make; None where F is not stable."""

    vector: Array
    evaluation: Evaluation | None

    @property
    def objective(self) -> float:
        """By the exact likelihood."""
        return float("inf") if self.evaluation is None else self.evaluation.likelihood_cost


class _TiedModel:
    """Gauss-Newton's model of half the objective by the chain rule."""

    stale = False

    def __init__(self, problem: EstimationProblem, product: _Product, point: _Tied) -> None:
        current = point.evaluation
        assert current is not None
        assert current.factors is not None
        chain = product.jacobian(point.vector)
        total = current.factors.total
        factor = scaled_factor(r_factor(np.column_stack([total[:, :-1] @ chain, total[:, -1]])))
        gradient = total[:, :-1].T @ total[:, -1]
        if problem.orders.nc:
            slopes = log_determinant_gradient(problem, current, linear=False)
            gradient[-problem.orders.nc :] += slopes * current.cost / (2.0 * current.n_equations)
        self.factor = factor.with_gradient(chain.T @ gradient)
        self.length = float(np.sqrt(self.factor.explained / current.noise_variance))
        self.promised = self.length**2 / 2

    def step(self, damping: float) -> tuple[Array, float]:
        return -self.factor.solution(damping), self.promised


class _TiedLikelihood:
    """What is minimised; `trail` holds cost and length of the next step at every point that was accepted."""

    def __init__(self, problem: EstimationProblem, product: _Product) -> None:
        self.problem, self.product = problem, product
        self.trail: list[tuple[float, float]] = []

    def at(self, vector: Array) -> _Tied:
        return _Tied(vector, evaluated(self.problem, self.product.polynomials(vector)))

    def moved(self, point: _Tied, move: Array) -> _Tied:
        vector = self.product.admissible(point.vector + move)
        return _Tied(point.vector, None) if vector is None else self.at(vector)

    def model(self, point: _Tied, neighbour: _TiedModel | None) -> _TiedModel:
        model = _TiedModel(self.problem, self.product, point)
        assert point.evaluation is not None
        self.trail.append((point.evaluation.cost, model.length))
        return model


def _search(
    problem: EstimationProblem, product: _Product, start: Array, *, settings: EstimationSettings
) -> tuple[Array, Evaluation, ScaledFactor, Convergence]:
    """The tied coefficients of largest likelihood."""
    likelihood = _TiedLikelihood(problem, product)
    first = likelihood.at(start)
    if not np.isfinite(first.objective):
        raise ComputationError("the start has no finite prediction error: lower the orders or rescale the data")
    end = descend(likelihood, first, settings.descent)
    converged, reason = how_it_ended(end.ending, end.model.length, settings)
    costs, lengths = (tuple(column) for column in zip(*likelihood.trail, strict=True))
    assert end.point.evaluation is not None
    convergence = Convergence(converged, reason, "ARMAX", costs, lengths)
    return end.point.vector, end.point.evaluation, end.model.factor, convergence


def _noise_start(white: BoxJenkinsModel, runs: Sequence[SampledRun], orders: BoxJenkinsOrders) -> tuple[Array, Array]:
    """C and D from the errors of the output-error model, by a long autoregression."""
    errors = [prediction_errors(r.signals, white.armax.polynomials, white.armax.orders).errors for r in runs]
    guess = long_arx_start([np.vstack([e, np.ones(e.size)]) for e in errors], ArmaxOrders(orders.nd, (), orders.nc, ()))
    return guess.polynomials.c, guess.polynomials.a


def _stable(f: Array) -> Array:
    """F with its unstable poles mirrored and those on the circle moved just inside."""
    poles = np.roots(reflected(f))
    sizes = np.maximum(np.abs(poles), np.finfo(float).tiny)
    return np.append(1.0, np.zeros(0)) if f.size == 1 else np.real(np.poly(poles * np.minimum(1.0, STABLE / sizes)))


def _delayed(polynomial: Array, lag: int) -> Array:
    return np.concatenate([np.zeros(lag), polynomial])


def _padded(polynomial: Array, length: int) -> Array:
    return np.concatenate([polynomial, np.zeros(length - polynomial.size)])


def _fill(polynomial: Array, order: int) -> Array:
    """Coefficients 1 ... order of a polynomial."""
    return _padded(polynomial, order + 1)[1:]
