"""Runs cut into stretches with free starts: multiple shooting (Bock, Kostina, Schloeder, GAMM-Mitt. 30, 2007).

In an unstable plant an error of the start, or of a parameter, grows until a free run says nothing. Over a stretch of
the growth's time constant it does not: the recorded inputs drive the simulation from a start that is free, a nuisance
of its own. Near a reference trajectory the residual r of a stretch is linear in its start's moves d, r + S d, and with
white noise and a normal prior of d the starts are eliminated,

    d = -(S'S + 1)^-1 S'r,   what is left is r + S d

(the Schur complement of their block). What else the state holds goes on from stretch to stretch
(`plant.restart`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array


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

    def first(self, n: int, samples: int) -> "Stretches":
        """The first n of them, which have so many samples together."""
        outside = None if self.outside is None else self.outside[:n]
        return Stretches(self.begins[:n], self.starts[:n], self.slopes[:, :, :samples], outside)

    def moves(self, over: Sequence[Array]) -> Array:
        """(n_row, n_stretch, n_start) that leave least of residuals over the noise, (n_row, n_sample) each."""
        slope = np.zeros(())
        for values, s in zip(over, self.slopes, strict=True):
            products = [np.add.reduceat(values * column, self.begins, axis=1) for column in s]
            slope = slope + np.stack(products, axis=-1)
        return -np.einsum("sab,rsb->rsa", self._inverse, slope)

    def without_starts(self, over: Sequence[Array], moves: Array | None = None) -> list[Array]:
        """What is left of residuals over the noise, (n_row, n_sample) each, beside the starts, by their `moves` where
        they are known."""
        moves = self.moves(over) if moves is None else moves
        lengths = np.diff([*self.begins, over[0].shape[1]])
        made = []
        for values, s in zip(over, self.slopes, strict=True):
            left = values.copy()
            for n, column in enumerate(s):
                left += np.repeat(moves[:, :, n], lengths, axis=1) * column
            made.append(left)
        return made

    def orthonormal(self, channel: int, part: slice) -> Array:
        """(n_start, n_sample) of a stretch: columns Q of a channel with S (S'S + 1)^-1 S' = Q Q'."""
        stretch = int(np.searchsorted(self.begins, part.start))
        root = np.linalg.cholesky(self._inverse[stretch])
        return np.asarray(root.T @ self.slopes[channel][:, part])

    @cached_property
    def _inverse(self) -> Array:
        """(n_stretch, n_start, n_start) of S'S + 1."""
        n = self.slopes.shape[1]
        gram = np.zeros((self.begins.size, n, n))
        for s in self.slopes:
            for a in range(n):
                for b in range(n):
                    gram[:, a, b] += np.add.reduceat(s[a] * s[b], self.begins)
        return np.asarray(np.linalg.inv(gram + np.eye(n)))


def moved(starts: Array, by: Array) -> Array:
    """Starts (..., n_stretch, 4) moved by positions, velocities and currents (..., n_stretch, n_start)."""
    by = np.broadcast_to(by, (*starts.shape[:-1], by.shape[-1]))
    made = starts.copy()
    made[..., 2:] += by[..., :2]
    made[..., : by.shape[-1] - 2] += by[..., 2:]
    return made
