"""The search for the coefficients of largest restricted likelihood, and the first guesses that it begins from.

Gauss-Newton (H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (12)-(14)) with damping on scaled
columns instead of a fixed factor; the undamped step is always tried in the end. Where Gauss-Newton no longer halves its
step, the exact second derivatives take over. It begins from a long ARX model, and from prior knowledge of mass and
suspension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from msl_fem.computing.arrays import Array
from msl_fem.computing.gauss_newton import Damping, DescentSettings, descend
from msl_fem.errors import InputError
from msl_fem.identification.likelihood import (
    EstimationProblem,
    Evaluation,
    SecondOrderModel,
    evaluated_reflected,
    objective_gradient,
    quadratic_model,
)
from msl_fem.identification.model import Convergence
from msl_fem.identification.oscillator import OscillatorPrior, discretised_oscillator
from msl_fem.identification.prediction_error import (
    ArmaxOrders,
    Polynomials,
    filtered,
    jacobian_factors,
    polynomials_of,
    prediction_errors,
    reflected,
)
from msl_fem.identification.regression import ScaledFactor, lagged_blocks, r_factor, scaled_factor, triangular_factor

LONG_ORDER = 20  # of the long ARX model, on top of twice the wanted order
SENSOR_NOISE_STEPS = 8
PIECES = 4  # of each run in an excerpt: a swept sine shows all its frequencies
DAMPING = Damping(first=0.0, least=1e-5, rise=1e-6, most=1e3, factor=100.0)  # 0, 1e-6, 1e-4, ... 1e4
NOISE_FREE = 1e-11  # rms prediction error over rms output below which only rounding is left
SLOW, CLOSE = 0.4, 6.0  # second derivatives are worth it if the step shrank by less and is shorter (standard errors)
NEAR_ENOUGH = 0.03  # standard errors; a search that rounding stops within this has converged


@dataclass(frozen=True)
class EstimationSettings:
    """When the search ends: a step shorter than `step_tolerance` standard errors, or `max_iterations` steps."""

    step_tolerance: float = 1e-3
    max_iterations: int = 60

    @property
    def descent(self) -> DescentSettings:
        """The same for `computing.gauss_newton`: the promised decrease is half the squared step in standard errors."""
        enough = self.step_tolerance**2 / 2
        return DescentSettings(DAMPING, enough, most_trials=10**6, most_steps=self.max_iterations)


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """The last evaluation, its Jacobian's decomposition and the trail."""

    evaluation: Evaluation
    factor: ScaledFactor
    convergence: Convergence


def maximise_likelihood(
    problem: EstimationProblem, *, start: Evaluation, name: str, settings: EstimationSettings
) -> LikelihoodFit:
    """Minimiser of the objective from one start, with the reason why the search ended."""
    likelihood = _Likelihood(problem)
    end = descend(likelihood, start, settings.descent)
    trail = likelihood.trail
    if end.point.cost <= likelihood.noise_free:
        converged = True
        reason = "the model explains the data to rounding"
    else:
        converged, reason = how_it_ended(end.ending, trail[-1][1], settings)
    costs, lengths = (tuple(column) for column in zip(*trail, strict=True))
    return LikelihoodFit(end.point, end.model.factor, Convergence(converged, reason, name, costs, lengths))


def how_it_ended(ending: str, length: float, settings: EstimationSettings) -> tuple[bool, str]:
    """Whether a search converged whose next step would have a length in standard errors, and the reason in words."""
    if ending == "converged":
        return True, f"the next step is below {settings.step_tolerance:g} standard errors"
    if ending == "no descent":
        return length < NEAR_ENOUGH, f"no step lowers the cost; the full one is {length:.2g} standard errors"
    return False, f"{settings.max_iterations} steps were taken; the next one is {length:.2g} standard errors"


class _Likelihood:
    """The objective of a problem; `trail` holds cost and length of the next step at every point that was accepted."""

    def __init__(self, problem: EstimationProblem) -> None:
        self.problem = problem
        self.noise_free = NOISE_FREE**2 * sum(float(signals[0] @ signals[0]) for signals in problem.runs)
        self.trail: list[tuple[float, float]] = []
        self._slow = False

    def moved(self, point: Evaluation, move: Array) -> Evaluation:
        orders = self.problem.orders
        return evaluated_reflected(self.problem, polynomials_of(point.polynomials.vector(orders) + move, orders))

    def model(self, point: Evaluation, neighbour: _LocalModel | None) -> _LocalModel:
        model = _LocalModel(self.problem, point)
        length = model.length
        self._slow = self._slow or (len(self.trail) > 1 and length > SLOW * self.trail[-1][1])
        self.trail.append((point.cost, length))
        if point.cost <= self.noise_free:
            model.promised = 0.0
        model.second_order = bool(self.problem.orders.nc) and self._slow and length < CLOSE
        return model


