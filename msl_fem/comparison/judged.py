"""Each model along each run: readings one sample ahead, ten samples ahead, in closed loop and in free run."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.comparison.accuracy import nrmse
from msl_fem.comparison.models import ARMAX, CoupledModel
from msl_fem.identification import ArmaxModel, predict, sampled_run, simulate
from msl_fem.prediction import (
    CallableLaw,
    RunData,
    closed_run,
    free_run,
    k_step,
    kalman_filter,
    kernel_plant,
    measured_start,
    open_loop_stable,
)
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record, Role, Run

Array = NDArray[np.float64]
HORIZON = 10
LEAD = 40  # samples left out of all errors at the beginning, where a predictor still finds its state
KINDS = ("one_step", "ten_step", "closed_loop", "free_run")
UNSTABLE = "the open loop does not return to its operating point, so a free run says nothing"
CURRENTS_IN = "armax takes currents, it has no drive for a law to command"


@dataclass(frozen=True, eq=False)
class ModelAccuracy:
    """A model against one channel of one run.

    Attributes
    ----------
    modelled : kind of `KINDS` to (n_sample,), nan at the beginning; a kind that is not there failed
    nrmse : kind to the error; None where there is none
    reason : why a kind has no error
    """

    model: str
    run: str
    role: Role
    channel: str
    measured: Array
    modelled: Mapping[str, Array]
    nrmse: Mapping[str, float | None]
    reason: str

    @property
    def best_known(self) -> str | None:
        """The hardest kind of prediction that there is: free run, else closed loop, ten samples ahead, one."""
        return next((kind for kind in reversed(KINDS) if self.nrmse[kind] is not None), None)

    def residual(self, kind: str) -> Array:
        """(n_sample - LEAD,) measured less modelled."""
        return (self.measured - self.modelled[kind])[LEAD:]

    def fields(self) -> dict[str, Any]:
        """The JSON fields of an entry of `models`."""
        return {
            "name": self.model, "run": self.run, "role": self.role, "channel": self.channel,
            **{f"nrmse_{kind}": self.nrmse[kind] for kind in KINDS}, "reason": self.reason,
        }  # fmt: skip


def coupled_accuracy(model: CoupledModel, data: RunData, asked: CallableLaw | None = None) -> list[ModelAccuracy]:
    """A coupled model on all channels of a run; in closed loop by `asked`, or by the run's linear law."""
    plant = kernel_plant(model.belief, rate=data.rate, ideal_current=data.ideal_current)
    start = measured_start(plant, data)
    found = kalman_filter(plant, data, model.noise, start=start)
    made: dict[str, Mapping[str, Array]] = {}
    reasons = []
    if found.ended is None:
        made["one_step"] = found.one_step
        made["ten_step"] = k_step(plant, data, found, HORIZON)
        lost = int(np.isnan(made["ten_step"][POSITION_COLUMN][LEAD:]).sum())
        if lost:
            del made["ten_step"]
            reasons.append(f"ten_step: {lost} predictions leave table or range")
    else:
        reasons.append(f"one_step, ten_step: {found.reason}")
    if data.law is not None or asked is not None:
        run = closed_run(plant, data, start, asked)
        if run.ended is None:
            made["closed_loop"] = run.readings
        else:
            reasons.append(f"closed_loop: {run.reason}")
    if open_loop_stable(model.belief, data):
        run = free_run(plant, data, start)
        if run.ended is None:
            made["free_run"] = run.readings
        else:
            reasons.append(f"free_run: {run.reason}")
    else:
        reasons.append(f"free_run: {UNSTABLE}")
    return [_judged(model.name, data, channel, made, reasons) for channel in data.measured]


def armax_accuracy(
    model: ArmaxModel, record: Record, run: Run, data: RunData, *, stable: bool, looped: bool = False
) -> list[ModelAccuracy]:
    """ARMAX on the position of a run; `looped` says that the run's loop is simulated with the other models."""
    sampled = sampled_run(record, run)
    made: dict[str, Mapping[str, Array]] = {
        "one_step": {POSITION_COLUMN: predict(model, sampled)},
        "ten_step": {POSITION_COLUMN: predict(model, sampled, HORIZON)},
    }
    reasons = [f"closed_loop: {CURRENTS_IN}"] if data.law is not None or looped else []
    if stable:
        free = simulate(model, sampled)
        if free.diverged_at is None:
            made["free_run"] = {POSITION_COLUMN: free.output}
        else:
            reasons.append(f"free_run: {free.reason} at sample {free.diverged_at}")
    else:
        reasons.append(f"free_run: {UNSTABLE}")
    return [_judged(ARMAX, data, POSITION_COLUMN, made, reasons)]


def _judged(
    model: str, data: RunData, channel: str, made: Mapping[str, Mapping[str, Array]], reasons: list[str]
) -> ModelAccuracy:
    measured = data.measured[channel]
    # the mean voltage of a run's last sample is no prediction of the state before it
    last = measured.size - (1 if channel.startswith("voltage") else 0)
    kept = slice(LEAD, last)
    errors: dict[str, float | None] = {kind: None for kind in KINDS}
    said = list(reasons)
    for kind in made:
        error = nrmse(measured[kept], made[kind][channel][kept])
        if np.isfinite(error):
            errors[kind] = error
        else:
            said.append(f"{kind}: not finite")
    kinds = {kind: values[channel] for kind, values in made.items() if errors[kind] is not None}
    return ModelAccuracy(model, data.name, data.role, channel, measured, kinds, errors, "; ".join(said))
