"""Numbers of compiled code that are one number, or one a lane: eight runs of the model advanced by one instruction.

Compiled functions take `Rows`: an array (n_row,) as numbers, or (n_row, LANES) as lanes, by its address alone. Written
with `rows[n]`, `fma`, `choose`, `smaller`, `exponential` and their like, and the operators they work on either. Eight
lanes are a vector of the machine (LLVM's <8 x double>), so what a lane computes equals to the last bit what the same
function computes on numbers. Rows count no references: the array must outlive them, and what takes `rows_of` an array
calls `keep` behind its last use.
"""

import math
from importlib import import_module
from typing import Any

from msl_fem.computing.compiled import compiled

LANES = 8
_LOG2_E = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10  # the first times an exponent is exact
_ROUNDER = 6755399441055744.0  # 1.5 2^52: added to a number and taken away again it leaves the nearest whole one
_OVERFLOW, _UNDERFLOW, _LARGEST = 710.0, -746.0, 1.7976931348623157e308
_LEAST_NORMAL, _ROOT_OF_TWO = 2.2250738585072014e-308, 1.4142135623730951
_E3, _E4, _E5, _E6, _E7, _E8, _E9, _E10, _E11, _E12, _E13 = (1.0 / math.factorial(k) for k in range(3, 14))
_L3, _L5, _L7, _L9, _L11, _L13, _L15, _L17, _L19, _L21, _L23 = (2.0 / k for k in range(3, 24, 2))
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
power_of_two: Any = _Generated("power_of_two")
"""2^a, of a whole number from -1022 to 1023."""
exponent_of: Any = _Generated("exponent_of")
"""The largest n with 2^n <= a, of a number from 2^-1022 on."""
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
def exponential(value: Value) -> Value:
    """exp, within an ulp: 2^n e^r with |r| <= log(2)/2 (Cody and Waite, Software Manual for the Elementary Functions,
    1980, chapter 6), e^r by its series up to r^13. A library's would be called lane by lane."""
    x = choose(value > _OVERFLOW, _OVERFLOW, value)
    x = choose(x < _UNDERFLOW, _UNDERFLOW, x)
    n = fma(x, _LOG2_E, _ROUNDER) - _ROUNDER
    r = fma(n, 0.0 - _LN2_LOW, fma(n, 0.0 - _LN2_HIGH, x))
    square = r * r
    even = fma(square, fma(square, fma(square, fma(square, fma(square, _E12, _E10), _E8), _E6), _E4), 0.5)
    odd = fma(square, fma(square, fma(square, fma(square, fma(square, _E13, _E11), _E9), _E7), _E5), _E3)
    found = 1.0 + fma(square, fma(r, odd, even), r)
    half = fma(n, 0.5, _ROUNDER) - _ROUNDER
    return found * power_of_two(half) * power_of_two(n - half)


@compiled
def logarithm(value: Value) -> Value:
    """Natural, within an ulp; minus infinity of 0, nan of what is below. n log(2) + log(1 + f) with 1 + f from the root
    of 1/2 to that of 2, and log(1 + f) = f - s (f - R) with s = f/(2 + f), R by the series of log((1 + s)/(1 - s)) up
    to s^23 (Cody and Waite, chapter 5)."""
    small, large = value < _LEAST_NORMAL, value > 1.0
    x = choose(small, value * 18014398509481984.0, choose(large, 0.25 * value, value))
    n = exponent_of(x)
    x = x * power_of_two(0.0 - n)
    above = x > _ROOT_OF_TWO
    f = choose(above, 0.5 * x, x) - 1.0
    n = choose(above, n + 1.0, n) - choose(small, 54.0, choose(large, 0.0 - 2.0, 0.0))
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = fma(w, fma(w, fma(w, fma(w, fma(w, _L23, _L19), _L15), _L11), _L7), _L3)
    odd = fma(w, fma(w, fma(w, fma(w, _L21, _L17), _L13), _L9), _L5)
    found = fma(n, _LN2_HIGH, f - fma(s, f - z * fma(z, odd, even), 0.0 - n * _LN2_LOW))
    found = choose(value > _LARGEST, value, found)
    return choose(value > 0.0, found, choose(value < 0.0, square_root(value), 0.0 - 1.0 / size(value)))


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
