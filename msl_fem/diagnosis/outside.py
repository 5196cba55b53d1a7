"""What no effect of the catalogue accounts for: in which equation it stands, and on which variable it depends.

A force, a voltage or an error of a reading is taken as an unknown function of one variable, a sum of cubic B-splines
with independent normal coefficients of a common size, and simulated through the plant: for small functions the readings
are linear in the coefficients. All that the fit does not know stays unknown. The log evidence, the highest over s, is

    b'(G + 1/s^2)^-1 b/2 - log det(1 + s^2 G)/2,

G and b as in `scoring`. Functions fitted through the simulation need no derivatives of noisy readings. The trajectory
is the model's own, so a variable is known but for what the model gets wrong.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from msl_fem.diagnosis.fit import Fit, Likelihood
from msl_fem.plant import kernel, layout
from msl_fem.plant.plant import FORCE_DRIVE
from msl_fem.prediction import KernelPlant, ModelHypothesis, RunData, Start, kernel_plant, measured_start
from msl_fem.prediction.free_run import kernel_state, readings_of
from msl_fem.record import Channel

Array = NDArray[np.float64]
N_SPLINE = 14
SIZES = np.geomspace(1e-4, 1e2, 13)
"""Of the coefficients, over the variable's own scale of the equation."""
ENOUGH = 20.0  # nats below which no variable is named
EXPLAINED = 0.3  # share of the excess power that a function of the best variable has to explain
LEVEL = 5.0  # nats within which variables are named together
MEMORIES = (0.005, 0.02, 0.1)  # s, of exponential memories of the position
FEW = (
    ("force", "position"), ("force", "velocity"), ("force", "memory of the position over 20 ms"),
    ("force", "current product"), ("voltage", "command"),
)  # fmt: skip
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
    likelihood: Likelihood, found: Fit, belief: ModelHypothesis, *, few: bool = False, threads: int = 1
) -> list[Dependence]:
    """Every (equation, variable), the most probable first.

    Parameters
    ----------
    belief : the model of the fit, with all that it found
    few : only `FEW`, in an eighth of the time
    """
    run = 0
    data = likelihood.problem.runs[run]
    plant = kernel_plant(belief, rate=data.rate, ideal_current=data.ideal_current)
    start = measured_start(plant, data)
    out = _simulated(plant, data, start)
    if not np.isfinite(out).all():
        return []
    scene = _Scene(likelihood, found, plant, data, start, out)
    pairs = [(equation, name) for equation, names in _tried(scene).items() for name in names]
    with ThreadPoolExecutor(threads) as pool:
        made = list(pool.map(lambda pair: scene.judged(*pair), [pair for pair in pairs if pair in FEW or not few]))
    return sorted(made, key=lambda d: -d.gain)


def named(ranked: Sequence[Dependence]) -> tuple[str, tuple[str, ...]]:
    """(equation, variables) that what is left depends on; empty where none stands out."""
    if not ranked or ranked[0].gain < ENOUGH or ranked[0].share < EXPLAINED:
        return "", ()
    best = ranked[0]
    level = [d.variable for d in ranked if d.equation == best.equation and best.gain - d.gain <= LEVEL]
    return best.equation, tuple(level)


def _simulated(
    plant: KernelPlant, data: RunData, start: Start, push: Array | None = None, more: Array | None = None
) -> Array:
    n = len(data.commands)
    out = np.full((n, layout.N_OUT), np.nan)
    commands = data.commands if more is None else data.commands + more
    done = kernel.run(
        plant.surface, plant.parameters, plant.effects, kernel_state(plant, start), commands,
        np.zeros(n) if push is None else push, plant.step, plant.substeps, out,
    )[1]  # fmt: skip
    out[done:] = np.nan
    return out


def _tried(scene: "_Scene") -> Mapping[str, list[str]]:
    motion = [name for name in scene.variables if not name.startswith(("current", "flux", "voltage", "command"))]
    sides = [name for name in scene.variables if name not in motion and name != "current product"]
    found = {"force": [*motion, *(["current product", *sides] if scene.plant.parameters.sides else [])]}
    if scene.plant.parameters.drive != FORCE_DRIVE:
        found["voltage"] = [*sides, "velocity", "time"]
        found["current reading"] = [*sides, "time"]
    found["position reading"] = ["position", "velocity", "time", *(n for n in motion if n.startswith("memory"))]
    return found


