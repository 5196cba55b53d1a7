"""What no effect of the catalogue accounts for: in which equation it stands, and on which variable it depends.

A force, a voltage or an error of a reading is taken as an unknown function of one variable, a straight line or a sum of
cubic B-splines with independent normal coefficients of a common size, and simulated through the plant: for small
functions the readings are linear in the coefficients. All that the fit does not know stays unknown. The log evidence,
the highest over s and of both forms, is

    b'(G + 1/s^2)^-1 b/2 - log det(1 + s^2 G)/2,

G and b as in `search`. Functions fitted through the simulation need no derivatives of noisy readings. The trajectory
is the model's own, so a variable is known but for what the model gets wrong.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import LANES
from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.likelihood import Fit, Likelihood
from msl_fem.diagnosis.problem import instrument_line, reading, states
from msl_fem.diagnosis.stretches import Stretches
from msl_fem.plant import layout
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.lane_block import LaneSettings
from msl_fem.plant.lane_run import LaneRun, run_lanes
from msl_fem.plant.plant import FORCE_DRIVE
from msl_fem.prediction import KernelPlant, ModelHypothesis, RunData, Start, measured_start
from msl_fem.prediction.hypothesis import plant_in_run, plant_of_run
from msl_fem.record.columns import Channel
from msl_fem.record.validity import bridged

N_SPLINE = 14
SIZES = np.geomspace(1e-4, 1e2, 13)
"""Of the coefficients, over the variable's own scale of the equation."""
WORTH_NAMING = 20.0  # nats below which no variable is named
EXPLAINED = 0.3  # share of the excess power that a function of the best variable has to explain
LEVEL = 5.0  # nats within which variables are named together
MEMORIES = (0.005, 0.02, 0.1)  # s, of exponential memories of the position
FEW = (
    ("force", "position"),
    ("force", "velocity"),
    ("force", "memory of the position over 20 ms"),
    ("force", "current product"),
    ("voltage", "command"),
)
"""Equations and variables by which most of what is in no catalogue acts."""
SMALL = 1e-3  # of the equation's scale: a coefficient in the simulations


@dataclass(frozen=True, eq=False)
class Dependence:
    """A function of one variable in one equation.

    Attributes
    ----------
    equation : "force", "voltage", "position reading" or "current reading"
    variable : what the function is of
    gain : nats of log evidence
    share : of the excess power over the noise that it explains
    at, value, band : (n,) the variable, the function there, and its standard error, SI units
    """

    equation: str
    variable: str
    gain: float
    share: float
    at: Array
    value: Array
    band: Array


def dependences(
    likelihood: Likelihood, fit: Fit, belief: ModelHypothesis, *, few: bool = False, threads: int = 1
) -> list[Dependence]:
    """Every (equation, variable), the most probable first.

    Parameters
    ----------
    belief : the model of the fit, with all that it found
    few : only `FEW`, in an eighth of the time
    """
    run, problem = likelihood.problem.runs[0], likelihood.problem
    plant = plant_of_run(belief, run)
    plant = replace(plant, substeps=problem.steps(plant.substeps, fit.unknowns.times_steps))
    trajectory = _Trajectory(plant, run, likelihood.problem.cut(0))
    if not np.isfinite(trajectory.out).all():
        return []
    judge = _FreeFunctions(likelihood, fit, trajectory)
    pairs = [(equation, name) for equation, names in _tried(trajectory).items() for name in names]
    chosen = [pair for pair in pairs if pair in FEW or not few]
    found = in_threads(lambda pair: judge.dependence(*pair), chosen, threads)
    return sorted(found, key=lambda dependence: -dependence.gain)


def named_dependence(ranked: Sequence[Dependence], *, share: float) -> tuple[str, tuple[str, ...]]:
    """(equation, variables) that what is left depends on; empty where none stands out, or explains that share of it."""
    if not ranked or ranked[0].gain < WORTH_NAMING or ranked[0].share < share:
        return "", ()
    best = ranked[0]
    level = [d.variable for d in ranked if d.equation == best.equation and best.gain - d.gain <= LEVEL]
    return best.equation, tuple(level)


