"""A record made ready for fits: what is believed, its runs and their starts, where it goes, which lines it tells."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import Likelihood
from msl_fem.diagnosis.noise_bands import make_bands
from msl_fem.diagnosis.simulator import Problem
from msl_fem.diagnosis.table_error import Visited, table_error
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.prediction import (
    KernelPlant,
    ModelHypothesis,
    RunData,
    free_parameters,
    free_run,
    kernel_plant,
    measured_start,
)
from msl_fem.prediction.free_run import counted, start_sigmas
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Tolerance

Array = NDArray[np.float64]
HEARD = 0.02  # of the noise's density: lines where the model's readings stay below it tell nothing
START = 10.0  # times the instruments' sigma: how far a run's start may lie from its first guess
WINDOWED = 1.3  # a margin above the highest line that is heard


def prepared(
    belief: ModelHypothesis, runs: Sequence[RunData], tolerance: Tolerance, *, threads: int = 1
) -> tuple[Likelihood, Unknowns]:
    """The likelihood of runs under a belief, and what it does not know without any effect."""
    plant = kernel_plant(belief, rate=runs[0].rate, ideal_current=runs[0].ideal_current)
    guesses = tuple(measured_start(plant, run) for run in runs)
    sigmas = tuple(START * start_sigmas(plant, run) for run in runs)  # the guess is the belief's, which may be off
    error = None
    if belief.table is not None and plant.parameters.sides:
        error = table_error(belief.table, visited(plant, runs), tolerance=tolerance.table) if tolerance.table else None
    problem = Problem(plant, tuple(runs), guesses, sigmas, error, threads)
    highest = max(
        highest_line(run, free_run(plant, run, guess).readings) for run, guess in zip(runs, guesses, strict=True)
    )
    bands = make_bands([len(run.commands) for run in runs], runs[0].rate, highest=highest)
    believed = tuple(free_parameters(belief, tolerance).items())
    n_table = 0 if error is None else len(error.modes)
    return Likelihood(problem, bands, plant.substeps), Unknowns(believed, n_table, tuple(s.size for s in sigmas))


def visited(plant: KernelPlant, runs: Sequence[RunData]) -> Visited:
    """Currents of a magnet and gaps that the readings of runs say, or where there are none, the commands."""
    p = plant.parameters
    positions = np.concatenate([run.measured[POSITION_COLUMN] for run in runs]) / plant.gain
    gaps = [p.nominal_gap + s * positions for s in ((-1.0, 1.0) if p.sides == 2 else (-1.0,))]
    currents = [
        np.abs(run.measured.get(f"current_{j + 1}_A", run.commands[:, j])) * p.current_share
        for run in runs
        for j in range(p.sides)
    ]
    low, high = min(float(c.min()) for c in currents), max(float(c.max()) for c in currents)
    return Visited((low, high), (min(float(g.min()) for g in gaps), max(float(g.max()) for g in gaps)))


def highest_line(run: RunData, readings: Mapping[str, Array]) -> float:
    """The highest frequency in Hz at which the model's readings stand out of the noise."""
    found = 0.0
    for name in counted(run):
        signal = readings[name]
        signal = signal[np.isfinite(signal)]
        if signal.size < 64:
            signal = run.measured[name]
        window = np.hanning(signal.size)
        power = np.abs(np.fft.rfft((signal - signal.mean()) * window)) ** 2 / np.sum(window**2)
        width = max(1, power.size // 400)
        smooth = np.convolve(power, np.full(width, 1 / width), mode="same")
        loud = np.flatnonzero(smooth > HEARD * run.noise[name].sigma ** 2)
        if loud.size:
            found = max(found, loud[-1] * run.rate / signal.size)
    return min(max(WINDOWED * found, 20 * run.rate / len(run.commands)), run.rate / 2)
