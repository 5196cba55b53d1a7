"""The identified model: its coefficients with their uncertainty, predictions, free run, fit, other tools' objects.

In a free run the inputs are given and the gaps of the magnets come from the simulated output: the model never sees the
measured output after the start, so nothing hides its errors; where it diverges, the result says at which sample and
why, and holds NaN from there on. A free run of an open-loop unstable model says little: use `predict` for those, or
simulate the closed loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.identification.data import PERIOD_MISMATCH, RationalInputs, SampledRun, check_length, check_runs
from msl_fem.identification.prediction_error import ArmaxOrders, Polynomials, filtered, prediction_errors

if TYPE_CHECKING:
    from control import TransferFunction

RUNAWAY = 1e3  # times the measured span around its middle: beyond, the run has diverged
_RUNNING, _GAP_CLOSED, _RAN_AWAY = 0, 1, 2


@dataclass(frozen=True)
class Convergence:
    """How the search went: where it began, cost after each step, length of each next step in standard errors."""

    converged: bool
    reason: str
    start: str
    costs: tuple[float, ...]
    step_lengths: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class ArmaxEstimate:
    """A(q) y = sum_k B_k(q) u_k + offset + C(q) e with covariance of its coefficients; `ArmaxModel` adds the methods.

    `covariance` has shape (n_names, n_names) in the order of `parameter_names`; the last is "delta" when a gap
    offset was estimated with the rational inputs. `noise_variance` is that of e, the one-step error, in the
    output's unit squared. `condition_number` is that of the Jacobian with scaled columns, `input_condition_number`
    that of the inputs' delayed samples. `input_slopes` holds the mean over the data of each input's derivative by the
    position, for rational inputs; empty otherwise. `notes` say in words what a reader should know before using it.
    """

    orders: ArmaxOrders
    polynomials: Polynomials
    input_names: tuple[str, ...]
    sampling_period: float
    parameter_names: tuple[str, ...]
    covariance: Array
    noise_variance: float
    condition_number: float
    input_condition_number: float
    n_samples: int
    convergence: Convergence
    rational: RationalInputs | None = None
    input_slopes: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def parameters(self) -> Array:
        """The coefficients in the order of `parameter_names`."""
        vector = self.polynomials.vector(self.orders)
        if len(self.parameter_names) == vector.size:
            return vector
        assert self.rational is not None
        return np.append(vector, self.rational.delta)

    @property
    def standard_errors(self) -> Array:
        """One standard deviation of each coefficient, in the order of `parameter_names`; nan where rounding has made
        its variance less than nothing."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(np.diag(self.covariance))

    @property
    def delta_standard_error(self) -> float | None:
        """Standard error of the gap offset in m; None when it was not estimated."""
        return float(self.standard_errors[-1]) if self.parameter_names[-1:] == ("delta",) else None


def prepared_run(model: ArmaxEstimate, run: SampledRun) -> SampledRun:
    """The run with exactly the model's inputs, in its order; InputError if it lacks one or is sampled otherwise."""
    check_runs([run], moving=False)
    if abs(run.sampling_period / model.sampling_period - 1.0) > PERIOD_MISMATCH:
        raise InputError(
            f"run {run.name!r} is sampled every {run.sampling_period:g} s but the model was identified at "
            f"{model.sampling_period:g} s: resample the run or identify at its rate"
        )
    check_length([run], samples_needed=1, longest_lag=model.orders.longest_lag)
    if model.rational is not None:
        return model.rational.evaluated(run)
    missing = [name for name in model.input_names if name not in run.inputs]
    if missing:
        raise InputError(
            f"run {run.name!r} lacks the model's input(s) {', '.join(missing)}; it has {', '.join(run.inputs)}"
        )
    return replace(run, inputs={name: run.inputs[name] for name in model.input_names})


def prediction_residuals(model: ArmaxEstimate, run: SampledRun) -> Array:
    """One-step prediction errors y(t) - yhat(t | t - 1), shape (n_samples,), NaN before sample `longest_lag`."""
    return np.asarray(run.output, dtype=float) - predict(model, run)