class _Trajectory:
    """The first run of a record as the fitted model makes it, from its measured start, or the starts of stretches."""

    def __init__(self, plant: KernelPlant, run: RunData, cut: Stretches | None) -> None:
        self.plant, self.run, self.cut = plant, run, cut
        self.starts = _whole(measured_start(plant, run)) if cut is None else states(plant, run, cut.starts, {})
        nothing = np.zeros((1, len(run.commands)))
        [found] = self._simulated(nothing, np.zeros((1, *self.commands.shape)))
        self.out = self._bridged(found.rows(0))
        [self.readings] = self._readings(found)

    @property
    def commands(self) -> Array:
        """(n_sample, n_side); in force drive (n_sample, 1)."""
        return self.run.commands[:, : max(self.plant.parameters.sides, 1)]

    def moved(self, pushes: Array, more: Array) -> Iterator[dict[str, Array]]:
        """Channel to (n_sample,) what is read in each case, with a force beside the magnets' (n_case, n_sample) and
        additions to the commands (n_case, n_sample, n_side); nan behind an early end."""
        quantities = frozenset(channel.quantity for channel in self.run.channels.values())
        for found in self._simulated(pushes, more, quantities):
            yield from self._readings(found)

    def _simulated(self, pushes: Array, more: Array, quantities: frozenset[str] | None = None) -> Iterator[LaneRun]:
        plant, run = self.plant, self.run
        inputs = Inputs(self.commands, run.rate, 0.0, run.hold)
        begins = np.zeros(1, dtype=np.intp) if self.cut is None else self.cut.begins
        for n in range(0, len(pushes), LANES):
            own = slice(n, n + LANES)
            count = len(pushes[own])
            settings = LaneSettings(
                effects=None if plant.effects is None else np.repeat(plant.readings[None], count, axis=0),
                starts=np.repeat(self.starts[None], count, axis=0),
                begins=begins,
                pushes=pushes[own],
                more=more[own],
                quantities=quantities,
            )
            plants = [plant_in_run(plant.parameters, run)] * count
            yield run_lanes(plant.surface, plants, inputs, substeps=plant.substeps, settings=settings)

    def _readings(self, found: LaneRun) -> Iterator[dict[str, Array]]:
        """Of each lane, channel to (n_sample,) what is read."""
        lines = {name: instrument_line(self.plant, name, {}) for name in self.run.channels}
        for lane in range(found.n_lane):
            yield {
                name: self._bridged(gain * reading(found, name)[lane] + zero) for name, (gain, zero) in lines.items()
            }

    def _bridged(self, out: Array) -> Array:
        """(n_sample, ...) with a straight line over stretches that do not count."""
        return out if self.cut is None else bridged(out.T, np.flatnonzero(~self.cut.counts(len(out)))).T

    @cached_property
    def variables(self) -> dict[str, Array]:
        """Variables (n_sample,), or (n_sample, 2) where each side has its own."""
        return _variables(self.plant, self.run, self.out)

    @cached_property
    def scales(self) -> dict[str, float]:
        """Of each equation, the usual size of its terms."""
        velocity = self.out[:, layout.OUT_V]
        return {
            "force": self.plant.parameters.mass * float(np.std(np.gradient(velocity))) * self.run.rate,
            "voltage": float(np.std(self.run.commands)) or 1.0,
            "current reading": float(np.std(self.out[:, layout.OUT_I1])) or 1.0,
            "position reading": float(np.std(self.out[:, layout.OUT_X])) or 1.0,
        }


def _whole(start: Start) -> Array:
    """(1, 4) of a run that is followed from its start to its end."""
    return np.array([[*start.currents, start.position, start.velocity]])


