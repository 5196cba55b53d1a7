"""How well models follow runs that no fit has seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.prediction import ModelHypothesis, RunData, free_run, kernel_plant, measured_start
from msl_fem.prediction.free_run import counted

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Followed:
    """A model on one channel of a run in free run from a measured start.

    Attributes
    ----------
    rms : of measured less simulated, SI unit; inf where the model left its table or range
    nrmse : over the standard deviation of measured
    floor : the noise's sigma, SI unit
    """

    run: str
    role: str
    channel: str
    rms: float
    nrmse: float
    floor: float
    samples: int
    deviation: float


def followed(belief: ModelHypothesis, runs: Sequence[RunData]) -> list[Followed]:
    """A model along runs, channel by channel."""
    found = []
    for data in runs:
        plant = kernel_plant(belief, rate=data.rate, ideal_current=data.ideal_current)
        readings = free_run(plant, data, measured_start(plant, data)).readings
        found += [_judged(data, name, readings) for name in counted(data)]
    return found


def _judged(data: RunData, name: str, readings: Mapping[str, Array]) -> Followed:
    error = data.measured[name] - readings[name]
    rms = float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else float("inf")
    deviation = float(data.measured[name].std())
    return Followed(data.name, data.role, name, rms, rms / deviation, data.noise[name].sigma, error.size, deviation)


def held_out_gains(follows: Sequence[Sequence[Followed]]) -> list[float]:
    """Nats that each model brings on held-out data over the one before it; every model follows all data."""
    unseen = [[one for one in found if one.role == "held-out"] for found in follows]
    return [log_likelihood_gain(a, b) for a, b in zip(unseen, unseen[1:], strict=False)]


def log_likelihood_gain(before: Sequence[Followed], after: Sequence[Followed]) -> float:
    """Nats by which runs are more probable under the second model, the noise's variance estimated for each, at least
    the instrument's."""
    total = 0.0
    for one, other in zip(before, after, strict=True):
        if not np.isfinite(other.rms):
            return -np.inf
        if not np.isfinite(one.rms):
            return np.inf
        total += one.samples * float(np.log(max(one.rms, one.floor) / max(other.rms, other.floor)))
    return total


def worst_over_floor(found: Sequence[Followed]) -> float:
    """The largest RMS error over the noise's sigma of all channels."""
    return max((one.rms / one.floor for one in found), default=float("nan"))
