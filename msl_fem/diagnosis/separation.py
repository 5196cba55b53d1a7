"""How far apart two explanations of a planned record are, from the model alone, no data needed.

If one is true, the record without its noise is the model's own with it. The other explanation, and all that is unknown
within its tolerances, is fitted to that; what is left, the squared residuals over the noise and the squares of the
unknowns over their tolerances, is d^2. Half of it is the log evidence, in nats, that the record would hold for the
truth over the other. For small effects it is the classical |S_a - P_b S_a|^2, the noncentrality of a test between two
linear models (Kay, Fundamentals of Statistical Signal Processing II, 1998, ch. 7). Being a fit it counts the second
order too, by which alone a delay and a lag differ.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.fit import Fit, Likelihood, columns
from msl_fem.diagnosis.simulator import Points
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns

Array = NDArray[np.float64]
STEPS, HALVINGS = 6, 4
SETTLED = 0.01  # share of d^2 that a further step must promise to be taken


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Effects with their parameters: unknowns, and z of each."""

    effects: tuple[EffectUnknown, ...]
    z: Array

    @classmethod
    def of(cls, found: Fit) -> "Hypothesis":
        """The effects of a fit at their fitted values."""
        return cls(found.unknowns.effects, found.z[found.unknowns.n_nuisance :])

    def scaled(self, factor: float) -> "Hypothesis":
        """With all amounts times a factor; shapes stay."""
        shape = np.array([bool(one.width) for one in self.effects])
        return Hypothesis(self.effects, np.where(shape, self.z, factor * self.z))


@dataclass(frozen=True, eq=False)
class Measure:
    """A number that is measured beside a run: its value for factors of believed parameters, numbers of the table's
    error and all parameters of effects, and one sigma of the measurement."""

    name: str
    value: Callable[[dict[str, float], Array, Array], float]
    sigma: float


class PlannedRecord:
    """A record that could be made: what its runs, and numbers measured beside them, would tell.

    The columns of what is unknown within its tolerances are computed once, for all pairs that are compared.

    Parameters
    ----------
    weight : by which the information of the simulated piece is multiplied; seconds planned over seconds simulated
    """

    def __init__(self, likelihood: Likelihood, plain: Unknowns, *, weight: float) -> None:
        self.likelihood, self.plain, self.weight = likelihood, plain, weight
        nothing = np.zeros(plain.size)
        self.base = likelihood.spectra(Points.of(plain, nothing[None]))[0]
        self.nuisance = columns(likelihood, plain, nothing, np.arange(plain.size), self.base)

    def distance(self, truth: Hypothesis, other: Hypothesis, measures: tuple[Measure, ...] = ()) -> float:
        """d^2; nan where the model does not bear the truth."""
        return _Fitted(self, truth, other, measures).least()


class _Fitted:
    """The other explanation fitted to what the truth makes of a planned record."""

    def __init__(
        self, plan: PlannedRecord, truth: Hypothesis, other: Hypothesis, measures: tuple[Measure, ...]
    ) -> None:
        self.plan, self.measures = plan, measures
        p = plan.plain
        true = Unknowns(p.believed, p.n_table, p.starts, truth.effects)
        self.unknowns = Unknowns(p.believed, p.n_table, p.starts, other.effects)
        at = np.concatenate([np.zeros(p.size), truth.z])
        self.target = plan.likelihood.spectra(Points.of(true, at[None]))[0]
        self.aims = self._measured(true, at)
        self.z = np.concatenate([np.zeros(p.size), other.z])

    def _measured(self, unknowns: Unknowns, z: Array) -> Array:
        table, effects = z[unknowns.table_rows], unknowns.effect_vector(z)
        return np.array([m.value(unknowns.factors(z), table, effects) / m.sigma for m in self.measures])

    def _spectrum(self, z: Array) -> Array:
        return self.plan.likelihood.spectra(Points.of(self.unknowns, z[None]))[0]

    def _cost(self, z: Array, spectrum: Array) -> float:
        left = spectrum - self.target
        beside = self._measured(self.unknowns, z) - self.aims
        return float(self.plan.weight * (left @ left) + beside @ beside + self._kept(z) @ self._kept(z))

    def _kept(self, z: Array) -> Array:
        """z over its prior's width: amounts of effects have none to speak of."""
        kept = z.copy()
        kept[self.unknowns.amounts] = 0.0
        return kept

    def least(self) -> float:
        """The least cost, by Gauss-Newton steps that are halved until they lead down."""
        if not np.isfinite(self.target).all():
            return float("nan")
        spectrum = self._spectrum(self.z)
        if not np.isfinite(spectrum).all():
            self.z[self.unknowns.n_nuisance :] = 0.0
            spectrum = self.plan.base
        cost = self._cost(self.z, spectrum)
        for _ in range(STEPS):
            move, promised = self._step(spectrum)
            if promised < SETTLED * cost:
                break
            for halving in range(HALVINGS):
                tried = self.unknowns.allowed(self.z + move / 2**halving)
                there = self._spectrum(tried)
                new = self._cost(tried, there) if np.isfinite(there).all() else np.inf
                if new < cost:
                    break
            else:
                break
            self.z, spectrum, cost = tried, there, new
        return cost

    def _step(self, spectrum: Array) -> tuple[Array, float]:
        n = self.unknowns.n_nuisance
        own = columns(self.plan.likelihood, self.unknowns, self.z, np.arange(n, self.z.size), spectrum)
        jacobian = np.concatenate([self.plan.nuisance, own], axis=1) * np.sqrt(self.plan.weight)
        left = (spectrum - self.target) * np.sqrt(self.plan.weight)
        beside = self._measured(self.unknowns, self.z)
        rows = np.array([self._measured_slope(k, beside) for k in range(self.z.size)]).reshape(self.z.size, -1).T
        prior = np.ones(self.z.size)
        prior[self.unknowns.amounts] = 0.0
        gram = jacobian.T @ jacobian + rows.T @ rows + np.diag(prior)
        slope = jacobian.T @ left + rows.T @ (beside - self.aims) + self._kept(self.z)
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        scaled = gram * scale[:, None] * scale + 1e-12 * np.eye(self.z.size)
        move = -scale * np.linalg.solve(scaled, scale * slope)
        return move, float(-slope @ move)

    def _measured_slope(self, k: int, here: Array) -> Array:
        """Slopes of the measured numbers over one unknown."""
        if not self.measures:
            return np.empty(0)
        step = float(self.unknowns.steps[k]) * 10
        moved = self.z.copy()
        moved[k] += step
        return (self._measured(self.unknowns, moved) - here) / step
