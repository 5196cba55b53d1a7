"""Numbers of compiled code that are one number, or one a lane: eight runs of the model advanced by one instruction.

Compiled functions take `Rows`: an array (n_row,) as numbers, or (n_row, LANES) as lanes, by its address alone. Written
with `rows[n]`, `fma`, `choose`, `smaller`, `exponential` and their like, and the operators they work on either. Eight
lanes are a vector of the machine (LLVM's <8 x double>), so what a lane computes equals to the last bit what the same
function computes on numbers. Rows count no references: the array must outlive them, and what takes `rows_of` an array
calls `keep` behind its last use.
"""

from importlib import import_module
from typing import Any

from msl_fem.computing.compiled import compiled

LANES = 8
Value = Any  # a number, or one a lane
Flag = Any  # a truth value, or one a lane
Rows = Any  # the rows of an array, by its address


class RowLayout:
    """Hands out the rows of an array one after the other: whoever wants a row names it, and nobody counts.

    Its rows follow those of another layout, if one is given.
    """

    def __init__(self, *, after: "RowLayout | None" = None) -> None:
        self.size: int = after.size if after else 0

    def row(self, size: int = 1) -> int:
        """The next row, or the first of the next `size` rows."""
        self.size += size
        return self.size - size

    def rows(self, count: int, size: int = 1) -> list[int]:
        """The next `count` rows, or the first of each of as many blocks."""
        return [self.row(size) for _ in range(count)]


class _Generated:
    """A function of compiled code that `lane_code` generates; numba is loaded when one that names it is compiled."""

    __module__ = "msl_fem.computing.lane_code"

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def _numba_type_(self) -> Any:
        code = import_module(self.__module__)
        return code.type_of(getattr(code, self._name))


fma: Any = _Generated("fma")
"""a b + c, rounded once where the machine can, whatever surrounds it: equal in every function that says it."""
size: Any = _Generated("size")
"""|a|"""
exponential: Any = _Generated("exponential")
"""exp(a)"""
logarithm: Any = _Generated("logarithm")
"""Natural, of a positive number."""
square_root: Any = _Generated("square_root")
"""Of a number that is not negative."""
sine_of: Any = _Generated("sine_of")
"""sin(a)"""
cosine_of: Any = _Generated("cosine_of")
"""cos(a)"""
choose: Any = _Generated("choose")
"""a where the flag is up, else b; both are computed."""
rows_of: Any = _Generated("rows_of")
"""The rows of a C-ordered array: lanes of (n_row, LANES), else numbers; None of None."""
keep: Any = _Generated("keep")
"""Nothing: the array lives until here."""
width: Any = _Generated("width")
"""How many lanes the rows have: 1 or LANES."""
lane_of: Any = _Generated("lane_of")
"""Row n of one lane."""
set_lane: Any = _Generated("set_lane")
"""Sets row n of one lane."""
every: Any = _Generated("every")
"""Whether the flag is up in every lane."""
some: Any = _Generated("some")
"""Whether the flag is up in one lane at least."""
first: Any = _Generated("first")
"""The number of the first lane, where all lanes are of one kind."""
call_at: Any = _Generated("call_at")
"""Calls the function of two rows that stands at an address, a number of `addresses.address_of`."""


@compiled
def smaller(a: Value, b: Value) -> Value:
    return choose(a < b, a, b)


@compiled
def larger(a: Value, b: Value) -> Value:
    return choose(a > b, a, b)


@compiled
def within(value: Value, reach: Value) -> Value:
    """The value, cut at plus and minus `reach`."""
    return smaller(larger(value, 0.0 - reach), reach)


@compiled
def sign_of(value: Value) -> Value:
    """1, 0 or -1; nan of nan."""
    return choose(value > 0.0, 1.0, choose(value < 0.0, 0.0 - 1.0, value))


@compiled
def hyperbolic_tangent(value: Value) -> Value:
    """tanh by exponentials, near 0 by its series, whose next term is below 1e-17 of it."""
    square = value * value
    fall = exponential(0.0 - 2.0 * size(value))
    far = sign_of(value) * (1.0 - fall) / (1.0 + fall)
    near = value * (
        1.0 - square * (1.0 / 3.0 - square * (2.0 / 15.0 - square * (17.0 / 315.0 - square * 62.0 / 2835.0)))
    )
    return choose(size(value) < 0.03, near, far)


@compiled
def hyperbolic_sine(value: Value) -> Value:
    """sinh by exponentials, near 0 by its series, whose next term is below 1e-17 of it."""
    square = value * value
    rise = exponential(size(value))
    near = value * (1.0 + square / 6.0 * (1.0 + square / 20.0 * (1.0 + square / 42.0)))
    return choose(size(value) < 0.03, near, sign_of(value) * 0.5 * (rise - 1.0 / rise))


@compiled
def hyperbolic_cosine(value: Value) -> Value:
    rise = exponential(size(value))
    return 0.5 * (rise + 1.0 / rise)


@compiled
def inverse_hyperbolic_sine(value: Value) -> Value:
    """asinh by a logarithm, near 0 by its series, whose next term is below 2e-17 of it."""
    square = value * value
    far = sign_of(value) * logarithm(size(value) + square_root(1.0 + square))
    near = value * (
        1.0 - square * (1.0 / 6.0 - square * (3.0 / 40.0 - square * (5.0 / 112.0 - square * 35.0 / 1152.0)))
    )
    return choose(size(value) < 0.03, near, far)