def predict(model: ArmaxEstimate, run: SampledRun, horizon: int = 1) -> Array:
    """Predictions yhat(t | t - horizon), shape (n_samples,), NaN where the record is too short for them.

    The inputs are taken as known up to t, rational terms at the measured position. The prediction error is
    sum_{j < horizon} h_j e(t - j) with h the pulse response of C/A and e the one-step errors (K. J. Astrom,
    Introduction to Stochastic Control Theory, ch. 6), which holds for an unstable A as well.
    """
    if horizon < 1:
        raise InputError(f"horizon {horizon} samples: give 1 or more")
    prepared = prepared_run(model, run)
    orders, polynomials = model.orders, model.polynomials
    errors = prediction_errors(prepared.signals, polynomials, orders).errors[orders.nc :]
    pulse = np.zeros(horizon)
    pulse[0] = 1.0
    missed = filtered(filtered(polynomials.c, polynomials.a, pulse), [1.0], errors)
    predicted = np.full(run.n_samples, np.nan)
    first = orders.longest_lag + horizon - 1
    predicted[first:] = np.asarray(run.output, dtype=float)[first:] - missed[horizon - 1 :]
    return predicted


@dataclass(frozen=True, eq=False)
class ArmaxFreeRun:
    """Simulated output (n_samples,), NaN from `diverged_at` on; the samples before `first` are the measured start."""

    output: Array
    first: int
    diverged_at: int | None = None
    reason: str = ""


class _Recursion(NamedTuple):
    """The model as plain arrays for the compiled loop; `b` (n_inputs, longest nb) is padded with zeros."""

    a: Array
    b: Array
    delay: np.ndarray
    offset: float
    gap: float
    gap_sign: np.ndarray
    gap_power: np.ndarray


def simulate_armax(
    model: ArmaxEstimate, run: SampledRun, *, initial: Literal["estimated", "measured"] = "estimated"
) -> ArmaxFreeRun:
    """Free run of the model over a run.

    The first `orders.longest_lag` outputs are the measured ones. Their noise starts a lightly damped, oversampled mode
    off its course, so by default ("estimated") the model's estimate of that noise, from the whole run, corrects the
    start; "measured" takes the samples as they are. InputError if the run does not fit the model.
    """
    if initial not in ("estimated", "measured"):
        raise InputError(f"initial = {initial!r}: give 'estimated' or 'measured'")
    orders, polynomials = model.orders, model.polynomials
    first = orders.longest_lag
    prepared = prepared_run(model, run)
    forcing = np.zeros(orders.nc)
    if initial == "estimated" and orders.nc:
        past = prediction_errors(prepared.signals, polynomials, orders).errors[: orders.nc][::-1]
        for j in range(orders.nc):
            forcing[j] = polynomials.c[j + 1 :] @ past[: orders.nc - j]
    output = np.array(run.output, dtype=float)
    middle = 0.5 * (output.max() + output.min())
    span = np.ptp(output)
    values = _numerators(model, run, prepared)
    end, state = _free_run(output, values, _recursion(model), (first, middle, RUNAWAY * span), forcing)
    if state == _RUNNING:
        return ArmaxFreeRun(output, first)
    output[end:] = np.nan
    reason = (
        "a gap closed"
        if state == _GAP_CLOSED
        else f"the output left {RUNAWAY:g} times the measured span or is not finite"
    )
    return ArmaxFreeRun(output, first, diverged_at=int(end), reason=reason)


def _numerators(model: ArmaxEstimate, run: SampledRun, prepared: SampledRun) -> Array:
    """Inputs (n_inputs, n_samples) before any division by a gap."""
    if model.rational is None:
        return np.vstack(list(prepared.inputs.values()))
    rows = [np.asarray(run.inputs[term.current_name]) ** term.current_power for term in model.rational.terms]
    rows += [np.asarray(run.inputs[name]) for name in model.rational.plain]
    return np.vstack(rows).astype(float)


def _recursion(model: ArmaxEstimate) -> _Recursion:
    lags, b = model.orders.input_lags, model.polynomials.b
    padded = np.zeros((len(b), max(map(len, b))))
    for row, coefficients in enumerate(b):
        padded[row, : coefficients.size] = coefficients
    signs, powers = np.zeros((2, len(b)), dtype=np.int64)
    gap = 0.0
    if model.rational is not None:
        gap = model.rational.nominal_gap + model.rational.delta
        for row, term in enumerate(model.rational.terms):
            signs[row], powers[row] = term.gap_sign, term.gap_power
    delay = np.array([lag[0] for lag in lags], dtype=np.int64)
    return _Recursion(model.polynomials.a, padded, delay, model.polynomials.offset, gap, signs, powers)


