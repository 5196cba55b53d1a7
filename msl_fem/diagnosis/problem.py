"""The runs of a record simulated for many values of the unknowns at once: what is measured less what is simulated."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import LANES
from msl_fem.diagnosis.row_loops import put_missed
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.diagnosis.table_error import TableErrorModes
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import InputError
from msl_fem.plant import Surface
from msl_fem.plant.effects import FINE, PARAMETER_INDEX, neutral_vector
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import FEW, Lanes, LaneSettings
from msl_fem.plant.lane_run import LaneRun, run_lanes, told_apart
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.segments import lasts
from msl_fem.prediction import KernelPlant, RunData, Start
from msl_fem.prediction.free_run import counted, start_sigmas
from msl_fem.prediction.hypothesis import is_closed_form, plant_in_run, times_factors, with_factors
from msl_fem.prediction.nuisances import line_of, together
from msl_fem.prediction.run_data import POSITION_COLUMN, VELOCITY_COLUMN
from msl_fem.prediction.scheduling import Schedule
from msl_fem.record import Tolerance
from msl_fem.record.columns import Channel
from msl_fem.record.validity import bridged

AT_ONCE = 4  # rows whose readings are put together at a time
START = 10.0  # times the instruments' sigma: how far a run's start may lie from its first guess


@dataclass(frozen=True, eq=False)
class FitProblem:
    """What stays the same in all fits of a record.

    Attributes
    ----------
    plant : as believed, at the runs' rate
    runs, guesses, start_sigmas : each run, the first guess of its start and its sigmas (position, velocity, currents)
    table_error : None for a rig without magnets
    threads : for the simulations of many rows
    stretches : of each run; None of a run that is followed from its start to its end. Empty: all are
    tolerance : of the instruments' zeros, by which starts may be off beside the noise
    coarse : steps a sample of rows that want no more, the current loop in closed form (`plant.fast_loop`); None: all
        have the same
    """

    plant: KernelPlant
    runs: tuple[RunData, ...]
    guesses: tuple[Start, ...]
    start_sigmas: tuple[Array, ...]
    table_error: TableErrorModes | None
    threads: int = 1
    stretches: tuple[Stretches | None, ...] = ()
    tolerance: Tolerance | None = None
    coarse: int | None = None

    @property
    def schedules(self) -> tuple[Schedule, ...]:
        """What goes with a second input, as the first run has it."""
        return self.runs[0].schedules if self.runs else ()

    @property
    def cuts(self) -> tuple[Stretches | None, ...]:
        """The stretches of each run, None of one that is followed as a whole."""
        return self.stretches or (None,) * len(self.runs)

    def cut(self, run: int) -> Stretches | None:
        """The stretches of a run, None of one that is followed as a whole."""
        return self.cuts[run]

    def steps(self, substeps: int, times: int) -> int:
        """Steps a sample of models that want so many times the coarse ones: the fine ones, where there are no others or
        where with so many the loop is not known in closed form."""
        wanted = substeps if self.coarse is None else self.coarse * times
        if wanted >= substeps or (times > 1 and not is_closed_form(self.plant, wanted)):
            return substeps
        return wanted

    def start_unit(self, run: int) -> Array:
        """(n_start,) one sigma of the prior of a start: position, velocity, currents that cannot jump."""
        return START * start_sigmas(self.plant, self.runs[run], tolerance=self.tolerance)

    def starts(self, n_row: int) -> "Starts":
        """Those of the stretches, the same in each row."""
        each = [np.zeros((0, 4)) if cut is None else cut.starts for cut in self.cuts]
        return tuple(np.broadcast_to(one, (n_row, *one.shape)) for one in each)

    def with_starts(self, starts: "Starts") -> "FitProblem":
        """With stretches that begin elsewhere, (1, n_stretch, 4) of each run."""
        each = zip(self.cuts, starts, strict=True)
        return replace(self, stretches=tuple(None if cut is None else cut.starting(own[0]) for cut, own in each))

    def first(self, samples: int) -> "FitProblem":
        """With the first stretches alone of each run that is followed over such, in which so many samples of all runs
        together lie, or nearly."""
        share = samples / sum(len(run.commands) for run in self.runs)
        runs, stretches = list(self.runs), list(self.cuts)
        for n, cut in enumerate(self.cuts):
            count = 0 if cut is None else int(np.searchsorted(cut.begins, share * len(runs[n].commands)))
            if cut is not None and 0 < count < cut.begins.size:
                end = int(cut.begins[count])
                runs[n], stretches[n] = runs[n].first(end), cut.first(count, end)
        return replace(self, runs=tuple(runs), stretches=tuple(stretches))

    @property
    def pieces(self) -> list[tuple[int, slice]]:
        """(run, its samples) of all stretches of all runs that count."""
        found = []
        for run, data in enumerate(self.runs):
            cut, n = self.cut(run), len(data.commands)
            parts = [slice(0, n)] if cut is None else cut.counted_parts(n)
            found += [(run, part) for part in parts]
        return found

    def counts(self, run: int) -> NDArray[np.bool_]:
        """(n_sample,) which samples of a run count."""
        cut, n = self.cut(run), len(self.runs[run].commands)
        return np.ones(n, dtype=bool) if cut is None else cut.counts(n)

    def surface(self, scale: float, numbers: Array) -> Surface:
        """The magnets' coenergy surface at a scale and numbers (n_mode,) of the table's error."""
        surface = self.plant.surface
        change = 0.0 if self.table_error is None else np.tensordot(numbers, self.table_error.modes, axes=1)
        return surface._replace(coefficients=scale * (surface.coefficients + change))

    def channels(self, run: int) -> list[str]:
        """The channels of a run that are compared."""
        return counted(self.runs[run])


Starts = tuple[Array, ...]
"""Of each run (n_row, n_stretch, 4), where its stretches begin; none of a run that is followed as a whole."""


@dataclass(frozen=True, eq=False)
class Points:
    """Values of the unknowns, (n_row, unknowns.size), and the effects that go with them, (n_row, N_PARAMETER); `times`
    says how many times the coarse steps each row wants, (n_row,), None: fine ones; `starts` where each row's stretches
    begin, None: those of the problem."""

    unknowns: Unknowns
    rows: Array
    effects: Array | None
    times: NDArray[np.intp] | None = None
    starts: Starts | None = None

    @classmethod
    def of(cls, unknowns: Unknowns, rows: Array, starts: Starts | None = None) -> "Points":
        """With the effects that the rows say, from the starts of one row. What wants more steps does so at nothing too,
        or differences would be of different steps."""
        effects = None if unknowns.plain else np.array([unknowns.effect_vector(z) for z in rows])
        every = None if starts is None else tuple(np.broadcast_to(own, (len(rows), *own.shape[1:])) for own in starts)
        return cls(unknowns, rows, effects, np.full(len(rows), unknowns.times_steps), every)

    @property
    def wanted(self) -> NDArray[np.intp]:
        """(n_row,) how many times the coarse steps each row wants."""
        return np.full(len(self.rows), FINE) if self.times is None else self.times

    def each(self) -> Iterator[tuple[Array, Array]]:
        """Row by row, the unknowns and the effects."""
        neutral = neutral_vector()
        for n, z in enumerate(self.rows):
            yield z, neutral if self.effects is None else self.effects[n]

    def only(self, rows: slice | NDArray[np.intp]) -> "Points":
        effects = None if self.effects is None else self.effects[rows]
        starts = None if self.starts is None else tuple(own[rows] for own in self.starts)
        return Points(self.unknowns, self.rows[rows], effects, self.wanted[rows], starts)


def simulated_residuals(problem: FitProblem, points: Points, *, substeps: int) -> list[Array]:
    """Measured less simulated of every run (n_channel, n_row, n_sample) in SI units; nan where a run ended early."""
    return [residuals_of_run(problem, points, run, substeps=substeps) for run in range(len(problem.runs))]


def batches(
    problem: FitProblem, points: Points, run: int, *, substeps: int, threads: int = 1
) -> list[NDArray[np.intp]]:
    """The rows in groups of equal steps, each of as many runs as the kernel advances at a time: what bounds the memory.
    Rows that it sees as alike, since what instruments read alone differs, are in one group. A few runs left over of
    several groups are shared among threads that have nothing else to do."""
    every = np.array([problem.steps(substeps, int(times)) for times in points.wanted])
    found = []
    for steps in np.unique(every):
        rows = np.flatnonzero(every == steps)
        if rows.size <= LANES:
            found.append(rows)
            continue
        own = points.only(rows)
        try:
            surface, plants, settings = _lane_settings(problem, own, run)
            place = told_apart(surface, plants, rate=problem.runs[run].rate, substeps=int(steps), settings=settings)
        except InputError:  # see `simulated_in_parts`
            place = np.arange(len(rows))
        whole, over = divmod(int(place.max()) + 1, LANES)
        idle = threads - whole % threads
        group = place // LANES
        if whole and over <= FEW * idle:
            left = place >= whole * LANES
            group[left] += place[left] % LANES % idle
        found += [rows[group == n] for n in np.unique(group)]
    return found


def residuals_of_run(problem: FitProblem, points: Points, run: int, *, substeps: int) -> Array:
    """`simulated_residuals` of one run."""
    parts = simulated_in_parts(problem, points, run, substeps=substeps)
    return np.concatenate([missed(problem, *part) for part in parts], axis=1)


def simulated_in_parts(
    problem: FitProblem, points: Points, run: int, *, substeps: int, at_once: int = AT_ONCE
) -> list[tuple[Points, int, LaneRun | None]]:
    """A few rows at a time, in their order, the run, and what it is with them; None: an effect beyond what the kernel
    takes, like a delay of more samples than it keeps."""
    data, p = problem.runs[run], problem.plant.parameters
    columns = max(p.sides, 1)
    inputs = data.inputs(columns)
    try:
        found = lanes(problem, points, run, inputs=inputs, substeps=substeps)
    except InputError:
        if len(points.rows) == 1:
            return [(points, run, None)]
        each = (points.only(slice(n, n + 1)) for n in range(len(points.rows)))
        return [part for own in each for part in simulated_in_parts(problem, own, run, substeps=substeps)]
    every = [slice(at, at + at_once) for at in range(0, len(points.rows), at_once)]
    return [(points.only(rows), run, found.only(rows)) for rows in every]


def missed(problem: FitProblem, points: Points, run: int, found: LaneRun | None, *, over_noise: bool = False) -> Array:
    """Measured less simulated of a run's channels, (n_channel, n_row, n_sample) in SI units or over the noise's sigma;
    nan without anything simulated."""
    names, data = problem.channels(run), problem.runs[run]
    residuals = np.empty((len(names), len(points.rows), len(data.commands)))
    if found is None:
        residuals[:] = np.nan
        return residuals
    factors = [points.unknowns.factors(z) for z in points.rows]
    left_out = data.left_out
    for name, values in zip(names, residuals, strict=True):
        unit, read = data.noise[name].sigma if over_noise else 1.0, reading(found, name)
        for n, f in enumerate(factors):
            put_missed(values[n], data.measured[name], read[n], *instrument_line(problem.plant, name, f), unit)
        if name in left_out:
            values[:] = bridged(values, left_out[name])
    return residuals


def lanes(
    problem: FitProblem, points: Points, run: int, *, inputs: Inputs, substeps: int, own: Stretches | None = None
) -> LaneRun:
    """The runs of all rows under some inputs, from the starts that the rows say, or of stretches; `own` are stretches
    in place of the problem's, with starts (n_row, n_stretch, 4)."""
    surface, plants, settings = _lane_settings(problem, points, run, own)
    steps = problem.steps(substeps, int(points.wanted.max()))
    return run_lanes(surface, plants, inputs, substeps=steps, settings=settings)


