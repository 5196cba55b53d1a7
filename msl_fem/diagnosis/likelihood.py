"""A record's `fit` runs as a likelihood of what is unknown: residuals over the noise, in the frequency domain.

A run is followed from its start to its end, or over stretches with free starts (`stretches`): then what is left of its
residual beside the starts is what counts. The colour of the noise is estimated together with the fit (`noise`).
"""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.known_copies import knowing
from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.gathered import GatheredRuns
from msl_fem.diagnosis.noise import (
    NoiseBands,
    NoiseWeights,
    ceilings,
    loudness,
    weights_of,
)
from msl_fem.diagnosis.problem import (
    AT_ONCE,
    FitProblem,
    Points,
    Starts,
    batches,
    missed,
    simulated_in_parts,
    simulated_residuals,
)
from msl_fem.diagnosis.row_loops import add_squares, put_lines, put_slopes
from msl_fem.diagnosis.shooting import ModelSpread, Shooting
from msl_fem.diagnosis.stretches import moved
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.wander import WanderLines, with_wander
from msl_fem.plant.lane_run import LaneRun
from msl_fem.record.columns import name_and_unit

NO_NOISE = "which is an error of the model and no noise"
"""How a note on what is left above an instrument's noise ends."""

CONVERGED = 0.05
"""Nats that a further step would gain, at which a fit has converged."""
QUIET = 1.1
"""RMS residual over the noise's sigma, up to which a residual is noise."""
SAMPLES = 20_000
"""Of all runs together, the first part of a record that is followed in stretches."""
COLUMNS = 16
"""Of a Jacobian that are simulated together: in double precision each is twice as large as where it stays."""
LONGER = 2.0
"""Times as many, from which a record is long."""
OF_PIECES = "_labels_of_runs", "_places_of_runs", "_alike"
"""What a likelihood finds of its pieces, whatever their starts."""


def over_chance(residual: Array) -> float:
    """RMS of a few numbers of unit sigma over what chance makes of so many: 1 and two standard errors of an RMS of n
    numbers, 1/sqrt(2 n) each."""
    return float(np.sqrt(np.mean(residual**2)) / (1.0 + 2.0 / np.sqrt(2.0 * residual.size)))


def white(excess: Mapping[str, float]) -> bool:
    """Whether what is left over the noise, by channel, is noise everywhere."""
    return max(excess.values(), default=0.0) <= QUIET


def jacobian_columns(
    likelihood: "Likelihood",
    unknowns: Unknowns,
    z: Array,
    which: NDArray[np.intp],
    residual: Array,
) -> Array:
    """Columns (n_number, n_which) of the residual's Jacobian by one-sided differences, backwards where a run fails."""
    columns = np.empty((residual.size, which.size), order="F")
    put_columns(columns, likelihood, unknowns, z, which, residual)
    return columns


def first_columns(likelihood: "Likelihood", unknowns: Unknowns, z: Array, count: int, residual: Array) -> Slopes:
    """`jacobian_columns` of so many unknowns, in single precision."""
    columns: Slopes = np.empty((residual.size, count), dtype=np.float32, order="F")
    put_columns(columns, likelihood, unknowns, z, np.arange(count), residual)
    return columns


def put_columns(
    columns: Array | Slopes,
    likelihood: "Likelihood",
    unknowns: Unknowns,
    z: Array,
    which: NDArray[np.intp],
    residual: Array,
    starts: Starts | None = None,
    nearer: Starts | None = None,
) -> Starts:
    """Sets columns (n_number, n_which) to `jacobian_columns` where stretches begin at `starts`; returns by how much the
    starts that suit a point, `nearer` at z, move with each unknown, (n_which, n_stretch, 4) of each run; none where no
    run is followed over stretches."""
    slopes: list[Starts] = []
    for begin in range(0, which.size, COLUMNS):
        part = slice(begin, begin + COLUMNS)
        own = _put_some(columns[:, part].T, likelihood, unknowns, z, which[part], residual, starts, nearer)
        slopes.append(own)
    return tuple(np.concatenate(own) for own in zip(*slopes, strict=True))