def _tried(trajectory: _Trajectory) -> Mapping[str, list[str]]:
    """Equation to the variables that are tried in it."""
    electrical = ("current", "flux", "voltage", "command")
    plant = trajectory.plant.parameters
    motion = [name for name in trajectory.variables if not name.startswith(electrical)]
    sides = [name for name in trajectory.variables if name not in motion and name != "current product"]
    tried = {"force": [*motion, *(["current product"] if plant.sides == 2 else []), *(sides if plant.sides else [])]}
    if plant.drive != FORCE_DRIVE:
        tried["voltage"] = [*sides, "velocity", "time"]
        tried["current reading"] = [*sides, "time"]
    memories = [name for name in motion if name.startswith("memory")]
    tried["position reading"] = ["position", "velocity", "time", *memories]
    return tried


class _Form:
    """Functions that are sums of some columns `of` (n_spline, n_column) of a basis, with the basis' G and b."""

    def __init__(self, of: Array, g: Array, b: Array) -> None:
        own, slope = of.T @ g @ of, of.T @ b
        gains = [_evidence(own, slope, size) for size in SIZES]
        size = float(SIZES[int(np.argmax(gains))])
        inverse = np.linalg.inv(own + np.eye(len(slope)) / size**2)
        self.gain = float(max(gains))
        self.coefficients, self.covariance = of @ (inverse @ slope), of @ inverse @ of.T


class _FreeFunctions:
    """Free functions of one variable beside all that a fit does not know."""

    def __init__(self, likelihood: Likelihood, fit: Fit, trajectory: _Trajectory) -> None:
        self.likelihood, self.trajectory = likelihood, trajectory
        self.root = fit.weights.root
        self.jacobian = fit.jacobian * self.root[:, None]
        self.residual = fit.residual * self.root
        self.prior = fit.unknowns.prior(fit.z)[2]
        self.inverse = np.linalg.inv(self.jacobian.T @ self.jacobian + np.diag(self.prior))
        self.channels = likelihood.problem.channels(0)

    def dependence(self, equation: str, variable: str) -> Dependence:
        """The most probable function of a variable in an equation."""
        basis, line, (points, shapes) = _basis(self.trajectory.variables[variable])
        columns = np.column_stack(self._responses(equation, basis)) * self.root[:, None]
        absorbed = self.inverse @ (self.jacobian.T @ columns)
        own = columns - self.jacobian @ absorbed
        g = own.T @ own + absorbed.T @ (self.prior[:, None] * absorbed)
        forms = [_Form(of, g, -own.T @ self.residual) for of in (line[:, None], np.eye(len(line)))]
        best = max(forms, key=lambda form: form.gain)
        after = self.residual + own @ best.coefficients
        excess, left = self._excess_power(self.residual), self._excess_power(after)
        share = 1 - left / excess if excess > 0 else 0.0
        scale = self.trajectory.scales[equation]
        variance = np.maximum(np.einsum("nk,kl,nl->n", shapes, best.covariance, shapes), 0.0)
        value = scale * (shapes @ best.coefficients)
        return Dependence(equation, variable, best.gain, share, points, value, scale * np.sqrt(variance))

    def _excess_power(self, weighted: Array) -> float:
        return float(np.sum((weighted / self.root) ** 2) - weighted.size)

    def _responses(self, equation: str, basis: Sequence[Array]) -> list[Array]:
        """Numbers (n_number of all runs,) by which the residual changes with a coefficient of one scale of each."""
        trajectory, scale = self.trajectory, self.trajectory.scales[equation]
        if equation.endswith("reading"):
            return [self._numbers(self._read(equation.split()[0], scale * part)) for part in basis]
        commands = trajectory.commands
        pushes, more = np.zeros((len(basis), len(commands))), np.zeros((len(basis), *commands.shape))
        for n, part in enumerate(basis):
            if equation == "force":
                pushes[n] = SMALL * scale * (part if part.ndim == 1 else part[:, 0] - part[:, -1])
            else:
                more[n] = SMALL * scale * (part[:, None] if part.ndim == 1 else part[:, : commands.shape[1]])
        return [self._numbers(self._moved(readings)) for readings in trajectory.moved(pushes, more)]

    def _read(self, quantity: str, error: Array) -> list[Array]:
        """What an error of the readings of a quantity changes in each channel."""
        nothing = np.zeros(len(error))
        return [
            nothing if channel.quantity != quantity else -(error if error.ndim == 1 else error[:, channel.index])
            for channel in map(Channel.of, self.channels)
        ]

    def _moved(self, moved: Mapping[str, Array]) -> list[Array]:
        """What readings change in each channel, for a coefficient of one scale; nothing where the run ended early."""
        zero = self.trajectory.readings
        changes = [(zero[name] - moved[name]) / SMALL for name in self.channels]
        ended = not all(np.isfinite(change).all() for change in changes)
        return [np.zeros_like(change) for change in changes] if ended else changes

    def _numbers(self, series: Sequence[Array]) -> Array:
        """Changes of the first run's channels as the likelihood orders and scales them, all other runs' nothing."""
        problem = self.likelihood.problem
        runs = []
        for k, run in enumerate(problem.runs):
            runs.append([np.zeros((1, len(run.commands))) for _ in problem.channels(k)])
        runs[0] = [values[None] for values in series]
        return self.likelihood.transformed(runs)[0]