def follows_from_before(problem: FitProblem, points: Points, run: int, *, substeps: int, own: Stretches) -> bool:
    """Whether a stretch follows from what those before have done to the model, as with a second mass: they are then
    neither better nor worse by themselves."""
    surface, plants, settings = _lane_settings(problem, points, run, own)
    steps = problem.steps(substeps, int(points.wanted.max()))
    one = Lanes(surface, plants, Inputs(np.zeros((1, 2)), problem.runs[run].rate), steps, settings)
    return any(lasts(effects) for _, effects in one.begun)


def _lane_settings(
    problem: FitProblem, points: Points, run: int, own: Stretches | None = None
) -> tuple[Surface, list[PlantParameters], LaneSettings]:
    unknowns, rows = points.unknowns, points.rows
    data = problem.runs[run]
    factors = [unknowns.factors(z) for z in rows]
    standing = [data.standing(f) for f in factors] if data.schedules else [{} for _ in factors]
    plants = [
        plant_in_run(with_factors(problem.plant.parameters, together(f, more), ideal_current=data.ideal_current), data)
        for f, more in zip(factors, standing, strict=True)
    ]
    effects = points.effects
    if effects is not None and data.schedules:
        effects = np.array([times_factors(v, more) for v, more in zip(effects, standing, strict=True)])
    cut = own or problem.cut(run)
    if cut is None:
        starts = np.array([_start(problem, unknowns, z, run) for z in rows])
    else:
        known = cut.starts if own is not None or points.starts is None else points.starts[run]
        read = np.broadcast_to(known, (len(rows), cut.begins.size, 4))
        starts = np.array([states(problem.plant, data, one, f) for one, f in zip(read, factors, strict=True)])
    surface, index = _surfaces(problem, unknowns, rows)
    settings = LaneSettings(
        effects=effects,
        starts=starts,
        surface_index=index,
        threads=problem.threads,
        begins=None if cut is None else cut.begins,
        quantities=frozenset(data.channels[name].quantity for name in problem.channels(run)),
        in_segments=True,
    )
    return surface, plants, settings