def _put_some(
    columns: Array | Slopes,
    likelihood: "Likelihood",
    unknowns: Unknowns,
    z: Array,
    which: NDArray[np.intp],
    residual: Array,
    starts: Starts | None = None,
    nearer: Starts | None = None,
) -> Starts:
    """Sets some of the columns (n_which, n_number), one after the other; returns what goes with them."""
    step = unknowns.steps[which]
    rows = np.tile(z, (which.size, 1))
    rows[np.arange(which.size), which] += step
    moved, led, _ = numbers_and_starts(likelihood, Points.of(unknowns, rows, starts))
    failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        step[failed] *= -1
        rows[failed, which[failed]] = z[which[failed]] + step[failed]
        moved[failed], again, _ = numbers_and_starts(likelihood, Points.of(unknowns, rows[failed], starts))
        for own, other in zip(led, again, strict=True):
            own[failed] = other
        moved[~np.isfinite(moved).all(axis=1)] = residual  # no slope to be had: the unknown stays where it is
    put_slopes(list(columns), moved, residual, step, threads=likelihood.threads_here)
    return tuple((a - b) / step[:, None, None] for a, b in zip(led, nearer or (), strict=False))


def numbers_and_starts(likelihood: "Likelihood", points: Points) -> tuple[Array, Starts, float]:
    """What `spectra_and_starts` says; of runs that are followed as a whole no starts, which are nowhere else."""
    return likelihood.spectra_and_starts(points) if likelihood.is_cut else (likelihood.spectra(points), (), 0.0)


@lru_cache(maxsize=2)
def _residuals_at(problem: FitProblem, unknowns: Unknowns, z: bytes, substeps: int) -> list[Array]:
    """Kept of the last points: excess and loudness there are asked for by several, one after the other."""
    points = Points.of(unknowns, np.frombuffer(z)[None])
    return simulated_residuals(problem, points, substeps=substeps)


@dataclass(eq=False)
class Columns:
    """A fit's Jacobian, by far the largest of what it holds, column by column, None once it was let go; and J'J,
    weighted."""

    values: Slopes | None
    gram: Array


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes
    ----------
    unknowns, z : what was fitted, (unknowns.size,)
    residual : (n_number,) over the white sigma; `weights` belong to it
    columns : of the Jacobian; shared by all copies
    objective, log_evidence : nats
    predicted : nats that a further step without damping would gain
    likelihood : that of the fit, the starts of its stretches those that suit it
    finished : whether it was led to its end, so that more steps are not worth trying, whatever they promise
    damping : with which further steps go on
    sane : of a fit that began so far from the record that it was heated, where it was last at numbers that a plant can
        have
    next_step : nats that the next step would gain with its damping
    nearer : starts of stretches that suit it still better to a linear model
    start_slopes : by how much each unknown moves the starts of stretches, (n_unknown, n_stretch, 4) of each run
    stale : whether some columns were taken over from a neighbouring point
    stuck : whether none of its last steps led down, of some at least
    """

    unknowns: Unknowns
    z: Array
    residual: Array
    columns: Columns
    weights: NoiseWeights
    objective: float
    log_evidence: float
    predicted: float
    simulations: int
    likelihood: "Likelihood"
    finished: bool = False
    damping: float = 1.0
    sane: "Fit | None" = None
    next_step: float = np.inf
    nearer: Starts | None = None
    start_slopes: Starts = ()
    stale: bool = True
    stuck: bool = False

    def to_come(self, steps: int) -> float:
        """Nats that so many steps more promise: with much damping, as along a bent valley, less than one without."""
        return max(min(self.predicted, steps * self.next_step), 0.0)

    @property
    def converged(self) -> bool:
        return self.predicted < CONVERGED

    @property
    def jacobian(self) -> Slopes:
        """(n_number, unknowns.size) of the residual, not weighted; computed once more where it was let go."""
        if self.columns.values is None:
            count = self.unknowns.size
            self.columns.values = first_columns(self.likelihood, self.unknowns, self.z, count, self.residual)
        return self.columns.values

    def lets_go(self) -> None:
        """Its Jacobian, which is not likely to be asked for any more."""
        self.columns.values = None

    @cached_property
    def excess(self) -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma; simulated once, since search and verdict ask often."""
        return self.likelihood.excess(self)

    @cached_property
    def nats_of_noise(self) -> float:
        """S of white noise as loud as the runs' instruments show it."""
        return self.likelihood.nats_of_noise(self.unknowns, self.z)

    @property
    def nats_above_noise(self) -> float:
        """Its S over that."""
        return self.objective - self.nats_of_noise

    def nats_apart(self, other: "Fit") -> float:
        """Nats that the record brings on average for this fit over another one, if this is true: half the square of how
        far their simulations lie from each other, over the noise."""
        apart = (other.residual - self.residual) * self.weights.root
        return float(apart @ apart) / 2

    @property
    def precision(self) -> Array:
        """J'J and the prior's curvature."""
        return self.columns.gram + np.diag(self.unknowns.prior(self.z)[2])