class _LocalModel:
    """Gauss-Newton's model of half the objective; the exact second derivatives, where these are asked for."""

    stale = False

    def __init__(self, problem: EstimationProblem, evaluation: Evaluation) -> None:
        assert evaluation.factors is not None
        self._problem, self._evaluation = problem, evaluation
        self._gradient = objective_gradient(problem, evaluation)
        self.factor = scaled_factor(evaluation.factors.total)
        self._steps: ScaledFactor | SecondOrderModel = self.factor.with_gradient(self._gradient)
        variance = evaluation.noise_variance
        self.length = float(np.sqrt(self._steps.explained / variance)) if variance > 0.0 else 0.0
        self.promised = self.length**2 / 2
        self.second_order = False

    def step(self, damping: float) -> tuple[Array, float]:
        if self.second_order and isinstance(self._steps, ScaledFactor):
            self._steps = quadratic_model(self._problem, self._evaluation, factor=self.factor, gradient=self._gradient)
        return -self._steps.solution(damping), self.promised


@dataclass(frozen=True, eq=False)
class FirstGuess:
    """A first guess and where it comes from."""

    name: str
    polynomials: Polynomials


def first_guesses(
    runs: Sequence[Array],
    orders: ArmaxOrders,
    prior: OscillatorPrior | None,
    *,
    sampling_period: float,
    names: Sequence[str],
) -> list[FirstGuess]:
    """All starts these data and this knowledge allow."""
    starts = [long_arx_start(runs, orders)]
    if orders.na and orders.nc >= orders.na:
        starts.append(sensor_noise_start(runs, orders, starts[0]))
    if prior is not None:
        starts += prior_starts(runs, orders, prior, sampling_period=sampling_period, names=names)
    return starts


def excerpts(runs: Sequence[Array], n_samples: int, *, longest_lag: int) -> Sequence[Array]:
    """Evenly spread pieces of the runs with about n_samples in all; the runs themselves when they are no longer."""
    total = sum(signals.shape[1] for signals in runs)
    if total <= n_samples:
        return runs
    pieces = []
    for signals in runs:
        length = signals.shape[1] * n_samples // (total * PIECES)
        length = min(max(length, 20 * longest_lag), signals.shape[1])
        gap = (signals.shape[1] - length) / (PIECES - 1)
        firsts = sorted({round(i * gap) for i in range(PIECES)})
        pieces += [np.ascontiguousarray(signals[:, first : first + length]) for first in firsts]
    return pieces


