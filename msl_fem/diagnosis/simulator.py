"""A record's `fit` runs simulated for many values of the unknowns at once, as residuals over the noise."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.table_error import TableError
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import InputError
from msl_fem.plant import Surface
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_run import LaneRun, LaneSettings, run_lanes
from msl_fem.prediction import KernelPlant, RunData, Start
from msl_fem.prediction.free_run import counted
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.record import Channel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem:
    """What stays the same in all fits of a record.

    Attributes
    ----------
    plant : as believed, at the runs' rate
    runs, guesses, start_sigmas : each run, the first guess of its start and its sigmas (position, velocity, currents)
    table_error : None for a rig without magnets
    threads : for the simulations of many rows
    """

    plant: KernelPlant
    runs: tuple[RunData, ...]
    guesses: tuple[Start, ...]
    start_sigmas: tuple[Array, ...]
    table_error: TableError | None
    threads: int = 1

    def channels(self, run: int) -> list[str]:
        """The channels of a run that are compared."""
        return counted(self.runs[run])


@dataclass(frozen=True, eq=False)
class Points:
    """Values of the unknowns, (n_row, unknowns.size), and the effects that go with them, (n_row, N_PARAMETER)."""

    unknowns: Unknowns
    rows: Array
    effects: Array | None

    @classmethod
    def of(cls, unknowns: Unknowns, rows: Array) -> "Points":
        """With the effects that the rows say."""
        effects = None if unknowns.plain else np.array([unknowns.effect_vector(z) for z in rows])
        return cls(unknowns, rows, effects)

    def only(self, rows: slice) -> "Points":
        return Points(self.unknowns, self.rows[rows], None if self.effects is None else self.effects[rows])


def residuals(problem: Problem, points: Points, *, substeps: int) -> list[list[Array]]:
    """Measured less simulated of every run and channel, (n_row, n_sample) in SI units; nan where a run ended early."""
    return [_of_run(problem, points, run, substeps) for run in range(len(problem.runs))]


def _of_run(problem: Problem, points: Points, run: int, substeps: int) -> list[Array]:
    data, p = problem.runs[run], problem.plant.parameters
    columns = max(p.sides, 1)
    inputs = Inputs(data.commands[:, :columns], data.rate)
    try:
        found = lanes(problem, points, run, inputs=inputs, substeps=substeps)
    except InputError:  # an effect beyond what the kernel takes, like a delay of more samples than it keeps
        if len(points.rows) == 1:
            return [np.full((1, len(data.commands)), np.nan) for _ in problem.channels(run)]
        parts = [_of_run(problem, points.only(slice(n, n + 1)), run, substeps) for n in range(len(points.rows))]
        return [np.concatenate(channel) for channel in zip(*parts, strict=True)]
    factors = [points.unknowns.factors(z) for z in points.rows]
    gains = np.array([f.get("position_gain", 1.0) for f in factors]) * problem.plant.gain
    return [data.measured[name] - reading(found, name, gains) for name in problem.channels(run)]


def lanes(problem: Problem, points: Points, run: int, *, inputs: Inputs, substeps: int) -> LaneRun:
    """The runs of all rows under some inputs, from the starts that the rows say."""
    unknowns, rows = points.unknowns, points.rows
    plants = [with_factors(problem.plant.parameters, unknowns.factors(z)) for z in rows]
    settings = LaneSettings(
        effects=points.effects,
        starts=np.array([_start(problem, unknowns, z, run) for z in rows]),
        surface_index=np.arange(len(rows)) if problem.table_error is not None else None,
        threads=problem.threads,
    )
    surface = _surfaces(problem, unknowns, rows)
    return run_lanes(surface, plants, inputs, substeps=substeps, settings=settings)


def reading(found: LaneRun, channel: str, gains: Array) -> Array:
    """(n_row, n_sample) of a channel by its column's name."""
    signal = Channel.of(channel)
    if signal.quantity == "position":
        return gains[:, None] * found.position
    sides = found.voltage if signal.quantity == "voltage" else found.current
    return sides[:, :, signal.index]


def _start(problem: Problem, unknowns: Unknowns, z: Array, run: int) -> Array:
    guess = problem.guesses[run]
    start = np.array([*guess.currents, guess.position, guess.velocity])
    moved = z[unknowns.start_rows(run)] * problem.start_sigmas[run]
    start[2:] += moved[:2]
    start[: moved.size - 2] += moved[2:]
    return start


def _surfaces(problem: Problem, unknowns: Unknowns, rows: Array) -> Surface:
    surface = problem.plant.surface
    if problem.table_error is None:
        return surface
    scale = np.array([unknowns.factors(z).get("magnetic_scale", 1.0) for z in rows])
    change = np.tensordot(rows[:, unknowns.table_rows], problem.table_error.modes, axes=1)
    return surface._replace(coefficients=scale[:, None, None, None, None] * (surface.coefficients + change))
