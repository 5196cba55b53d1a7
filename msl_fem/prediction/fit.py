"""Believed parameters fitted to a record's `fit` runs, with the record's tolerances as their prior."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.gauss_newton import FitSettings, MapFit, fit_map
from msl_fem.errors import ComputationError, InputError
from msl_fem.prediction.free_run import (
    counted,
    free_run,
    measured_start,
    moved_start,
    open_loop_stable,
    start_sigmas,
    weighted,
)
from msl_fem.prediction.hypothesis import (
    KernelPlant,
    ModelHypothesis,
    believed_value,
    fitted_factor,
    free_parameters,
    kernel_plant,
)
from msl_fem.prediction.kalman import kalman_filter, tuned_process_noise
from msl_fem.prediction.nuisances import ADDITIVE, together
from msl_fem.prediction.run_data import RunData
from msl_fem.record import Tolerance

Method = Literal["free run", "one-step predictions"]
MOST_SAMPLES = 20_000  # of each run that a fit looks at
ROUNDS = 4
ENOUGH = 1.1  # times the assumed noise: up to here a residual is taken to be noise
STEP = 1e-6  # of a tolerance: near a sharp resonance a difference over more than this is a secant, no slope
FAR = 3.0  # tolerances: a fitted parameter further off is named


@dataclass(frozen=True)
class FittedParameter:
    """A believed parameter after the fit, SI units; `tolerances` is how many of them it moved."""

    believed: float
    value: float
    low: float
    high: float
    tolerances: float


@dataclass(frozen=True, eq=False)
class RecordFit:
    """The outcome of a fit.

    Attributes
    ----------
    belief : with the fitted factors
    parameters : by name, with 95 % intervals
    by : what was compared with the runs
    excess : channel to RMS residual over noise at the end; above 1 the noise was taken as larger by it
    """

    belief: ModelHypothesis
    parameters: Mapping[str, FittedParameter]
    by: Method
    excess: Mapping[str, float]
    fit: MapFit

    @property
    def far(self) -> dict[str, FittedParameter]:
        """The parameters that left their tolerances far behind."""
        return {name: fitted for name, fitted in self.parameters.items() if abs(fitted.tolerances) > FAR}


def fit_record(belief: ModelHypothesis, runs: Sequence[RunData], tolerance: Tolerance) -> RecordFit:
    """The most probable parameters of a belief given runs, by free runs where all of them can run free.

    Prior: the logarithm of a parameter over its believed value is normal with the tolerance as its sigma. The starts
    of the runs are nuisances. A residual larger than the noise is taken as noise of its own size (a variance estimated
    a channel), in turns with the parameters, so that a model error does not pass for information.

    Raises
    ------
    InputError : no runs, or nothing to fit
    ComputationError : the model cannot follow the runs at all
    """
    sigmas = free_parameters(belief, tolerance, runs=runs)
    if not runs or not sigmas:
        raise InputError("there is no run to fit, or no parameter with a tolerance")
    heads = [run.first(MOST_SAMPLES) for run in runs]
    if all(open_loop_stable(belief, run) for run in heads):
        try:
            return _fit(belief, heads, sigmas, _FreeRuns(belief, heads, sigmas, tolerance), by="free run")
        except ComputationError:
            pass
    return _fit(belief, heads, sigmas, _Innovations(belief, heads, sigmas), by="one-step predictions")


class _FreeRuns:
    """Residuals of free runs; z holds parameters, then the starts of the runs."""

    def __init__(
        self, belief: ModelHypothesis, runs: Sequence[RunData], sigmas: Mapping[str, float], tolerance: Tolerance
    ) -> None:
        self.belief = belief
        self.runs = runs
        self.sigmas = sigmas
        plants = [_plant(belief, run, sigmas, np.zeros(len(sigmas))) for run in runs]
        self.guesses = [measured_start(plant, run) for plant, run in zip(plants, runs, strict=True)]
        self.starts = [start_sigmas(p, run, tolerance=tolerance) for p, run in zip(plants, runs, strict=True)]
        self.nuisances = sum(sigma.size for sigma in self.starts)

    def __call__(self, z: Array, scale: Mapping[str, float]) -> Array:
        n = len(self.sigmas)
        parts = []
        for run, guess, sigma in zip(self.runs, self.guesses, self.starts, strict=True):
            start = moved_start(guess, z[n : n + sigma.size] * sigma)
            n += sigma.size
            try:
                plant = _plant(self.belief, run, self.sigmas, z[: len(self.sigmas)])
            except InputError:  # a step of the search out of the table
                size = sum(run.measured[name].size for name in counted(run))
                parts.append(np.full(size, np.nan))
                continue
            parts.append(weighted(free_run(plant, run, start), run, scale))
        return np.concatenate(parts)

    def channels(self) -> list[tuple[str, slice]]:
        return _slices(self.runs)


class _Innovations:
    """Errors of one-step predictions, with the process noise that suits the belief; z holds parameters."""

    def __init__(self, belief: ModelHypothesis, runs: Sequence[RunData], sigmas: Mapping[str, float]) -> None:
        self.belief = belief
        self.runs = runs
        self.sigmas = sigmas
        self.noise = tuned_process_noise(_plant(belief, runs[0], sigmas, np.zeros(len(sigmas))), runs)
        self.nuisances = 0

    def __call__(self, z: Array, scale: Mapping[str, float]) -> Array:
        parts = []
        for run in self.runs:
            predicted = kalman_filter(_plant(self.belief, run, self.sigmas, z), run, self.noise)
            for name in predicted.whitened:
                error = run.measured[name] - predicted.one_step[name]
                error[0] = 0.0
                parts.append(error / (run.noise[name].sigma * scale.get(name, 1.0)))
        return np.concatenate(parts)

    def channels(self) -> list[tuple[str, slice]]:
        return _slices(self.runs, without_voltages=True)


def _fit(
    belief: ModelHypothesis,
    runs: Sequence[RunData],
    sigmas: Mapping[str, float],
    residuals: _FreeRuns | _Innovations,
    *,
    by: Method,
) -> RecordFit:
    """The fit in turns with the channels' scales: RMS residual over noise, at least 1."""
    scale: dict[str, float] = {}
    z = np.zeros(len(sigmas) + residuals.nuisances)
    for _ in range(ROUNDS):
        settings = FitSettings(step=STEP, damping=1.0 if scale else 1e3, most_steps=30)
        fit = fit_map(
            lambda rows: np.array([residuals(row, scale) for row in rows]),  # noqa: B023 - used at once
            z,
            settings=settings,
        )
        z = fit.parameters
        rms: dict[str, list[Array]] = {}
        for name, part in residuals.channels():
            rms.setdefault(name, []).append(fit.residual[part] * scale.get(name, 1.0))
        excess = {name: float(np.sqrt(np.mean(np.concatenate(p) ** 2))) for name, p in rms.items()}
        needed = {name: max(1.0, value) for name, value in excess.items()}
        settled = all(abs(needed[name] / scale.get(name, 1.0) - 1) < ENOUGH - 1 for name in needed)
        scale = needed
        if settled:
            break
    return _outcome(belief, sigmas, fit, by=by, excess=excess)


