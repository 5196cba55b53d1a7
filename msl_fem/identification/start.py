"""First guesses of the coefficients: from a long ARX model, and from prior knowledge of mass and suspension."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials, polynomials_of, reflected
from msl_fem.identification.prediction_error import jacobian_factors, prediction_errors
from msl_fem.identification.prior import OscillatorPrior, discretised_oscillator
from msl_fem.identification.regression import lagged_blocks, r_factor, scaled_factor, triangular_factor

LONG_ORDER = 20  # of the long ARX model, on top of twice the wanted order
SENSOR_NOISE_STEPS = 8
PIECES = 4  # of each run in an excerpt: a swept sine shows all its frequencies


@dataclass(frozen=True, eq=False)
class Start:
    """A first guess and where it comes from."""

    name: str
    polynomials: Polynomials


def first_guesses(
    runs: Sequence[FloatArray],
    orders: ArmaxOrders,
    prior: OscillatorPrior | None,
    *,
    sampling_period: float,
    names: Sequence[str],
) -> list[Start]:
    """All starts these data and this knowledge allow."""
    starts = [long_arx_start(runs, orders)]
    if orders.na and orders.nc >= orders.na:
        starts.append(sensor_noise_start(runs, orders, starts[0]))
    if prior is not None:
        starts += prior_starts(runs, orders, prior, sampling_period=sampling_period, names=names)
    return starts


def excerpts(runs: Sequence[FloatArray], n_samples: int, *, longest_lag: int) -> Sequence[FloatArray]:
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


def long_arx_start(runs: Sequence[FloatArray], orders: ArmaxOrders) -> Start:
    """Hannan-Rissanen start: the innovations of a long ARX model become a measured input of C.

    E. J. Hannan and J. Rissanen, Biometrika 69, 1982; L. Ljung, System Identification, 2nd ed., sec. 10.4.
    """
    if orders.nc == 0:
        return Start("least squares", _arx(runs, orders))
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
    return Start("long ARX", replace(guess, c=reflected(guess.c)))


def prior_starts(
    runs: Sequence[FloatArray],
    orders: ArmaxOrders,
    prior: OscillatorPrior,
    *,
    sampling_period: float,
    names: Sequence[str],
) -> list[Start]:
    """Starts whose A comes from mass, damping and stiffness; InputError if na or a known gain's B has no room.

    C is A (all noise is the sensor's) or 1 (all noise is a force); the unknown B are fitted for each.
    """
    if orders.na < 2:
        raise InputError(f"a mass on a suspension needs na >= 2 but na = {orders.na}: raise na or drop the prior")
    a, b = discretised_oscillator(prior, sampling_period)
    unknown_names = set(prior.force_gains) - set(names)
    if unknown_names:
        raise InputError(f"prior gain of {sorted(unknown_names)}: the inputs are {', '.join(names)}")
    known: list[FloatArray | None] = []
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
        Start(f"prior, {name}", _refitted(runs, orders, replace(start, c=c), free=free))
        for name, c in _noise_models(start.a, orders.nc).items()
    ]


def sensor_noise_start(runs: Sequence[FloatArray], orders: ArmaxOrders, first: Start) -> Start:
    """Start for white sensor noise: C is the A of the step before, and A, B follow by least squares.

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
    return Start("sensor noise", best)


def _noise_models(a: FloatArray, nc: int) -> dict[str, FloatArray]:
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


def _signed(solution: FloatArray, orders: ArmaxOrders) -> FloatArray:
    """Regression coefficients as model coefficients: A stands on the other side of the equation."""
    signed = solution.copy()
    signed[: orders.na] *= -1.0
    return signed


def _arx(runs: Sequence[FloatArray], orders: ArmaxOrders) -> Polynomials:
    columns = [*_regressors(orders), (0, 0)]
    blocks = (b for s in runs for b in lagged_blocks(s, columns, first=orders.longest_lag))
    factor = triangular_factor(blocks, len(columns))
    return polynomials_of(_signed(scaled_factor(factor).solution(), orders), orders)


def _with_innovations(signals: FloatArray, model: Polynomials, orders: ArmaxOrders) -> FloatArray:
    """The signals and, as a further row, the errors of a long ARX model (zero before its first equation)."""
    errors = lfilter(model.a, [1.0], signals[0]) - model.offset
    for row, (lags, b) in enumerate(zip(orders.input_lags, model.b, strict=True), start=1):
        errors -= lfilter(np.concatenate([np.zeros(lags[0]), b]), [1.0], signals[row])
    errors[: orders.longest_lag] = 0.0
    return np.vstack([signals, errors])


def _refitted(
    runs: Sequence[FloatArray], orders: ArmaxOrders, start: Polynomials, *, free: npt.NDArray[np.bool_]
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


def _padded(polynomial: FloatArray, order: int) -> FloatArray:
    padded = np.zeros(order + 1)
    padded[: min(polynomial.size, order + 1)] = polynomial[: order + 1]
    return padded


def _placed(b: FloatArray, lags: range, name: str) -> FloatArray:
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
