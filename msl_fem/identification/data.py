"""Sampled input/output data of one run, and what makes it unfit for identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from msl_fem.errors import InputError

FloatArray = npt.NDArray[np.float64]

PERIOD_MISMATCH = 1e-6  # relative; runs of one fit share their sampling period to this
CONSTANT_SPAN = 1e-12  # a channel that moves less than this part of its level is constant to rounding


@dataclass(frozen=True, eq=False)
class SampledRun:
    """One run of equidistant samples: the output and the named inputs, all of shape (n_samples,), SI units.

    `sampling_period` is in seconds. The order of `inputs` is the order of the model's inputs.
    """

    output: FloatArray
    inputs: Mapping[str, FloatArray]
    sampling_period: float
    name: str = "run"
    output_name: str = field(default="output", kw_only=True)

    @property
    def n_samples(self) -> int:
        """Number of samples of the output."""
        return int(np.asarray(self.output).shape[0])

    @property
    def signals(self) -> FloatArray:
        """Rows output, inputs, ones: shape (2 + n_inputs, n_samples)."""
        rows = [self.output, *self.inputs.values(), np.ones(self.n_samples)]
        return np.ascontiguousarray(np.vstack([np.asarray(row, dtype=float) for row in rows]))


def check_runs(runs: Sequence[SampledRun], *, moving: bool = True) -> None:
    """Nothing; raises InputError that names run and channel when the runs cannot be used together.

    With `moving`, no channel may be constant over all runs.
    """
    if not runs:
        raise InputError("no run was given: identification needs at least one run of input/output data")
    first = runs[0]
    if not first.inputs:
        raise InputError(f"run {first.name!r} has no input: an ARMAX model needs at least one")
    for run in runs:
        _check_channels(run)
        if tuple(run.inputs) != tuple(first.inputs):
            raise InputError(
                f"run {run.name!r} has the inputs {', '.join(run.inputs)} but run {first.name!r} has "
                f"{', '.join(first.inputs)}: give every run the same inputs in the same order"
            )
        if abs(run.sampling_period / first.sampling_period - 1.0) > PERIOD_MISMATCH:
            raise InputError(
                f"run {run.name!r} is sampled every {run.sampling_period:g} s but run {first.name!r} every "
                f"{first.sampling_period:g} s: one discrete-time model needs one rate; resample one of them"
            )
    if moving:
        _check_movement(runs)


def check_length(runs: Sequence[SampledRun], *, samples_needed: int, longest_lag: int) -> None:
    """Nothing; raises InputError when the runs hold fewer samples than the model's coefficients deserve."""
    usable = sum(max(run.n_samples - longest_lag, 0) for run in runs)
    shortest = min(runs, key=lambda run: run.n_samples)
    if usable < samples_needed or shortest.n_samples <= 2 * longest_lag + 1:
        raise InputError(
            f"too few samples: {usable} usable over {len(runs)} run(s) (shortest: {shortest.name!r} with "
            f"{shortest.n_samples}), at least {samples_needed} are needed for these orders and more than "
            f"{2 * longest_lag + 1} in each run; record longer or lower the orders"
        )


def _check_channels(run: SampledRun) -> None:
    if not (np.isfinite(run.sampling_period) and run.sampling_period > 0.0):
        raise InputError(f"run {run.name!r} has the sampling period {run.sampling_period!r} s: give a positive one")
    channels = {run.output_name: run.output, **run.inputs}
    if len(channels) != 1 + len(run.inputs):
        raise InputError(f"run {run.name!r} has an input with the output's name {run.output_name!r}: rename one")
    for name, values in channels.items():
        samples = np.asarray(values)
        if samples.ndim != 1:
            raise InputError(f"run {run.name!r}: {name!r} has shape {samples.shape}, expected (n_samples,)")
        if samples.shape[0] != run.n_samples:
            raise InputError(
                f"run {run.name!r}: {name!r} has {samples.shape[0]} samples but {run.output_name!r} has "
                f"{run.n_samples}: all channels of a run need the same length"
            )
        bad = np.flatnonzero(~np.isfinite(samples))
        if bad.size:
            raise InputError(
                f"run {run.name!r}: {name!r} is not finite at sample {bad[0]} ({bad.size} such samples): "
                "cut the run there or repair the samples"
            )


def _check_movement(runs: Sequence[SampledRun]) -> None:
    """A channel that never moves says nothing: refuse it by name."""
    names = [(runs[0].output_name, True)] + [(name, False) for name in runs[0].inputs]
    for name, is_output in names:
        parts = [np.asarray(run.output if is_output else run.inputs[name], dtype=float) for run in runs]
        low, high = min(float(p.min()) for p in parts), max(float(p.max()) for p in parts)
        if high - low <= CONSTANT_SPAN * max(abs(low), abs(high)):
            what = "output" if is_output else "input"
            way_out = (
                "check the sensor"
                if is_output
                else "leave it out (a constant force is the orders' offset=True) or excite it"
            )
            raise InputError(f"{what} {name!r} is constant ({low:g}) in all runs and tells nothing: {way_out}")
