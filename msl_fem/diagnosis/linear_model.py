"""The linear model around a fit: what amounts would bring there, the densities of the noise estimated anew with them.

With the weighted residual r, the columns J of what is unknown at a fit and C of further amounts a, the likelihood over
the amounts is that of a linear model with

    G = C'C - C'J (J'J + I)^-1 J'C,   b = -C'r + C'J (J'J + I)^-1 (J'r + z)
      = R'R + X'X,                      = -R'r + X'z,   X = (J'J + I)^-1 J'C,   R = C - J X.

The second form loses no digits where what is unknown makes up for almost all of C. With Cauchy's prior the log evidence
grows by b'a - a'Ga/2 - sum log(1 + a^2) - log det(G + 2)/2 at the best a, if the noise stays what it is without the
amounts. It does not: what a missing cause leaves passes for noise of a colour, and of n numbers of a band that are all
its doing a linear model of fixed weights promises n/2 nats at most, where a fit brings n/2 times the log of what the
densities fall by. So the best a are found with the densities that belong to them, by reweighting (Green, J. R. Stat.
Soc. B 46, 1984, 149-192), from the products of all columns band by band. With one band and no colour both are the same
to second order. Where a zero wanders, densities stay those of the fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array, Slopes
from msl_fem.computing.gauss_newton import ROWS_AT_ONCE, summed_over_rows
from msl_fem.computing.threads import in_threads
from msl_fem.diagnosis.likelihood import Fit
from msl_fem.diagnosis.noise import NoiseWeights
from msl_fem.diagnosis.unknowns import CAUCHY

ROUNDING = 1e-12  # of a diagonal: amounts that act alike
REWEIGHTED = 12
"""How often the noise's densities are estimated anew at most."""
ENOUGH = 0.05  # nats: less from another time is none
HALVED = 5  # times that a step which leads up is halved at most
NEAR, FAR = 2.0, 0.02
"""Curvatures of the prior near nothing, and far out, where it is all but flat."""


@dataclass(frozen=True, eq=False)
class BestAmounts:
    """The best point of some amounts: the nats of log evidence, the amounts, and by how much all that was unknown
    before moves."""

    gain: float
    amounts: Array
    shift: Array


class _End(NamedTuple):
    """Where a minimum is: the nats, u, and the matrices there of what was unknown before, and of the amounts when that
    is free."""

    nats: float
    at: Array
    before: Array
    own: Array


