"""A record's `fit` runs simulated for many values of the unknowns at once, as residuals over the noise.

The colour of the noise is estimated together with the fit, as spectral densities of each channel in bands. The discrete
Fourier transform of a residual holds, at every frequency, numbers that are nearly independent with the variance of the
noise's spectrum (Whittle, Ark. Mat. 2, 1953, 423-434). In a band the density is taken as constant, with a weak prior at
the white noise of the instrument's sigma (an inverse gamma distribution of `PRIOR` degrees of freedom).
Integrating it out leaves, for a band of n real numbers with the sum of squares Q over the white density,

    (n + PRIOR)/2 log((Q + PRIOR)/(n + PRIOR)).

No instrument's noise is ten times its stated sigma at the lowest frequencies, so in the lowest band the density ends
at a ceiling (`SLOW_CEILING`): what is above it, an offset or a drift, counts by its square.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.table_error import TableErrorModes
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import InputError
from msl_fem.plant import Surface
from msl_fem.plant.effects import neutral_vector
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_run import LaneRun, LaneSettings, run_lanes
from msl_fem.prediction import KernelPlant, RunData, Start
from msl_fem.prediction.free_run import counted
from msl_fem.prediction.hypothesis import with_factors
from msl_fem.prediction.nuisances import line_of, together
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record.columns import Channel

SLOW_CEILING = 100.0
CONVERGED = 0.05
"""Nats that a further step would gain, at which a fit has converged."""
AT_ONCE = 16  # rows that are simulated together: what bounds the memory
START = 10.0  # times the instruments' sigma: how far a run's start may lie from its first guess
HEARD = 0.02  # of the noise's density: lines where the model's readings stay below it tell nothing
WINDOWED = 1.3  # a margin above the highest line that is heard
PRIOR = 4.0
OCTAVE = 2.0
FEWEST = 8  # lines of the longest run that a band holds at least


@dataclass(frozen=True, eq=False)
class NoiseBands:
    """Which lines of which run belong to which band.

    Attributes
    ----------
    edges : (n_band + 1,) Hz; the last is the highest frequency that a fit looks at
    counts : channel to (n_band,) real numbers in each band, all runs together
    lines : number of lines kept of each run
    band_of : of each run, (n_line,) the band of a line
    """

    edges: Array
    lines: tuple[int, ...]
    band_of: tuple[NDArray[np.intp], ...]

    @property
    def n_band(self) -> int:
        return self.edges.size - 1


def make_bands(samples: Sequence[int], rate: float, *, highest: float) -> NoiseBands:
    """Octaves below the highest frequency, the lowest one from 0."""
    longest = max(samples) / rate
    edges = [min(highest, rate / 2)]
    while edges[-1] / OCTAVE > FEWEST / longest:
        edges.append(edges[-1] / OCTAVE)
    grid = np.array([0.0, *edges[-1::-1]])
    lines, band_of = [], []
    for n in samples:
        f = np.fft.rfftfreq(n, 1 / rate)
        kept = int(np.searchsorted(f, grid[-1], side="right"))
        lines.append(kept)
        band_of.append(np.clip(np.searchsorted(grid, f[:kept], side="right") - 1, 0, grid.size - 2))
    return NoiseBands(grid, tuple(lines), tuple(band_of))


def transformed(values: Array, n_line: int) -> Array:
    """Real and imaginary parts of the first lines, (..., 2 n_line); of white noise each has its variance."""
    found = np.fft.rfft(values, axis=-1)[..., :n_line]
    n = values.shape[-1]
    parts = np.concatenate([found.real, found.imag], axis=-1) * np.sqrt(2.0 / n)
    parts[..., 0] /= np.sqrt(2.0)  # the mean has no imaginary part
    if n_line == n // 2 + 1 and n % 2 == 0:
        parts[..., n_line - 1] /= np.sqrt(2.0)
    return parts


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


@dataclass(frozen=True, eq=False)
class FitProblem:
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
    table_error: TableErrorModes | None
    threads: int = 1

    def surface(self, scale: float, numbers: Array) -> Surface:
        """The magnets' coenergy surface at a scale and numbers (n_mode,) of the table's error."""
        surface = self.plant.surface
        change = 0.0 if self.table_error is None else np.tensordot(numbers, self.table_error.modes, axes=1)
        return surface._replace(coefficients=scale * (surface.coefficients + change))

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

    def each(self) -> Iterator[tuple[Array, Array]]:
        """Row by row, the unknowns and the effects."""
        neutral = neutral_vector()
        for n, z in enumerate(self.rows):
            yield z, neutral if self.effects is None else self.effects[n]

    def only(self, rows: slice) -> "Points":
        return Points(self.unknowns, self.rows[rows], None if self.effects is None else self.effects[rows])


def simulated_residuals(problem: FitProblem, points: Points, *, substeps: int) -> list[list[Array]]:
    """Measured less simulated of every run and channel, (n_row, n_sample) in SI units; nan where a run ended early."""
    return [_of_run(problem, points, run, substeps) for run in range(len(problem.runs))]


def _of_run(problem: FitProblem, points: Points, run: int, substeps: int) -> list[Array]:
    data, p = problem.runs[run], problem.plant.parameters
    columns = max(p.sides, 1)
    inputs = Inputs(data.commands[:, :columns], data.rate, hold=data.hold)
    try:
        found = lanes(problem, points, run, inputs=inputs, substeps=substeps)
    except InputError:  # an effect beyond what the kernel takes, like a delay of more samples than it keeps
        if len(points.rows) == 1:
            return [np.full((1, len(data.commands)), np.nan) for _ in problem.channels(run)]
        parts = [_of_run(problem, points.only(slice(n, n + 1)), run, substeps) for n in range(len(points.rows))]
        return [np.concatenate(channel) for channel in zip(*parts, strict=True)]
    factors = [points.unknowns.factors(z) for z in points.rows]
    gains = np.array([f.get("position_gain", 1.0) for f in factors]) * problem.plant.gain
    residuals = []
    for name in problem.channels(run):
        lines = np.array([line_of(name, together(problem.plant.instruments, f)) for f in factors])
        if name == POSITION_COLUMN:
            lines[:, 0] = gains
        residuals.append(data.measured[name] - (lines[:, :1] * reading(found, name) + lines[:, 1:]))
    return residuals


def lanes(problem: FitProblem, points: Points, run: int, *, inputs: Inputs, substeps: int) -> LaneRun:
    """The runs of all rows under some inputs, from the starts that the rows say."""
    unknowns, rows = points.unknowns, points.rows
    ideal = problem.runs[run].ideal_current
    plants = [with_factors(problem.plant.parameters, unknowns.factors(z), ideal_current=ideal) for z in rows]
    settings = LaneSettings(
        effects=points.effects,
        starts=np.array([_start(problem, unknowns, z, run) for z in rows]),
        surface_index=np.arange(len(rows)) if problem.table_error is not None else None,
        threads=problem.threads,
    )
    surface = _surfaces(problem, unknowns, rows)
    return run_lanes(surface, plants, inputs, substeps=substeps, settings=settings)


def reading(found: LaneRun, channel: str) -> Array:
    """(n_row, n_sample) of a channel by its column's name, before gain and zero of its instrument."""
    if channel == POSITION_COLUMN:
        return found.position
    measured = Channel.of(channel)
    values = found.voltage if measured.quantity == "voltage" else found.current
    return values[:, :, measured.index]