class _Scene:
    """A fitted run, its trajectory, and what is unknown around it."""

    def __init__(
        self, likelihood: Likelihood, found: Fit, plant: KernelPlant, data: RunData, start: Start, out: Array
    ) -> None:
        self.likelihood, self.plant, self.data, self.start, self.out = likelihood, plant, data, start, out
        self.channels = likelihood.problem.channels(0)
        root = found.weights.root
        j = found.jacobian * root[:, None]
        self.root = root
        self.j, self.residual = j, found.residual * root
        self.inverse = np.linalg.inv(j.T @ j + np.diag(found.unknowns.prior(found.z)[2]))
        self.raw = found.residual
        self.variables = _variables(plant, data, out)
        self.zero = readings_of(plant, data, out)
        self.sizes = {
            "force": plant.parameters.mass * float(np.std(np.gradient(out[:, layout.OUT_V]))) * data.rate,
            "voltage": float(np.std(data.commands)) or 1.0,
            "current reading": float(np.std(out[:, layout.OUT_I1])) or 1.0,
            "position reading": float(np.std(out[:, layout.OUT_X])) or 1.0,
        }

    def judged(self, equation: str, name: str) -> Dependence:
        z = self.variables[name]  # (n_sample,) or (n_sample, 2), one a side
        basis, at = _basis(z)
        columns = np.column_stack([self._response(equation, part) for part in basis]) * self.root[:, None]
        mixed = columns.T @ self.j
        g = columns.T @ columns - mixed @ self.inverse @ mixed.T
        b = -columns.T @ self.residual + mixed @ self.inverse @ (self.j.T @ self.residual)
        gains = [_evidence(g, b, s) for s in SIZES]
        size = float(SIZES[int(np.argmax(gains))])
        matrix = g + np.eye(len(b)) / size**2
        a = np.linalg.solve(matrix, b)
        scale = self.sizes[equation]
        spread = np.linalg.inv(matrix)
        points, shapes = at
        shift = self.inverse @ (mixed.T @ a)
        after = self.residual + columns @ a - self.j @ shift
        excess = float(np.sum((self.residual / self.root) ** 2) - self.raw.size)
        left = float(np.sum((after / self.root) ** 2) - self.raw.size)
        band = scale * np.sqrt(np.einsum("nk,kl,nl->n", shapes, spread, shapes))
        share = 1 - left / excess if excess > 0 else 0.0
        return Dependence(equation, name, float(max(gains)), share, points, scale * (shapes @ a), band)

    def _response(self, equation: str, part: Array) -> Array:
        """Numbers (n_number of all runs,) by which the residual changes with a coefficient of one scale."""
        small = SMALL * self.sizes[equation]
        zeros = [np.zeros_like(self.data.measured[name]) for name in self.channels]
        if equation.endswith("reading"):
            first = equation.split()[0]
            for k, name in enumerate(self.channels):
                if name.startswith(first):
                    own = part if part.ndim == 1 else part[:, Channel.of(name).index]
                    zeros[k] = -own * self.sizes[equation]
            return self._numbers(zeros)
        if equation == "force":
            push = small * (part if part.ndim == 1 else part[:, 0] - part[:, -1])
            out = _simulated(self.plant, self.data, self.start, push=push)
        else:
            more = np.zeros_like(self.data.commands)
            sides = self.plant.parameters.sides
            more[:, :sides] = small * (part[:, None] if part.ndim == 1 else part[:, :sides])
            out = _simulated(self.plant, self.data, self.start, more=more)
        if not np.isfinite(out).all():
            return self._numbers(zeros)
        moved = readings_of(self.plant, self.data, out)
        return self._numbers([(self.zero[name] - moved[name]) * (SMALL**-1) for name in self.channels])

    def _numbers(self, series: Sequence[Array]) -> Array:
        found = [[np.zeros((1, len(r.commands))) for _ in self.likelihood.problem.channels(k)]
                 for k, r in enumerate(self.likelihood.problem.runs)]  # fmt: skip
        found[0] = [values[None] for values in series]
        return self.likelihood.transformed(found)[0]


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


def _basis(z: Array) -> tuple[list[Array], tuple[Array, Array]]:
    """Splines at the samples, each of the shape of z; and where to show the function, with their values there."""
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
    return [every[:, k].reshape(z.shape) for k in range(every.shape[1])], (points, values(points))


def _evidence(g: Array, b: Array, size: float) -> float:
    matrix = np.eye(len(b)) + size**2 * g
    return float(size**2 * (b @ np.linalg.solve(matrix, b)) / 2 - np.linalg.slogdet(matrix)[1] / 2)
