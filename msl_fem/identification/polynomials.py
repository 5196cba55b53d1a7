"""Orders and polynomials of a MISO ARMAX model, A(q) y = sum_k B_k(q) u_k + offset + C(q) e.

A and C are monic in the delay operator q^-1: A = 1 + a_1 q^-1 + ... + a_na q^-na; B_k holds the coefficients of
q^-nk_k ... q^-(nk_k + nb_k - 1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray


@dataclass(frozen=True)
class ArmaxOrders:
    """Numbers of coefficients of A, of each B_k and of C, and the delay nk of each input in samples.

    `nb` and `nk` are one number for all inputs or one for each; `offset` adds a constant to the right-hand side.
    """

    na: int
    nb: int | tuple[int, ...]
    nc: int
    nk: int | tuple[int, ...] = 1
    offset: bool = False

    def for_inputs(self, n_inputs: int) -> ArmaxOrders:
        """The same orders with `nb` and `nk` as tuples of n_inputs; InputError if they do not fit."""
        nb, nk = _per_input("nb", self.nb, n_inputs, 1), _per_input("nk", self.nk, n_inputs, 0)
        for name, value in (("na", self.na), ("nc", self.nc)):
            if value < 0:
                raise InputError(f"order {name} = {value}: give 0 or more")
        return ArmaxOrders(self.na, nb, self.nc, nk, self.offset)

    @property
    def input_lags(self) -> tuple[range, ...]:
        """Delays at which each input enters; only for orders that went through `for_inputs`."""
        assert isinstance(self.nb, tuple)
        assert isinstance(self.nk, tuple)
        return tuple(range(nk, nk + nb) for nb, nk in zip(self.nb, self.nk, strict=True))

    @property
    def longest_lag(self) -> int:
        """Samples of history that one equation reaches back."""
        return max(self.na, self.nc, *(lags[-1] for lags in self.input_lags))

    @property
    def n_parameters(self) -> int:
        """Number of coefficients, the offset included."""
        return self.na + sum(map(len, self.input_lags)) + int(self.offset) + self.nc

    @property
    def n_linear(self) -> int:
        """Number of coefficients that the errors are linear in, given C: those of A, of all B and the offset."""
        return self.n_parameters - self.nc

    def parameter_names(self, input_names: Sequence[str]) -> tuple[str, ...]:
        """Names of the coefficients in the order of the parameter vector: A, B_1, B_2, ..., offset, C."""
        names = [f"a{i}" for i in range(1, self.na + 1)]
        for name, lags in zip(input_names, self.input_lags, strict=True):
            names += [f"b[{name}][{lag}]" for lag in lags]
        return (*names, *(["offset"] if self.offset else []), *(f"c{i}" for i in range(1, self.nc + 1)))


def _per_input(name: str, value: int | tuple[int, ...], n_inputs: int, least: int) -> tuple[int, ...]:
    values = (value,) * n_inputs if isinstance(value, int) else tuple(value)
    if len(values) != n_inputs:
        raise InputError(f"order {name} = {value} is for {len(values)} inputs but there are {n_inputs}")
    if min(values) < least:
        raise InputError(f"order {name} = {value}: give {least} or more for every input")
    return values


@dataclass(frozen=True, eq=False)
class Polynomials:
    """The coefficients: `a` (na + 1,) and `c` (nc + 1,) with their leading 1, one array (nb_k,) for each input."""

    a: FloatArray
    b: tuple[FloatArray, ...]
    c: FloatArray
    offset: float = 0.0

    def vector(self, orders: ArmaxOrders) -> FloatArray:
        """The free coefficients in one vector, shape (n_parameters,)."""
        offset = [self.offset] if orders.offset else []
        return np.concatenate([self.a[1:], *self.b, offset, self.c[1:]])


def polynomials_of(vector: FloatArray, orders: ArmaxOrders) -> Polynomials:
    """The polynomials that a parameter vector of shape (n_parameters,) stands for."""
    lengths = [orders.na, *map(len, orders.input_lags), int(orders.offset), orders.nc]
    parts = np.split(np.asarray(vector, dtype=float), np.cumsum(lengths)[:-1])
    a, *b, offset, c = parts
    return Polynomials(
        a=np.concatenate([[1.0], a]),
        b=tuple(b),
        c=np.concatenate([[1.0], c]),
        offset=float(offset[0]) if orders.offset else 0.0,
    )


def reflected(c: FloatArray) -> FloatArray:
    """A monic polynomial with the zeros outside the unit circle mirrored to the inside, the others untouched.

    A moving average and its mirror image have the same spectrum up to a factor (spectral factorisation), so C
    can always be chosen invertible; A must not be treated so, because an unstable plant is not its stable mirror.
    """
    zeros = np.roots(c)
    outside = np.abs(zeros) > 1.0
    if not outside.any():
        return c
    zeros[outside] = 1.0 / np.conj(zeros[outside])
    mirrored = np.zeros_like(c)
    mirrored[: zeros.size + 1] = np.real(np.poly(zeros))
    return mirrored