def _outcome(
    belief: ModelHypothesis, sigmas: Mapping[str, float], fit: MapFit, *, by: Method, excess: Mapping[str, float]
) -> RecordFit:
    error = np.sqrt(np.diag(fit.covariance))
    parameters = {}
    factors = dict(belief.factors)
    for n, (name, sigma) in enumerate(sigmas.items()):
        believed = believed_value(belief, name)
        z = float(fit.parameters[n])
        three = [fitted_factor(name, sigma, z + k * 1.96 * error[n]) for k in (-1, 0, 1)]
        low, value, high = (believed + b if name in ADDITIVE else believed * b for b in three)
        parameters[name] = FittedParameter(believed, float(value), float(low), float(high), z)
        factors |= together({name: belief.factors[name]} if name in belief.factors else {}, {name: three[1]})
    return RecordFit(replace(belief, factors=factors), parameters, by, excess, fit)


def _plant(belief: ModelHypothesis, run: RunData, sigmas: Mapping[str, float], z: Array) -> KernelPlant:
    factors = {name: fitted_factor(name, sigma, z[n]) for n, (name, sigma) in enumerate(sigmas.items())}
    return kernel_plant(belief, rate=run.rate, factors=factors, ideal_current=run.ideal_current)


def _slices(runs: Sequence[RunData], *, without_voltages: bool = False) -> list[tuple[str, slice]]:
    slices = []
    first = 0
    for run in runs:
        for name in counted(run):
            if without_voltages and run.channels[name].quantity == "voltage":
                continue
            behind = first + len(run.commands)
            slices.append((name, slice(first, behind)))
            first = behind
    return slices
