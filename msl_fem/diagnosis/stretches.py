"""Runs cut into stretches with free starts: multiple shooting (Bock, Kostina, Schloeder, GAMM-Mitt. 30, 2007).

In an unstable plant an error of the start, or of a parameter, grows until a free run says nothing. Over a stretch of
the growth's time constant it does not: the recorded inputs drive the simulation from a start that is free, a nuisance
of its own. Near a reference trajectory the residual r of a stretch is linear in its start's moves d, r + S d, and with
white noise and a normal prior of d the starts are eliminated,

    d = -(S'S + 1)^-1 S'r,   what is left is r + S d

(the Schur complement of their block). What else the state holds goes on from stretch to stretch
(`plant.restart`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.known_copies import knowing
from msl_fem.diagnosis.row_loops import put_gram, put_moves

ROUNDING = 1e-12  # of S'S, each start by its own size: a direction in which there is less shows nothing


@dataclass(frozen=True, eq=False)
class Stretches:
    """How a run is cut, and the starts from which it is followed.

    Attributes
    ----------
    begins : (n_stretch,) first samples, the first is 0
    starts : (n_stretch, 4) currents of the sides (A), position (m), velocity (m/s), as instruments read them where they
        are read: where a model believes in another gain or zero of them, what moves begins elsewhere
    slopes : (n_channel, n_start, n_sample) of the channels' residuals over their noise, by the moves of the starts
    outside : (n_stretch,) those in which the model leaves its table or range, which do not count; None: all count
    """

    begins: NDArray[np.intp]
    starts: Array
    slopes: Array
    outside: NDArray[np.bool_] | None = None

    def parts(self, n_sample: int) -> list[slice]:
        """The samples of each stretch."""
        ends = [*self.begins[1:], n_sample]
        return [slice(int(begin), int(end)) for begin, end in zip(self.begins, ends, strict=True)]

    def counted_parts(self, n_sample: int) -> list[slice]:
        """The samples of each stretch that counts."""
        parts = self.parts(n_sample)
        return parts if self.outside is None else [p for p, out in zip(parts, self.outside, strict=True) if not out]

    def counts(self, n_sample: int) -> NDArray[np.bool_]:
        """(n_sample,) whether a sample counts."""
        counts = np.zeros(n_sample, dtype=bool)
        for part in self.counted_parts(n_sample):
            counts[part] = True
        return counts

    def starting(self, starts: Array) -> "Stretches":
        """With other starts, the slopes being these."""
        return knowing(replace(self, starts=starts), self, "_roots", "_inverse")

    def first(self, n: int, samples: int) -> "Stretches":
        """The first n of them, which have so many samples together."""
        outside = None if self.outside is None else self.outside[:n]
        return Stretches(self.begins[:n], self.starts[:n], self.slopes[:, :, :samples], outside)

    def moves(self, over: Array) -> Array:
        """(n_row, n_stretch, n_start) that leave least of residuals over the noise (n_channel, n_row, n_sample)."""
        return self._moves(over, leave_out=False)

    def without_starts(self, over: Array) -> Array:
        """What is left of residuals over the noise (n_channel, n_row, n_sample) beside the starts."""
        left = over.copy()
        self.leave_out_starts(left)
        return left

    def leave_out_starts(self, over: Array) -> Array:
        """The same in place; returns the moves of the starts."""
        return self._moves(over, leave_out=True)

    def _moves(self, over: Array, *, leave_out: bool) -> Array:
        moves = np.empty((over.shape[1], self.begins.size, self.slopes.shape[1]))
        put_moves(moves, over, self.slopes, self.begins, self._inverse, leave_out)
        moves[~np.isfinite(moves).all(axis=2)] = 0.0  # where nothing can be simulated a start stays where it is
        return moves

    def orthonormal(self) -> Array:
        """(n_channel, n_start, n_sample), in each stretch columns Q with S (S'S + 1)^-1 S' = Q Q'."""
        found = np.empty_like(self.slopes)
        for root, part in zip(self._roots, self.parts(self.slopes.shape[-1]), strict=True):
            found[:, :, part] = root.T @ self.slopes[:, :, part]
        return found

    @cached_property
    def _inverse(self) -> Array:
        """(n_stretch, n_start, n_start) of S'S + 1."""
        return self._roots @ np.swapaxes(self._roots, 1, 2)

    @cached_property
    def _roots(self) -> Array:
        """(n_stretch, n_start, n_start) R with R R' the inverse of S'S + 1: where errors grow, all starts may act alike
        but for rounding, by 1e16 times a step of theirs."""
        n = self.slopes.shape[1]
        gram = np.empty((self.begins.size, n, n))
        put_gram(gram, self.slopes, self.begins)
        gram += np.eye(n)
        roots, finite = np.full_like(gram, np.nan), np.isfinite(gram).all(axis=(1, 2))
        size = np.sqrt(np.diagonal(gram[finite], axis1=1, axis2=2))
        values, vectors = np.linalg.eigh(gram[finite] / (size[:, :, None] * size[:, None, :]))
        over = np.where(values > ROUNDING, 1.0 / np.sqrt(np.maximum(values, ROUNDING)), 0.0)
        roots[finite] = vectors * over[:, None, :] / size[:, :, None]
        return roots


def moved(starts: Array, by: Array) -> Array:
    """Starts (..., n_stretch, 4) moved by positions, velocities and currents (..., n_stretch, n_start)."""
    by = np.broadcast_to(by, (*starts.shape[:-1], by.shape[-1]))
    made = starts.copy()
    made[..., 2:] += by[..., :2]
    made[..., : by.shape[-1] - 2] += by[..., 2:]
    return made
