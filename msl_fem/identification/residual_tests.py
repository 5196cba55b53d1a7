"""Tests of the residuals: whiteness, and correlation with each input, with bands that mean what they say.

Each test asks whether delayed residuals (or a delayed input) explain the residuals beyond what the model's own
coefficients could: the score, or Lagrange multiplier, test (L. G. Godfrey, Econometrica 46, 1978; T. S. Breusch,
Austral. Econ. Papers 17, 1978). The delayed samples are first freed of their projection on the Jacobian, so the test is
exact for large records also after a fit, where the textbook band 1/sqrt(n) is too wide at short lags (G. E. P. Box and
D. A. Pierce, J. Amer. Statist. Assoc. 65, 1970). With nothing to project it is the test of G. M. Ljung and G. E. P. Box
(Biometrika 65, 1978). The band is for the largest lag: white residuals leave it anywhere with probability `alpha`, the
neighbouring lags of a smooth input counted as the nearly one that they are.

Under feedback the inputs answer to the errors. The test for it is the score test with the inputs ahead of the errors
instead of behind. What the past of all channels explains is taken out first (P. E. Caines and C. W. Chan, IEEE Trans.
Autom. Control 20, 1975): errors of the model's form depend on past inputs, and so, of a smooth input, on its future.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, ndtri

from msl_fem.computing.arrays import Array
from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.errors import InputError
from msl_fem.identification.data import SampledRun
from msl_fem.identification.model import ArmaxEstimate, prepared_run
from msl_fem.identification.prediction_error import prediction_errors, sensitivity_columns, sensitivity_signals
from msl_fem.identification.regression import lagged_blocks, r_factor, triangular_factor

EXPLAINED_BY_MODEL = 1e-6  # a delayed signal with less than this part outside the Jacobian carries no test
DISTINCT = 1e-3  # smallest singular value, over the largest, of a direction that counts as one of its own
INDEPENDENT = 0.2  # correlations of scores below this do not change the law of the largest one
DRAWS = 20_000  # of the largest score under whiteness: the probability to leave a 1 % band is known to 0.07 %
_SEED = 20_250_101  # the band of one record must not change from call to call
SOUND_WHEN = (
    "a prediction-error estimate from closed-loop data is sound when something outside the loop excites it (a "
    "reference, an added signal), the loop has a delay of a sample or more (nk >= 1), and the noise model is rich "
    "enough, which the residual tests show; a free run of an unstable plant says nothing, the closed loop with its "
    "controller does"
)


@dataclass(frozen=True)
class CorrelationTest:
    """Correlations of the residuals with one delayed signal and what white residuals would show.

    `correlation` and `band` run over `lags`; the largest ratio of the two decides `inside_band`. `statistic` is the
    portmanteau over all lags, chi-square with `degrees_of_freedom` under whiteness, and `p_value` its tail.
    """

    name: str
    lags: tuple[int, ...]
    correlation: tuple[float, ...]
    band: tuple[float, ...]
    alpha: float
    inside_band: bool
    statistic: float
    degrees_of_freedom: int
    p_value: float


@one_blas_thread
def residual_tests(
    model: ArmaxEstimate, run: SampledRun, *, lags: int = 25, alpha: float = 0.01, fitted: bool = True
) -> tuple[CorrelationTest, ...]:
    """Whiteness first (lags 1 ... lags), then one test for each input over one run.

    An input's lag 0 is tested only if the model has it (nk = 0): under feedback, the input of an instant knows its
    output. With `fitted`, what the coefficients can explain is left out, as is right for runs that were fitted;
    without, a held-out run is also asked for errors of the coefficients. Rational inputs are taken at the measured
    position. InputError if the run does not fit the model or is too short for the lags.
    """
    check_settings(lags, alpha, run.n_samples)
    prepared = prepared_run(model, run)
    signals = prepared.signals
    orders = model.orders
    polynomials = model.polynomials
    errors = prediction_errors(signals, polynomials, orders).errors
    sensitivities = sensitivity_signals(signals, polynomials, errors)
    columns, row_error = sensitivity_columns(orders)
    explained = columns if fitted else columns[: orders.nc]
    inputs = signals[1:-1] - signals[1:-1].mean(axis=1, keepdims=True)
    stacked = np.vstack([sensitivities, inputs])
    first = signals.shape[1] - errors.size + lags
    earliest = [1, *(min(lag[0], 1) for lag in orders.input_lags)]
    tested = [("residuals", row_error), *zip(model.input_names, range(row_error + 1, len(stacked)), strict=True)]
    tests = []
    for (name, row), begin in zip(tested, earliest, strict=True):
        delays = range(begin, lags + 1)
        table_columns = [*explained, *((row, lag) for lag in delays), (row_error, 0)]
        factor = triangular_factor(lagged_blocks(stacked, table_columns, first=first), len(table_columns))
        norms = np.linalg.norm(factor[:, len(explained) : -1], axis=0)
        tail = factor[len(explained) :, len(explained) :]
        variance = float(errors @ errors) / (errors.size - len(explained))
        tests.append(score_test(name, delays, tail=tail, scales=(norms, variance, errors.size - lags), alpha=alpha))
    return tuple(tests)


def whiteness_test(sequence: Array, *, lags: int = 25, alpha: float = 0.01) -> CorrelationTest:
    """Whether a plain sequence (n_samples,), to which nothing was fitted, is white."""
    samples = np.asarray(sequence, dtype=float)
    check_settings(lags, alpha, samples.size)
    delays = range(1, lags + 1)
    table_columns = [*((0, lag) for lag in delays), (0, 0)]
    factor = triangular_factor(lagged_blocks(samples[None, :], table_columns, first=0), len(table_columns))
    norms = np.linalg.norm(factor[:, :-1], axis=0)
    variance = float(samples @ samples) / samples.size
    return score_test("sequence", delays, tail=factor, scales=(norms, variance, samples.size), alpha=alpha)


def score_test(
    name: str, delays: Sequence[int], *, tail: Array, scales: tuple[Array, float, int], alpha: float
) -> CorrelationTest:
    """The test from the triangular factor of [delayed signal, residuals], the model's part already projected out."""
    norms, variance, n_errors = scales
    delayed, target = tail[:, :-1], tail[:, -1]
    own = np.linalg.norm(delayed, axis=0)
    carries = own > EXPLAINED_BY_MODEL * np.maximum(norms, np.finfo(float).tiny)
    directions = delayed[:, carries] / own[carries]
    scores = np.zeros(len(delays))
    scores[carries] = directions.T @ target / np.sqrt(variance)
    critical = _largest_score(directions, alpha)
    left, sizes, _ = np.linalg.svd(directions, full_matrices=False)
    distinct = sizes > DISTINCT * np.max(sizes, initial=0.0)
    statistic = float(np.sum((left[:, distinct].T @ target) ** 2) / variance)
    freedom = int(distinct.sum())
    share = np.where(carries, own / np.maximum(norms, np.finfo(float).tiny), 0.0) / np.sqrt(n_errors)
    return CorrelationTest(
        name=name,
        lags=tuple(delays),
        correlation=tuple((scores * share).tolist()),
        band=tuple((critical * share).tolist()),
        alpha=alpha,
        inside_band=bool(np.max(np.abs(scores), initial=0.0) <= critical),
        statistic=statistic,
        degrees_of_freedom=freedom,
        p_value=float(chdtrc(freedom, statistic)) if freedom else 1.0,
    )


