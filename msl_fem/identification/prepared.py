"""A run in the shape a model wants: its inputs by name, the rational terms evaluated at the measured position."""

from __future__ import annotations

from dataclasses import replace

from msl_fem.errors import InputError
from msl_fem.identification.data import PERIOD_MISMATCH, SampledRun, check_length, check_runs
from msl_fem.identification.model import ArmaxEstimate


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
