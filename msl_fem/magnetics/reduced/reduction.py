"""A reduced model for the points of a table, built where it errs most, with a certificate; or none where none holds.

Weak greedy (Binev et al., SIAM J. Math. Anal. 43, 2011): a space of solutions with their derivatives along currents and
coordinate grows at points where the reduced model is most sensitive to its last modes, and at those farthest from all
seen. Every check is one full step of Newton's from the reduced state, which squares its error: what the numbers change
by is the estimate, and where it is too large the corrected state enters the space.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import qr

from msl_fem.computing.arrays import Array
from msl_fem.errors import NotConverged
from msl_fem.magnetics.reduced.cubature import sparse_weights
from msl_fem.magnetics.reduced.full_field import ALONE, ROUGH, FullField
from msl_fem.magnetics.reduced.integrands import force_integrands, number_integrands
from msl_fem.magnetics.reduced.reduced_model import FieldPoints, KnownStates, ReducedModel, ReducedStates
from msl_fem.magnetics.reduced.space import Basis, SnapshotSpace
from msl_fem.materials.curves import Indices

CLOSE = 0.15  # in ranks of coordinate and currents, each 0 to 1
DRAFTED = 3  # points at once
DRAFTED_FOR = 20  # points of a table
SAFETY = 3.5  # for points that are not checked
LEAST_ESTIMATE = 0.25  # of the tolerance: a dozen small checks say no more of the others
FINER, FINEST = 2.0, 0.1  # how a cubature that misses too much keeps more of the sums, and down to which share of `fit`
SLOPE_SHARE = 0.3  # of a derivative beside a solution in the space


@dataclass(frozen=True)
class ReductionSettings:
    """How a reduced model is built.

    Attributes
    ----------
    tolerance : of force and flux linkage, of full scale, that every check must hold
    rounds : of checks at most, each of `checks` points
    drafts : rounds before, with a coarse quadrature, at most: one for every `DRAFTED_FOR` points
    modes : times the tolerance, below which share of a solution's size a mode is left out
    fit : times the tolerance, below which share of the largest of the cubature's sums they are not kept
    trained : solutions whose reduced forces the cubature keeps, beside what force and flux linkage of all points ask
    built_at : points that a model is built for, of many
    looked_at : points at which its error is looked at in the end, of many
    widened : times at most that those where it is too large there are built for as well
    fits : of the cubature at most
    share : of a sum for a reduced force beside one for a number
    """

    tolerance: float = 2.5e-4
    rounds: int = 4
    checks: int = 9
    drafts: int = 5
    modes: float = 1.7
    fit: float = 0.1
    trained: int = 5
    built_at: int = 72
    looked_at: int = 200
    widened: int = 3
    fits: int = 2
    share: float = 0.01


@dataclass(frozen=True)
class Certificate:
    """How far a reduced table may be from the full one; field names as in the command line's JSON.

    Attributes
    ----------
    error_estimate : of force or flux linkage, of full scale: `SAFETY` times the largest of the last checks, at least
        `LEAST_ESTIMATE` times the tolerance
    checked : points where a full step of Newton's was taken from the reduced state of the final model
    effectivity : estimate over the true error, at the worst of them
    """

    error_estimate: float
    checked: int
    effectivity: float


@dataclass(frozen=True, eq=False)
class Reduction:
    """The model, its states at the points, its certificate, and the number of full solutions taken."""

    model: ReducedModel
    states: ReducedStates
    certificate: Certificate
    solutions: int


@dataclass(frozen=True)
class _Taken:
    """A solution in the space: its point, the place of its potential there, after which come the slopes; the scales.

    And how large force and flux linkages are there.
    """

    point: FieldPoints
    place: int
    scales: list[float]
    sizes: Array


class Reducer:
    """Builds the reduced model of a field for points (n,)."""

    def __init__(self, full: FullField, points: FieldPoints, settings: ReductionSettings) -> None:
        self.full, self.settings = full, settings
        self.look_at(points)
        ends = np.unique(points.coordinate)
        data, slopes = full.without_field(float(ends[ends.size // 2]))
        self.space = SnapshotSpace(full.model, data)
        self.solutions = 0
        self._taken: list[_Taken] = []
        self._last: tuple[ReducedModel, ReducedStates] | None = None
        self._fit = settings.fit
        self._without_field(slopes)
        for q in {float(ends[0]), float(ends[-1])}:
            self._without_field(full.without_field(q)[1])
        rest = [float(_rank(np.unique(axis), 0.0)) for axis in points.currents.T]
        self._seen = [np.array([share, *rest]) for share in (0.0, 0.5, 1.0)]

    def look_at(self, points: FieldPoints) -> None:
        """Go on for these points (n,)."""
        self.points = points
        self.places = np.stack([_ranks(axis) for axis in (points.coordinate, *points.currents.T)], axis=1)
        self._driven = np.abs(points.currents).max(axis=1) > 0

    def _without_field(self, vectors: Sequence[Array]) -> None:
        for vector in vectors:
            self.space.add(vector)
        self.solutions += 1

    def take(self, n: int, potential: Array, full: FullField | None = None) -> None:
        """Let a state at the n-th point, whose tangent was the last one factored, and its slopes enter the space.

        `full` : the field it is of, where that is another magnet's on this mesh moved
        """
        q = float(self.points.coordinate[n])
        slopes = (full or self.full).responses(q, potential)
        numbers = (full or self.full).numbers(q, potential)
        sizes = np.abs([numbers.energy_slope, *numbers.flux_linkage])
        place = len(self.space)
        scales = [self.space.add(potential), *(self.space.add(slope, SLOPE_SHARE) for slope in slopes)]
        self._taken.append(_Taken(self.points.only([n]), place, scales, sizes))
        self.solutions += 1

    def farthest(self, count: int) -> list[int]:
        """Points one after the other that are farthest from all seen, which they then are."""
        chosen = []
        for _ in range(count):
            away = np.min([np.linalg.norm(self.places - place, axis=1) for place in self._seen], axis=0)
            chosen.append(int(np.argmax(np.where(self._driven, away, -1.0))))
            self._seen.append(self.places[chosen[-1]])
        return chosen

    def draft(self) -> None:
        """The space from a few points apart, each field from what a model with a coarse quadrature predicts."""
        for count in [1] * (1 + self.points.currents.shape[1]) + [DRAFTED] * self.settings.drafts:
            chosen = self.farthest(count)
            basis = self.space.basis(self.settings.modes * self.settings.tolerance)
            points = self.points.only(chosen)
            model = ReducedModel(basis, self.full.sources, basis.coarse_iron())
            states = model.solve(points, self.taken_in(basis).near(points).states if self._taken else None).states
            for n, state in zip(chosen, states, strict=True):
                self._solve_roughly(n, basis.vectors @ state)

    def _solve_roughly(self, n: int, start: Array) -> None:
        try:
            solution = self.full.solve(self.points, n, start, ROUGH)
        except NotConverged:
            return
        self.take(n, solution.potential)

    def model(self) -> tuple[ReducedModel, ReducedStates, Array] | None:
        """The reduced model of the space with few quadrature points, its states, and by how much the cubature misses.

        None where the states do not converge.

        The points keep what force and flux linkage ask at all points as they are expected, then as they were found;
        and more of it from then on, where they miss too much.
        """
        settings = self.settings
        basis = self.space.basis(settings.modes * settings.tolerance)
        taken = self.taken_in(basis)
        full_scale = np.max([taken.sizes for taken in self._taken], axis=0)
        forces = force_integrands(basis, taken.states[_spread(taken.states, settings.trained)])
        forces *= settings.share
        known = (taken if self._last is None else self._last_in(basis, *self._last)).near(self.points)
        found: list[tuple[ReducedModel, ReducedStates, Array]] = []
        for _ in range(settings.fits):
            rows = np.concatenate([number_integrands(basis, known, full_scale), forces])
            points, weight = sparse_weights(rows, basis.quadrature.weight, tolerance=self._fit * settings.tolerance)
            model = ReducedModel(basis, self.full.sources, basis.some_iron(points, weight), points)
            known = states = model.solve(self.points, known.states)
            if not (states.steps > 0).all():
                return None
            found.append((model, states, model.cubature_error(states, np.arange(len(self.points)))))
            if SAFETY * found[-1][2].max() <= settings.tolerance:
                break
            self._fit = max(self._fit / FINER, settings.fit * FINEST)
        best = min(found, key=lambda one: float(one[2].max()))
        self._last = best[:2]
        return best

    def taken_in(self, basis: Basis) -> KnownStates:
        """The solutions taken, and their slopes, in a basis of the space."""
        places = [taken.place + k for taken in self._taken for k in range(len(taken.scales))]
        found = self.space.within(basis, places, [scale for taken in self._taken for scale in taken.scales])
        each = found.reshape(len(self._taken), -1, basis.size)
        coordinate = np.concatenate([taken.point.coordinate for taken in self._taken])
        currents = np.concatenate([taken.point.currents for taken in self._taken])
        return KnownStates(FieldPoints(coordinate, currents), each[:, 0], each[:, 2:], each[:, 1])

    def _last_in(self, basis: Basis, model: ReducedModel, states: ReducedStates) -> KnownStates:
        """The states of a model in the basis of a larger space."""
        turn = np.linalg.lstsq(basis.vectors, model.basis.vectors)[0].T
        return KnownStates(states.points, states.states @ turn, states.by_current @ turn, states.by_coordinate @ turn)

    def doubtful(self, model: ReducedModel, states: ReducedStates, missed: Array) -> list[int]:
        """Points to check: where the cubature errs most, where the last modes matter most, and far from all."""
        third = self.settings.checks // 3
        chosen = _apart(np.argsort(-missed), self.places, third)
        chosen += _apart(np.argsort(-_sensitivity(model, states)), self.places, third)
        chosen += self.farthest(self.settings.checks - 2 * third)
        return list(dict.fromkeys(chosen))

    def check(
        self, model: ReducedModel, states: ReducedStates, chosen: Sequence[int], *, enrich: bool
    ) -> tuple[Array, list[Array]]:
        """(len(chosen),) estimated errors at points, of full scale; where they are too large the space may grow.

        And the potentials that Newton's steps lead to.
        """
        errors, potentials = np.zeros(len(chosen)), []
        for k, n in enumerate(chosen):
            errors[k], potential = _corrected(self.full, model, states, n)
            if enrich and not SAFETY * errors[k] <= self.settings.tolerance:
                self.take(n, potential)
            potentials.append(potential)
        return errors, potentials

    def effectivity(self, states: ReducedStates, n: int, near: Array, estimate: float) -> float:
        """An estimate over the true error of force or flux linkage, of full scale; a potential nearby is the start."""
        exact = self.full.solve(self.points, n, near, ALONE)
        error = change_of_numbers(self.full, states, n, exact.potential)
        return estimate / error if error > 0 else 1.0

    def reduction(self) -> Reduction | None:
        """The reduced model whose checks all hold; None where none does after all rounds."""
        settings = self.settings
        for attempt in range(settings.rounds):
            built = self.model()
            if built is None:
                return None
            model, states, missed = built
            chosen = self.doubtful(model, states, missed)
            errors, potentials = self.check(model, states, chosen, enrich=attempt + 1 < settings.rounds)
            if (SAFETY * errors <= settings.tolerance).all():
                worst = int(np.argmax(errors))
                estimate = max(SAFETY * float(errors[worst]), LEAST_ESTIMATE * settings.tolerance)
                ratio = self.effectivity(states, chosen[worst], potentials[worst], estimate)
                certificate = Certificate(estimate, len(chosen), ratio)
                return Reduction(model, states, certificate, self.solutions)
        return None


def reduce_at_all(full: FullField, points: FieldPoints, settings: ReductionSettings) -> Reduction | None:
    """The reduced model of many points (n,), built and checked at some of them, then checked at the worst of all.

    Where one of these checks does not hold, the model is built for those points as well. None where that does not help.
    """
    some = _some(points, settings.built_at)
    settings = replace(settings, drafts=min(settings.drafts, len(points) // DRAFTED_FOR))
    reducer = Reducer(full, points.only(some), settings)
    reducer.draft()
    for _ in range(settings.widened):
        reduction = reducer.reduction()
        if reduction is None or some.size == len(points):
            return reduction
        model = reduction.model
        states = model.solve(points)
        if not (states.steps > 0).all():
            return None
        looked_at = _some(points, settings.looked_at)
        error = model.cubature_error(states, looked_at)
        worst = looked_at[np.argsort(-error)[: settings.checks // 3]]
        some = np.union1d(some, worst)
        reducer.look_at(points.only(some))
        among = np.searchsorted(some, worst).tolist()
        errors, _ = reducer.check(model, states.only(some), among, enrich=True)
        before = reduction.certificate
        largest = max(before.error_estimate, SAFETY * float(errors.max()))
        if largest <= settings.tolerance:
            certificate = Certificate(largest, before.checked + len(worst), before.effectivity)
            return Reduction(model, states, certificate, reduction.solutions)
    return None


def _some(points: FieldPoints, most: int) -> Indices:
    """Points spread along the way through all, the corners of coordinate and currents among them."""
    way = points.way()
    ends = np.isin(points.coordinate, [points.coordinate.min(), points.coordinate.max()])
    for current in np.abs(points.currents).T:
        ends &= current == current.max()
    spread = way[np.linspace(0, way.size - 1, min(most, way.size)).round().astype(int)]
    return np.unique(np.r_[spread, np.flatnonzero(ends)])


def _corrected(full: FullField, model: ReducedModel, states: ReducedStates, n: int) -> tuple[float, Array]:
    """The estimated error at a point, of full scale, and the potential that Newton's steps lead to."""
    potential = full.newton_steps(states.points, n, model.basis.vectors @ states.states[n])
    return change_of_numbers(full, states, n, potential), potential