@dataclass(frozen=True, eq=False)
class Likelihood:
    """A record as a likelihood of its unknowns.

    Attributes
    ----------
    substeps : Runge-Kutta steps a sample, where they are fine
    strict : whether the noise has a ceiling in every octave
    gathered : where simulations meet with those of other fits; None: they are run at once
    """

    problem: FitProblem
    bands: NoiseBands
    substeps: int
    strict: bool = field(default=False, kw_only=True)
    gathered: GatheredRuns | None = field(default=None, kw_only=True)

    def steps(self, times: int) -> int:
        """Runge-Kutta steps a sample of models that want so many times the coarse ones."""
        return self.problem.steps(self.substeps, times)

    def spectra(self, points: Points) -> Array:
        """Residuals in the frequency domain over their white sigma, (n_row, n_number); nan of a failed run."""
        return self.spectra_and_starts(points)[0]

    def spectra_and_starts(self, points: Points) -> tuple[Array, Starts, float]:
        """`spectra`, the starts of stretches that leave least to a linear model, and how far the farthest of them is
        from where it was, in units of its prior."""
        if self.gathered is None:
            found = self._simulated(points)
        else:
            found = self.gathered.spectra(self.problem, points, self._simulated)
        starts, largest = [], 0.0
        every = zip(self._moves_in(found), points.starts or self.problem.starts(len(found)), strict=True)
        for run, (moves, own) in enumerate(every):
            by = moves.reshape(*own.shape[:2], -1) if moves.size else np.zeros((*own.shape[:2], 2))
            starts.append(moved(own, by * self.problem.start_unit(run)[: by.shape[-1]]))
            largest = max(largest, float(np.abs(by).max(initial=0.0)))
        return found[:, : self._labels_of_runs.size], tuple(starts), largest

    @property
    def _n_moves(self) -> list[int]:
        """How many numbers move the starts of each run's stretches."""
        return [0 if cut is None else cut.begins.size * cut.slopes.shape[1] for cut in self.problem.cuts]

    def _moves_in(self, found: Array) -> list[Array]:
        """Of each run, the part (n_row, n_move) of what `_simulated` makes that moves its starts."""
        return np.split(found[:, self._labels_of_runs.size :], np.cumsum(self._n_moves)[:-1], axis=1)

    def _simulated(self, points: Points) -> Array:
        """(n_row, n_number + n_move) `spectra`, and behind them the moves of the starts."""
        found = np.empty((len(points.rows), self._labels_of_runs.size + sum(self._n_moves)))
        for run, (own, moves) in enumerate(zip(self._places_of_runs, self._moves_in(found), strict=True)):
            self._fill(found[:, own], moves, run, points)
        return found

    def _fill(self, found: Array, moves: Array, run: int, points: Points) -> None:
        """Writes a run's part of the numbers (n_row, n_own), and what moves its starts, (n_row, n_move); simulated,
        transformed and forgotten group by group, a single one by all threads."""
        threads = self.threads_here
        groups = batches(self.problem, points, run, substeps=self.substeps, threads=threads)
        within = threads if len(groups) == 1 else 1
        problem = replace(self.problem, threads=within)

        def fill(rows: NDArray[np.intp]) -> None:
            at_once = min(AT_ONCE, -(-rows.size // within))
            parts = simulated_in_parts(problem, points.only(rows), run, substeps=self.substeps, at_once=at_once)
            ends = np.cumsum([len(own.rows) for own, *_ in parts])
            in_threads(write, list(zip(np.split(rows, ends[:-1]), parts, strict=True)), within)

        def write(part: tuple[NDArray[np.intp], tuple[Points, int, LaneRun | None]]) -> None:
            rows, simulated = part
            over = missed(problem, *simulated, over_noise=True)
            moves[rows] = self._leave_out_starts(run, over)
            self._put_numbers(found, rows, run, over)

        in_threads(fill, groups, threads)

    def transformed(self, found: Sequence[Sequence[Array] | Array]) -> Array:
        """Arrays (n_row, n_sample) of every run's channels as `spectra` orders and scales them."""
        each = [self._over_noise(run, channels) for run, channels in enumerate(found)]
        numbers = np.empty((each[0].shape[1], self._labels_of_runs.size))
        for run, (own, over) in enumerate(zip(self._places_of_runs, each, strict=True)):
            self._put_numbers(numbers[:, own], np.arange(len(numbers)), run, over)
        return numbers

    def _put_numbers(self, numbers: Array, rows: NDArray[np.intp], run: int, over: Array) -> None:
        """Puts a run's residuals over the noise (n_channel, n_own, n_sample) in the frequency domain, piece by piece,
        into n_own rows of its numbers (n_row, n_number)."""
        n_channel, at = len(over), 0
        for samples, count, lines in self._alike[run]:
            length, size = (samples.stop - samples.start) // count, 2 * count * n_channel * lines
            for n, row in enumerate(rows):  # a row at a time: it stays in the cache
                spectrum = np.fft.rfft(over[:, n : n + 1, samples].reshape(n_channel, 1, count, length))
                put_lines(numbers[row : row + 1, at : at + size], spectrum, length)
            at += size

    @cached_property
    def _alike(self) -> list[list[tuple[slice, int, int]]]:
        """Of each run, pieces of equal length behind each other: (their samples, how many, lines of each)."""
        found: list[list[tuple[slice, int, int]]] = [[] for _ in self.problem.runs]
        for lines, (run, part) in zip(self.bands.lines, self.problem.pieces, strict=True):
            before, count, _ = found[run][-1] if found[run] else (slice(-1, -1), 1, 0)
            if before.stop == part.start and before.stop - before.start == count * (part.stop - part.start):
                found[run][-1] = (slice(before.start, part.stop), count + 1, lines)
            else:
                found[run].append((part, 1, lines))
        return found

    def _over_noise(self, run: int, channels: Sequence[Array] | Array) -> Array:
        """Residuals of a run's channels over their noise's sigma (n_channel, n_row, n_sample), without what starts of
        stretches account for."""
        sigmas = [self.problem.runs[run].noise[name].sigma for name in self.problem.channels(run)]
        over = np.array([values / sigma for values, sigma in zip(channels, sigmas, strict=True)])
        self._leave_out_starts(run, over)
        return over

    def _leave_out_starts(self, run: int, over: Array) -> Array:
        """Takes what starts of stretches account for from a run's residuals over the noise, in place; returns the moves
        of these (n_row, n_move)."""
        cut, n_row = self.problem.cut(run), over.shape[1]
        return np.zeros((n_row, 0)) if cut is None else cut.leave_out_starts(over).reshape(n_row, -1)

    def first_part(self) -> tuple["Likelihood", NDArray[np.bool_]]:
        """That of the first stretches alone, of about `SAMPLES` (`FitProblem.first`), and which of the numbers,
        (n_number,), are its."""
        problem = self.problem.first(SAMPLES)
        kept = [part.stop <= len(problem.runs[run].commands) for run, part in self.problem.pieces]
        lines, band_of = tuple(compress(self.bands.lines, kept)), tuple(compress(self.bands.band_of, kept))
        numbers = np.repeat(kept, self._sizes_of_pieces)
        beside = np.ones(self.labels.size - numbers.size, dtype=bool)  # a map's rows
        bands = replace(self.bands, lines=lines, band_of=band_of)
        return replace(self, problem=problem, bands=bands), np.concatenate([numbers, beside])

    @property
    def is_long(self) -> bool:
        """Whether runs have so many samples that their first part is worth a fit of its own."""
        return sum(len(run.commands) for run in self.problem.runs) >= LONGER * SAMPLES

    @property
    def _sizes_of_pieces(self) -> list[int]:
        """How many numbers each piece has."""
        each = zip(self.bands.lines, self.problem.pieces, strict=True)
        return [2 * lines * len(self.problem.channels(run)) for lines, (run, _) in each]

    def gathering(self, runs: GatheredRuns | None) -> "Likelihood":
        """The same, its simulations run where they meet with those of other fits."""
        return knowing(replace(self, gathered=runs), self, *OF_PIECES, "spent")

    @property
    def highest_at_rest(self) -> float:
        """The highest current (A) of the rows of a map beside the runs; 0 without one."""
        return 0.0

    @property
    def threads(self) -> int:
        """That simulate."""
        return self.problem.threads

    @property
    def threads_here(self) -> int:
        """That simulate and do sums where it meets others at the moment."""
        return self.threads if self.gathered is None else self.gathered.threads

    @property
    def is_cut(self) -> bool:
        """Whether a run is followed over stretches."""
        return any(cut is not None for cut in self.problem.stretches)

    @property
    def begins(self) -> tuple[bytes, ...]:
        """Where the stretches of each run begin: numbers are those of the same samples where these are alike."""
        return tuple(b"" if cut is None else cut.begins.tobytes() for cut in self.problem.stretches)

    def starting(self, starts: Starts) -> "Likelihood":
        """With stretches that begin elsewhere."""
        return knowing(replace(self, problem=self.problem.with_starts(starts)), self, *OF_PIECES, "spent")

    def followed(self, unknowns: Unknowns, z: Array) -> "Likelihood":
        """With the starts of the stretches moved to where the model at z has them."""
        spread, cuts = ModelSpread(unknowns, z, np.zeros((0, z.size))), []
        with nullcontext() if self.gathered is None else self.gathered.by_itself:
            for n, cut in enumerate(self.problem.stretches):
                shot = Shooting(self.problem, n, spread, substeps=self.substeps)
                cuts.append(None if cut is None else shot.refined(cut))
        return knowing(replace(self, problem=replace(self.problem, stretches=tuple(cuts))), self, *OF_PIECES)

    def objective(self, unknowns: Unknowns, z: Array) -> float:
        """S at z; inf where the simulation fails."""
        residual = self.spectra(Points.of(unknowns, z[None]))[0]
        if not np.isfinite(residual).all():
            return np.inf
        return self.weights(residual, unknowns).nats + unknowns.prior(z)[0]

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma."""
        return self.excess_of_runs(found)

    def excess_of_runs(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma, all frequencies and all runs together, of the numbers of a
        fit; its residual may be that of other stretches.

        Where the highest frequencies show an instrument louder than stated, over that (`noise.loudness`). What a zero
        that wanders accounts for is none of it.
        """
        simulated = self._residuals_at(found.unknowns, found.z)
        over, loud = self._over_and_loudness(simulated)
        power = {name: np.mean([np.mean(values**2) for values in runs]) for name, runs in over.items()}
        if found.unknowns.wanders in power:
            name = found.unknowns.wanders
            samples = sum(values.size for values in over[name])
            wander, noise = self._shares(found, self.transformed(simulated)[0])
            power[name] = max(power[name] - wander / samples, noise / samples)
        return {name: float(np.sqrt(power[name])) / loud[name] for name in over}

    def loudness(self, found: Fit) -> dict[str, float]:
        """Channel to how many times as loud as stated its instrument is, as far as a fit's residuals show it."""
        return self._loudness_at(found.unknowns, found.z)

    def _residuals_at(self, unknowns: Unknowns, z: Array) -> list[Array]:
        """`simulated_residuals` of one row, not to be changed."""
        return _residuals_at(self.problem, unknowns, z.tobytes(), self.substeps)

    def _loudness_at(self, unknowns: Unknowns, z: Array) -> dict[str, float]:
        return self._over_and_loudness(self._residuals_at(unknowns, z))[1]

    def nats_of_noise(self, unknowns: Unknowns, z: Array) -> float:
        """S of white noise as loud as the runs' instruments show it at z."""
        loud, names = self._loudness_at(unknowns, z), self.channel_names
        own = np.bincount(self._labels_of_runs, minlength=self.bands.n_band * len(names))
        count = (own - self.spent[: own.size]).reshape(len(names), -1).sum(axis=1)
        return float(np.log([loud[name] for name in names]) @ count)

    def _over_and_loudness(self, simulated: list[Array]) -> tuple[dict[str, list[Array]], dict[str, float]]:
        """By channel residuals over the noise's sigma of each run where they count (n_sample,), and the loudness."""
        over: dict[str, list[Array]] = {}
        reads: dict[str, list[NDArray[np.bool_]]] = {}
        for run, channels in enumerate(simulated):
            counts, left_out = self.problem.counts(run), self.problem.runs[run].left_out
            for name, every in zip(self.problem.channels(run), self._over_noise(run, channels), strict=True):
                read = np.ones(every.shape[1], dtype=bool)
                read[left_out.get(name, [])] = False
                over.setdefault(name, []).append(every[0, counts])
                reads.setdefault(name, []).append(read[counts])
        return over, {name: loudness(over[name], reads[name]) for name in over}

    def _shares(self, found: Fit, residual: Array) -> tuple[float, float]:
        """Of the squares of the numbers of a channel whose zero wanders, together, what the wander accounts for, and
        what is left."""
        runs = self.runs_part(found)[0]
        weights = runs.weights(residual, found.unknowns)
        own = runs.labels // self.bands.n_band == runs.channel_names.index(found.unknowns.wanders)
        wander = (1 - weights.of_noise) * residual**2
        return float(np.sum(wander)), float(np.sum((residual**2 - wander)[own]))

    def standard_errors(self, found: Fit, along: Array | None = None) -> Array:
        """(unknowns.size,) of the unknowns at a fit, or (n,) of sums of them with weights `along` (n, unknowns.size): a
        95 % interval is 1.96 of them to either side."""
        along = np.eye(found.z.size) if along is None else along
        precision = found.precision
        unit = 1.0 / np.sqrt(np.diag(precision))  # a fit that is lost tells some 1e16 times more of one than of another
        told, ways = np.linalg.eigh(unit[:, None] * precision * unit)
        return np.asarray(np.sqrt(((along * unit @ ways) ** 2 / np.maximum(told, np.finfo(float).eps)).sum(axis=1)))

    def above_noise(self, found: Fit) -> list[str]:
        """In which octaves what is left is more than an instrument's noise can be, also of a louder one, in words."""
        loud = self.loudness(found)
        count = np.maximum(np.bincount(self.labels) - self.spent, 1.0)
        density = np.bincount(self.labels, weights=found.residual**2 * found.weights.of_noise) / count
        names, n_band = self.channel_names, self.bands.n_band
        told = []
        most = ceilings(n_band, len(names), strict=True) * np.repeat(
            [max(loud[name], 1.0) ** 2 for name in names], n_band
        )
        for label in np.flatnonzero(density > most):
            low, high = self.bands.edges[label % n_band : label % n_band + 2]
            channel = name_and_unit(names[label // n_band])[0].replace("_", " ")
            times = f"{np.sqrt(density[label]):.3g} times the noise is left"
            told.append(f"{channel}: from {low:.3g} to {high:.3g} Hz {times}, {NO_NOISE}")
        return told

    def runs_part(self, found: Fit) -> tuple["Likelihood", Fit]:
        """The runs alone, and a fit as they see it: all there is, where nothing stands beside them."""
        return self, found

    @property
    def labels(self) -> NDArray[np.intp]:
        """(n_number,) the band of each number, channels apart, runs together."""
        return self._labels_of_runs

    @cached_property
    def _labels_of_runs(self) -> NDArray[np.intp]:
        names = self.channel_names
        parts = []
        for piece, (run, _) in enumerate(self.problem.pieces):
            band = np.tile(self.bands.band_of[piece], 2)
            band[self.bands.lines[piece]] = band[0]
            parts += [band + self.bands.n_band * names.index(name) for name in self.problem.channels(run)]
        return np.concatenate(parts)

    @cached_property
    def _places_of_runs(self) -> list[slice]:
        """Where the numbers of each run stand."""
        sizes = np.zeros(len(self.problem.runs), dtype=int)
        for size, (run, _) in zip(self._sizes_of_pieces, self.problem.pieces, strict=True):
            sizes[run] += size
        ends = np.cumsum(sizes)
        return [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]

    @cached_property
    def spent(self) -> Array:
        """(n_label,) how many numbers of each label went into starts that were eliminated: the trace of what
        eliminates them, which is that of Q Q' with orthonormal columns Q of the starts; and those that readings which
        do not count leave out, a share of each band's."""
        spent = np.zeros(int(self.labels.max()) + 1)
        at = 0
        for piece, (run, part) in enumerate(self.problem.pieces):
            for name in self.problem.channels(run):
                size = 2 * self.bands.lines[piece]
                if share := self._share_invalid(run, part, name):
                    spent += share * np.bincount(self._labels_of_runs[at : at + size], minlength=spent.size)
                at += size
        for run, own in enumerate(self._places_of_runs):
            cut, numbers = self.problem.cut(run), np.empty((1, own.stop - own.start))
            for columns in [] if cut is None else np.moveaxis(cut.orthonormal(), 1, 0):
                self._put_numbers(numbers, np.zeros(1, dtype=np.intp), run, columns[:, None])
                add_squares(np.zeros(spent.size), spent, numbers[0], self._labels_of_runs[own])
        return spent

    def _share_invalid(self, run: int, part: slice, name: str) -> float:
        """Of a channel's readings over some samples, those that do not count."""
        at = self.problem.runs[run].invalid.get(name)
        return 0.0 if at is None else float(np.sum((at >= part.start) & (at < part.stop)) / (part.stop - part.start))

    @property
    def ceilings(self) -> Array:
        """(n_label,) the largest density over the white one that a band's noise can have; what is louder is the model's
        error."""
        return ceilings(self.bands.n_band, len(self.channel_names), strict=self.strict)

    def weights(self, residual: Array, unknowns: Unknowns) -> NoiseWeights:
        """The most probable densities given a residual (n_number,)."""
        plain = self.plain_weights(residual)
        if unknowns.wanders not in self.channel_names:
            return plain
        lines = self.wander_lines(unknowns.wanders)
        return with_wander(plain, residual, self.labels, self.ceilings, self.spent, lines)

    def plain_weights(self, residual: Array) -> NoiseWeights:
        """The same where no zero wanders."""
        return weights_of(residual, self.labels, self.ceilings, self.spent)

    def wander_lines(self, channel: str) -> WanderLines:
        """Where a channel's zero shows."""
        places = np.flatnonzero(self._labels_of_runs // self.bands.n_band == self.channel_names.index(channel))
        frequencies = []
        for lines, (run, part) in zip(self.bands.lines, self.problem.pieces, strict=True):
            if channel in self.problem.channels(run):
                turn = np.pi * np.maximum(np.arange(lines), 0.5) / (part.stop - part.start)
                frequencies.append(np.tile(np.sin(turn) * self.problem.runs[run].rate / np.pi, 2))
        return WanderLines(places, np.concatenate(frequencies))

    def noise_spectra(self, weights: NoiseWeights) -> dict[str, tuple[Array, Array]]:
        """By channel the edges of the bands (n_band + 1,) in Hz, and in each the power density of a fit's noise, with
        a wander of the zero, over the stated white one (n_band,), its geometric mean."""
        n, density = self.bands.n_band, weights.density
        if weights.wander is not None:
            levels = np.bincount(self.labels, weights=-2.0 * np.log(weights.root)) / np.bincount(self.labels)
            density = np.exp(levels)
        rows = {name: density[k * n : (k + 1) * n] for k, name in enumerate(self.channel_names)}
        return {name: (self.bands.edges, row) for name, row in rows.items() if row.size == n}

    @property
    def channel_names(self) -> list[str]:
        found: list[str] = []
        for run in range(len(self.problem.runs)):
            found += [name for name in self.problem.channels(run) if name not in found]
        return found
