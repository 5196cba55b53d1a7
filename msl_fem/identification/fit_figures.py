"""How well a model reproduces a run, one sample ahead and in free run, in per cent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.identification.data import FloatArray, SampledRun
from msl_fem.identification.free_run import simulate
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.prediction import predict


@dataclass(frozen=True)
class RunFit:
    """Fit of one run in per cent; `free_run` is None where the free run diverged, with the sample and the reason."""

    run: str
    one_step: float
    free_run: float | None
    diverged_at: int | None = None
    reason: str = ""


def fit_percent(measured: FloatArray, modelled: FloatArray) -> float:
    """100 (1 - ||y - yhat|| / ||y - mean y||) over the samples where yhat is a number; 100 is perfect.

    The figure that L. Ljung's System Identification Toolbox calls fit.
    """
    known = np.isfinite(modelled)
    y = np.asarray(measured, dtype=float)[known]
    return float(100.0 * (1.0 - np.linalg.norm(y - modelled[known]) / np.linalg.norm(y - y.mean())))


def fit_figures(model: ArmaxEstimate, runs: Sequence[SampledRun]) -> tuple[RunFit, ...]:
    """One-step and free-run fit of every run, over the samples after the initial ones."""
    return tuple(_run_fit(model, run) for run in runs)


def _run_fit(model: ArmaxEstimate, run: SampledRun) -> RunFit:
    one_step = fit_percent(run.output, predict(model, run))
    free = simulate(model, run)
    if free.diverged_at is not None:
        return RunFit(run.name, one_step, None, free.diverged_at, free.reason)
    after = slice(free.first, None)
    return RunFit(run.name, one_step, fit_percent(np.asarray(run.output)[after], free.output[after]))