@compiled
def _free_run(output, values, model, limits, forcing):  # type: ignore[no-untyped-def]
    """Runs the recursion in place from limits[0] on; returns the sample it stopped at and why."""
    first, middle, reach = limits
    n_inputs, n_coefficients = model.b.shape
    for t in range(output.size):
        if t >= first:
            total = model.offset
            if t - first < forcing.size:
                total += forcing[t - first]
            for i in range(1, model.a.size):
                total -= model.a[i] * output[t - i]
            for k in range(n_inputs):
                for j in range(n_coefficients):
                    if model.b[k, j] != 0.0:
                        total += model.b[k, j] * values[k, t - model.delay[k] - j]
            if not abs(total - middle) <= reach:
                return t, _RAN_AWAY
            output[t] = total
        for k in range(n_inputs):
            if model.gap_power[k] > 0:
                gap = model.gap + model.gap_sign[k] * output[t]
                if gap <= 0.0:
                    return t, _GAP_CLOSED
                values[k, t] /= gap ** model.gap_power[k]
    return output.size, _RUNNING


@dataclass(frozen=True)
class FitFigures:
    """Fit of one run in per cent; `free_run` is None where the free run diverged, with the sample and the reason."""

    run: str
    one_step: float
    free_run: float | None
    diverged_at: int | None = None
    reason: str = ""


def fit_percent(measured: Array, modelled: Array) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean y||) where yhat is a number; 100 is perfect, nan where y stands still.

    The figure that L. Ljung's System Identification Toolbox calls fit.
    """
    known = np.isfinite(modelled)
    y = np.asarray(measured, dtype=float)[known]
    if y.size == 0 or np.ptp(y) == 0:
        return float("nan")
    return float(100.0 * (1.0 - np.linalg.norm(y - modelled[known]) / np.linalg.norm(y - y.mean())))


def fit_figures(model: ArmaxEstimate, runs: Sequence[SampledRun]) -> tuple[FitFigures, ...]:
    """One-step and free-run fit of every run, over the samples after the initial ones."""
    return tuple(_run_fit(model, run) for run in runs)


def _run_fit(model: ArmaxEstimate, run: SampledRun) -> FitFigures:
    one_step = fit_percent(run.output, predict(model, run))
    free = simulate_armax(model, run)
    if free.diverged_at is not None:
        return FitFigures(run.name, one_step, None, free.diverged_at, free.reason)
    after = slice(free.first, None)
    return FitFigures(run.name, one_step, fit_percent(np.asarray(run.output)[after], free.output[after]))


def transfer_matrix(model: ArmaxEstimate, *, noise: bool = False) -> TransferFunction:
    """Discrete transfer functions B_k/A from every input to the output, one row; with `noise`, C/A as last column.

    Its inputs are the model's: of rational inputs the evaluated terms, not the currents. The offset has no place in a
    transfer function and is left out. InputError without python-control.
    """
    try:
        import control
    except ImportError as err:
        raise InputError("to_control needs the package python-control: pip install control") from err
    polynomials = model.polynomials
    tops = [
        np.concatenate([np.zeros(lags[0]), b]) for lags, b in zip(model.orders.input_lags, polynomials.b, strict=True)
    ]
    names = list(model.input_names)
    if noise:
        tops.append(polynomials.c)
        names.append("innovation")
    fractions = [_in_powers_of_z(top, polynomials.a) for top in tops]
    return control.tf(
        [[top for top, _ in fractions]],
        [[bottom for _, bottom in fractions]],
        model.sampling_period,
        inputs=names,
        outputs=["y"],
    )


def _in_powers_of_z(top: Array, bottom: Array) -> tuple[Array, Array]:
    """Numerator and denominator in powers of z from polynomials in z^-1."""
    length = max(top.size, bottom.size)
    padded = [np.concatenate([p, np.zeros(length - p.size)]) for p in (top, bottom)]
    return padded[0], padded[1]
