"""How far apart two explanations of a planned record are, from the model alone, no data needed.

If one is true, the record without its noise is the model's own with it. The other explanation, and all that is unknown
within its tolerances, is fitted to that; what is left, the squared residuals over the noise and the squares of the
unknowns over their tolerances, is d^2. Half of it is the log evidence, in nats, that the record would hold for the
truth over the other. For small effects it is the classical |S_a - P_b S_a|^2, the noncentrality of a test between two
linear models (Kay, Fundamentals of Statistical Signal Processing II, 1998, ch. 7). Being a fit it counts the second
order too, by which alone a delay and a lag differ.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.gauss_newton import HALVING, DescentSettings, descend, halved
from msl_fem.diagnosis.likelihood import Fit, Likelihood, jacobian_columns
from msl_fem.diagnosis.problem import FitProblem, Points
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.plant import static_map
from msl_fem.plant.effects import PARAMETER_INDEX, from_vector

STEPS = 20
ENOUGH = 0.01  # of d^2, that a further step must promise to be taken
SETTLED = 0.01  # the same as a share of d^2
LITTLE = 1.0  # of d^2, below which another start brings nothing that matters
STALE = 0.5  # share of its promise that a step has to bring for the columns of what is uncertain to be kept

Measured = Callable[[dict[str, float], Array, Array], float]
"""Of factors of believed parameters, numbers of the table's error and all parameters of effects."""
GAUGE_BLOCK, SCALES, OHMMETER, LOAD_CELL = 2e-4, 2e-4, 1e-3, 2e-3
"""One sigma of each, relative: a block of 1 mm read to 0.2 um; workshop scales; a bench meter with four wires; a load
cell and a gap set by shims."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Effects with their parameters: unknowns, and z of each; `beside` what a fit to the record at hand made of the
    believed parameters and the table, in whose place nothing stands where it is not known."""

    effects: tuple[EffectUnknown, ...]
    z: Array
    beside: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, found: Fit) -> "Hypothesis":
        """The effects of a fit at their fitted values."""
        unknowns = found.unknowns
        return cls(unknowns.effects, found.z[unknowns.n_nuisance :], found.z[: unknowns.table_rows.stop])

    def scaled(self, factor: float) -> "Hypothesis":
        """With all amounts times a factor; shapes stay."""
        shape = np.array([bool(one.width) for one in self.effects])
        return Hypothesis(self.effects, np.where(shape, self.z, factor * self.z), factor * self.beside)


@dataclass(frozen=True, eq=False)
class Measure:
    """A number that is measured beside a run: its value, and one sigma of the measurement."""

    name: str
    value: Measured
    sigma: float


class PlannedRecord:
    """A record that could be made: what its runs, and numbers measured beside them, would tell.

    Parameters
    ----------
    weight : by which the information of the simulated piece is multiplied; seconds planned over seconds simulated
    """

    def __init__(self, likelihood: Likelihood, plain: Unknowns, *, weight: float) -> None:
        self.likelihood, self.plain, self.weight = likelihood, plain, weight
        self._spectra: dict[tuple[tuple[EffectUnknown, ...], bytes], Array] = {}
        self._columns: dict[tuple[tuple[EffectUnknown, ...], bytes], Array] = {}

    @cached_property
    def nuisance(self) -> Array:
        """Columns (n_number, plain.size) of what is uncertain, as believed; computed once for all pairs compared."""
        nothing = np.zeros(self.plain.size)
        base = self.likelihood.spectra(Points.of(self.plain, nothing[None]))[0]
        return jacobian_columns(self.likelihood, self.plain, nothing, np.arange(nothing.size), base)

    def spectrum(self, unknowns: Unknowns, z: Array) -> Array:
        """(n_number,) at one point of unknowns that differ from the plain ones by their effects alone. It is kept, for
        each number measured beside the record has the fit begin anew."""
        key = unknowns.effects, z.tobytes()
        if key not in self._spectra:
            self._spectra[key] = self.likelihood.spectra(Points.of(unknowns, z[None]))[0]
        return self._spectra[key]

    def columns(self, unknowns: Unknowns, z: Array) -> Array:
        """Columns (n_number, n_effect) of the effects there, kept likewise."""
        key = unknowns.effects, z.tobytes()
        if key not in self._columns:
            which = np.arange(unknowns.n_nuisance, z.size)
            self._columns[key] = jacobian_columns(self.likelihood, unknowns, z, which, self.spectrum(unknowns, z))
        return self._columns[key]

    def distance(self, truth: Hypothesis, other: Hypothesis, measures: tuple[Measure, ...] = ()) -> float:
        """d^2; nan where the model does not bear the truth."""
        return _Separation(self, truth, other, measures).least()