def _variables(plant: KernelPlant, data: RunData, out: Array) -> dict[str, Array]:
    """Variables (n_sample,), or (n_sample, 2) where each side has its own."""
    x, v = out[:, layout.OUT_X], out[:, layout.OUT_V]
    found = {"position": x, "velocity": v, "acceleration": np.gradient(v) * data.rate, "time": data.time}
    for time in MEMORIES:
        pole = np.exp(-1 / (time * data.rate))
        past = lfilter([1 - pole], [1, -pole], x - x[0]) + x[0]
        found[f"memory of the position over {1e3 * time:g} ms"] = x - past
    if plant.parameters.sides:
        currents = out[:, layout.OUT_I1 : layout.OUT_I1 + 2]
        flux = out[:, layout.OUT_FLUX_1 : layout.OUT_FLUX_1 + 2]
        found["current"], found["flux linkage"] = currents, flux
        found["flux linkage's rate"] = np.gradient(flux, axis=0) * data.rate
        found["command"] = data.commands
        if plant.parameters.sides == 2:
            found["current product"] = currents[:, 0] * currents[:, 1]
    return found


def _basis(z: Array) -> tuple[list[Array], Array, tuple[Array, Array]]:
    """Splines at the samples, each of the shape of z; their coefficients (n_spline,) that make a straight line from -1
    to 1 (Greville's abscissae); and where to show the function, with the splines' values there."""
    flat = z.ravel()
    low, high = np.quantile(flat, (0.002, 0.998))
    if not high > low:
        high = low + max(abs(low), 1.0) * 1e-6
    inner = np.linspace(low, high, N_SPLINE - 2)
    knots = np.r_[[low] * 3, inner, [high] * 3]
    points = np.linspace(low, high, 41)

    def values(at: Array) -> Array:
        return np.asarray(BSpline.design_matrix(np.clip(at, low, high), knots, 3).toarray())

    every = values(flat)
    line = np.convolve(knots[1:-1], np.full(3, 2 / 3), mode="valid") - low - high
    each = [every[:, k].reshape(z.shape) for k in range(every.shape[1])]
    return each, line / (high - low), (points, values(points))


def _evidence(g: Array, b: Array, size: float) -> float:
    matrix = np.eye(len(b)) + size**2 * g
    return float(size**2 * (b @ np.linalg.solve(matrix, b)) / 2 - np.linalg.slogdet(matrix)[1] / 2)
