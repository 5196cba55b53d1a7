"""Sensitivity and margins of a loop that runs, from a test signal that is added to its position reading.

The controller takes e = y + w, the reading and the test signal. From w to e is S = 1/(1 + L), opened at the reading as
ISO 14839-3 (2006) measures it; of one input and one output it is the same wherever the loop is opened. No model of
plant or controller is used, and nothing is assumed of the noise but that it was not made by w.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.design import zone_of
from msl_fem.control.linear_loop import Complex
from msl_fem.control.local_rational import LocalResponse, fit_local_response
from msl_fem.control.margins import gain_crossings, margins, phase_crossings
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value
from msl_fem.files.quantity import format_quantity
from msl_fem.record import Record, Run

INJECTION = "injection_m"
_WINDOW = 0.25  # of its middle frequency, to either side
_FEWEST_BINS = 32  # of a window: four a parameter
_BINS_OF_CURVE = 240  # of a window, at most; the peak takes all
_STEP = 1.2  # of the middle frequencies
_FINE = 40  # frequencies of the curve in a step
_EXCITED = 0.03  # of the largest line: bins below hold no test signal
_CONFIDENCE = 0.95
_SHORTEST = 1000  # samples


@dataclass(frozen=True)
class Bounded:
    """A number with its 95 % interval."""

    value: float
    interval: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """The JSON object; what is not finite is null."""
        return {"value": json_value(self.value), "interval": json_value(self.interval)}


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """What a run's test signal tells of its loop.

    Attributes
    ----------
    run, position : its file, and the mean of the reading in m
    frequency, sensitivity : (n_frequency,) Hz and S
    deviation : (n_frequency,) one sigma of |S|
    peak, peak_at : largest |S| within the excited band, and where in Hz
    inside : whether |S| falls on both sides of its peak within the band; else it may be larger beyond
    gain_up, gain_down, phase, delay : margins as of `Margins`
    """

    run: str
    position: float
    frequency: Array
    sensitivity: Complex
    deviation: Array
    peak: Bounded
    peak_at: float
    inside: bool
    gain_up: Bounded
    gain_down: Bounded
    phase: Bounded
    delay: Bounded

    @property
    def zone(self) -> str:
        """The zone of ISO 14839-3 (2006) that the peak falls in."""
        return zone_of(self.peak.value)

    @property
    def zones_possible(self) -> str:
        """The zones that the interval of the peak reaches, from the better one."""
        low, high = (zone_of(end) for end in self.peak.interval)
        return "".join(zone for zone in "ABCD" if low <= zone <= high)

    def to_json(self) -> dict[str, Any]:
        """The JSON object of the figures."""
        return {
            "run": self.run,
            "position_m": self.position,
            "band_Hz": [float(self.frequency[0]), float(self.frequency[-1])],
            "peak_sensitivity": self.peak.value,
            "peak_sensitivity_interval": list(self.peak.interval),
            "peak_sensitivity_Hz": self.peak_at,
            "peak_inside_band": self.inside,
            "zone": self.zone,
            "zones_possible": self.zones_possible,
            "gain_margin_up": self.gain_up.to_json(),
            "gain_margin_down": self.gain_down.to_json(),
            "phase_margin_deg": self.phase.to_json(),
            "delay_margin_s": self.delay.to_json(),
        }


def measured_loops(record: Record) -> tuple[MeasuredLoop, ...]:
    """The loops of a record's runs that have a test signal, the one with the largest peak sensitivity first.

    Raises
    ------
    InputError : no run has one; a run is too short, its reference does not rest, its test signal has too few lines
    """
    runs = [run for run in record.runs if INJECTION in run.columns]
    if record.sampling is None or not runs:
        raise InputError(
            f"no run has a column {INJECTION}: the test signal that was added to the position reading before the "
            'controller took it; simulate one with msl-fem control --inject "multisine:..." -o RECORD'
        )
    found = [measured_loop(run, rate=record.sampling.rate) for run in runs]
    return tuple(sorted(found, key=lambda loop: -loop.peak.value))


def measured_loop(run: Run, *, rate: float) -> MeasuredLoop:
    """The loop of a run; raises as `measured_loops`."""
    signals = _at_rest(run)
    frequency, given, answer = _bins(signals, rate=rate, run=run)
    windows = _windows(frequency)
    parts = []
    for n, centre in enumerate(windows):
        ends = np.sqrt(windows[max(n - 1, 0)] * centre), np.sqrt(windows[min(n + 1, windows.size - 1)] * centre)
        fine = np.geomspace(*ends, _FINE, endpoint=n == windows.size - 1)
        local = _local(frequency, given, answer, float(centre), most=_BINS_OF_CURVE)
        parts.append((fine, local.response(fine), local.deviation(fine)))
    f, sensitivity, deviation = (np.concatenate(part) for part in zip(*parts, strict=True))
    at = float(f[np.argmax(np.abs(sensitivity))])
    peak, peak_at, inside = _peak(_local(frequency, given, answer, at), f, at)
    return MeasuredLoop(
        run.file,
        float(np.mean(signals[0])),
        f,
        sensitivity,
        deviation,
        peak,
        peak_at,
        inside,
        *_margin_estimates(sensitivity, deviation, f),
    )


def _at_rest(run: Run) -> Array:
    """(2, n_sample) reading and test signal, from where the reference rests and the test signal acts."""
    injection = run[INJECTION]
    acting = np.flatnonzero(injection)
    if not acting.size:
        raise InputError(f"{run.file}: {INJECTION} is 0 throughout; add a test signal of some um to the reading")
    start = acting[0]
    if "reference_m" in run:
        moving = np.flatnonzero(np.diff(run["reference_m"]))
        start = max(start, moving[-1] + 1 if moving.size else 0)
    signals = np.stack([run["position_m"], injection])[:, start : acting[-1] + 1]
    if signals.shape[1] < _SHORTEST:
        raise InputError(
            f"{run.file}: the test signal acts on {signals.shape[1]} samples of a resting reference; at least "
            f"{_SHORTEST} are needed: hold a position while it acts"
        )
    return signals


def _bins(signals: Array, *, rate: float, run: Run) -> tuple[Array, Complex, Complex]:
    """Frequency, spectrum of the test signal and of what the controller took, (n_bin,) at the excited lines."""
    n = signals.shape[1]
    given = np.fft.rfft(signals[1])
    answer = np.fft.rfft(signals[0] - signals[0].mean() + signals[1])
    frequency = np.fft.rfftfreq(n, 1 / rate)
    excited = np.abs(given) > _EXCITED * np.abs(given[1:]).max()
    excited &= (frequency > 0) & (frequency < 0.499 * rate)
    if np.count_nonzero(excited) < 2 * _FEWEST_BINS:
        raise InputError(
            f"{run.file}: the test signal has {np.count_nonzero(excited)} lines; at least {2 * _FEWEST_BINS} are "
            "needed: noise or a multisine of one long period"
        )
    return frequency[excited], given[excited], answer[excited]


def _windows(frequency: Array) -> Array:
    """(n_window,) middle frequencies over the excited band, evenly in their logarithm."""
    low, high = float(frequency[0]), float(frequency[-1])
    return np.geomspace(low, high, max(3, int(np.log(high / low) / np.log(_STEP)) + 1))


def _local(
    frequency: Array, given: Complex, answer: Complex, centre: float, *, most: int | None = None
) -> LocalResponse:
    """The fit about a frequency, wide enough for its bins; of more than `most` every second, third, ... is taken."""
    away = np.abs(frequency - centre)
    half = max(_WINDOW * centre, float(np.partition(away, _FEWEST_BINS)[_FEWEST_BINS]))
    near = np.flatnonzero(away <= half)
    near = near[:: 1 if most is None else -(-near.size // most)]
    return fit_local_response(frequency[near], given[near], answer[near], centre=centre, half_width=half)


def _peak(local: LocalResponse, frequency: Array, near: float) -> tuple[Bounded, float, bool]:
    """The peak with its interval, where it is, and whether it lies within the band.

    At a peak the slope is zero, so the error there is the peak's; what errors of its place add is taken off. Where
    noise is as large as the peak, no such expansion holds, and the largest value stands as it was found.
    """
    low, high = max(near / _STEP, frequency[0]), min(near * _STEP, frequency[-1])
    fine = np.linspace(low, high, 8 * _FINE)
    size = np.abs(local.response(fine))
    top = int(np.argmax(size))
    half = _quantile(local.freedom) * float(local.deviation(fine[top : top + 1])[0])
    inside = frequency[0] < fine[top] < frequency[-1]
    value = float(size[top])
    if 0 < top < fine.size - 1 and half < value:
        apart = fine[1] - fine[0]
        curvature = (size[top - 1] - 2 * value + size[top + 1]) / apart**2
        value -= min(half, local.excess(float(fine[top]), curvature=float(curvature), step=apart))
    return Bounded(value, (max(value - half, 0.0), value + half)), float(fine[top]), bool(inside)


def _margin_estimates(
    sensitivity: Complex, deviation: Array, frequency: Array
) -> tuple[Bounded, Bounded, Bounded, Bounded]:
    """Gain up and down, phase in degrees, delay in s: each of the crossing that decides."""
    transfer = 1 / sensitivity - 1
    sigma = deviation / np.abs(sensitivity) ** 2
    nearest = margins(transfer, frequency)
    crossed = {c.factor: (c.frequency, c.spread) for c in phase_crossings(transfer, frequency)}
    turned = {}
    for c in gain_crossings(transfer, frequency):
        turned[float(np.degrees(abs(c.angle)))] = (c.frequency, float(np.degrees(c.angle_spread)))
        turned[c.delay] = (c.frequency, c.delay_spread)

    def estimate(value: float, places: dict[float, tuple[float, float]]) -> Bounded:
        if value not in places:
            return Bounded(value, (value, value))
        at, spread = places[value]
        half = _quantile() * spread * float(np.interp(at, frequency, sigma))
        return Bounded(value, (max(value - half, 0.0), value + half))

    return (
        estimate(nearest.gain_up, crossed),
        estimate(nearest.gain_down, crossed),
        estimate(nearest.phase, turned),
        estimate(nearest.delay, turned),
    )


def _quantile(freedom: float = np.inf) -> float:
    """Of Student's distribution, for an interval to both sides."""
    from scipy.special import ndtri, stdtrit

    share = 0.5 + 0.5 * _CONFIDENCE
    return float(ndtri(share) if np.isinf(freedom) else stdtrit(freedom, share))


def text_of(estimate: Bounded, unit: str) -> str:
    """The number with its interval as people read it."""
    if not np.isfinite(estimate.value):
        return "none"
    low, high = (format_quantity(end, unit, digits=3) for end in estimate.interval)
    return f"{format_quantity(estimate.value, unit, digits=3)} ({low} ... {high})"