@dataclass(frozen=True, eq=False)
class _SeparationPoint:
    """The other explanation at some unknowns; d^2 is its objective."""

    z: Array
    spectrum: Array
    measured: Array
    objective: float


class _SeparationModel:
    """d^2 near a point, the readings linear; `nuisance` the columns of what is uncertain, stale where they are those
    of another point."""

    def __init__(self, gram: Array, slope: Array, nuisance: Array, *, stale: bool) -> None:
        self.nuisance, self.stale = nuisance, stale
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        scaled = gram * scale[:, None] * scale + 1e-12 * np.eye(slope.size)
        self._move = -scale * np.linalg.solve(scaled, scale * slope)
        self.promised = float(-slope @ self._move)

    def step(self, damping: float) -> tuple[Array, float]:
        return halved(self._move, damping), self.promised


class _Separation:
    """The other explanation fitted to what the truth makes of a planned record."""

    def __init__(
        self, plan: PlannedRecord, truth: Hypothesis, other: Hypothesis, measures: tuple[Measure, ...]
    ) -> None:
        self.plan, self.measures, self.truth, self.other = plan, measures, truth, other
        p = plan.plain
        true = replace(p, effects=truth.effects)
        self.unknowns = replace(p, effects=other.effects)
        at = np.concatenate([np.zeros(p.size), truth.z])
        self.target = plan.spectrum(true, at)
        self.aims = self._measured(true, at)

    def least(self) -> float:
        """The least d^2, by Gauss-Newton steps that are halved until they lead down, from each of `_starts`."""
        if not np.isfinite(self.target).all():
            return float("nan")
        limits = DescentSettings(HALVING, enough=ENOUGH, enough_share=SETTLED, most_steps=STEPS, renewal=STALE)
        least = float("inf")
        for z in self._starts():
            start = self._at(z)
            if least > LITTLE and np.isfinite(start.objective):
                first = self._linearised(start, self.plan.nuisance)
                least = min(least, descend(self, start, limits, first=first).point.objective)
        return least

    def _starts(self) -> list[Array]:
        """Where the fit begins: what is uncertain as far apart as the fits of both to the record at hand have it, or
        else as believed; and the other explanation absent, from where the first step is the linear model's."""
        fitted, absent = np.zeros(self.unknowns.size), np.zeros(self.unknowns.size)
        n = self.plan.plain.size
        fitted[n:], absent[n:] = self.other.z, self.other.scaled(0.0).z
        known = self.other.beside.size
        if known == self.truth.beside.size <= n:
            fitted[:known] = self.other.beside - self.truth.beside
        return [fitted, absent]

    def moved(self, point: _SeparationPoint, move: Array) -> _SeparationPoint:
        return self._at(self.unknowns.allowed(point.z + move))

    def model(self, point: _SeparationPoint, neighbour: _SeparationModel | None) -> _SeparationModel:
        return self._linearised(point, None if neighbour is None else neighbour.nuisance)

    def _linearised(self, point: _SeparationPoint, nuisance: Array | None) -> _SeparationModel:
        """The model at a point; the columns of what is uncertain are computed where they are not given."""
        n, stale = self.unknowns.n_nuisance, nuisance is not None
        root = np.sqrt(self.plan.weight)
        if nuisance is None:
            which = np.arange(point.z.size)
            columns = jacobian_columns(self.plan.likelihood, self.unknowns, point.z, which, point.spectrum)
        else:
            columns = np.concatenate([nuisance, self.plan.columns(self.unknowns, point.z)], axis=1)
        jacobian = columns * root
        left = (point.spectrum - self.target) * root
        slopes = [self._measured_slope(k, point) for k in range(point.z.size)]
        rows = np.array(slopes).reshape(point.z.size, -1).T
        prior = np.ones(point.z.size)
        prior[self.unknowns.amounts] = 0.0
        gram = jacobian.T @ jacobian + rows.T @ rows + np.diag(prior)
        slope = jacobian.T @ left + rows.T @ (point.measured - self.aims) + self._over_prior(point.z)
        return _SeparationModel(gram, slope, columns[:, :n], stale=stale)

    def _at(self, z: Array) -> _SeparationPoint:
        spectrum = self.plan.spectrum(self.unknowns, z)
        if not np.isfinite(spectrum).all():
            return _SeparationPoint(z, spectrum, self.aims, np.inf)
        left = spectrum - self.target
        measured = self._measured(self.unknowns, z)
        beside, over_prior = measured - self.aims, self._over_prior(z)
        d2 = self.plan.weight * (left @ left) + beside @ beside + over_prior @ over_prior
        return _SeparationPoint(z, spectrum, measured, float(d2))

    def _measured(self, unknowns: Unknowns, z: Array) -> Array:
        table, effects = z[unknowns.table_rows], unknowns.effect_vector(z)
        return np.array([m.value(unknowns.factors(z), table, effects) / m.sigma for m in self.measures])

    def _over_prior(self, z: Array) -> Array:
        """z over its prior's width: amounts of effects have none to speak of."""
        kept = z.copy()
        kept[self.unknowns.amounts] = 0.0
        return kept

    def _measured_slope(self, k: int, here: _SeparationPoint) -> Array:
        """Slopes of the measured numbers over one unknown."""
        if not self.measures:
            return np.empty(0)
        step = float(self.unknowns.steps[k]) * 10
        moved = here.z.copy()
        moved[k] += step
        return (self._measured(self.unknowns, moved) - here.measured) / step


