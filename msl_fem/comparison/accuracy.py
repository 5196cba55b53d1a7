"""How far each model is from each run, and where: one number a kind of prediction, by band of frequency, over what a
residual may depend on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from msl_fem.comparison.models import ARMAX, CoupledModel
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.identification import ArmaxModel, predict, sampled_run, simulate_armax
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
from msl_fem.record import Channel, Record, Role, Run

FEWEST = 8  # samples of a bin or lines of a band that still say something
SLOPE_SAMPLES = 15  # of the parabola that gives the velocity
HORIZON = 10
LEAD = 40  # samples left out of all errors at the beginning, where a predictor still finds its state
KINDS = ("one_step", "ten_step", "closed_loop", "free_run")
"""Kinds of prediction, the hardest last: one sample ahead, ten samples ahead, in closed loop, in free run."""
UNSTABLE = "the open loop does not return to its operating point, so a free run says nothing"
CURRENTS_IN = "armax takes currents, it has no drive for a law to command"


def nrmse(measured: Array, model: Array) -> float:
    """RMS of (measured - model) over the standard deviation of measured, (n_sample,) each; nan where model is nan.

    Raises
    ------
    InputError : different lengths, or a measured channel that never moves
    """
    error, scale = _error(measured, model)
    return float(np.sqrt(np.mean(error**2)) / scale)


@dataclass(frozen=True, eq=False)
class Spread:
    """RMS and mean of a residual over bins of a variable.

    Attributes
    ----------
    edges : (n_bin + 1,) of the variable
    rms, mean : (n_bin,) of the residual; nan where a bin holds too few samples
    count : (n_bin,) samples
    """

    edges: Array
    rms: Array
    mean: Array
    count: NDArray[np.intp]

    def to_json(self) -> dict[str, Any]:
        """An entry of `over`."""
        return {"edges": self.edges, "rms": self.rms, "mean": self.mean, "count": self.count}


def over_variable(residual: Array, variable: Array, *, bins: int = 12) -> Spread:
    """The residual over equally filled bins of a variable, (n_sample,) each; fewer bins where values repeat.

    Raises
    ------
    InputError : different lengths
    """
    if residual.shape != variable.shape:
        raise InputError(f"a residual of {residual.size} samples over {variable.size} values; give equally many")
    edges = np.unique(np.quantile(variable, np.linspace(0, 1, bins + 1)))
    if edges.size < 2:
        edges = np.array([edges[0], edges[0] + max(abs(edges[0]), 1.0) * 1e-12])
    which = np.clip(np.searchsorted(edges, variable, side="right") - 1, 0, edges.size - 2)
    count = np.bincount(which, minlength=edges.size - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(which, residual, edges.size - 1) / count
        rms = np.sqrt(np.bincount(which, residual**2, edges.size - 1) / count)
    thin = count < FEWEST
    return Spread(edges, np.where(thin, np.nan, rms), np.where(thin, np.nan, mean), count)


@dataclass(frozen=True, eq=False)
class Bands:
    """A channel and its residual by band of frequency.

    Attributes
    ----------
    edges : (n_band + 1,) Hz
    measured, residual : (n_band,) RMS of what lies in the band; nan where it holds too few lines
    """

    edges: Array
    measured: Array
    residual: Array

    @property
    def nrmse(self) -> Array:
        """(n_band,) the residual over the measured in the band."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.residual / self.measured

    def to_json(self) -> dict[str, Any]:
        """An entry of `bands`."""
        return {"edges_Hz": self.edges, "measured": self.measured, "residual": self.residual, "nrmse": self.nrmse}


