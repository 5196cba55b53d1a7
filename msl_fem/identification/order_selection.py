"""The orders of ARMAX by a stated criterion: a walk from neighbour to neighbour until none is better.

Every candidate is fitted to the same equations (those that the largest lag admits), or likelihoods could not be
compared. The walk looks at excerpts: orders are a coarse question, and 10 000 samples answer it. Each candidate is
sought from the usual starts and from the coefficients of the model that the walk stands on.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification.armax import best_search
from msl_fem.identification.criterion import Criterion
from msl_fem.identification.data import FloatArray, SampledRun, check_length, check_runs
from msl_fem.identification.excitation import check_excitation, check_feedback
from msl_fem.identification.gauss_newton import SearchSettings
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.prior import OscillatorPrior
from msl_fem.identification.problem import Problem
from msl_fem.identification.start import Start, excerpts, first_guesses

EXCERPT_SAMPLES = 10_000
SEARCH = SearchSettings(step_tolerance=0.05, max_iterations=15)  # a likelihood within 0.001 is enough
SAMPLES_PER_PARAMETER = 10


@dataclass(frozen=True)
class OrderLimits:
    """The largest orders that are looked at, and the smallest and largest delay."""

    na: int = 6
    nb: int = 6
    nc: int = 6
    nk: tuple[int, int] = (1, 4)


@dataclass(frozen=True)
class OrderSelection:
    """The chosen orders, and the criterion's value of every candidate in the order in which it was tried."""

    orders: ArmaxOrders
    criterion: str
    tried: tuple[tuple[ArmaxOrders, float], ...]


@one_blas_thread
def select_orders(
    runs: Sequence[SampledRun],
    *,
    start: ArmaxOrders | None = None,
    criterion: Criterion | None = None,
    limits: OrderLimits | None = None,
    prior: OscillatorPrior | None = None,
) -> OrderSelection:
    """The orders with the smallest criterion among those met on the way from `start` (2, 2, 2, 1), all inputs alike.

    One step changes na, nb, nc or nk by one, or na, nb and nc together. A candidate that cannot be identified counts as
    infinitely poor. InputError for data that cannot be used; ComputationError if no candidate could be fitted.
    """
    check_runs(runs)
    criterion, limits = criterion or Criterion(), limits or OrderLimits()
    here = start or ArmaxOrders(2, 2, 2, max(1, limits.nk[0]))
    if not (isinstance(here.nb, int) and isinstance(here.nk, int)):
        raise InputError("the search for orders starts from one nb and one nk for all inputs")
    names = tuple(runs[0].inputs)
    longest = max(limits.na, limits.nc, limits.nk[1] + limits.nb - 1)
    needed = SAMPLES_PER_PARAMETER * here.for_inputs(len(names)).n_parameters
    check_length(runs, samples_needed=needed, longest_lag=longest)
    pieces = excerpts([run.signals for run in runs], EXCERPT_SAMPLES, longest_lag=longest)
    guess = None if prior is None else replace(prior, tolerance=None)
    walk = _Walk(pieces, names, runs[0].sampling_period, longest, criterion, guess)
    while True:
        best = min([here, *_neighbours(here, limits)], key=lambda orders: walk.value(orders, near=here))
        if best == here:
            break
        here = best
    if here not in walk.found:
        raise ComputationError(
            f"none of {len(walk.values)} candidate orders could be identified: state the orders instead"
        )
    return OrderSelection(here, criterion.name, tuple(walk.values.items()))


def _neighbours(orders: ArmaxOrders, limits: OrderLimits) -> Iterator[ArmaxOrders]:
    assert isinstance(orders.nb, int)
    assert isinstance(orders.nk, int)
    moves = [(1, 1, 1, 0), (-1, -1, -1, 0), (1, 0, 1, 0), (-1, 0, -1, 0)]
    moves += [tuple(sign * (i == j) for j in range(4)) for i in range(4) for sign in (1, -1)]  # type: ignore[misc]
    moves += [(0, -1, 0, 1), (0, 1, 0, -1)]
    for da, db, dc, dk in moves:
        na, nb, nc, nk = orders.na + da, orders.nb + db, orders.nc + dc, orders.nk + dk
        if (
            0 <= na <= limits.na
            and 1 <= nb <= limits.nb
            and 0 <= nc <= limits.nc
            and limits.nk[0] <= nk <= limits.nk[1]
        ):
            yield ArmaxOrders(na, nb, nc, nk, orders.offset)


@dataclass(frozen=True, eq=False)
class _Walk:
    """The candidates met so far: the criterion's values, and the polynomials of those that could be identified."""

    pieces: Sequence[FloatArray]
    names: tuple[str, ...]
    sampling_period: float
    longest: int
    criterion: Criterion
    prior: OscillatorPrior | None
    values: dict[ArmaxOrders, float] = field(default_factory=dict)
    found: dict[ArmaxOrders, Polynomials] = field(default_factory=dict)

    def value(self, orders: ArmaxOrders, *, near: ArmaxOrders) -> float:
        """The criterion on the equations that all candidates share; inf if these orders cannot be identified."""
        if orders not in self.values:
            self.values[orders] = float("inf")
            with contextlib.suppress(InputError, ComputationError):
                self.values[orders] = self._fitted(orders, near)
        return self.values[orders]

    def _fitted(self, orders: ArmaxOrders, near: ArmaxOrders) -> float:
        full = orders.for_inputs(len(self.names))
        runs = [np.ascontiguousarray(signals[:, self.longest - full.longest_lag :]) for signals in self.pieces]
        if sum(signals.shape[1] for signals in runs) < SAMPLES_PER_PARAMETER * full.n_parameters:
            raise InputError("too few samples")
        check_excitation(runs, full, self.names)
        check_feedback(runs, full, self.names)
        prior = self.prior if full.na >= 2 else None
        starts = first_guesses(runs, full, prior, sampling_period=self.sampling_period, names=self.names)
        if near in self.found:
            starts.append(Start("neighbour", _moved(self.found[near], near.for_inputs(len(self.names)), full)))
        result = best_search(Problem(runs, full), starts=starts, settings=SEARCH)
        self.found[orders] = result.evaluation.polynomials
        return self.criterion.value(result.evaluation)


def _moved(polynomials: Polynomials, old: ArmaxOrders, new: ArmaxOrders) -> Polynomials:
    """The coefficients at their delays, zeros at new ones."""
    rows = []
    for b, before, after in zip(polynomials.b, old.input_lags, new.input_lags, strict=True):
        at = dict(zip(before, b, strict=True))
        rows.append(np.array([at.get(lag, 0.0) for lag in after]))
    a, c = (_cut(p, n + 1) for p, n in ((polynomials.a, new.na), (polynomials.c, new.nc)))
    return Polynomials(a, tuple(rows), c, polynomials.offset)


def _cut(polynomial: FloatArray, length: int) -> FloatArray:
    return np.concatenate([polynomial, np.zeros(length)])[:length]
