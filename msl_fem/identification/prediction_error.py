"""One-step prediction errors of ARMAX and their sensitivities to the coefficients.

Predictor and gradient: L. Ljung, System Identification, 2nd ed., eqs. (4.18), (10.51)-(10.53); H. M. Gutierrez and
P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (7)-(11). The errors before the first equation are unknown and 1/C may
remember them for as long as the whole record (white sensor noise on a lightly damped, oversampled plant puts C's
zeros next to A's). So the initial state of 1/C is free, run by run: nc pulses on the first nc equations. The errors
are linear in the pulses, which are solved for exactly at every trial of the coefficients (variable projection,
Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.regression import LaggedColumn, lagged_blocks, triangular_factor

FORGOTTEN = 1e-17  # a pulse response below this part of its peak no longer reaches double precision


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Errors (n_samples - longest_lag,) from the first full equation on, and the pulses (nc,) that start 1/C."""

    errors: FloatArray
    pulses: FloatArray

    @property
    def cost(self) -> float:
        """Sum of squared prediction errors."""
        return float(self.errors @ self.errors)


def equation_error(signals: FloatArray, polynomials: Polynomials, orders: ArmaxOrders) -> FloatArray:
    """A y - sum B_k u_k - offset for t = longest_lag ... n_samples - 1; `signals` as SampledRun.signals."""
    first, end = orders.longest_lag, signals.shape[1]
    total = np.full(end - first, -polynomials.offset)
    for lag, a in enumerate(polynomials.a):
        total += a * signals[0, first - lag : end - lag]
    for row, (lags, b) in enumerate(zip(orders.input_lags, polynomials.b, strict=True), start=1):
        for lag, coefficient in zip(lags, b, strict=True):
            total -= coefficient * signals[row, first - lag : end - lag]
    return total


def prediction_errors(signals: FloatArray, polynomials: Polynomials, orders: ArmaxOrders) -> PredictionErrors:
    """One-step prediction errors with the best initial state of 1/C; C must have no zero outside the unit circle."""
    errors = lfilter([1.0], polynomials.c, equation_error(signals, polynomials, orders))
    if orders.nc == 0:
        return PredictionErrors(errors, np.zeros(0))
    response = pulse_response(polynomials.c, errors.size)
    remembered = min(_memory(polynomials.c, errors.size) + orders.nc, errors.size)
    columns = [(0, lag) for lag in range(orders.nc)]
    stacked = np.vstack([response, errors])
    factor = triangular_factor(
        lagged_blocks(stacked, [*columns, (1, 0)], first=0, last=remembered), orders.nc + 1
    )
    pulses = -np.linalg.solve(factor[:-1, :-1], factor[:-1, -1])
    for lag, pulse in enumerate(pulses):
        errors[lag:remembered] += pulse * response[: remembered - lag]
    return PredictionErrors(errors, pulses)


def pulse_response(c: FloatArray, n_samples: int) -> FloatArray:
    """Response of 1/C to a unit pulse, shape (n_samples,)."""
    pulse = np.zeros(n_samples)
    pulse[0] = 1.0
    return lfilter([1.0], c, pulse)


def _memory(c: FloatArray, n_samples: int) -> int:
    """Samples after which 1/C has forgotten a pulse to rounding, at most n_samples."""
    slowest = float(np.max(np.abs(np.roots(c)), initial=0.0))
    if slowest == 0.0:
        return c.size
    if slowest >= 1.0:
        return n_samples
    return min(n_samples, c.size + int(1.5 * np.log(FORGOTTEN) / np.log(slowest)))


def sensitivity_signals(
    signals: FloatArray, polynomials: Polynomials, errors: FloatArray, *, extra: FloatArray | None = None
) -> FloatArray:
    """Rows whose delayed copies are the errors' derivatives: y/C, -u_k/C, -1/C, -e/C, pulse response, e, extra.

    `extra` (n_samples,) is a further derivative before filtering with 1/C, such as that of the inputs to a gap
    offset. Shape (nu + 5 or nu + 6, n_samples); rows of e and of the pulse start at the first full equation.
    """
    n_samples = signals.shape[1]
    first = n_samples - errors.size
    padded, pulse = np.zeros((2, n_samples))
    padded[first:] = errors
    pulse[first] = 1.0
    rows = [signals[0], *(-signals[1:]), -padded, pulse, *([] if extra is None else [extra])]
    filtered = lfilter([1.0], polynomials.c, np.vstack(rows))
    return np.insert(filtered, signals.shape[0] + 2, padded, axis=0)


def sensitivity_columns(orders: ArmaxOrders, *, extra: bool = False) -> tuple[list[LaggedColumn], int]:
    """Columns of the Jacobian among the sensitivity signals, pulses first, and the row of the errors themselves.

    Delayed copies of one filtered signal stand for the derivatives: they differ from the exact ones by a transient
    of 1/C only, which the pulse columns span.
    """
    n_inputs = len(orders.input_lags)
    row_one, row_e, row_pulse, row_error = n_inputs + 1, n_inputs + 2, n_inputs + 3, n_inputs + 4
    columns = [(row_pulse, lag) for lag in range(orders.nc)]
    columns += [(0, lag) for lag in range(1, orders.na + 1)]
    for row, lags in enumerate(orders.input_lags, start=1):
        columns += [(row, lag) for lag in lags]
    columns += [(row_one, 0)] if orders.offset else []
    columns += [(row_e, lag) for lag in range(1, orders.nc + 1)]
    columns += [(row_error + 1, 0)] if extra else []
    return columns, row_error


def jacobian_factor(
    runs: Sequence[FloatArray],
    polynomials: Polynomials,
    orders: ArmaxOrders,
    *,
    errors: Sequence[FloatArray],
    extra: Sequence[FloatArray] | None = None,
) -> FloatArray:
    """Triangular factor of [Jacobian, errors] over all runs, with each run's pulses eliminated.

    Shape (n_parameters + 1, n_parameters + 1), one more with `extra` (one signal a run).
    """
    columns, row_error = sensitivity_columns(orders, extra=extra is not None)
    columns = [*columns, (row_error, 0)]
    total = np.zeros((0, len(columns) - orders.nc))
    for index, (signals, error) in enumerate(zip(runs, errors, strict=True)):
        rows = sensitivity_signals(
            signals, polynomials, error, extra=None if extra is None else extra[index]
        )
        factor = triangular_factor(lagged_blocks(rows, columns, first=orders.longest_lag), len(columns))
        total = np.linalg.qr(np.vstack([total, factor[orders.nc :, orders.nc :]]), mode="r")
    return total
