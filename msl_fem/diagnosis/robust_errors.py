"""Standard errors that hold though what a model leaves is no white noise: the sandwich P^-1 M P^-1.

P is the Gauss-Newton matrix with the prior, M the covariance of its score, taken from what is left in two ways
(H. White, Econometrica 48, 1980, 817-838; K.-Y. Liang, S. Zeger, Biometrika 73, 1986, 13-22):

    line by line    the power of a line and its two neighbours, over which a sine between two lines leaks. An error that
                    comes again with every stroke stands in the lines in which the regressors stand, and weighs there;
    run by run      the scores of whole runs, each a draw. An error that is another one in runs of other strokes
                    scatters them. Student's t has one degree of freedom less than the effective number of runs
                    (A. Carter, K. Schnepel, D. Steigerwald, Rev. Econ. Stat. 99, 2017, 698-709), by what each tells.

The larger of both counts, never less than what white noise would leave, nor more than what was believed before.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm, t

from msl_fem.computing.arrays import Array
from msl_fem.diagnosis.likelihood import Fit

FEWEST_RUNS = 2.0
"""Effective ones, below which they tell no scatter."""
NEIGHBOURS = np.ones(3)
PROBABILITY = 0.975


def robust_errors(found: Fit, lines: Sequence[int], along: Array) -> Array:
    """(n,) by which the 95 % intervals of sums of the unknowns, weighted by `along` (n, unknowns.size), reach to either
    side, over 1.96.

    `lines` are those of each run; of a run the fit's residual holds the real parts, then the imaginary parts.
    """
    inverse = np.linalg.inv(found.precision)
    to = along @ inverse
    prior = np.asarray(np.diag(found.unknowns.prior(found.z)[2]), dtype=np.float64)
    left, slopes = found.residual * found.weights.root, found.jacobian * found.weights.root[:, None]
    ends = np.cumsum([2 * n for n in lines])
    runs = [slice(int(end) - 2 * n, int(end)) for end, n in zip(ends, lines, strict=True)]
    white = _errors(to, found.precision)
    by_line = _errors(to, prior + sum(_of_lines(left[run], slopes[run]) for run in runs))
    scores = np.array([slopes[run].T @ left[run] for run in runs])
    told = np.array([np.sum((slopes[run] @ to.T) ** 2, axis=0) for run in runs])
    effective = np.maximum(told.sum(axis=0) ** 2 / np.maximum((told**2).sum(axis=0), 1e-300), 1.0)
    many = effective >= FEWEST_RUNS
    degrees = np.where(many, effective - 1, 1.0)
    wide = (t.ppf(PROBABILITY, degrees) / norm.ppf(PROBABILITY)) ** 2 * effective / degrees
    by_run = np.sqrt(_errors(to, prior) ** 2 + wide * _errors(to, scores.T @ scores) ** 2)
    found_by = np.maximum.reduce([white, by_line, np.where(many, by_run, 0.0)])
    believed = np.sqrt(np.sum(along**2 / np.diag(prior), axis=1))
    return np.asarray(np.minimum(found_by, believed))


def _errors(to: Array, score: Array) -> Array:
    """(n,) of sums that are `to` (n, n_unknown) times a score of this covariance."""
    return np.asarray(np.sqrt(np.sum(to @ score * to, axis=1)))


def _of_lines(left: Array, slopes: Array) -> Array:
    """The covariance of a run's score (n_unknown, n_unknown), each line with its power and its neighbours'."""
    n = left.size // 2
    count = np.full(n, 2.0)
    count[0] = 1.0  # the mean has no imaginary part
    power = left[:n] ** 2 + left[n:] ** 2
    local = np.convolve(power, NEIGHBOURS, "same") / np.convolve(count, NEIGHBOURS, "same")
    return np.asarray((slopes * np.tile(local, 2)[:, None]).T @ slopes)
