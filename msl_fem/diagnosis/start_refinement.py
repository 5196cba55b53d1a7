"""Starts of stretches on their way to those that leave least, by Gauss-Newton's method."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.stretches import Stretches, moved

LOST = 1e6  # times the noise, that stand for a stretch that left table or range
FAR_MORE = 2.0  # times what another start leaves over a stretch, with which one has lost its way
SETTLED = 2e-3  # moves of the starts, in units of their prior, that are none
FALLS = 0.5  # of what was left, below which what is tried is better whatever single stretches say
LITTLE, MOST_IDLE = 1.0, 2  # squares that moves bring, all stretches together, and how often in a row they may
NEAR_BY = 0.3  # moves of the starts behind which slopes are those before


@dataclass(frozen=True, eq=False)
class Simulated:
    """Stretches with their slopes, what is left over the noise (n_channel, n_sample), and its squares of each
    stretch."""

    cut: Stretches
    left: Array
    costs: Array

    @classmethod
    def of(cls, cut: Stretches, over: Array) -> "Simulated":
        finite = np.isfinite(over.sum())  # as mostly: then nothing has to be looked for
        squares = np.sum((over if finite else np.nan_to_num(over, nan=LOST)) ** 2, axis=0)
        return cls(cut, over.copy() if finite else np.nan_to_num(over), np.add.reduceat(squares, cut.begins))

    @property
    def total(self) -> float:
        """Of the stretches that count."""
        return float(np.sum(self.costs if self.cut.outside is None else self.costs[~self.cut.outside]))

    def or_better(self, other: "Simulated") -> "Simulated":
        """Of each stretch the one that leaves less, each as it was simulated behind its own ones."""
        better = other.costs < self.costs
        now = np.repeat(better, np.diff([*self.cut.begins, self.left.shape[1]]))
        starts = np.where(better[:, None], other.cut.starts, self.cut.starts)
        slopes = np.where(now, other.cut.slopes, self.cut.slopes)
        left = np.where(now, other.left, self.left)
        return Simulated(replace(self.cut, starts=starts, slopes=slopes), left, np.minimum(self.costs, other.costs))


class StartRefinement:
    """Starts of stretches on their way to those that leave least.

    Where all that a state keeps over a start soon settles, each stretch is better or worse by itself. Where something
    lasts, as the motion of a second mass, a stretch follows from what those before have done to the model: of some
    starts that are better and others that are not, what they leave together tells a simulation alone.
    """

    def __init__(
        self,
        cut: Stretches,
        sigmas: Array,
        *,
        by_themselves: bool,
        hopeless: Callable[[Stretches], NDArray[np.bool_]] | None = None,
    ) -> None:
        """`by_themselves` are stretches of which none follows from those before; `hopeless` tells for which no starts
        are looked for."""
        self.cut = cut
        self._hopeless = hopeless
        self.settled = self.near_by = False
        self._idle, self._sigmas = 0, sigmas
        self._part = np.ones(cut.begins.size)
        self._kept: Simulated | None = None
        self._every: tuple[Simulated, ...] = ()
        self._by_themselves = by_themselves

    @property
    def best(self) -> Stretches:
        return self.cut if self._kept is None else self._kept.cut

    @property
    def least(self) -> Array:
        """(n_stretch,) squares that are left."""
        assert self._kept is not None
        return self._kept.costs

    def take(self, over: Array, slopes: Array | None) -> None:
        """Residuals over the noise (n_channel, n_sample), and slopes of the starts, at `cut`: the better ones of each
        stretch are kept. Without slopes those before are kept."""
        found = Simulated.of(replace(self.cut, slopes=self.best.slopes if slopes is None else slopes), over)
        before, self._every = self._kept, ()
        if before is None:
            self._kept = found
            if self._hopeless is not None:
                self._part[self._hopeless(found.cut)] = 0.0
            return
        if not self._by_themselves and found.total < FALLS * before.total:
            self._kept = found
            self._part[self._part > 0.0] = 1.0
            self._idle = 0
            return
        better = found.costs < before.costs
        self._part = np.where(better & (self._part > 0.0), 1.0, self._part / 2)
        self._kept = before.or_better(found)
        if better.any() and not better.all() and not self._by_themselves:
            self._every = before, found
        else:
            self._tells_idle(before)

    @property
    def mixed(self) -> bool:
        """Whether what is kept has to be simulated: `mix` takes what it leaves."""
        return bool(self._every)

    def mix(self, over: Array) -> None:
        """What the kept starts leave together, over the noise: the best is kept of these, those before, and those that
        were tried last."""
        assert self._kept is not None
        mixed = Simulated.of(self._kept.cut, over)
        before, found = self._every
        self._kept = min((before, found, mixed), key=lambda one: one.total)
        if self._kept is before:
            self._part /= 2
        if self._kept is found:
            self._part[self._part > 0.0] = 1.0
        self._tells_idle(before)

    def _tells_idle(self, before: Simulated) -> None:
        assert self._kept is not None
        self._idle = self._idle + 1 if before.total - self._kept.total < LITTLE else 0

    def or_better(self, other: "StartRefinement") -> Stretches:
        """Of each stretch the start that leaves less, of both."""
        assert self._kept is not None
        assert other._kept is not None
        return self._kept.or_better(other._kept).cut

    def give_up(self, least: Array) -> None:
        """Lets stretches stay that leave far more than the least known, (n_stretch,), of which something else is
        nearer to what suits them."""
        self._part = np.where(self.least > FAR_MORE * least, 0.0, self._part)

    def move(self) -> None:
        """A Gauss-Newton step of the starts, or a part of it."""
        assert self._kept is not None
        moves = self._part[:, None] * self.best.moves(self._kept.left[:, None])[0]
        largest = float(np.abs(moves).max())
        self.settled, self.near_by = largest < SETTLED or self._idle >= MOST_IDLE, largest < NEAR_BY
        self.cut = replace(self.best, starts=moved(self.best.starts, moves * self._sigmas))
