"""What the grids of shapes need to know of a record, from its runs and from what a fit leaves."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.diagnosis.variants import Scene
from msl_fem.prediction import RunData
from msl_fem.prediction.run_data import POSITION_COLUMN

Array = NDArray[np.float64]
MOST_LINES = 3
LOUD = 12.0  # times the mean power of the lines around: what noise does once in e^12 lines
APART = 4  # lines between two that are taken
SLOWEST = 3  # periods of a run below which a line is a drift
SMOOTH = 20  # samples over which a velocity is taken


def scene(likelihood: Likelihood, found: Fit) -> Scene:
    """The scene of a record at a fit without what is looked for."""
    problem, p = likelihood.problem, likelihood.problem.plant.parameters
    currents = [run.measured.get("current_1_A", run.commands[:, 0]) for run in problem.runs]
    own = np.sqrt(p.stiffness / p.mass) / (2 * np.pi) if p.stiffness else 0.0
    return Scene(
        position=_rms([run.measured[POSITION_COLUMN] for run in problem.runs]),
        current=_rms(currents) if p.sides else 1.0,
        velocity=_rms([_velocity(run) for run in problem.runs]),
        own_frequency=float(own) or 20.0,
        lines=loud_lines(likelihood, found),
    )


def _rms(values: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean([np.var(v) for v in values])))


def _velocity(run: RunData) -> Array:
    smooth = np.convolve(run.measured[POSITION_COLUMN], np.ones(SMOOTH) / SMOOTH, "valid")
    return (smooth[SMOOTH:] - smooth[:-SMOOTH]) * run.rate / SMOOTH


def loud_lines(likelihood: Likelihood, found: Fit) -> tuple[float, ...]:
    """Frequencies in Hz at which single lines of the weighted residual stand out, the loudest first."""
    weighted = found.residual * found.weights.root
    at, candidates = 0, []
    for run, data in enumerate(likelihood.problem.runs):
        n = likelihood.bands.lines[run]
        spacing = data.rate / len(data.commands)
        for _ in likelihood.problem.channels(run):
            power = weighted[at : at + n] ** 2 + weighted[at + n : at + 2 * n] ** 2
            at += 2 * n
            around = np.convolve(power, np.ones(31) / 31, "same")
            loud = np.flatnonzero(power > LOUD * np.maximum(around - power / 31, 2.0 / 3))
            candidates += [(float(power[k]), _peak(power, int(k)) * spacing, spacing) for k in loud if k >= SLOWEST]
    found_lines: list[float] = []
    for _, frequency, spacing in sorted(candidates, reverse=True):
        if all(abs(frequency - other) > APART * spacing for other in found_lines):
            found_lines.append(frequency)
    return tuple(found_lines[:MOST_LINES])


def _peak(power: Array, k: int) -> float:
    """The place of a peak between its lines, by the amplitudes of its neighbours (Jacobsen, Kootsookos, 2007, for no
    window)."""
    if not 0 < k < power.size - 1:
        return float(k)
    low, top, high = np.sqrt(power[k - 1 : k + 2])
    side = 1.0 if high > low else -1.0
    return float(k + side * max(high, low) / (top + max(high, low)))