def by_band(measured: Array, model: Array, *, rate: float, edges: Array | None = None) -> Bands:
    """The residual by band, by Parseval's theorem on windowed lines; octave bands from 1 Hz by default.

    A Hann window keeps what a run does not repeat from leaking into other bands. The mean is left out.

    Raises
    ------
    InputError : different lengths, a channel that never moves
    """
    error, _ = _error(measured, model)
    bounds = octaves(measured.size / rate, rate / 2) if edges is None else np.asarray(edges, dtype=float)
    window = np.hanning(measured.size)
    frequency = np.fft.rfftfreq(measured.size, 1 / rate)
    weight = 2 / (measured.size * np.sum(window**2))

    def rms(signal: Array) -> Array:
        power = weight * np.abs(np.fft.rfft(window * (signal - signal.mean()))) ** 2
        bands = np.full(bounds.size - 1, np.nan)
        for k, (low, high) in enumerate(zip(bounds[:-1], bounds[1:], strict=True)):
            lines = (frequency >= low) & (frequency < high)
            if lines.sum() >= FEWEST:
                bands[k] = np.sqrt(power[lines].sum())
        return bands

    return Bands(bounds, rms(measured), rms(error))


def octaves(duration: float, highest: float) -> Array:
    """Edges of octaves in Hz, from ten periods in the duration or 1 Hz on, up to `highest`."""
    lowest = max(1.0, 10 / duration)
    count = max(1, int(np.floor(np.log2(highest / lowest))))
    return np.append(lowest * 2.0 ** np.arange(count), highest)


def _error(measured: Array, model: Array) -> tuple[Array, float]:
    if measured.shape != model.shape or measured.ndim != 1:
        raise InputError(f"measured has the shape {measured.shape}, the model {model.shape}; give equal lengths")
    scale = float(measured.std())
    if not scale > 1e-12 * float(np.abs(measured).max(initial=0.0)):
        raise InputError("the measured channel never moves, so no error can be relative to it; leave it out")
    return measured - model, scale


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
    def hardest_kind(self) -> str | None:
        """The hardest kind of prediction that there is: free run, else closed loop, ten samples ahead, one."""
        return next((kind for kind in reversed(KINDS) if self.nrmse[kind] is not None), None)

    def residual(self, kind: str) -> Array:
        """(n_sample - LEAD,) measured less modelled."""
        return (self.measured - self.modelled[kind])[LEAD:]

    def to_json(self) -> dict[str, Any]:
        """An entry of `models`."""
        return {
            "name": self.model,
            "run": self.run,
            "role": self.role,
            "channel": self.channel,
            **{f"nrmse_{kind}": self.nrmse[kind] for kind in KINDS},
            "reason": self.reason,
        }


def coupled_accuracy(model: CoupledModel, data: RunData, law: CallableLaw | None = None) -> list[ModelAccuracy]:
    """A coupled model on all channels of a run; in closed loop by `law`, or by the run's linear law."""
    plant = kernel_plant(model.belief, rate=data.rate, ideal_current=data.ideal_current)
    start = measured_start(plant, data)
    filtered = kalman_filter(plant, data, model.noise, start=start)
    modelled: dict[str, Mapping[str, Array]] = {}
    reasons = []
    if filtered.ended is None:
        modelled["one_step"] = filtered.one_step
        ten_step = k_step(plant, data, filtered, HORIZON)
        failed = int(np.isnan(ten_step[POSITION_COLUMN][LEAD:]).sum())
        if failed:
            reasons.append(f"ten_step: {failed} predictions leave table or range")
        else:
            modelled["ten_step"] = ten_step
    else:
        reasons.append(f"one_step, ten_step: {filtered.reason}")
    runs = {}
    if data.law is not None or law is not None:
        runs["closed_loop"] = closed_run(plant, data, start, law)
    stable = open_loop_stable(model.belief, data)
    if stable:
        runs["free_run"] = free_run(plant, data, start)
    for kind, run in runs.items():
        if run.ended is None:
            modelled[kind] = run.readings
        else:
            reasons.append(f"{kind}: {run.reason}")
    if not stable:
        reasons.append(f"free_run: {UNSTABLE}")
    return [_accuracy(model.name, data, channel, modelled, reasons) for channel in data.measured]