def beside_a_run(problem: FitProblem) -> Iterator[Measure]:
    """The measurements that a rig allows."""
    gain = PARAMETER_INDEX["position_sensor_nonlinearity", "gain_error"]

    def reading(factors: dict[str, float], table: Array, effects: Array) -> float:
        return float(np.log(factors.get("position_gain", 1.0) * (1 + effects[gain])))

    yield Measure("a gauge block under the position sensor", reading, GAUGE_BLOCK)
    yield Measure("the mover weighed", _log_of("moving_mass"), SCALES)
    if problem.plant.parameters.sides:
        yield Measure("the coils' resistance", _log_of("coil_resistance"), OHMMETER)
        yield Measure("one force at rest, by a load cell", _static_force(problem), LOAD_CELL)


def _log_of(believed: str) -> Measured:
    """The log of a believed parameter over its believed value."""
    return lambda factors, table, effects: float(np.log(factors.get(believed, 1.0)))


def _static_force(problem: FitProblem) -> Measured:
    """The log of a magnet's force at rest, at the nominal gap and the mean current of the runs."""
    plant = problem.plant
    p = plant.parameters
    run = problem.runs[0]
    currents = run.measured.get("current_1_A", run.commands[:, 0])
    current = float(np.sqrt(np.mean(currents**2))) * p.current_share

    def force(factors: dict[str, float], table: Array, effects: Array) -> float:
        surface = problem.surface(factors.get("magnetic_scale", 1.0), table)
        gap = p.nominal_gap * factors.get("nominal_gap", 1.0)
        found, _ = static_map(surface, p, from_vector(effects), gap=[gap], current=[current])
        return float(np.log(found[0]))

    return force
