"""k-step predictions and residuals of an identified model on a run."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray, SampledRun
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.prediction_error import prediction_errors
from msl_fem.identification.prepared import prepared_run


def residuals(model: ArmaxEstimate, run: SampledRun) -> FloatArray:
    """One-step prediction errors y(t) - yhat(t | t - 1), shape (n_samples,), NaN before sample `longest_lag`."""
    return np.asarray(run.output, dtype=float) - predict(model, run)


def predict(model: ArmaxEstimate, run: SampledRun, horizon: int = 1) -> FloatArray:
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
    missed = lfilter(lfilter(polynomials.c, polynomials.a, pulse), [1.0], errors)
    predicted = np.full(run.n_samples, np.nan)
    first = orders.longest_lag + horizon - 1
    predicted[first:] = np.asarray(run.output, dtype=float)[first:] - missed[horizon - 1 :]
    return predicted
