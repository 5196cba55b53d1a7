"""How far apart causes are in a planned run, by what instruments: the noncentrality of one over another.

The truth is the change of the readings that the cause makes at its full size, all orders of it. The rival is fitted in
its amount, and everything that is not known within its tolerance with it (`separation`, in the linear model), in
whichever of its forms comes nearest. A rival that makes up for nearly all of it is simulated anew at the amount that
was fitted: a delay and a lag of one pole, alike to first order, differ by the second, which goes with the square of the
amount.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import DECIDES
from msl_fem.diagnosis.planning.absorbed import BelievedRefit, channel_parts
from msl_fem.diagnosis.separation import Measure
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


ALIKE = 0.01
"""Of the noncentrality of a cause over none: what a rival leaves that is alike to first order."""
_SAME_AMOUNT = 0.03
WEAK = 1e-12  # prior of an amount, over what the run tells of it
_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class CauseInRun:
    """A cause in a planned run.

    Attributes
    ----------
    effects : all that there are with it
    change_at : the change of the readings, (n_number,) over the noise, at a multiple of its size; raises as
        `PlannedRuns.record`
    other_forms : the same of other forms that it may have
    """

    effects: EffectValues
    change_at: Callable[[float], Array]
    other_forms: tuple[Callable[[float], Array], ...] = ()

    @property
    def forms(self) -> tuple[Callable[[float], Array], ...]:
        return self.change_at, *self.other_forms


class Separations:
    """The causes of a planned run, told apart.

    Parameters
    ----------
    weight : seconds planned over seconds simulated
    """

    def __init__(self, refit: BelievedRefit, causes: Mapping[str, CauseInRun], *, weight: float) -> None:
        self.causes, self.root = causes, np.sqrt(weight)
        self.columns = self.root * refit.columns
        self.scaled: dict[tuple[str, int, float], Array] = {}
        self.changes = {name: self._change(name, 1.0) for name in causes}
        self.parts = list(channel_parts(refit.likelihood))
        self.rows: dict[str, Array] = {}
        self.seen: dict[str, dict[str, float]] = {}
        named = {words: instrument for instrument, words in BESIDE.items()}
        for measure in refit.measures():
            self._add(named[measure.name], measure, refit)

    def _add(self, instrument: str, measure: Measure, refit: BelievedRefit) -> None:
        self.rows[instrument] = refit.measured_row(measure)
        self.seen[instrument] = {
            name: refit.measured_change(measure, cause.effects) for name, cause in self.causes.items()
        }

    def _change(self, name: str, amount: float, form: int = 0) -> Array:
        """The change by a multiple of a cause in a form, kept; of one that is not borne that of the cause, scaled."""
        key = (name, form, float(f"{amount:.2g}"))
        if key not in self.scaled:
            try:
                self.scaled[key] = self.root * self.causes[name].forms[form](key[2])
            except (InputError, ComputationError):
                if (form, amount) == (0, 1.0):
                    raise
                self.scaled[key] = key[2] * self.changes[name]
        return self.scaled[key]

    def distance(self, truth: str, rival: str | None, instruments: Iterable[str]) -> float:
        """d^2 of a cause over another, or over none."""
        read = _Readings(self, set(instruments))
        target = read.of(truth, 1.0)
        alone = read.least(target, None)[0]
        if rival is None:
            return alone
        return min(read.over_form(target, alone, rival, form) for form in range(len(self.causes[rival].forms)))

    def apart(self, first: str, second: str, instruments: Sequence[str]) -> float:
        """d^2 of two causes whichever is the truth: the lesser one."""
        return min(self.distance(first, second, instruments), self.distance(second, first, instruments))

    def pairs(self, instruments: Sequence[str]) -> dict[Pair, float]:
        """d^2 of every two causes that are seen at all."""
        names = [name for name in self.causes if self.distance(name, None, instruments) >= DECIDES]
        return {
            (first, second): self.apart(first, second, instruments)
            for n, first in enumerate(names)
            for second in names[n + 1 :]
        }

    def unseen(self, instruments: Sequence[str]) -> list[str]:
        """Causes that what is not known makes up for."""
        return [name for name in self.causes if self.distance(name, None, instruments) < DECIDES]


class _Readings:
    """What a set of instruments reads of a planned run."""

    def __init__(self, separations: Separations, instruments: set[str]) -> None:
        self.all = separations
        self.kept = [part for name, part in separations.parts if name.partition("_")[0] in instruments]
        self.beside = [name for name in separations.rows if name in instruments]
        rows = [separations.columns[part] for part in self.kept] + [separations.rows[n][None] for n in self.beside]
        self.columns = np.concatenate(rows) if rows else np.zeros((0, separations.columns.shape[1]))

    def of(self, name: str, amount: float, form: int = 0) -> Array:
        """A cause at a multiple of its size."""
        change = self.all._change(name, amount, form)
        seen = [amount * self.all.seen[one][name] for one in self.beside]
        return np.concatenate([*(change[part] for part in self.kept), seen])

    def over_form(self, target: Array, alone: float, rival: str, form: int) -> float:
        """d^2 over a rival in one of its forms, at the amount that suits; `alone` is that over none."""
        amount = 1.0
        distance, factor = self.least(target, self.of(rival, amount, form))
        for _ in range(_ROUNDS):
            if not (distance < ALIKE * alone and factor > 0 and abs(np.log(factor)) > _SAME_AMOUNT):
                break
            amount = float(f"{amount * factor:.2g}")
            distance, factor = self.least(target, self.of(rival, amount, form))
        return distance

    def least(self, target: Array, rival: Array | None) -> tuple[float, float]:
        """(d^2, how much of the rival) where the rival and all that is unknown are fitted to a change."""
        columns, prior = self.columns, np.ones(self.columns.shape[1])
        if rival is not None:
            columns = np.column_stack([columns, -rival])
            prior = np.append(prior, WEAK * max(float(rival @ rival), WEAK))
        move = -np.linalg.solve(columns.T @ columns + np.diag(prior), columns.T @ target)
        rest = target + columns @ move
        return float(rest @ rest + prior @ move**2), float(move[-1])


def groups(names: Sequence[str], pairs: Mapping[Pair, float]) -> list[list[str]]:
    """Causes that are not told apart, with one another or over others; single ones are told from all."""
    found: list[list[str]] = []
    for name in names:
        near = [g for g in found if any(_undecided(pairs, name, other) for other in g)]
        found = [g for g in found if g not in near] + [[*(other for g in near for other in g), name]]
    return found


def _undecided(pairs: Mapping[Pair, float], first: str, second: str) -> bool:
    return pairs.get((first, second), pairs.get((second, first), np.inf)) < DECIDES
