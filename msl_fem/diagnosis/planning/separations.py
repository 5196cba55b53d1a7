"""How far apart causes are in a planned run, by what instruments: the noncentrality of one over another.

The truth is the change of the readings that the cause makes at its full size, all orders of it. The rival is fitted in
its amounts, and everything that is not known within its tolerance with it, in whichever of its forms comes nearest: the
linear model first, then what is left is simulated anew where that has led (Gauss-Newton steps with the slopes of the
belief). A delay and a lag of one pole, alike to first order, differ by the second, which goes with the square of the
amount; and what tolerances make up for, they do so in all orders.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import DECIDES
from msl_fem.diagnosis.planning.absorbed import BelievedRefit, channel_parts
from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.effects import EffectValues

RUN_INSTRUMENTS = ("position", "current", "voltage")
"""What is sampled along a run: the first word of its columns."""
BESIDE = {
    "gauge-block": "a gauge block under the position sensor",
    "scales": "the mover weighed",
    "ohmmeter": "the coils' resistance",
    "load-cell": "one force at rest, by a load cell",
}
"""What is measured once beside the runs, and its name in `beside_a_run`."""
INSTRUMENTS = (*RUN_INSTRUMENTS, *BESIDE)
Pair = tuple[str, str]
ChangeOf = Callable[[ExpectedCause], Array]
"""The change of the readings by a cause, (n_number,) over the noise; raises as `PlannedRuns.record`."""


ITS_OWN = 0.5
"""Of the noncentrality of a cause over none: what a rival leaves at most that could have been taken for the cause."""
SETTLED, LITTLE = 0.05, 0.1  # share of d^2, and of itself, that another round may bring and is not worth it
WEAK = 1e-10  # prior of an amount, over what the run tells of it where all else is known
ROUNDS = 6
NEAREST = 2  # forms of a rival that are simulated anew
SHARES = (1.0, 0.1, 0.01)
"""Of a form's amounts, at which its slopes are taken."""


@dataclass(frozen=True, eq=False)
class CauseInRun:
    """A cause at its size, and the forms that are fitted to others: their amounts are free."""

    cause: ExpectedCause
    forms: tuple[ExpectedCause, ...]


class Separations:
    """The causes of a planned run, told apart.

    Parameters
    ----------
    believed : effects that are there besides
    weight : seconds planned over seconds simulated
    rounds : how often at most what a rival leaves is simulated anew; 0: the linear model
    """

    def __init__(
        self,
        refit: BelievedRefit,
        causes: Mapping[str, CauseInRun],
        change_of: ChangeOf,
        *,
        believed: EffectValues | None = None,
        weight: float,
        rounds: int = ROUNDS,
    ) -> None:
        self.rounds = rounds
        self.refit, self.causes, self.change_of, self.believed = refit, causes, change_of, believed
        self.root = np.sqrt(weight)
        self.columns = self.root * refit.columns
        self.parts = list(channel_parts(refit.likelihood))
        named = {words: instrument for instrument, words in BESIDE.items()}
        self.measures = {named[measure.name]: measure for measure in refit.measures()}
        self.rows = {name: refit.measured_row(measure) for name, measure in self.measures.items()}
        self._changes: dict[tuple[str, tuple[tuple[str, float], ...]], Array] = {}
        self._readings: dict[frozenset[str], _Readings] = {}
        self.changes = {name: self.change(one.cause) for name, one in causes.items()}

    def change(self, cause: ExpectedCause) -> Array:
        """The change by a cause, kept; raises as `change_of`."""
        key = cause.effect, tuple(cause.values.items())
        if key not in self._changes:
            self._changes[key] = self.root * self.change_of(cause)
        return self._changes[key]

    def measured(self, instrument: str, cause: ExpectedCause) -> float:
        """By how much a cause changes a number measured beside the run, over its sigma."""
        return self.refit.measured_change(self.measures[instrument], cause.beside(self.believed))

    def distance(self, truth: str, rival: str | None, instruments: Iterable[str]) -> float:
        """d^2 of a cause over another, or over none."""
        read = self._read(instruments)
        return read.alone(truth) if rival is None else read.nearest(truth, rival)[0]

    def all_suited(self, truth: str, instruments: Iterable[str]) -> list[ExpectedCause]:
        """All causes, those that could be taken for one of them in the form and at the amounts that come nearest."""
        read = self._read(instruments)
        found = []
        for name, one in self.causes.items():
            distance, nearest = (np.inf, None) if name == truth else read.nearest(truth, name)
            alike = nearest is not None and distance < ITS_OWN * read.alone(truth)
            found.append(nearest if alike and nearest is not None else one.cause)
        return found

    def apart(self, first: str, second: str, instruments: Sequence[str]) -> float:
        """d^2 of two causes whichever is the truth: the lesser one."""
        return min(self.distance(first, second, instruments), self.distance(second, first, instruments))

    def pairs(self, instruments: Sequence[str], *, every: bool = False) -> dict[Pair, float]:
        """d^2 of every two causes that are seen at all, or of all that there are."""
        names = [name for name in self.causes if every or self.distance(name, None, instruments) >= DECIDES]
        return {
            (first, second): self.apart(first, second, instruments)
            for n, first in enumerate(names)
            for second in names[n + 1 :]
        }

    def one_way(self, pairs: Iterable[Pair], instruments: Sequence[str]) -> dict[Pair, float]:
        """The greater d^2 of two causes, with which one of them is told from the other if it is the truth."""
        return {
            (first, second): max(self.distance(first, second, instruments), self.distance(second, first, instruments))
            for first, second in pairs
        }

    def unseen(self, instruments: Sequence[str]) -> list[str]:
        """Causes that what is not known makes up for."""
        return [name for name in self.causes if self.distance(name, None, instruments) < DECIDES]

    def _read(self, instruments: Iterable[str]) -> "_Readings":
        key = frozenset(instruments)
        if key not in self._readings:
            self._readings[key] = _Readings(self, key)
        return self._readings[key]


