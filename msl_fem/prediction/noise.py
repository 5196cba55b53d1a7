"""The noise of a record's channels: what the instruments state, else what the highest frequencies hold."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.record import Record

Array = NDArray[np.float64]
HIGHEST_BAND = 0.8  # of half the sampling rate: from here on, a channel is taken to hold noise alone
LOWEST = 1e-9  # of a channel's span: noise below is none


@dataclass(frozen=True)
class NoiseFloor:
    """One sigma of a channel and where it comes from."""

    sigma: float
    source: Literal["stated in [noise]", "estimated above 80 % of half the sampling rate"]

    @property
    def stated(self) -> bool:
        return self.source == "stated in [noise]"


def noise_floor(record: Record, channel: str) -> NoiseFloor:
    """The noise of a channel by its column's name: the least over the runs where it has to be estimated."""
    kind = next(k for k in ("flux_linkage", "position", "current", "voltage", "force") if channel.startswith(k))
    stated = getattr(record.noise, kind)
    if stated:
        return NoiseFloor(float(stated), "stated in [noise]")
    found = [highest_band_sigma(run[channel]) for run in record.runs if channel in run]
    return NoiseFloor(min(found), "estimated above 80 % of half the sampling rate")


def highest_band_sigma(signal: Array) -> float:
    """Sigma of the white noise that would have the power of a signal's highest band, with a Hann window."""
    window = np.hanning(signal.size)
    power = np.abs(np.fft.rfft((signal - signal.mean()) * window)) ** 2
    lines = power[int(HIGHEST_BAND * power.size) :]
    return float(max(np.sqrt(lines.mean() / np.sum(window**2)), LOWEST * np.ptp(signal)))