def armax_accuracy(
    model: ArmaxModel, record: Record, run: Run, data: RunData, *, stable: bool, looped: bool = False
) -> ModelAccuracy:
    """ARMAX on the position of a run; `looped` says that the run's loop is simulated with the other models."""
    sampled = sampled_run(record, run)
    modelled = {"one_step": predict(model, sampled), "ten_step": predict(model, sampled, HORIZON)}
    reasons = [f"closed_loop: {CURRENTS_IN}"] if data.law is not None or looped else []
    if stable:
        free = simulate_armax(model, sampled)
        if free.diverged_at is None:
            modelled["free_run"] = free.output
        else:
            reasons.append(f"free_run: {free.reason} at sample {free.diverged_at}")
    else:
        reasons.append(f"free_run: {UNSTABLE}")
    readings = {kind: {POSITION_COLUMN: values} for kind, values in modelled.items()}
    return _accuracy(ARMAX, data, POSITION_COLUMN, readings, reasons)


def _accuracy(
    model: str, data: RunData, channel: str, modelled: Mapping[str, Mapping[str, Array]], reasons: list[str]
) -> ModelAccuracy:
    measured = data.measured[channel]
    # the mean voltage of a run's last sample is no prediction of the state before it
    behind = measured.size - (1 if data.channels[channel].quantity == "voltage" else 0)
    kept = slice(LEAD, behind)
    errors: dict[str, float | None] = dict.fromkeys(KINDS)
    kinds = {}
    reasons = list(reasons)
    for kind, readings in modelled.items():
        error = nrmse(measured[kept], readings[channel][kept])
        if np.isfinite(error):
            errors[kind] = error
            kinds[kind] = readings[channel]
        else:
            reasons.append(f"{kind}: not finite")
    return ModelAccuracy(model, data.name, data.role, channel, measured, kinds, errors, "; ".join(reasons))


@dataclass(frozen=True, eq=False)
class LocatedResidual:
    """Where one model's residual on one channel of one run lives; `kind` says of which prediction."""

    accuracy: ModelAccuracy
    kind: str
    over: Mapping[str, Spread]
    bands: Bands

    def to_json(self) -> dict[str, Any]:
        """An entry of `residuals`."""
        return {
            "name": self.accuracy.model,
            "run": self.accuracy.run,
            "role": self.accuracy.role,
            "channel": self.accuracy.channel,
            "prediction": self.kind,
            "over": {name: spread.to_json() for name, spread in self.over.items()},
            "by_band": self.bands.to_json(),
        }


def residual_variables(record: Record, run: Run) -> dict[str, Array]:
    """What a residual may depend on, by name with unit, (n_sample,) each."""
    x = run["position_m"]
    rate = 1.0 / run.sampling_period
    variables = {}
    for side in (1, 2):
        current = Channel("current", side).column
        for column in (current, Channel("command", side).column):
            if column in run:
                variables[current] = run[column]
                break
    motion = record.actuator.motion
    if motion is not None and motion.nominal_gap is not None and record.actuator.magnet is not None:
        variables["gap_1_m"] = motion.nominal_gap - x
    else:
        variables["position_m"] = x
    variables["velocity_m_per_s"] = savgol_filter(x, SLOPE_SAMPLES, 2, deriv=1) * rate
    variables["amplitude_m"] = np.abs(x - x.mean())
    variables["time_s"] = run.time
    return variables


def locate_residual(record: Record, run: Run, accuracy: ModelAccuracy) -> LocatedResidual | None:
    """Of the hardest prediction that the model bears; None where it bears none."""
    kind = accuracy.hardest_kind
    if kind is None:
        return None
    error = accuracy.residual(kind)
    finite = np.isfinite(error)  # of a voltage, the last sample is not
    over = {}
    for name, variable in residual_variables(record, run).items():
        over[name] = over_variable(error[finite], variable[LEAD:][finite])
    measured = accuracy.measured[LEAD:][finite]
    model = accuracy.modelled[kind][LEAD:][finite]
    return LocatedResidual(accuracy, kind, over, by_band(measured, model, rate=1.0 / run.sampling_period))