def states(plant: KernelPlant, data: RunData, starts: Array, factors: Mapping[str, float]) -> Array:
    """(n_stretch, 4) where stretches begin in truth, by a plant whose instruments have these factors beside its own."""
    found = starts.copy()
    gain, zero = instrument_line(plant, POSITION_COLUMN, factors)
    if plant.effects is not None:
        gain *= 1.0 + plant.readings[PARAMETER_INDEX["position_sensor_nonlinearity", "gain_error"]]
    found[:, 2], found[:, 3] = (starts[:, 2] - zero) / gain, starts[:, 3] / gain
    for side in range(plant.parameters.sides):
        column = Channel("current", side + 1).column
        if column in data.measured:
            gain, zero = instrument_line(plant, column, factors)
            found[:, side] = (starts[:, side] - zero) / gain
    return found


def instrument_line(plant: KernelPlant, column: str, factors: Mapping[str, float]) -> tuple[float, float]:
    """(gain, zero) of a reading by a plant whose instruments have these factors beside its own."""
    gain, zero = line_of(column, together(plant.instruments, factors))
    return (plant.gain * factors.get("position_gain", 1.0) if column == POSITION_COLUMN else gain), zero


def reading(found: LaneRun, channel: str) -> Sequence[Array]:
    """(n_sample,) of each row of a channel by its column's name, before gain and zero of its instrument."""
    if channel == POSITION_COLUMN:
        return found.as_read("position")
    if channel == VELOCITY_COLUMN:
        return found.as_read("velocity")
    measured = Channel.of(channel)
    return found.as_read(measured.quantity, measured.index)


def _start(problem: FitProblem, unknowns: Unknowns, z: Array, run: int) -> Array:
    guess = problem.guesses[run]
    start = np.array([*guess.currents, guess.position, guess.velocity])
    moved = z[unknowns.start_rows(run)] * problem.start_sigmas[run]
    start[2:] += moved[:2]
    start[: moved.size - 2] += moved[2:]
    return start


def _surfaces(problem: FitProblem, unknowns: Unknowns, rows: Array) -> tuple[Surface, NDArray[np.int64] | None]:
    """(the different surfaces of the rows, which of them each row has)."""
    surface = problem.plant.surface
    if problem.table_error is None:
        return surface, None
    scale = np.array([unknowns.factors(z).get("magnetic_scale", 1.0) for z in rows])
    every = np.column_stack([scale, rows[:, unknowns.table_rows]])
    numbers, index = (
        (every, np.zeros(1, dtype=np.intp)) if len(every) == 1 else np.unique(every, axis=0, return_inverse=True)
    )
    change = np.tensordot(numbers[:, 1:], problem.table_error.modes, axes=1)
    coefficients = numbers[:, 0, None, None, None, None] * (surface.coefficients + change)
    return surface._replace(coefficients=coefficients), index.reshape(-1)