@dataclass(frozen=True, eq=False)
class _FreeForm:
    """A form whose amounts are free: of each the change that it makes alone, and what of that no unknown makes up for,
    (n_amount, n_number); the curvature of d^2 over the amounts, and the multiples (n_amount, 2) that are allowed."""

    form: ExpectedCause
    slopes: Array
    left: Array
    curvature: Array
    allowed: Array

    def least(self, target: Array) -> Array:
        """The amounts, as multiples of the form's, that come nearest to a change."""
        return self.nearer(target, np.zeros(len(self.left)))

    def nearer(self, target: Array, multiples: Array) -> Array:
        """By how much to move them, from where these leave that of a change: least squares, an amount that would go
        beyond its bounds at its bound."""
        slope, (low, high) = self.left @ target, (self.allowed - multiples[:, None]).T
        move, free = np.zeros(slope.size), np.ones(slope.size, dtype=bool)
        while free.any():
            right = slope[free] - self.curvature[np.ix_(free, ~free)] @ move[~free]
            move[free] = np.linalg.solve(self.curvature[np.ix_(free, free)], right)
            beyond = free & ((move < low) | (move > high))
            if not beyond.any():
                break
            move, free = np.clip(move, low, high), free & ~beyond
        return move


class _Readings:
    """What a set of instruments reads of a planned run."""

    def __init__(self, separations: Separations, instruments: frozenset[str]) -> None:
        self.all = separations
        self.kept = [part for name, part in separations.parts if name.partition("_")[0] in instruments]
        self.beside = [name for name in separations.rows if name in instruments]
        rows = [separations.columns[part] for part in self.kept] + [separations.rows[n][None] for n in self.beside]
        self.columns = np.concatenate(rows) if rows else np.zeros((0, separations.columns.shape[1]))
        self._inverse = np.linalg.inv(self.columns.T @ self.columns + np.eye(self.columns.shape[1]))
        self._alone: dict[str, float] = {}
        self._forms: dict[str, list[_FreeForm]] = {}
        self._nearest: dict[Pair, tuple[float, ExpectedCause | None]] = {}

    def of(self, cause: ExpectedCause) -> Array:
        """The change by a cause, (n_number,)."""
        change = self.all.change(cause)
        return np.concatenate(
            [*(change[part] for part in self.kept), [self.all.measured(n, cause) for n in self.beside]]
        )

    def left(self, changes: Array) -> Array:
        """What of changes (..., n_number) no unknown within its tolerance makes up for, so that its product with a
        change is that of both."""
        return np.asarray(changes - ((changes @ self.columns) @ self._inverse) @ self.columns.T)

    @cached_property
    def targets(self) -> dict[str, Array]:
        return {name: self.of(one.cause) for name, one in self.all.causes.items()}

    def alone(self, truth: str) -> float:
        """d^2 of a cause over none."""
        if truth not in self._alone:
            self._alone[truth] = self._over_none(self.targets[truth])
        return self._alone[truth]

    def nearest(self, truth: str, rival: str) -> tuple[float, ExpectedCause | None]:
        """d^2 over a rival, and that in its form and at its amounts; None where no form comes nearer than none."""
        if (truth, rival) not in self._nearest:
            if rival not in self._forms:
                tried = [self._free(form) for form in self.all.causes[rival].forms]
                self._forms[rival] = [free for free in tried if free is not None]
            target = self.targets[truth]
            best: tuple[float, ExpectedCause | None] = (self.alone(truth), None)
            linear = [(free, free.least(target)) for free in self._forms[rival]]
            linear.sort(key=lambda one: self._square(target - one[1] @ one[0].slopes))
            for free, multiples in linear[:NEAREST]:
                distance, cause = self._over_form(target, free, multiples)
                best = min(best, (distance, cause), key=lambda one: one[0])
            self._nearest[truth, rival] = best
        return self._nearest[truth, rival]

    def _free(self, form: ExpectedCause) -> _FreeForm | None:
        """The form with free amounts, its slopes at the largest of a few shares of it that the run bears."""
        for share in SHARES:
            one = form.times([share] * len(form.amounts))
            try:
                slopes = np.array([self.of(one.only(name)) for name in one.amounts])
            except (InputError, ComputationError):
                continue
            left = self.left(slopes)
            curvature = slopes @ left.T + WEAK * np.diag(np.sum(slopes**2, axis=1) + WEAK)
            return _FreeForm(one, slopes, left, curvature, np.array([one.most(name) for name in one.amounts]))
        return None

    def _over_form(self, target: Array, free: _FreeForm, multiples: Array) -> tuple[float, ExpectedCause]:
        """d^2 over a form, and that at the amounts that suit, from where the linear model has them.

        What is left then is simulated anew at these amounts and at the unknowns that go with them, as often as that
        moves it: of a change of hundreds of sigma the second order of what makes up for it counts.
        """
        rest = target - multiples @ free.slopes
        distance = self._square(rest)
        for _ in range(self.all.rounds):
            cause = free.form.times(multiples)
            again = self._simulated(target, cause, self._unknowns(rest))
            if again is None:
                break
            move = free.nearer(again, multiples)
            rest, multiples, before = again - move @ free.slopes, multiples + move, distance
            distance = self._square(rest)
            if abs(distance - before) <= SETTLED * distance + LITTLE:
                break
        return distance, free.form.times(multiples)

    def _over_none(self, target: Array) -> float:
        """The same over none."""
        rest, distance = target, self._square(target)
        for _ in range(self.all.rounds):
            again = self._simulated(target, None, self._unknowns(rest))
            if again is None:
                break
            rest, before = again, distance
            distance = self._square(rest)
            if abs(distance - before) <= SETTLED * distance + LITTLE:
                break
        return distance

    def _unknowns(self, rest: Array) -> Array:
        """Where the unknowns go that make up for a change."""
        return np.asarray(-self._inverse @ (self.columns.T @ rest))

    def _simulated(self, target: Array, cause: ExpectedCause | None, z: Array) -> Array | None:
        """What a cause and unknowns at z leave of a change, less what these take to first order; None where the model
        does not bear it."""
        try:
            effects = self.all.believed if cause is None else cause.beside(self.all.believed)
            change = np.zeros(target.size) if cause is None else self.of(cause)
            moved = self.all.root * self.all.refit.moved(z, effects)
        except (InputError, ComputationError):
            return None
        beside = [self.all.refit.measured_moved(self.all.measures[name], z, effects) for name in self.beside]
        rest = target - change + np.concatenate([*(moved[part] for part in self.kept), beside]) - self.columns @ z
        return rest if np.isfinite(rest).all() else None

    def _square(self, change: Array) -> float:
        return max(float(change @ self.left(change)), 0.0)


def groups(names: Sequence[str], pairs: Mapping[Pair, float]) -> list[list[str]]:
    """Causes that are not told apart, with one another or over others; single ones are told from all."""
    found: list[list[str]] = []
    for name in names:
        near = [g for g in found if any(_undecided(pairs, name, other) for other in g)]
        found = [g for g in found if g not in near] + [[*(other for g in near for other in g), name]]
    return found


def _undecided(pairs: Mapping[Pair, float], first: str, second: str) -> bool:
    return pairs.get((first, second), pairs.get((second, first), np.inf)) < DECIDES
