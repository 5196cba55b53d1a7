"""Least squares with lagged signals in flat memory: the triangular factor is accumulated block by block.

Orthogonal factors, never normal equations: J'J would square the condition number, and the lagged samples of
smooth, oversampled signals are nearly collinear. Householder QR is indifferent to column scaling, so columns are
scaled on the small triangular factor, where their norms are known (Golub & Van Loan, Matrix Computations,
sec. 5.2 and 5.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError

BLOCK_ROWS = 4096
RANK_TOLERANCE = 1e-13  # of the largest singular value of the scaled matrix: below it is rounding

LaggedColumn = tuple[int, int]
"""(row of the signal matrix, delay in samples)."""


def lagged_blocks(
    signals: Array, columns: Sequence[LaggedColumn], *, first: int, last: int | None = None
) -> Iterable[Array]:
    """Blocks of the matrix whose column (row, lag) is signals[row, t - lag] for t = first ... last - 1.

    `signals` has shape (n_signals, n_samples); samples before the first one count as zero.
    """
    end = signals.shape[1] if last is None else last
    for start in range(first, end, BLOCK_ROWS):
        stop = min(start + BLOCK_ROWS, end)
        block = np.zeros((stop - start, len(columns)), order="F")
        for j, (row, lag) in enumerate(columns):
            missing = min(max(lag - start, 0), stop - start)
            block[missing:, j] = signals[row, start + missing - lag : stop - lag]
        yield block


def r_factor(matrix: Array) -> Array:
    """The triangular factor of a matrix (n_rows, n_columns), shape (min(n_rows, n_columns), n_columns)."""
    return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=float)


def triangular_factor(blocks: Iterable[Array], n_columns: int) -> Array:
    """Upper triangular R (n_columns, n_columns) with R'R = M'M for the matrix M whose row blocks are given."""
    factor = np.zeros((0, n_columns))
    for block in blocks:
        factor = r_factor(np.vstack([factor, block]) if factor.size else block)
    missing = n_columns - factor.shape[0]
    return np.vstack([factor, np.zeros((missing, n_columns))]) if missing else factor


@dataclass(frozen=True, eq=False)
class ScaledFactor:
    """Singular value decomposition of a triangular factor with columns scaled to unit norm, and its right side."""

    scale: Array
    singular_values: Array
    right: Array
    target: Array

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the scaled matrix; inf when the smallest is zero."""
        smallest = float(self.singular_values[-1])
        return float(self.singular_values[0]) / smallest if smallest > 0.0 else float("inf")

    @property
    def kept(self) -> Array:
        """1 for the directions above rounding, 0 for the others."""
        limit = RANK_TOLERANCE * self.singular_values[0]
        return np.where(self.singular_values > limit, 1.0, 0.0)

    @property
    def explained(self) -> float:
        """Sum of squares of the right side that the columns can explain."""
        return float(np.sum((self.kept * self.target) ** 2))

    def solution(self, damping: float = 0.0) -> Array:
        """Minimiser of |M x - r|^2 + damping s_1^2 |scaled x|^2; directions below rounding stay zero."""
        s = self.singular_values
        ridge = damping * s[0] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            gain = np.where(self.kept > 0.0, s / (s**2 + ridge), 0.0)
        return (self.right.T @ (gain * self.target)) / self.scale

    def with_gradient(self, gradient: Array) -> ScaledFactor:
        """The same matrix with the right side whose M'r is `gradient`."""
        with np.errstate(divide="ignore"):
            inverse = np.where(self.kept > 0.0, 1.0 / self.singular_values, 0.0)
        return replace(self, target=inverse * (self.right @ (gradient / self.scale)))

    def gram(self) -> Array:
        """M'M with unscaled columns."""
        half = (self.singular_values[:, None] * self.right) * self.scale
        return half.T @ half

    def inverse_gram(self) -> Array:
        """(M'M)^-1 on the directions above rounding."""
        with np.errstate(divide="ignore"):
            inverse = np.where(self.kept > 0.0, 1.0 / self.singular_values, 0.0)
        half = (self.right.T * inverse) / self.scale[:, None]
        return half @ half.T


def scaled_factor(factor: Array) -> ScaledFactor:
    """Decomposition of the triangular factor of [M, r]: the last column is the right side r."""
    matrix, target = factor[:-1, :-1], factor[:-1, -1]
    scale = np.linalg.norm(matrix, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    try:
        left, singular_values, right = np.linalg.svd(matrix / scale)
    except np.linalg.LinAlgError as err:
        raise ComputationError(
            f"the regression of {matrix.shape[1]} parameters is not finite ({err}); lower the orders, or check the "
            "scaling of the data"
        ) from err
    return ScaledFactor(scale, singular_values, right, left.T @ target)
