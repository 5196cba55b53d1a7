"""Newton's iteration in a reduced space, at many points in step; what goes over the quadrature is compiled."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dposv, dpotrs

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.splines import hermite_cubic
from msl_fem.materials.curves import NO_FIELD, Curves, Indices, magnetise_all

ACCEPTED = 1e-5  # relative energy norm of the last of Newton's steps: its square is left, slopes 5e-6 of the largest
SAME_WAY = 1e-9  # of a step of the currents
MOST_STEPS, MOST_TRIALS = 60, 30
MANY = 16  # points from which on products of the gradients are worth their making


class ReducedIron(NamedTuple):
    """Quadrature of the irons' energy in a reduced space of N functions.

    Attributes
    ----------
    gradients : (2 n_point, N) both derivatives of each function, point after point; their size is |B|
    weight : (n_point,) positive
    iron : (n_point,) which of the curves
    """

    gradients: Array
    weight: Array
    iron: Indices
    curves: Curves


@compiled
def magnetise_fields(field: Array, iron: ReducedIron, curvature: Array) -> None:
    """Gradients (n, 2 n_point) of states to weighted H, in place; `curvature` (n, 3 n_point) is written unless empty.

    It holds w dH/dB: all its xx entries, then xy, then yy. With n = B/|B|: dH/dB = H/B + (dH/d|B| - H/B) n n^T.
    """
    n_point = iron.weight.size
    size, h, slope = np.empty(n_point), np.empty(n_point), np.empty(n_point)
    for k in range(field.shape[0]):
        for q in range(n_point):
            size[q] = np.sqrt(field[k, 2 * q] ** 2 + field[k, 2 * q + 1] ** 2)
        magnetise_all(size, iron.iron, iron.curves, h, slope)
        for q in range(n_point):
            x, y, b, w = field[k, 2 * q], field[k, 2 * q + 1], size[q], iron.weight[q]
            nu, excess = slope[q], 0.0
            if b > NO_FIELD:
                nu = h[q] / b
                excess = (slope[q] - nu) / (b * b)
            field[k, 2 * q], field[k, 2 * q + 1] = w * nu * x, w * nu * y
            if curvature.size:
                curvature[k, q] = w * (nu + excess * x * x)
                curvature[k, n_point + q] = w * excess * x * y
                curvature[k, 2 * n_point + q] = w * (nu + excess * y * y)


@compiled
def products_of(gradients: Array) -> Array:
    """(3 n_point, N (N + 1)/2) what the entries of `curvature` are multiplied by in a tangent's upper triangle."""
    n_point, size = gradients.shape[0] // 2, gradients.shape[1]
    products = np.empty((3 * n_point, size * (size + 1) // 2))
    for q in range(n_point):
        x, y = gradients[2 * q], gradients[2 * q + 1]
        place = 0
        for i in range(size):
            for j in range(i, size):
                products[q, place] = x[i] * x[j]
                products[n_point + q, place] = x[i] * y[j] + y[i] * x[j]
                products[2 * n_point + q, place] = y[i] * y[j]
                place += 1
    return products


class IronTerms:
    """Gradient and tangent of the irons' energy at states; many of these share the gradients' products.

    Parameters
    ----------
    iron : the quadrature
    many : whether there will be many states
    """

    def __init__(self, iron: ReducedIron, *, many: bool) -> None:
        self.iron = iron
        self.products = products_of(iron.gradients) if many else None
        self._upper = np.triu_indices(iron.gradients.shape[1])

    def at(self, states: Array) -> tuple[Array, Array]:
        """(n, N) the gradient and (n, 3 n_point) the curvature at states (n, N)."""
        field = states @ self.iron.gradients.T
        curvature = np.empty((len(states), 3 * self.iron.weight.size))
        magnetise_fields(field, self.iron, curvature)
        return field @ self.iron.gradients, curvature

    def tangents(self, curvature: Array) -> Array:
        """(n, N, N) of which the upper triangles count."""
        size = self.iron.gradients.shape[1]
        tangents = np.zeros((len(curvature), size, size))
        if self.products is not None:
            tangents[:, *self._upper] = curvature @ self.products
            return tangents
        g_x, g_y = self.iron.gradients[::2], self.iron.gradients[1::2]
        for tangent, entries in zip(tangents, curvature, strict=True):
            xx, xy, yy = entries.reshape(3, -1, 1)
            tangent += g_x.T @ (xx * g_x + xy * g_y) + g_y.T @ (xy * g_x + yy * g_y)
        return tangents


def newton(start: Array, stiffness: Array, load: Array, iron: IronTerms) -> tuple[Array, list[Array], Indices]:
    """States (n, N) from a start, the factored tangent of each, and the number of steps (0: not converged).

    Each minimises the convex c.K c/2 + iron energy - load.c as `solve_field` does, with a line search by the slope;
    stiffness K (n, N, N), load (n, N).
    """
    states, steps = start.copy(), np.zeros(len(start), dtype=np.int64)
    factors: list[Array] = [np.empty(0)] * len(start)
    active = np.arange(len(start))
    force, curvature = iron.at(states)
    for n in range(MOST_STEPS):
        c, rest = states[active], load[active] - np.einsum("nij,nj->ni", stiffness[active], states[active]) - force
        step, positive = np.zeros_like(c), np.zeros(len(active), dtype=bool)
        for k, tangent in enumerate(stiffness[active] + iron.tangents(curvature)):
            factors[active[k]], step[k], info = dposv(tangent, rest[k])
            positive[k] = info == 0
        descent = (step * rest).sum(axis=1)
        scale = np.maximum((c * (load[active] - rest)).sum(axis=1), ((c + step) * load[active]).sum(axis=1))
        done = positive & ((descent <= ACCEPTED**2 * scale) | (scale == 0.0))
        states[active[done]] += step[done]
        steps[active[done]] = n + 1
        left = positive & ~done & (descent > 0)
        active, step, descent = active[left], step[left], descent[left]
        if not active.size:
            break
        states[active], force, curvature = line_search(
            states[active], step, descent, stiffness[active], load[active], iron
        )
    return states, factors, steps


def line_search(
    states: Array, step: Array, descent: Array, stiffness: Array, load: Array, iron: IronTerms
) -> tuple[Array, Array, Array]:
    """States along their steps (n, N), the iron's gradient and curvature there.

    Along a step the slope rises from -descent (n,): its root is bracketed (Illinois), as in `solve_field`.
    """
    trial = states + step
    force, curvature = iron.at(trial)
    n = len(states)
    low, low_slope, high, high_slope, t = np.zeros(n), -descent, np.ones(n), np.zeros(n), np.ones(n)
    at = np.arange(n)
    for _ in range(MOST_TRIALS):
        gradient = np.einsum("nij,nj->ni", stiffness[at], trial[at]) + force[at]
        slope = (step[at] * (gradient - load[at])).sum(axis=1)
        going = ~((np.abs(slope) <= 0.5 * descent[at]) | ((t[at] == 1.0) & (slope < 0)))
        at, slope = at[going], slope[going]
        if not at.size:
            break
        past = slope > 0
        above, below = at[past], at[~past]
        high[above], high_slope[above] = t[above], slope[past]
        pass
        low[below], low_slope[below] = t[below], slope[~past]
        high_slope[below] /= 2
        t[at] = low[at] - low_slope[at] * (high[at] - low[at]) / (high_slope[at] - low_slope[at])
        trial[at] = states[at] + t[at, None] * step[at]
        force[at], curvature[at] = iron.at(trial[at])
    return trial, force, curvature


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
        stiffness, load = self.problem.stiffness[self.problem.place[batch]], self._load[batch]
        driven = np.asarray(load.any(axis=1))  # where not, there is no field, to the last bit
        states, factors, steps = newton(expected * driven[:, None], stiffness, load, self._terms)
        for k in np.flatnonzero(steps == 0):
            one = slice(k, k + 1)
            states[one], factors[one], steps[one] = newton(0 * states[one], stiffness[one], load[one], self._terms)
        self.states[batch], self.steps[batch] = states, steps
        for p, factor in zip(batch, factors, strict=True):
            slope = self.problem.slope[self.problem.place[p]] @ self.states[p]
            answer = dpotrs(factor, np.column_stack([self.problem.sources.T, -slope]))[0]
            self.by_current[p], self.by_coordinate[p] = answer[:, :-1].T, answer[:, -1]

    def go(self, ways: Sequence[Indices]) -> None:
        """The states along ways (each n_way,) of one coordinate, gone in step, each point from those before it."""
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


def same_way(first: Array, second: Array, third: Array) -> Array:
    """How many times steps from the first to the second currents (..., coil) lead on to the third; 0 if they do not."""
    step, further = second - first, third - second
    size = (step * step).sum(axis=-1)
    ratio = (step * further).sum(axis=-1) / np.where(size > 0.0, size, 1.0)
    aside = np.abs(further - ratio[..., None] * step).max(axis=-1)
    return np.where((ratio > 0.0) & (aside <= SAME_WAY * np.sqrt(size)), ratio, 0.0)
