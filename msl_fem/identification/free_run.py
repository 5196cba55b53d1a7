"""Free run of an identified model: inputs given, the output simulated, the magnets' gaps taken from the simulation.

The model never sees the measured output after the start, so nothing hides its errors; where it diverges, the result
says at which sample and why, and holds NaN from there on. A free run of an open-loop unstable model says little: use
`predict` for those, or simulate the closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray, SampledRun
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.prediction_error import prediction_errors
from msl_fem.identification.prepared import prepared_run

RUNAWAY = 1e3  # times the measured span around its middle: beyond, the run has diverged

_RUNNING, _GAP_CLOSED, _RAN_AWAY = 0, 1, 2


@dataclass(frozen=True, eq=False)
class FreeRun:
    """Simulated output (n_samples,), NaN from `diverged_at` on; the samples before `first` are the measured start."""

    output: FloatArray
    first: int
    diverged_at: int | None = None
    reason: str = ""


class _Recursion(NamedTuple):
    """The model as plain arrays for the compiled loop; `b` (n_inputs, longest nb) is padded with zeros."""

    a: FloatArray
    b: FloatArray
    delay: np.ndarray
    offset: float
    gap: float
    gap_sign: np.ndarray
    gap_power: np.ndarray


def simulate(
    model: ArmaxEstimate, run: SampledRun, *, initial: Literal["estimated", "measured"] = "estimated"
) -> FreeRun:
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
    middle, span = 0.5 * (output.max() + output.min()), np.ptp(output)
    values = _numerators(model, run, prepared)
    end, state = _free_run(output, values, _recursion(model), (first, middle, RUNAWAY * span), forcing)
    if state == _RUNNING:
        return FreeRun(output, first)
    output[end:] = np.nan
    reason = (
        "a gap closed"
        if state == _GAP_CLOSED
        else f"the output left {RUNAWAY:g} times the measured span or is not finite"
    )
    return FreeRun(output, first, diverged_at=int(end), reason=reason)


def _numerators(model: ArmaxEstimate, run: SampledRun, prepared: SampledRun) -> FloatArray:
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