@dataclass(frozen=True, eq=False)
class _Valley:
    """What is minimised over u = (y, a): of the products (n_label, n, n) of columns and residual, band by band, the
    nats of data and priors. All that was unknown before moves by y + `along` a, under a prior of this slope and
    curvature there."""

    products: Array
    along: Array
    slope: Array
    curvature: Array
    noise: NoiseWeights

    @property
    def n_before(self) -> int:
        return len(self.along)

    def nats(self, u: Array) -> tuple[float, Array]:
        """(the nats at u, the densities there over those of the fit)"""
        whole = np.append(u, 1.0)
        data, density = self.noise.again(np.einsum("i,lij,j->l", whole, self.products, whole, optimize=True))
        move, amounts = self.moved(u), u[self.n_before :]
        before = float(self.slope @ move + move @ (self.curvature * move) / 2)
        return data + before + float(np.log1p(amounts**2).sum()), density

    def moved(self, u: Array) -> Array:
        """How far all that was unknown before moves."""
        return u[: self.n_before] + self.along @ u[self.n_before :]

    def step(self, density: Array, weak: Array, one_sided: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """(the best point with these densities and curvatures of the amounts' prior, the matrix of what was unknown
        before, that of the amounts when it is free)"""
        n, k = self.n_before, weak.size
        matrix = np.tensordot(1.0 / density, self.products, axes=1)
        slope, matrix = matrix[:-1, -1], matrix[:-1, :-1]
        ways = np.hstack([np.eye(n), self.along])
        matrix = matrix + ways.T @ (self.curvature[:, None] * ways)
        slope = slope + ways.T @ self.slope
        before = np.linalg.solve(matrix[:n, :n], np.column_stack([slope[:n], matrix[:n, n:]]))
        still, absorbed = before[:, 0], before[:, 1:]
        own = matrix[n:, n:] - matrix[n:, :n] @ absorbed
        amounts = held(own + np.diag(weak), matrix[n:, :n] @ still - slope[n:], one_sided) if k else np.zeros(0)
        return np.concatenate([-still - absorbed @ amounts, amounts]), matrix[:n, :n], own


class Background:
    """What is unknown at a fit, and the columns of many amounts, multiplied with one another once, band by band."""

    def __init__(self, found: Fit, raw: Slopes, moved: Array | None = None) -> None:
        """`raw` are columns (n_number, n_amount) of the residual, not weighted; they are weighted in place and become
        `own_columns`, less what the unknowns make up for. With each amount the unknowns move already by `moved`
        (n_unknown, n_amount)."""
        root, jacobian = found.weights.root, found.jacobian
        raw *= root[:, None]
        residual = found.residual * root
        _, self.slope, self.curvature = found.unknowns.prior(found.z)
        threads = found.likelihood.threads

        def with_unknowns(rows: slice) -> tuple[Array, ...]:
            return ((jacobian[rows] * root[rows, None]).T @ raw[rows].astype(np.float64),)

        [between] = summed_over_rows(with_unknowns, len(raw), threads=threads)
        moved = np.zeros_like(between) if moved is None else moved
        absorbed = np.linalg.solve(found.precision, between + self.curvature[:, None] * moved)

        def beside_them(rows: NDArray[np.intp]) -> Array:
            weighted = jacobian.T[:, rows] * root[rows]
            left = raw.T[:, rows] - absorbed.T @ weighted
            raw.T[:, rows] = left
            whole = np.vstack([weighted, left, residual[rows]])
            return np.asarray(whole @ whole.T)

        places = _rows_of_labels(found.likelihood.labels, found.weights.density.size)
        sums = in_threads(lambda parts: sum(map(beside_them, parts[1:]), beside_them(parts[0])), places, threads)
        self.products = np.array(sums)
        self.own_columns, self.along, self.noise = raw, moved - absorbed, found.weights
        n = len(absorbed)
        of_amounts = self.products[:, n:-1, n:-1].sum(axis=0)
        self.own = self.along.T @ (self.curvature[:, None] * self.along) + of_amounts
        self.without = self._best((), np.zeros(0, dtype=bool))

    def best(self, places: Sequence[int], one_sided: NDArray[np.bool_]) -> BestAmounts:
        """The best point of the amounts that stand at these places."""
        end, n = self._best(places, one_sided), len(self.along)
        occam = np.linalg.slogdet(end.own + NEAR * np.eye(len(places)))[1] + _log_ratio(end.before, self.without.before)
        gain = self.without.nats - end.nats + CAUCHY * len(places) - float(occam) / 2
        amounts = end.at[n:]
        return BestAmounts(gain, amounts, end.at[:n] + self.along[:, list(places)] @ amounts)

    def _best(self, places: Sequence[int], one_sided: NDArray[np.bool_]) -> _End:
        n = len(self.along)
        rows = np.array([*range(n), *(n + place for place in places), self.products.shape[1] - 1])
        products: Array = self.products[:, rows[:, None], rows]
        valley = _Valley(products, self.along[:, list(places)], self.slope, self.curvature, self.noise)
        at = np.zeros(n + len(places)) if not places else np.concatenate([self.without.at, np.zeros(len(places))])
        here = (*valley.nats(at), at)
        weak = (NEAR, FAR) if places else (NEAR,)
        steps = [valley.step(here[1], np.full(len(places), way), one_sided) for way in weak]
        for _ in range(REWEIGHTED):
            ends = [_down(valley, here, end) for end, *_ in steps]
            best = min(range(len(steps)), key=lambda n: ends[n][0])
            matrices = steps[best][1:]
            gained, here = here[0] - ends[best][0], ends[best]
            if gained < ENOUGH:
                break
            steps = [valley.step(here[1], 2.0 / (1.0 + here[2][n:] ** 2), one_sided)]
        return _End(here[0], here[2], *matrices)


_Place = tuple[float, Array, Array]
"""(nats, densities, where)"""


def _down(valley: _Valley, here: _Place, end: Array) -> _Place:
    """On the way from a place to a point: its end, or where it leads down; else here."""
    nats, _, at = here
    for _ in range(HALVED):
        there, density = valley.nats(end)
        if there < nats:
            return there, density, end
        end = (at + end) / 2
    return here


def _log_ratio(one: Array, other: Array) -> float:
    """Of the determinants of two matrices."""
    return float(np.linalg.slogdet(one)[1] - np.linalg.slogdet(other)[1]) if one.size else 0.0


def _rows_of_labels(labels: NDArray[np.intp], n_label: int) -> list[list[NDArray[np.intp]]]:
    """Of each label the rows of its numbers, some at a time."""
    order = np.argsort(labels, kind="stable")
    ends = np.searchsorted(labels[order], np.arange(n_label), side="right")
    every = np.split(order, ends[:-1])
    return [np.array_split(rows, max(1, -(-rows.size // ROWS_AT_ONCE))) for rows in every]


def held(g: Array, b: Array, one_sided: NDArray[np.bool_]) -> Array:
    """The best point with one-sided numbers at least 0, by leaving out those below."""
    kept = np.ones(b.size, dtype=bool)
    guess = np.zeros(b.size)
    for _ in range(b.size + 1):  # one may be left out each time, and the rest is to be solved for after the last
        guess = np.zeros(b.size)
        if not kept.any():
            return guess
        own = g[np.ix_(kept, kept)]
        guess[kept] = np.linalg.solve(own + ROUNDING * np.diag(np.diag(own)), b[kept])
        bad = one_sided & (guess < 0)
        if not bad.any():
            break
        kept &= ~bad
    return guess