def long_arx_start(runs: Sequence[Array], orders: ArmaxOrders) -> FirstGuess:
    """Hannan-Rissanen start: the innovations of a long ARX model become a measured input of C.

    E. J. Hannan and J. Rissanen, Biometrika 69, 1982; L. Ljung, System Identification, 2nd ed., sec. 10.4.
    """
    if orders.nc == 0:
        return FirstGuess("least squares", _arx(runs, orders))
    shortest = min(signals.shape[1] for signals in runs)
    columns_per_lag = 1 + len(orders.input_lags)
    total = sum(signals.shape[1] for signals in runs)
    length = min(LONG_ORDER + 2 * orders.longest_lag, shortest // 4, total // (5 * columns_per_lag))
    length = max(length, orders.longest_lag)
    nb = tuple(length for _ in orders.input_lags)
    long_orders = replace(orders, na=length, nb=nb, nc=0)
    long_model = _arx(runs, long_orders)
    stacked = [_with_innovations(signals, long_model, long_orders) for signals in runs]
    row_e = stacked[0].shape[0] - 1
    columns = _regressors(orders) + [(row_e, lag) for lag in range(1, orders.nc + 1)] + [(0, 0)]
    first = long_orders.longest_lag + orders.nc
    blocks = (block for s in stacked for block in lagged_blocks(s, columns, first=first))
    solution = scaled_factor(triangular_factor(blocks, len(columns))).solution()
    guess = polynomials_of(_signed(solution, orders), orders)
    return FirstGuess("long ARX", replace(guess, c=reflected(guess.c)))


def prior_starts(
    runs: Sequence[Array],
    orders: ArmaxOrders,
    prior: OscillatorPrior,
    *,
    sampling_period: float,
    names: Sequence[str],
) -> list[FirstGuess]:
    """Starts whose A comes from mass, damping and stiffness; InputError if na or a known gain's B has no room.

    C is A (all noise is the sensor's) or 1 (all noise is a force); the unknown B are fitted for each.
    """
    if orders.na < 2:
        raise InputError(f"a mass on a suspension needs na >= 2 but na = {orders.na}: raise na or drop the prior")
    a, b = discretised_oscillator(prior, sampling_period)
    unknown_names = set(prior.force_gains) - set(names)
    if unknown_names:
        raise InputError(f"prior gain of {sorted(unknown_names)}: the inputs are {', '.join(names)}")
    known: list[Array | None] = []
    for name, lags in zip(names, orders.input_lags, strict=True):
        gain = prior.force_gains.get(name)
        known.append(None if gain is None else _placed(gain * b, lags, name))
    start = Polynomials(
        a=_padded(a, orders.na),
        b=tuple(np.zeros(len(lags)) if k is None else k for k, lags in zip(known, orders.input_lags, strict=True)),
        c=_padded(np.ones(1), orders.nc),
    )
    free_inputs = [np.full(len(lags), k is None) for k, lags in zip(known, orders.input_lags, strict=True)]
    fixed = [np.zeros(orders.na, dtype=bool), np.ones(int(orders.offset), dtype=bool), np.zeros(orders.nc, dtype=bool)]
    free = np.concatenate([fixed[0], *free_inputs, *fixed[1:]])
    return [
        FirstGuess(f"prior, {name}", _refitted(runs, orders, replace(start, c=c), free=free))
        for name, c in _noise_models(start.a, orders.nc).items()
    ]


def sensor_noise_start(runs: Sequence[Array], orders: ArmaxOrders, first: FirstGuess) -> FirstGuess:
    """FirstGuess for white sensor noise: C is the A of the step before, and A, B follow by least squares.

    Steiglitz-McBride iteration (K. Steiglitz and L. E. McBride, IEEE Trans. Autom. Control 10, 1965), which finds an
    oversampled, lightly damped mode under noise where a long ARX model sees none.
    """
    free = np.arange(orders.n_parameters) < orders.n_parameters - orders.nc
    best, best_cost = first.polynomials, np.inf
    trial = first.polynomials
    for _ in range(SENSOR_NOISE_STEPS):
        trial = _refitted(runs, orders, replace(trial, c=reflected(_padded(trial.a, orders.nc))), free=free)
        cost = sum(prediction_errors(signals, trial, orders).cost for signals in runs)
        if cost < best_cost:
            best, best_cost = trial, cost
    return FirstGuess("sensor noise", best)


def _noise_models(a: Array, nc: int) -> dict[str, Array]:
    """C for noise that is a white force, and where there is room, for noise that is the sensor's: C = A."""
    models = {"white force": _padded(np.ones(1), nc)}
    if nc >= a.size - 1:
        models["white sensor noise"] = reflected(_padded(a, nc))
    return models


def _regressors(orders: ArmaxOrders) -> list[tuple[int, int]]:
    """Columns of the equation without noise: y, u and one, delayed."""
    columns = [(0, lag) for lag in range(1, orders.na + 1)]
    for row, lags in enumerate(orders.input_lags, start=1):
        columns += [(row, lag) for lag in lags]
    return columns + ([(len(orders.input_lags) + 1, 0)] if orders.offset else [])


def _signed(solution: Array, orders: ArmaxOrders) -> Array:
    """Regression coefficients as model coefficients: A stands on the other side of the equation."""
    signed = solution.copy()
    signed[: orders.na] *= -1.0
    return signed


def _arx(runs: Sequence[Array], orders: ArmaxOrders) -> Polynomials:
    columns = [*_regressors(orders), (0, 0)]
    blocks = (b for s in runs for b in lagged_blocks(s, columns, first=orders.longest_lag))
    factor = triangular_factor(blocks, len(columns))
    return polynomials_of(_signed(scaled_factor(factor).solution(), orders), orders)


def _with_innovations(signals: Array, model: Polynomials, orders: ArmaxOrders) -> Array:
    """The signals and, as a further row, the errors of a long ARX model (zero before its first equation)."""
    errors = filtered(model.a, [1.0], signals[0]) - model.offset
    for row, (lags, b) in enumerate(zip(orders.input_lags, model.b, strict=True), start=1):
        errors -= filtered(np.concatenate([np.zeros(lags[0]), b]), [1.0], signals[row])
    errors[: orders.longest_lag] = 0.0
    return np.vstack([signals, errors])


def _refitted(
    runs: Sequence[Array], orders: ArmaxOrders, start: Polynomials, *, free: npt.NDArray[np.bool_]
) -> Polynomials:
    """The coefficients marked in `free` (not those of C) by least squares, given the others: one exact step."""
    if not free.any():
        return start
    errors = [prediction_errors(signals, start, orders).errors for signals in runs]
    factor = jacobian_factors(runs, start, orders, errors=errors).total
    chosen = np.append(np.flatnonzero(free), orders.n_parameters)
    vector = start.vector(orders)
    vector[free] -= scaled_factor(r_factor(factor[:, chosen])).solution()
    return polynomials_of(vector, orders)


def _padded(polynomial: Array, order: int) -> Array:
    padded = np.zeros(order + 1)
    padded[: min(polynomial.size, order + 1)] = polynomial[: order + 1]
    return padded


def _placed(b: Array, lags: range, name: str) -> Array:
    """Coefficients of delays 1 and 2 put where the orders have room for them."""
    placed = np.zeros(len(lags))
    for lag, value in zip((1, 2), b, strict=True):
        if lag not in lags:
            raise InputError(
                f"input {name!r} has no coefficient at delay {lag}, which a force on a mass needs: "
                "give it nk <= 1 and nk + nb >= 3, or drop its prior gain"
            )
        placed[lags.index(lag)] = value
    return placed
