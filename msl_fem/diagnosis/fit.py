"""The most probable unknowns of a record, its noise's colour estimated with them, and the log evidence.

Minimised is S(z) = sum over bands (n + p)/2 log((Q(z) + p)/(n + p)) - log prior(z): the residuals' likelihood with the
densities of the noise integrated out (`noise_bands`), and the prior of the unknowns. A Gauss-Newton step takes the
densities as they are at the point; since log is concave, a step that decreases the quadratic decreases S. Damping is
in the prior's metric (`computing.gauss_newton`). The log evidence is Laplace's, -S - log det(J'J + P)/2, P the prior's
curvature.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.noise_bands import PRIOR, Bands, transformed
from msl_fem.diagnosis.simulator import Points, Problem, residuals
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.errors import ComputationError

Array = NDArray[np.float64]
STALE = 0.6
"""Share of the predicted decrease that a step has to bring for the nuisances' columns to be kept."""
SLOW_CEILING = 100.0
AT_ONCE = 16  # rows that are simulated together: what bounds the memory
ENOUGH = 0.05
"""Nats that a further step would gain, at which a fit has converged."""


@dataclass(frozen=True, eq=False)
class Likelihood:
    """A record as a likelihood of its unknowns; `substeps` are Runge-Kutta steps a sample."""

    problem: Problem
    bands: Bands
    substeps: int

    def spectra(self, points: Points) -> Array:
        """Residuals in the frequency domain over their white sigma, (n_row, n_number); nan of a failed run."""
        parts = [points.only(slice(at, at + AT_ONCE)) for at in range(0, len(points.rows), AT_ONCE)]
        return np.concatenate([self.transformed(residuals(self.problem, p, substeps=self.substeps)) for p in parts])

    def transformed(self, found: list[list[Array]]) -> Array:
        """Arrays (n_row, n_sample) of every run's channels as `spectra` orders and scales them."""
        parts = []
        for run, channels in enumerate(found):
            data = self.problem.runs[run]
            for name, values in zip(self.problem.channels(run), channels, strict=True):
                parts.append(transformed(values / data.noise[name].sigma, self.bands.lines[run]))
        return np.concatenate(parts, axis=-1)

    def excess(self, found: "Fit") -> dict[str, float]:
        """Channel to RMS residual over the noise's sigma, all frequencies and all runs together."""
        power: dict[str, list[float]] = {}
        points = Points.of(found.unknowns, found.z[None])
        for run, channels in enumerate(residuals(self.problem, points, substeps=self.substeps)):
            for name, values in zip(self.problem.channels(run), channels, strict=True):
                sigma = self.problem.runs[run].noise[name].sigma
                power.setdefault(name, []).append(float(np.mean(values**2)) / sigma**2)
        return {name: float(np.sqrt(np.mean(values))) for name, values in power.items()}

    def runs_part(self, found: "Fit") -> tuple["Likelihood", "Fit"]:
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

    def weights(self, residual: Array) -> "Weights":
        """The most probable densities given a residual (n_number,)."""
        return weights_of(residual, self.labels, self.ceilings)

    @property
    def channel_names(self) -> list[str]:
        found: list[str] = []
        for run in range(len(self.problem.runs)):
            found += [name for name in self.problem.channels(run) if name not in found]
        return found


@dataclass(frozen=True, eq=False)
class Weights:
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


def weights_of(residual: Array, labels: NDArray[np.intp], ceilings: Array) -> Weights:
    """The most probable densities given a residual (n_number,), none above its ceiling (n_label,)."""
    count = np.bincount(labels) + PRIOR
    power = np.bincount(labels, weights=residual**2) + PRIOR
    density = np.minimum(power / count, ceilings)
    nats = np.sum(count * (np.log(density) - 1) + power / density) / 2
    return Weights(density, 1 / np.sqrt(density)[labels], float(nats))


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
    weights: Weights
    objective: float
    log_evidence: float
    predicted: float
    simulations: int

    @property
    def converged(self) -> bool:
        return self.predicted < ENOUGH

    @property
    def precision(self) -> Array:
        """J'J and the prior's curvature."""
        j = self.jacobian * self.weights.root[:, None]
        return np.asarray(j.T @ j + np.diag(self.unknowns.prior(self.z)[2]))


@dataclass(frozen=True)
class FitPlan:
    """How a fit goes.

    Attributes
    ----------
    most_steps : accepted or not
    damping : the first mu
    enough : nats that a further step would gain, at which it ends
    renew : whether the nuisances' columns may be computed anew; they are where a step brings less than it promised
    """

    most_steps: int = 60
    damping: float = 1.0
    enough: float = ENOUGH
    renew: bool = True


def columns(likelihood: Likelihood, unknowns: Unknowns, z: Array, which: NDArray[np.intp], residual: Array) -> Array:
    """Columns (n_number, n_which) of the residual's Jacobian by one-sided differences, backwards where a run fails."""
    step = unknowns.steps[which]
    rows = np.tile(z, (which.size, 1))
    rows[np.arange(which.size), which] += step
    moved = likelihood.spectra(Points.of(unknowns, rows))
    failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        step[failed] *= -1
        rows[failed, which[failed]] = z[which[failed]] + step[failed]
        moved[failed] = likelihood.spectra(Points.of(unknowns, rows[failed]))
        moved[~np.isfinite(moved).all(axis=1)] = residual  # no slope to be had: the unknown stays where it is
    return np.asarray(((moved - residual) / step[:, None]).T)


