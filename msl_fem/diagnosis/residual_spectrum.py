"""What stands out of the spectrum of what a fit leaves: lines, as of a hum, and peaks, as of a resonance.

A grid of frequencies that is fine enough for a resonance of a per cent of damping has a hundred points; what a record
shows of one is a peak of what is left without it, some per cent wide.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.noise import in_time, transformed

MOST_LINES = 3  # that are tried as frequencies of a disturbance
LOUD = 12.0  # times the mean power of the lines around: what noise does once in e^12 lines
APART = 4  # lines between two that are taken
FEWEST_LINES = 62  # of a run: two widths of the mean around
SLOWEST = 3  # periods of a run below which a line is a drift
MOST_RESONANCES = 2
NARROW = 0.02  # of its frequency: the width over which a spectrum is told
FEWEST_IN_PEAK = 5  # lines of such a width, whose median is no single line's
AROUND = 12  # widths to either side whose median a peak stands out of
STANDS_OUT = 15.0  # nats that the lines of a width tell of standing out of that
OF_A_LINE = 0.5  # of the power of a peak, that is in one line: no resonance
ONE_PEAK = 0.15  # of its frequency, within which two peaks are one
BELOW = 0.8  # of half the sampling rate


@dataclass(frozen=True, eq=False)
class RestSpectrum:
    """The power (n_line,) of what is left of a channel of a run, weighted, in lines of a spacing in Hz."""

    power: Array
    spacing: float


Candidate = tuple[float, float, float]
"""(how much it stands out, its frequency in Hz, the spacing of its spectrum in Hz)"""


def spectra_of_rest(likelihood: Likelihood, found: Fit) -> list[RestSpectrum]:
    """Of each channel of each run; what is left over stretches is joined, since a line is one of the whole run."""
    spectra = []
    for rate, signal in _joined(likelihood, found.residual * found.weights.root):
        n = signal.size // 2 + 1
        lines = transformed(signal, n)
        spectra.append(RestSpectrum(lines[:n] ** 2 + lines[n:] ** 2, rate / signal.size))
    return spectra


def loud_lines(spectra: list[RestSpectrum]) -> tuple[float, ...]:
    """Frequencies in Hz at which single lines of a spectrum stand out, the loudest first."""
    candidates: list[Candidate] = []
    for one in spectra:
        power, spacing = one.power, one.spacing
        if power.size < FEWEST_LINES:
            continue
        around = np.convolve(power, np.ones(31) / 31, "same")
        loud = np.flatnonzero(power > LOUD * np.maximum(around - power / 31, 2.0 / 3))
        loud = loud[loud >= SLOWEST]
        candidates += [(float(power[k]), _peak(power, int(k)) * spacing, spacing) for k in loud]
    return _first_apart(candidates, MOST_LINES, lambda _, spacing: APART * spacing)


def resonances(spectra: list[RestSpectrum]) -> tuple[float, ...]:
    """Frequencies in Hz about which some per cent of a spectrum stand out, what tells most first."""
    candidates = [peak for one in spectra for peak in _peaks_of(one)]
    return _first_apart(candidates, MOST_RESONANCES, lambda other, _: ONE_PEAK * other)


def _first_apart(candidates: list[Candidate], most: int, least: Callable[[float, float], float]) -> tuple[float, ...]:
    """The frequencies of some candidates that stand out most, each farther from those before than `least` says of the
    other's frequency and of its own spectrum's spacing."""
    found: list[float] = []
    for _, frequency, spacing in sorted(candidates, reverse=True):
        if all(abs(frequency - other) > least(other, spacing) for other in found):
            found.append(frequency)
    return tuple(found[:most])


def _peaks_of(one: RestSpectrum) -> list[Candidate]:
    """The peaks of a spectrum: n lines of so many times the power around, r, tell
    n (r - 1 - log r)."""
    edges = [SLOWEST]
    while (wider := edges[-1] + max(FEWEST_IN_PEAK, round(NARROW * edges[-1]))) <= BELOW * one.power.size:
        edges.append(wider)
    if len(edges) <= 2 * AROUND:
        return []
    levels = np.array([np.median(one.power[low:high]) for low, high in zip(edges, edges[1:], strict=False)])
    found = []
    for n in range(1, levels.size - 1):
        ratio = levels[n] / np.median(levels[max(0, n - AROUND) : n + AROUND + 1])
        told = (edges[n + 1] - edges[n]) * float(ratio - 1 - np.log(ratio))
        if ratio > 1 and told > STANDS_OUT and levels[n] == levels[n - 1 : n + 2].max():
            lines = np.arange(edges[n - 1], edges[n + 2])
            shares = one.power[lines] / one.power[lines].sum()
            if shares.max() < OF_A_LINE:
                found.append((told, float(lines @ shares) * one.spacing, one.spacing))
    return found


def _joined(likelihood: Likelihood, weighted: Array) -> list[tuple[float, Array]]:
    """(samples a second, (n_sample,) what is left in time) of each channel of each run, nothing where none counts."""
    problem, at = likelihood.problem, 0
    found: dict[tuple[int, str], Array] = {}
    for lines, (run, part) in zip(likelihood.bands.lines, problem.pieces, strict=True):
        for name in problem.channels(run):
            signal = found.setdefault((run, name), np.zeros(len(problem.runs[run].commands)))
            signal[part] = in_time(weighted[at : at + 2 * lines], part.stop - part.start)
            at += 2 * lines
    return [(problem.runs[run].rate, signal) for (run, _), signal in found.items()]


def _peak(power: Array, k: int) -> float:
    """The place of a peak between its lines, by the amplitudes of its neighbours (Jacobsen, Kootsookos, 2007, for no
    window)."""
    if not 0 < k < power.size - 1:
        return float(k)
    low, top, high = np.sqrt(power[k - 1 : k + 2])
    side = 1.0 if high > low else -1.0
    return float(k + side * max(high, low) / (top + max(high, low)))
