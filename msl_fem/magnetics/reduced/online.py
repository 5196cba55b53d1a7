"""Where the states of a reduced space are sought: each from those found before it, or from what is expected."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.splines import hermite_cubic
from msl_fem.magnetics.reduced.linear_systems import SystemsAt, linear_products
from msl_fem.magnetics.reduced.newton import newton
from msl_fem.magnetics.reduced.reduced_iron import IronTerms, ReducedIron
from msl_fem.materials.curves import Indices

SAME_WAY = 1e-9  # of a step of the currents
MANY = 16  # points from which on products of the gradients are worth their making
AT_ONCE = 256  # points
APART = 3  # coordinates from one that is gone along to the next


class ReducedProblem(NamedTuple):
    """What is solved at points (n,): the linear regions in a reduced space, the coils, the irons.

    Attributes
    ----------
    place, coordinate : (n,) which of the coordinates q (n_q,)
    currents : (n, coil)
    stiffness, slope : (n_q, N, N) of the linear regions, and its derivative with respect to q
    sources : (coil, N)
    iron : the quadrature
    """

    place: Indices
    coordinate: Array
    currents: Array
    stiffness: Array
    slope: Array
    sources: Array
    iron: ReducedIron


class StatesAt:
    """Where the points' states are found: points with their start at once, or along ways.

    Attributes
    ----------
    states, by_current, by_coordinate : (n, N), dc/di (n, coil, N), dc/dq (n, N)
    steps : (n,) Newton's, 0 where they did not converge
    """

    def __init__(self, problem: ReducedProblem) -> None:
        self.problem = problem
        n, n_coil, size = problem.place.size, *problem.sources.shape
        self.states, self.steps = np.zeros((n, size)), np.zeros(n, dtype=np.int64)
        self.by_current, self.by_coordinate = np.zeros((n, n_coil, size)), np.zeros((n, size))
        self._load = problem.currents @ problem.sources
        self._terms = IronTerms(problem.iron, many=n >= MANY)

    def seek(self, batch: Indices, expected: Array) -> None:
        """The states of some points from what is expected (len(batch), N), or else from none, and their slopes."""
        for begin in range(0, len(batch), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            self._seek(batch[part], expected[part])

    def _seek(self, batch: Indices, expected: Array) -> None:
        place, load = self.problem.place[batch], self._load[batch]
        driven = np.asarray(load.any(axis=1))  # where not, there is no field, to the last bit
        found = newton(expected * driven[:, None], SystemsAt(self.problem.stiffness, place), load, self._terms)
        self.states[batch], self.steps[batch] = found.states, found.steps
        pull = -linear_products(self.problem.slope, place, found.states[:, None])
        sources = np.broadcast_to(self.problem.sources, (batch.size, *self.problem.sources.shape))
        answer = found.responses(np.concatenate([sources, pull], axis=1), self._terms)
        self.by_current[batch], self.by_coordinate[batch] = answer[:, :-1], answer[:, -1]
        failed = batch[found.steps == 0]
        if failed.size and expected.any():
            self._seek(failed, np.zeros((failed.size, expected.shape[1])))

    def go(self, ways: Sequence[Indices]) -> None:
        """The states along ways (each n_way,) of one coordinate after the other.

        Some are gone in step, each point from those before it. Those between two of them at the same currents, all at
        once, from the cubic along the coordinate.
        """
        between = [k for k in range(1, len(ways) - 1) if k % APART and self._alike(ways, k)]
        self._march([ways[k] for k in np.setdiff1d(np.arange(len(ways)), between)])
        if between:
            expected = [self._between(*(ways[n] for n in (*_ends(k, len(ways)), k))) for k in between]
            self.seek(np.concatenate([ways[k] for k in between]), np.concatenate(expected))

    def _alike(self, ways: Sequence[Indices], k: int) -> bool:
        """Whether a way has the currents of the two that it lies between, in their order."""
        one, *others = (self.problem.currents[ways[n]] for n in (k, *_ends(k, len(ways))))
        return all(np.array_equal(one, other) for other in others)

    def _between(self, first: Indices, last: Indices, way: Indices) -> Array:
        """(n_way, N) on a way between two others, by the cubic along the coordinate; the logarithm of a gap."""
        q = self.problem.coordinate
        per_unit = q if q.min() > 0.0 else np.ones_like(q)  # dq/du
        u = np.log(q) if q.min() > 0.0 else q
        start, end, here = (self.problem.place[one[0]] for one in (first, last, way))
        width = u[end] - u[start]
        slopes = tuple(self.by_coordinate[one] * (per_unit[at] * width) for one, at in ((first, start), (last, end)))
        return hermite_cubic((self.states[first], self.states[last]), slopes, (u[here] - u[start]) / width)

    def _march(self, ways: Sequence[Indices]) -> None:
        """The states along ways gone in step, each point from those before it."""
        for k in range(max(map(len, ways))):
            on = [way[max(k - 2, 0) : k + 1] for way in ways if k < len(way)]
            self.seek(np.array([way[-1] for way in on]), self._expected(np.array(on).T))

    def _expected(self, on: Indices) -> Array:
        """(n, N) at the last of the points (up to 3, n), by the cubic of the two before where it leads on to them."""
        if len(on) == 1:
            return np.zeros((on.shape[1], self.states.shape[1]))
        currents = self.problem.currents[on]
        last, expected = on[-2], self.states[on[-2]] + self._rise(currents[-1] - currents[-2], on[-2])
        if len(on) == 2:
            return expected
        before, ratio = currents[1] - currents[0], same_way(*currents)
        slopes = self._rise(before, on[0]), self._rise(before, last)
        further = hermite_cubic((self.states[on[0]], self.states[last]), slopes, 1.0 + ratio[:, None])
        straight = (ratio > 0.0) & (self.steps[on[0]] > 0) & (self.steps[last] > 0)
        return np.where(straight[:, None], further, expected)

    def _rise(self, currents: Array, at: Indices) -> Array:
        """(n, N) what the slopes at points (n,) make of steps of the currents (n, coil)."""
        return np.asarray(np.einsum("nk,nkj->nj", currents, self.by_current[at]))


def _ends(k: int, n: int) -> tuple[int, int]:
    """Which of n ways, every `APART`th and the last one, the k-th lies between."""
    before = k - k % APART
    return before, min(before + APART, n - 1)


def same_way(first: Array, second: Array, third: Array) -> Array:
    """How many times steps from the first to the second currents (..., coil) lead on to the third; 0 if they do not."""
    step, further = second - first, third - second
    size = (step * step).sum(axis=-1)
    ratio = (step * further).sum(axis=-1) / np.where(size > 0.0, size, 1.0)
    aside = np.abs(further - ratio[..., None] * step).max(axis=-1)
    return np.where((ratio > 0.0) & (aside <= SAME_WAY * np.sqrt(size)), ratio, 0.0)
