"""Orders and rational terms by a stated criterion.

Orders: a walk from neighbour to neighbour until none is better. Every candidate is fitted to the same equations (those
that the largest lag admits), or likelihoods could not be compared. The walk looks at excerpts: orders are a coarse
question, and 10 000 samples answer it. Each candidate is sought from the usual starts and from the coefficients of the
model that the walk stands on.

Terms, by forward selection: each step takes the term that explains most of what is left. It begins with the best law of
one term a side, found by fitting each. The terms on trial are ranked by what they would explain of the errors once
their own B is free, all other coefficients adjusted to first order: the score of a Lagrange multiplier test (T. S.
Breusch and A. R. Pagan, Rev. Econ. Stud. 47, 1980). The first in rank is fitted and stays if the criterion falls, the
gap offset is estimated anew, and every earlier term that the criterion does not miss goes. It ends when none of the
best few pays for its coefficients. Choosing the best of m candidates finds something in mere noise, so each term costs
2 log m more (extended BIC: J. Chen and Z. Chen, Biometrika 95, 2008).
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import ComputationError, InputError
from msl_fem.identification.armax import ArmaxModel, best_search, check_excitation, check_feedback
from msl_fem.identification.data import RationalInputs, RationalTerm, SampledRun, check_length, check_runs
from msl_fem.identification.gap_offset import DeltaSearch, identify_rational
from msl_fem.identification.likelihood import EstimationProblem, InformationCriterion, evaluated_reflected
from msl_fem.identification.oscillator import OscillatorPrior
from msl_fem.identification.prediction_error import (
    ArmaxOrders,
    Polynomials,
    prediction_errors,
    sensitivity_columns,
    sensitivity_signals,
)
from msl_fem.identification.regression import lagged_blocks, r_factor, triangular_factor
from msl_fem.identification.search import EstimationSettings, FirstGuess, excerpts, first_guesses

EXCERPT_SAMPLES = 10_000
SAMPLES_PER_PARAMETER = 10
OWN_SHARE = 1e-4  # of a candidate's filtered columns that the model must not already explain
TRIES = 3  # candidates of a step that are fitted before the search ends

SEARCH = EstimationSettings(step_tolerance=0.05, max_iterations=15)  # a likelihood within 0.001 is enough


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
    criterion: InformationCriterion | None = None,
    limits: OrderLimits | None = None,
    prior: OscillatorPrior | None = None,
) -> OrderSelection:
    """The orders with the smallest criterion among those met on the way from `start` (2, 2, 2, 1), all inputs alike.

    One step changes na, nb, nc or nk by one, or na, nb and nc together. A candidate that cannot be identified counts as
    infinitely poor. InputError for data that cannot be used; ComputationError if no candidate could be fitted.
    """
    check_runs(runs)
    criterion = criterion or InformationCriterion()
    limits = limits or OrderLimits()
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
        na = orders.na + da
        nb = orders.nb + db
        nc = orders.nc + dc
        nk = orders.nk + dk
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

    pieces: Sequence[Array]
    names: tuple[str, ...]
    sampling_period: float
    longest: int
    criterion: InformationCriterion
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
            starts.append(FirstGuess("neighbour", _moved(self.found[near], near.for_inputs(len(self.names)), full)))
        result = best_search(EstimationProblem(runs, full), starts=starts, settings=SEARCH)
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


def _cut(polynomial: Array, length: int) -> Array:
    return np.concatenate([polynomial, np.zeros(length)])[:length]


Tried = tuple[tuple[str, ...], float]
"""(inputs of a model that was fitted, the criterion's value)."""


@dataclass(frozen=True)
class TermSelection:
    """The chosen terms, with the gap offset at which they were chosen, and every set that was fitted with its value."""

    rational: RationalInputs
    criterion: str
    tried: tuple[Tried, ...]


@dataclass(frozen=True, eq=False)
class TermSearch:
    """What a search for terms works with: pieces of the runs, orders alike for all inputs, and how models compare."""

    runs: tuple[SampledRun, ...]
    orders: ArmaxOrders
    criterion: InformationCriterion
    delta: DeltaSearch | None
    prior: OscillatorPrior | None
    candidates: tuple[RationalTerm, ...]

    def fitted(self, rational: RationalInputs, *, search: bool = False) -> tuple[ArmaxModel, float]:
        """The model with these terms, its gap offset held unless `search`, and the criterion's value."""
        model = identify_rational(
            self.runs, self.orders, rational=rational, prior=self.prior, search=self.delta if search else None
        )
        assert model.rational is not None
        signals = [model.rational.evaluated(run).signals for run in self.runs]
        value = self.criterion.value(evaluated_reflected(EstimationProblem(signals, model.orders), model.polynomials))
        return model, value + 2.0 * len(rational.terms) * float(np.log(max(len(self.candidates), 1)))


def candidate_terms(sides: Sequence[int]) -> tuple[RationalTerm, ...]:
    """i^p / g^q with p = 1, 2, 3 and q = 0 ... 3 for each side."""
    return tuple(RationalTerm(side, p, q) for side in sides for p in (1, 2, 3) for q in range(4))


@one_blas_thread
def select_terms(
    runs: Sequence[SampledRun],
    search: TermSearch,
    *,
    rational: RationalInputs,
) -> TermSelection:
    """The terms found by forward selection; `rational` states the nominal gap, delta to begin with and plain channels.

    `search.runs` are replaced by excerpts of `runs`. InputError for data or orders that cannot be used, or orders that
    differ between inputs.
    """
    check_runs(runs)
    if not (isinstance(search.orders.nb, int) and isinstance(search.orders.nk, int)):
        raise InputError("the search for terms needs one nb and one nk for all inputs")
    search = replace(search, runs=_pieces(runs, search.orders))
    tried: list[Tried] = []
    model, value = _best_law(search, rational, tried)
    while True:
        grown = _grown(search, model, value, tried=tried)
        if grown is None:
            break
        model, value = _pruned(search, *search.fitted(grown, search=True), tried=tried)
    assert model.rational is not None
    return TermSelection(model.rational, search.criterion.name, tuple(tried))


def _best_law(search: TermSearch, rational: RationalInputs, tried: list[Tried]) -> tuple[ArmaxModel, float]:
    """The best model with one term i^p/g^q a side, the same for all sides; with single terms if no law is for all."""
    sides = {term.side for term in search.candidates}
    laws: dict[tuple[int, int], list[RationalTerm]] = {}
    for term in search.candidates:
        laws.setdefault((term.current_power, term.gap_power), []).append(term)
    sets = [tuple(law) for law in laws.values() if len(law) == len(sides)] or [(term,) for term in search.candidates]
    best = None
    refusal = ComputationError("no candidate term was given")
    for terms in sets:
        try:
            model, value = search.fitted(replace(rational, terms=terms), search=True)
        except (InputError, ComputationError) as err:
            refusal = ComputationError(f"no candidate term could be fitted; the last one failed: {err}")
            continue
        tried.append((model.input_names, value))
        if best is None or value < best[1]:
            best = model, value
    if best is None:
        raise refusal
    return best


def _grown(
    search: TermSearch,
    model: ArmaxModel,
    value: float,
    *,
    tried: list[Tried],
) -> RationalInputs | None:
    """The terms with the best further one, None if none pays for its coefficients."""
    rational = model.rational
    assert rational is not None
    for term in _ranked(search, model)[:TRIES]:
        wider = replace(rational, terms=(*rational.terms, term))
        try:
            larger, larger_value = search.fitted(wider)
        except (InputError, ComputationError):  # the term hardly differs from those that are in
            continue
        tried.append((larger.input_names, larger_value))
        if larger_value < value:
            return wider
    return None


def _pruned(search: TermSearch, model: ArmaxModel, value: float, *, tried: list[Tried]) -> tuple[ArmaxModel, float]:
    """The model without the terms that the criterion does not miss; the last one that came in stays."""
    assert model.rational is not None
    for term in model.rational.terms[:-1]:
        assert model.rational is not None
        fewer = replace(model.rational, terms=tuple(t for t in model.rational.terms if t != term))
        smaller, smaller_value = search.fitted(fewer)
        tried.append((smaller.input_names, smaller_value))
        if smaller_value <= value:
            model, value = search.fitted(fewer, search=True)
    return model, value


def _ranked(search: TermSearch, model: ArmaxModel) -> list[RationalTerm]:
    """The candidates that are not in the model, by the share of the errors that they would explain; best first."""
    rational, orders = model.rational, model.orders
    assert rational is not None
    fresh = [term for term in search.candidates if term not in rational.terms]
    if not fresh:
        return []
    columns, row_error = sensitivity_columns(orders)
    assert isinstance(search.orders.nb, int)
    assert isinstance(search.orders.nk, int)
    lags = range(search.orders.nk, search.orders.nk + search.orders.nb)
    total = np.zeros((0, 0))
    for run in search.runs:
        signals = rational.evaluated(run).signals
        errors = prediction_errors(signals, model.polynomials, orders).errors
        rows = sensitivity_signals(signals, model.polynomials, errors)
        extra = RationalInputs(tuple(fresh), rational.nominal_gap, rational.delta).evaluated(run).signals[1:-1]
        others = sensitivity_signals(np.vstack([signals[:1], extra, signals[-1:]]), model.polynomials, errors)
        stacked = np.vstack([rows, others[1 : 1 + len(fresh)]])
        trial = [(rows.shape[0] + k, lag) for k in range(len(fresh)) for lag in lags]
        table_columns = [*columns, *trial, (row_error, 0)]
        factor = triangular_factor(
            lagged_blocks(stacked, table_columns, first=orders.longest_lag - orders.nc), len(table_columns)
        )
        own = factor[orders.nc :, orders.nc :]
        total = r_factor(np.vstack([total, own])) if total.size else own
    return _by_gain(total, fresh, n_model=len(columns) - orders.nc, n_lags=len(lags))


def _by_gain(total: Array, fresh: Sequence[RationalTerm], *, n_model: int, n_lags: int) -> list[RationalTerm]:
    """Terms in the order of the errors' squares that their columns explain beyond the model's."""
    gains = {}
    for k, term in enumerate(fresh):
        chosen = slice(n_model + k * n_lags, n_model + (k + 1) * n_lags)
        tail = total[n_model:, chosen]
        own = np.linalg.norm(tail, axis=0) / np.linalg.norm(total[:, chosen], axis=0)
        if own.max() > OWN_SHARE:
            left, sizes, _ = np.linalg.svd(tail / np.linalg.norm(tail, axis=0), full_matrices=False)
            distinct = sizes > OWN_SHARE * sizes[0]
            gains[term] = float(np.sum((left[:, distinct].T @ total[n_model:, -1]) ** 2))
    return sorted(gains, key=lambda term: -gains[term])


def _pieces(runs: Sequence[SampledRun], orders: ArmaxOrders) -> tuple[SampledRun, ...]:
    """Evenly spread pieces of the runs with about EXCERPT_SAMPLES in all."""
    names = tuple(runs[0].inputs)
    lag = max(orders.for_inputs(1).longest_lag, 1)
    pieces = excerpts([run.signals for run in runs], EXCERPT_SAMPLES, longest_lag=lag)
    return tuple(
        replace(runs[0], output=piece[0], inputs=dict(zip(names, piece[1:-1], strict=True)), name=f"piece {i}")
        for i, piece in enumerate(pieces)
    )