def _start(problem: FitProblem, unknowns: Unknowns, z: Array, run: int) -> Array:
    guess = problem.guesses[run]
    start = np.array([*guess.currents, guess.position, guess.velocity])
    moved = z[unknowns.start_rows(run)] * problem.start_sigmas[run]
    start[2:] += moved[:2]
    start[: moved.size - 2] += moved[2:]
    return start


def _surfaces(problem: FitProblem, unknowns: Unknowns, rows: Array) -> Surface:
    surface = problem.plant.surface
    if problem.table_error is None:
        return surface
    scale = np.array([unknowns.factors(z).get("magnetic_scale", 1.0) for z in rows])
    change = np.tensordot(rows[:, unknowns.table_rows], problem.table_error.modes, axes=1)
    return surface._replace(coefficients=scale[:, None, None, None, None] * (surface.coefficients + change))


@dataclass(frozen=True, eq=False)
class NoiseWeights:
    """The noise's densities over the white one by band label, how many numbers each has, and the objective's data part.

    Attributes
    ----------
    density : (n_label,)
    root : (n_number,) one over the square root of each number's density
    nats : the data's part of S
    """

    density: Array
    root: Array
    nats: float


def weights_of(residual: Array, labels: NDArray[np.intp], ceilings: Array) -> NoiseWeights:
    """The most probable densities given a residual (n_number,), none above its ceiling (n_label,)."""
    count = np.bincount(labels) + PRIOR
    power = np.bincount(labels, weights=residual**2) + PRIOR
    density = np.minimum(power / count, ceilings)
    nats = np.sum(count * (np.log(density) - 1) + power / density) / 2
    return NoiseWeights(density, 1 / np.sqrt(density)[labels], float(nats))


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a fit ended.

    Attributes
    ----------
    unknowns, z : what was fitted, (unknowns.size,)
    residual : (n_number,) over the white sigma; `weights` belong to it
    jacobian : (n_number, unknowns.size) of the residual, not weighted
    objective, log_evidence : nats
    predicted : nats that a further step would gain
    """

    unknowns: Unknowns
    z: Array
    residual: Array
    jacobian: Array
    weights: NoiseWeights
    objective: float
    log_evidence: float
    predicted: float
    simulations: int

    @property
    def converged(self) -> bool:
        return self.predicted < CONVERGED

    @property
    def precision(self) -> Array:
        """J'J and the prior's curvature."""
        j = self.jacobian * self.weights.root[:, None]
        return np.asarray(j.T @ j + np.diag(self.unknowns.prior(self.z)[2]))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """A record as a likelihood of its unknowns; `substeps` are Runge-Kutta steps a sample."""

    problem: FitProblem
    bands: NoiseBands
    substeps: int

    def spectra(self, points: Points) -> Array:
        """Residuals in the frequency domain over their white sigma, (n_row, n_number); nan of a failed run."""
        parts = [points.only(slice(at, at + AT_ONCE)) for at in range(0, len(points.rows), AT_ONCE)]
        return np.concatenate(
            [self.transformed(simulated_residuals(self.problem, p, substeps=self.substeps)) for p in parts]
        )

    def transformed(self, found: list[list[Array]]) -> Array:
        """Arrays (n_row, n_sample) of every run's channels as `spectra` orders and scales them."""
        parts = []
        for run, channels in enumerate(found):
            data = self.problem.runs[run]
            for name, values in zip(self.problem.channels(run), channels, strict=True):
                parts.append(transformed(values / data.noise[name].sigma, self.bands.lines[run]))
        return np.concatenate(parts, axis=-1)

    def excess(self, found: Fit) -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma, all frequencies and all runs together."""
        power: dict[str, list[float]] = {}
        points = Points.of(found.unknowns, found.z[None])
        for run, channels in enumerate(simulated_residuals(self.problem, points, substeps=self.substeps)):
            for name, values in zip(self.problem.channels(run), channels, strict=True):
                sigma = self.problem.runs[run].noise[name].sigma
                power.setdefault(name, []).append(float(np.mean(values**2)) / sigma**2)
        return {name: float(np.sqrt(np.mean(values))) for name, values in power.items()}

    def runs_part(self, found: Fit) -> tuple["Likelihood", Fit]:
        """The runs alone, and a fit as they see it: all there is, where nothing stands beside them."""
        return self, found

    @property
    def labels(self) -> NDArray[np.intp]:
        """(n_number,) the band of each number, channels apart, runs together."""
        names = self.channel_names
        parts = []
        for run in range(len(self.problem.runs)):
            band = np.tile(self.bands.band_of[run], 2)
            band[self.bands.lines[run]] = band[0]
            parts += [band + self.bands.n_band * names.index(name) for name in self.problem.channels(run)]
        return np.concatenate(parts)

    @property
    def ceilings(self) -> Array:
        """(n_label,) the largest density over the white one that a band's noise can have: of the lowest one of each
        channel `SLOW_CEILING`, where there are several. A drift or an offset of any size would pass as noise there for
        a few nats."""
        found = np.full(self.bands.n_band * len(self.channel_names), np.inf)
        if self.bands.n_band > 1:
            found[:: self.bands.n_band] = SLOW_CEILING
        return found

    def weights(self, residual: Array) -> NoiseWeights:
        """The most probable densities given a residual (n_number,)."""
        return weights_of(residual, self.labels, self.ceilings)

    @property
    def channel_names(self) -> list[str]:
        found: list[str] = []
        for run in range(len(self.problem.runs)):
            found += [name for name in self.problem.channels(run) if name not in found]
        return found