def _largest_score(directions: Array, alpha: float) -> float:
    """The value that the largest |score| exceeds with probability alpha when the residuals are white.

    `directions` (n_rows, n_lags) have unit columns: the scores are jointly normal with their inner products as
    correlations. Nearly independent ones follow Z. Sidak, J. Amer. Statist. Assoc. 62, 1967; the others are drawn.
    """
    if directions.shape[1] == 0:
        return 0.0
    factor = r_factor(directions)
    overlap = np.max(np.abs(factor.T @ factor - np.eye(factor.shape[1])))
    if overlap < INDEPENDENT:
        return float(ndtri(0.5 + 0.5 * (1.0 - alpha) ** (1.0 / factor.shape[1])))
    draws = np.random.default_rng(_SEED).standard_normal((DRAWS, factor.shape[0]))
    return float(np.quantile(np.max(np.abs(draws @ factor), axis=1), 1.0 - alpha))


def check_settings(lags: int, alpha: float, n_samples: int) -> None:
    if not 0.0 < alpha < 1.0:
        raise InputError(f"alpha = {alpha}: give a probability between 0 and 1")
    if not 1 <= lags <= n_samples // 10:
        raise InputError(f"lags = {lags}: give 1 ... {n_samples // 10} for a run of {n_samples} samples")


@one_blas_thread
def feedback_tests(
    model: ArmaxEstimate, run: SampledRun, channels: Sequence[str], *, lags: int = 25, alpha: float = 0.01
) -> tuple[CorrelationTest, ...]:
    """One test a channel of the run: its values 1 ... lags samples ahead against the one-step errors.

    `channels` are as recorded (currents, forces): a rational term holds the measured position and answers to its noise
    without any feedback. `lags` of the result are negative. InputError if the run does not fit the model.
    """
    check_settings(lags, alpha, run.n_samples)
    signals = prepared_run(model, run).signals
    orders = model.orders
    errors = prediction_errors(signals, model.polynomials, orders).errors
    rows = sensitivity_signals(signals, model.polynomials, errors)
    columns, row_error = sensitivity_columns(orders)
    n_samples = signals.shape[1]
    first = n_samples - errors.size
    variance = float(errors @ errors) / (errors.size - len(columns))  # of the model; the past takes little more
    tests = []
    recorded = [np.asarray(run.inputs[name], dtype=float) for name in channels]
    past = [channel - channel.mean() for channel in recorded]
    behind = [(len(rows) + k, lag) for k in range(len(past)) for lag in range(lags)]
    explained = [*columns, *behind]
    for name, channel in zip(channels, recorded, strict=True):
        ahead = np.concatenate([channel[lags:] - channel.mean(), np.zeros(lags)])
        table_columns = [*explained, *((len(rows) + len(past), lag) for lag in range(lags)), (row_error, 0)]
        stacked = np.vstack([rows, *past, ahead])
        blocks = lagged_blocks(stacked, table_columns, first=first + lags, last=n_samples - lags)
        factor = triangular_factor(blocks, len(table_columns))
        norms = np.linalg.norm(factor[:, len(explained) : -1], axis=0)
        tail = factor[len(explained) :, len(explained) :]
        delays = [lag - lags for lag in range(lags)]
        tests.append(score_test(name, delays, tail=tail, scales=(norms, variance, errors.size - 2 * lags), alpha=alpha))
    return tuple(tests)


def feedback_note(tests: Sequence[CorrelationTest], *, known: bool) -> str | None:
    """The sentence for the reader; None in open loop. `known`: the record says that it was made in closed loop."""
    answering = [test.name for test in tests if not test.inside_band]
    if not known and not answering:
        return None
    seen = f" ({', '.join(answering)} answer to the errors)" if answering else ""
    return f"recorded under feedback{seen}: {SOUND_WHEN}"
