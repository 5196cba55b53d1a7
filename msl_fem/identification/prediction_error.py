"""Orders and polynomials of a MISO ARMAX model, its one-step prediction errors and their sensitivities.

A(q) y = sum_k B_k(q) u_k + offset + C(q) e. A and C are monic in the delay operator q^-1: A = 1 + a_1 q^-1 + ... +
a_na q^-na; B_k holds the coefficients of q^-nk_k ... q^-(nk_k + nb_k - 1).

Predictor and gradient: L. Ljung, System Identification, 2nd ed., eqs. (4.18), (10.51)-(10.53); H. M. Gutierrez and
P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (7)-(11). The nc errors before the first full equation are unknown, and
1/C may remember them for the whole record: white sensor noise on a lightly damped, oversampled plant puts C's zeros
next to A's. So they are estimated with the rest, run by run, exactly at every trial of the coefficients (the errors
are linear in them: variable projection, Golub & Pereyra, SIAM J. Numer. Anal. 10, 1973), and count in the cost like
all other errors. Exact maximum likelihood minimises the cost times det(H'H)^(1/n) with H the response to the unknown
errors (G. E. P. Box and G. M. Jenkins, Time Series Analysis, app. A7.4): it does not change when zeros of C are
mirrored at the unit circle, whereas the bare cost falls without end as they leave it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.identification.regression import LaggedColumn, lagged_blocks, r_factor, triangular_factor

FORGOTTEN = 1e-17  # a pulse response below this part of its peak no longer reaches double precision


@dataclass(frozen=True)
class ArmaxOrders:
    """Numbers of coefficients of A, of each B_k and of C, and the delay nk of each input in samples.

    `nb` and `nk` are one number for all inputs or one for each; `offset` adds a constant to the right-hand side.
    """

    na: int
    nb: int | tuple[int, ...]
    nc: int
    nk: int | tuple[int, ...] = 1
    offset: bool = False

    def for_inputs(self, n_inputs: int) -> ArmaxOrders:
        """The same orders with `nb` and `nk` as tuples of n_inputs; InputError if they do not fit."""
        nb = _per_input("nb", self.nb, n_inputs, 1)
        nk = _per_input("nk", self.nk, n_inputs, 0)
        for name, value in (("na", self.na), ("nc", self.nc)):
            if value < 0:
                raise InputError(f"order {name} = {value}: give 0 or more")
        return ArmaxOrders(self.na, nb, self.nc, nk, self.offset)

    @property
    def input_lags(self) -> tuple[range, ...]:
        """Delays at which each input enters; only for orders that went through `for_inputs`."""
        assert isinstance(self.nb, tuple)
        assert isinstance(self.nk, tuple)
        return tuple(range(nk, nk + nb) for nb, nk in zip(self.nb, self.nk, strict=True))

    @property
    def longest_lag(self) -> int:
        """Samples of history that one equation reaches back."""
        return max(self.na, self.nc, *(lags[-1] for lags in self.input_lags))

    @property
    def n_parameters(self) -> int:
        """Number of coefficients, the offset included."""
        return self.na + sum(map(len, self.input_lags)) + int(self.offset) + self.nc

    @property
    def n_linear(self) -> int:
        """Number of coefficients that the errors are linear in, given C: those of A, of all B and the offset."""
        return self.n_parameters - self.nc

    def parameter_names(self, input_names: Sequence[str]) -> tuple[str, ...]:
        """Names of the coefficients in the order of the parameter vector: A, B_1, B_2, ..., offset, C."""
        names = [f"a{i}" for i in range(1, self.na + 1)]
        for name, lags in zip(input_names, self.input_lags, strict=True):
            names += [f"b[{name}][{lag}]" for lag in lags]
        return (*names, *(["offset"] if self.offset else []), *(f"c{i}" for i in range(1, self.nc + 1)))


def _per_input(name: str, value: int | tuple[int, ...], n_inputs: int, least: int) -> tuple[int, ...]:
    values = (value,) * n_inputs if isinstance(value, int) else tuple(value)
    if len(values) != n_inputs:
        raise InputError(f"order {name} = {value} is for {len(values)} inputs but there are {n_inputs}")
    if min(values) < least:
        raise InputError(f"order {name} = {value}: give {least} or more for every input")
    return values


@dataclass(frozen=True, eq=False)
class Polynomials:
    """The coefficients: `a` (na + 1,) and `c` (nc + 1,) with their leading 1, one array (nb_k,) for each input."""

    a: Array
    b: tuple[Array, ...]
    c: Array
    offset: float = 0.0

    def vector(self, orders: ArmaxOrders) -> Array:
        """The free coefficients in one vector, shape (n_parameters,)."""
        offset = [self.offset] if orders.offset else []
        return np.concatenate([self.a[1:], *self.b, offset, self.c[1:]])


def polynomials_of(vector: Array, orders: ArmaxOrders) -> Polynomials:
    """The polynomials that a parameter vector of shape (n_parameters,) stands for."""
    lengths = [orders.na, *map(len, orders.input_lags), int(orders.offset), orders.nc]
    parts = np.split(np.asarray(vector, dtype=float), np.cumsum(lengths)[:-1])
    a, *b, offset, c = parts
    return Polynomials(
        a=np.concatenate([[1.0], a]),
        b=tuple(b),
        c=np.concatenate([[1.0], c]),
        offset=float(offset[0]) if orders.offset else 0.0,
    )


def reflected(c: Array) -> Array:
    """A monic polynomial with the zeros outside the unit circle mirrored to the inside, the others untouched.

    A moving average and its mirror image have the same spectrum up to a factor (spectral factorisation), so C
    can always be chosen invertible; A must not be treated so, because an unstable plant is not its stable mirror.
    """
    zeros = np.roots(c)
    outside = np.abs(zeros) > 1.0
    if not outside.any():
        return c
    zeros[outside] = 1.0 / np.conj(zeros[outside])
    mirrored = np.zeros_like(c)
    mirrored[: zeros.size + 1] = np.real(np.poly(zeros))
    return mirrored


@dataclass(frozen=True, eq=False)
class PredictionErrors:
    """Errors from `longest_lag - nc` on, shape (nc + n_equations,), the first nc of them estimated.

    `log_determinant` is that of H'H, H the response of the errors to the first nc of them; n_equations =
    n_samples - longest_lag.
    """

    errors: Array
    log_determinant: float
    n_equations: int

    @property
    def cost(self) -> float:
        """Sum of squared prediction errors."""
        return float(self.errors @ self.errors)


def filtered(numerator: ArrayLike, denominator: ArrayLike, signal: Array) -> Array:
    """A signal (..., n_samples) from rest through the ratio of two polynomials in the delay."""
    from scipy.signal import lfilter  # here, for its import costs a second

    return np.asarray(lfilter(numerator, denominator, signal))


def equation_error(signals: Array, polynomials: Polynomials, orders: ArmaxOrders) -> Array:
    """A y - sum B_k u_k - offset for t = longest_lag ... n_samples - 1; `signals` as SampledRun.signals."""
    first, end = orders.longest_lag, signals.shape[1]
    total = np.full(end - first, -polynomials.offset)
    for lag, a in enumerate(polynomials.a):
        total += a * signals[0, first - lag : end - lag]
    for row, (lags, b) in enumerate(zip(orders.input_lags, polynomials.b, strict=True), start=1):
        for lag, coefficient in zip(lags, b, strict=True):
            total -= coefficient * signals[row, first - lag : end - lag]
    return total


def prediction_errors(signals: Array, polynomials: Polynomials, orders: ArmaxOrders) -> PredictionErrors:
    """One-step prediction errors with the best nc errors before the first full equation."""
    nc = orders.nc
    known = np.concatenate([np.zeros(nc), equation_error(signals, polynomials, orders)])
    errors = filtered([1.0], polynomials.c, known)
    if nc == 0:
        return PredictionErrors(errors, 0.0, errors.size)
    response = pulse_response(polynomials.c, errors.size)
    factor = _pulse_factor(response, nc, errors=errors)
    pulses = -np.linalg.solve(factor[:-1, :-1], factor[:-1, -1])
    for lag, pulse in enumerate(pulses):
        stop = min(lag + response.size, errors.size)
        errors[lag:stop] += pulse * response[: stop - lag]
    return PredictionErrors(errors, _log_determinant(factor), errors.size - nc)


def pulse_response(c: Array, n_samples: int) -> Array:
    """Response of 1/C to a unit pulse for as long as it is remembered, at most n_samples."""
    pulse = np.zeros(_memory(c, n_samples))
    pulse[0] = 1.0
    return filtered([1.0], c, pulse)


def _pulse_factor(response: Array, nc: int, *, errors: Array | None = None) -> Array:
    """Triangular factor of [responses to a pulse in each of the first nc samples, errors], (nc + 1, nc + 1)."""
    target = np.zeros(response.size) if errors is None else errors[: response.size]
    columns = [*((0, lag) for lag in range(nc)), (1, 0)]
    return triangular_factor(lagged_blocks(np.vstack([response, target]), columns, first=0), nc + 1)


def _log_determinant(factor: Array) -> float:
    return 2.0 * float(np.sum(np.log(np.abs(np.diag(factor)[:-1]))))


def _memory(c: Array, n_samples: int) -> int:
    """Samples after which 1/C has forgotten a pulse to rounding, at most n_samples."""
    slowest = float(np.max(np.abs(np.roots(c)), initial=0.0))
    if slowest == 0.0:
        return min(c.size, n_samples)
    if slowest >= 1.0:
        return n_samples
    return min(n_samples, c.size + int(1.5 * np.log(FORGOTTEN) / np.log(slowest)))


def sensitivity_signals(
    signals: Array, polynomials: Polynomials, errors: Array, *, extra: Array | None = None
) -> Array:
    """Rows whose delayed copies are the errors' derivatives: y/C, -u_k/C, -1/C, -e/C, pulse/C, e, extra/C.

    `extra` (n_samples,) is a further derivative of the equation error, such as that of the inputs to a gap offset.
    Shape (nu + 5 or nu + 6, n_samples); the rows of e and of the pulse start at the first error.
    """
    n_samples = signals.shape[1]
    first = n_samples - errors.size
    padded, pulse = np.zeros((2, n_samples))
    padded[first:] = errors
    pulse[first] = 1.0
    rows = [signals[0], *(-signals[1:]), -padded, pulse, *([] if extra is None else [extra])]
    through = filtered([1.0], polynomials.c, np.vstack(rows))
    return np.insert(through, signals.shape[0] + 2, padded, axis=0)


def twice_filtered(rows: Array, polynomials: Polynomials) -> Array:
    """Sensitivity signals filtered by 1/C once more: delayed by i and negated, their derivatives by c_i."""
    return filtered([1.0], polynomials.c, rows)


def sensitivity_columns(orders: ArmaxOrders, *, extra: bool = False) -> tuple[list[LaggedColumn], int]:
    """Columns of the Jacobian among the sensitivity signals, pulses first, and the row of the errors themselves.

    Delayed copies of one filtered signal stand for the derivatives: they differ from the exact ones by a transient
    of 1/C only, which the pulse columns span.
    """
    n_inputs = len(orders.input_lags)
    row_one = n_inputs + 1
    row_e = n_inputs + 2
    row_pulse = n_inputs + 3
    row_error = n_inputs + 4
    columns = [(row_pulse, lag) for lag in range(orders.nc)]
    columns += [(0, lag) for lag in range(1, orders.na + 1)]
    for row, lags in enumerate(orders.input_lags, start=1):
        columns += [(row, lag) for lag in lags]
    columns += [(row_one, 0)] if orders.offset else []
    columns += [(row_e, lag) for lag in range(1, orders.nc + 1)]
    columns += [(row_error + 1, 0)] if extra else []
    return columns, row_error


@dataclass(frozen=True, eq=False)
class JacobianFactors:
    """Triangular factor of [Jacobian, errors] over all runs with each run's first nc errors eliminated, and those rows.

    `total` has shape (n_columns, n_columns), n_columns = n_parameters + 1, one more with an extra column; each of
    `heads`, one a run, holds the eliminated rows and has shape (nc, nc + n_columns).
    """

    total: Array
    heads: tuple[Array, ...]

    def with_rows(self, rows: Array) -> JacobianFactors:
        """The same with further rows (n_rows, n_columns), equations that belong to no run."""
        return replace(self, total=r_factor(np.vstack([self.total, rows])))


def jacobian_factors(
    runs: Sequence[Array],
    polynomials: Polynomials,
    orders: ArmaxOrders,
    *,
    errors: Sequence[Array],
    extra: Sequence[Array] | None = None,
) -> JacobianFactors:
    """Factors of [Jacobian, errors]; with `extra` (one signal a run) its column stands before the errors."""
    columns, row_error = sensitivity_columns(orders, extra=extra is not None)
    columns = [*columns, (row_error, 0)]
    total = np.zeros((0, len(columns) - orders.nc))
    heads = []
    for index, (signals, error) in enumerate(zip(runs, errors, strict=True)):
        rows = sensitivity_signals(signals, polynomials, error, extra=None if extra is None else extra[index])
        first = orders.longest_lag - orders.nc
        factor = triangular_factor(lagged_blocks(rows, columns, first=first), len(columns))
        heads.append(factor[: orders.nc])
        total = r_factor(np.vstack([total, factor[orders.nc :, orders.nc :]]))
    return JacobianFactors(total, tuple(heads))


def cost_gradient(signals: Array, polynomials: Polynomials, orders: ArmaxOrders, *, errors: Array) -> Array:
    """Gradient of half the cost of one run by the coefficients, shape (n_parameters,).

    The errors are orthogonal to the pulse responses, so the transients that delayed copies differ by do not count.
    """
    columns, row_error = sensitivity_columns(orders)
    rows = sensitivity_signals(signals, polynomials, errors)
    first = signals.shape[1] - errors.size
    gradient = np.zeros(orders.n_parameters)
    for j, (row, lag) in enumerate(columns[orders.nc :]):
        start = max(first, lag)
        gradient[j] = rows[row, start - lag : rows.shape[1] - lag] @ rows[row_error, start:]
    return gradient
