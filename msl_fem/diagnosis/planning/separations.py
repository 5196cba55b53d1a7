"""How far apart causes are in a planned run, by what instruments: the noncentrality of one over another.

The truth is the change of the readings that the cause makes at its full size, all orders of it. The rival is fitted in
its amount, and everything that is not known within its tolerance with it (`separation`, in the linear model): so a
delay and a lag, alike to first order, differ by the second.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.next_experiment import DECIDES
from msl_fem.diagnosis.planning.absorbed import BelievedRefit, channel_parts
from msl_fem.diagnosis.separation import Measure
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


@dataclass(frozen=True, eq=False)
class CauseInRun:
    """A cause in a planned run: all effects that there are then, and the change of the readings (n_number,)."""

    effects: EffectValues
    change: Array


class Separations:
    """The causes of a planned run, told apart.

    Parameters
    ----------
    weight : seconds planned over seconds simulated
    """

    def __init__(self, refit: BelievedRefit, causes: Mapping[str, CauseInRun], *, weight: float) -> None:
        self.causes, root = causes, np.sqrt(weight)
        self.columns = root * refit.columns
        self.changes = {name: root * cause.change for name, cause in causes.items()}
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

    def distance(self, truth: str, rival: str | None, instruments: Iterable[str]) -> float:
        """d^2 of a cause over another, or over none."""
        columns, target = self._read(truth, rival, set(instruments))
        prior = np.ones(columns.shape[1])
        prior[self.columns.shape[1] :] = 1e-12 * max(float(np.sum(columns[:, -1] ** 2)), 1e-300)
        move = -np.linalg.solve(columns.T @ columns + np.diag(prior), columns.T @ target)
        rest = target + columns @ move
        return float(rest @ rest + prior @ move**2)

    def _read(self, truth: str, rival: str | None, instruments: set[str]) -> tuple[Array, Array]:
        """(columns of all that may move, the change to be followed) as these instruments read them."""
        kept = [part for name, part in self.parts if name.partition("_")[0] in instruments]
        beside = [name for name in self.rows if name in instruments]
        rows = [self.columns[part] for part in kept] + [self.rows[name][None] for name in beside]
        columns = np.concatenate(rows) if rows else np.zeros((1, self.columns.shape[1]))
        if not rows:
            return columns, np.zeros(1)
        changes = [
            np.concatenate([*(self.changes[name][part] for part in kept), [self.seen[b][name] for b in beside]])
            for name in (truth, *([] if rival is None else [rival]))
        ]
        moving = columns if rival is None else np.column_stack([columns, -changes[1]])
        return moving, changes[0]

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


def groups(names: Sequence[str], pairs: Mapping[Pair, float]) -> list[list[str]]:
    """Causes that are not told apart, with one another or over others; single ones are told from all."""
    found: list[list[str]] = []
    for name in names:
        near = [g for g in found if any(_undecided(pairs, name, other) for other in g)]
        found = [g for g in found if g not in near] + [[*(other for g in near for other in g), name]]
    return found


def _undecided(pairs: Mapping[Pair, float], first: str, second: str) -> bool:
    return pairs.get((first, second), pairs.get((second, first), np.inf)) < DECIDES