def fit(likelihood: Likelihood, unknowns: Unknowns, start: Array, *, plan: FitPlan | None = None,
        nuisance_columns: Array | None = None) -> Fit:  # fmt: skip
    """The most probable unknowns next to a start.

    Parameters
    ----------
    nuisance_columns : (n_number, n_nuisance) known from a neighbouring fit; None: they are computed

    Raises
    ------
    ComputationError : the simulation fails at the start
    """
    search = _Search(likelihood, unknowns, unknowns.allowed(start))
    search.linearise(nuisance_columns)
    how = plan or FitPlan()
    damping = how.damping
    for _ in range(how.most_steps):
        if search.predicted < how.enough:
            if not (search.stale and how.renew):
                break
            search.linearise()
            continue
        move, promised = search.step(damping)
        gained = search.tried(move)
        if gained > 0:
            damping = damping / 10 if damping > 1e-4 else 0.0
            search.linearise(None if how.renew and gained < STALE * promised else search.nuisance_columns)
        elif search.stale and how.renew:
            search.linearise()
        elif damping > 1e8:
            break
        else:
            damping = max(10 * damping, 1e-2)
    return search.ended()


class _Search:
    """Where a fit is, and its quadratic model there."""

    def __init__(self, likelihood: Likelihood, unknowns: Unknowns, z: Array) -> None:
        self.likelihood, self.unknowns = likelihood, unknowns
        self.labels, self.ceilings = likelihood.labels, likelihood.ceilings
        self.z, self.simulations, self.stale = z, 1, False
        self.residual = likelihood.spectra(Points.of(unknowns, z[None]))[0]
        if not np.isfinite(self.residual).all():
            raise ComputationError("the simulation fails at the start of the fit")
        self.weights = weights_of(self.residual, self.labels, self.ceilings)
        self.cost = self.weights.nats + unknowns.prior(z)[0]
        self.jacobian = np.empty((self.residual.size, z.size))

    @property
    def nuisance_columns(self) -> Array:
        return self.jacobian[:, : self.unknowns.n_nuisance]

    def linearise(self, nuisance_columns: Array | None = None) -> None:
        """Computes the columns here; those of the nuisances only where they are not given."""
        n = self.unknowns.n_nuisance
        which = np.arange(0 if nuisance_columns is None else n, self.unknowns.size)
        if nuisance_columns is not None:
            self.jacobian[:, :n] = nuisance_columns
        if which.size:
            self.jacobian[:, which] = columns(self.likelihood, self.unknowns, self.z, which, self.residual)
        self.simulations += which.size
        self.stale = nuisance_columns is not None
        j = self.jacobian * self.weights.root[:, None]
        _, prior_slope, curvature = self.unknowns.prior(self.z)
        self.gram, self.curvature = j.T @ j, curvature
        self.slope = j.T @ (self.residual * self.weights.root) + prior_slope
        self.free = _free(self.unknowns, self.z, self.slope)
        self.predicted = self.step(-1.0)[1]

    def step(self, damping: float) -> tuple[Array, float]:
        """(the step, nats that it promises); -1 for the step without any damping."""
        free = np.ix_(self.free, self.free)
        matrix = (self.gram + np.diag(self.curvature))[free]
        move = np.zeros(self.z.size)
        damped = matrix + (1 + damping) * np.diag(self.curvature[self.free])
        move[self.free] = np.linalg.solve(matrix if damping < 0 else damped, -self.slope[self.free])
        part = move[self.free]
        return move, float(-self.slope[self.free] @ part - part @ matrix @ part / 2)

    def tried(self, move: Array) -> float:
        """Nats gained by a step, which is taken where there are any."""
        there = self.unknowns.allowed(self.z + move)
        residual = self.likelihood.spectra(Points.of(self.unknowns, there[None]))[0]
        self.simulations += 1
        if not np.isfinite(residual).all():
            return -np.inf
        weights = weights_of(residual, self.labels, self.ceilings)
        gained = self.cost - weights.nats - self.unknowns.prior(there)[0]
        if gained > 0:
            self.z, self.residual, self.weights, self.cost = there, residual, weights, self.cost - gained
        return float(gained)

    def ended(self) -> Fit:
        evidence = -self.cost - float(np.linalg.slogdet(self.gram + np.diag(self.curvature))[1]) / 2
        return Fit(
            self.unknowns, self.z, self.residual, self.jacobian, self.weights, float(self.cost), evidence,
            self.predicted, self.simulations,
        )  # fmt: skip


def _free(unknowns: Unknowns, z: Array, slope: Array) -> NDArray[np.intp]:
    """The unknowns that no bound holds against their slope."""
    held = []
    for n, one in enumerate(unknowns.effects, unknowns.n_nuisance):
        lowest, highest = one.bounds
        if (z[n] <= lowest and slope[n] >= 0) or (z[n] >= highest and slope[n] <= 0):
            held.append(n)
    return np.setdiff1d(np.arange(z.size), held)