def change_of_numbers(full: FullField, states: ReducedStates, n: int, potential: Array) -> float:
    """How far force and flux linkage of a state are from those of a potential, of full scale."""
    numbers = full.numbers(float(states.points.coordinate[n]), potential)
    force = abs(numbers.energy_slope - states.energy_slope[n]) / np.abs(states.energy_slope).max()
    flux = np.abs(numbers.flux_linkage - states.flux_linkage[n]) / np.abs(states.flux_linkage).max(axis=0)
    return max(float(force), float(flux.max()))


def _ranks(values: Array) -> Array:
    """(n,) places of values among their different ones, 0 to 1."""
    return _rank(np.unique(values), values)


def _rank(different: Array, values: "Array | float") -> Array:
    return np.asarray(np.interp(values, different, np.linspace(0, 1, different.size)))


def _apart(order: Indices, places: Array, count: int) -> list[int]:
    """The first of an order, and those after it that are not close to one taken before."""
    taken: list[int] = []
    for n in order:
        if all(np.linalg.norm(places[n] - places[other]) > CLOSE for other in taken):
            taken.append(int(n))
        if len(taken) == count:
            break
    return taken


def _spread(states: Array, count: int) -> Indices:
    """The states (n, N) that are least combinations of each other: QR with column pivoting."""
    size = np.linalg.norm(states, axis=1)
    scaled = states[size > 0] / np.sqrt(size[size > 0])[:, None]
    order = qr(scaled.T, mode="r", pivoting=True)[1]
    return np.asarray(np.flatnonzero(size > 0)[order[:count]])


def _sensitivity(model: ReducedModel, states: ReducedStates) -> Array:
    """(n,) what force and flux linkage change by, of full scale, when the last third of the modes is left out."""
    model = model.without_last(model.basis.size // 3)
    fewer = model.solve(states.points, states.states[:, : model.basis.size])
    parts = [(states.energy_slope[:, None], fewer.energy_slope[:, None]), (states.flux_linkage, fewer.flux_linkage)]
    return np.max([np.abs(a - b).max(axis=1) / np.abs(a).max() for a, b in parts], axis=0)
