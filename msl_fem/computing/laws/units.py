"""Units of a user's law by their exponents of SI's base units: "N s2/m2" or "N s^2/m^2" to (kg m^-1)."""

import re
from collections.abc import Iterable
from fractions import Fraction
from typing import NamedTuple

from msl_fem.errors import InputError

Exponents = tuple[Fraction, Fraction, Fraction, Fraction, Fraction]
BASES = ("kg", "m", "s", "A", "K")
_PREFIXES = {"k": 1e3, "M": 1e6, "m": 1e-3, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "n": 1e-9}
_KNOWN: dict[str, tuple[int, int, int, int, int]] = {
    "kg": (1, 0, 0, 0, 0), "m": (0, 1, 0, 0, 0), "s": (0, 0, 1, 0, 0), "A": (0, 0, 0, 1, 0), "K": (0, 0, 0, 0, 1),
    "N": (1, 1, -2, 0, 0), "J": (1, 2, -2, 0, 0), "W": (1, 2, -3, 0, 0), "Pa": (1, -1, -2, 0, 0),
    "V": (1, 2, -3, -1, 0), "ohm": (1, 2, -3, -2, 0), "Wb": (1, 2, -2, -1, 0), "T": (1, 0, -2, -1, 0),
    "H": (1, 2, -2, -2, 0), "C": (0, 0, 1, 1, 0), "F": (-1, -2, 4, 2, 0), "Hz": (0, 0, -1, 0, 0),
}  # fmt: skip
_FACTOR = re.compile(r"\s*([*·/]?)\s*([A-Za-zµμΩ%]+|1)(?:\s*(?:\^|\*\*)\s*|(?=[-\d]))?(-?\d)?(?![\d.])")


class Dimension(NamedTuple):
    """Exponents of kg, m, s, A, K."""

    exponents: Exponents

    def times(self, other: "Dimension") -> "Dimension":
        return Dimension(_five(a + b for a, b in zip(self.exponents, other.exponents, strict=True)))

    def power(self, exponent: Fraction) -> "Dimension":
        return Dimension(_five(exponent * a for a in self.exponents))

    @property
    def text(self) -> str:
        """In base units, "1" for a pure number."""
        parts = [
            name if power == 1 else f"{name}^{power}"
            for name, power in zip(BASES, self.exponents, strict=True)
            if power
        ]
        return " ".join(parts) or "1"


def _five(values: Iterable[Fraction]) -> Exponents:
    kg, m, s, a, k = values
    return kg, m, s, a, k


NUMBER = Dimension(_five(Fraction(0) for _ in BASES))


class Unit(NamedTuple):
    """A unit: factor to SI, dimension, and its text without prefixes as the files write it."""

    factor: float
    dimension: Dimension
    text: str


def parse_unit(text: str) -> Unit:
    """The unit of a text like "N s2/m2", "mm", "1/s" or "" (a pure number); a "/" divides by the one factor behind it.

    Raises
    ------
    InputError : a name that is no unit; names it and those there are
    """
    factor, dimension, words, at = 1.0, NUMBER, "", 0
    stripped = text.strip()
    while at < len(stripped):
        match = _FACTOR.match(stripped, at)
        if match is None:
            raise InputError(f"'{stripped[at:].strip()}' in the unit '{stripped}' is no unit; write it like 'N s2/m2'")
        at = match.end()
        sign = -1 if match[1] == "/" else 1
        power = int(match[3] or 1)
        size, name = _named(match[2], stripped)
        factor *= size ** (sign * power)
        if name:
            exponents = Dimension(_five(Fraction(e) for e in _KNOWN[name]))
            dimension = dimension.times(exponents.power(Fraction(sign * power)))
            words += _word(name, power, divided=sign < 0, first=not words)
    return Unit(factor, dimension, words)


def _word(name: str, power: int, *, divided: bool, first: bool) -> str:
    if divided and first:
        return f"{name}^{-power}"
    raised = name if power == 1 else f"{name}^{power}"
    return f"/{raised}" if divided else raised if first else f" {raised}"


def _named(name: str, whole: str) -> tuple[float, str]:
    """(factor, SI name) of a unit with or without a prefix; the name of a number is empty."""
    name = name.replace("Ω", "ohm")
    if name in ("1", "rad"):
        return 1.0, ""
    if name == "%":
        return 0.01, ""
    if name in _KNOWN:
        return 1.0, name
    if name == "g":
        return 1e-3, "kg"
    if name[:1] in _PREFIXES and name[1:] in _KNOWN and name[1:] != "kg":
        return _PREFIXES[name[0]], name[1:]
    raise InputError(
        f"'{name}' in the unit '{whole}' is no unit; there are {', '.join(_KNOWN)}, g, rad and %, with the prefixes "
        f"{', '.join(_PREFIXES)}"
    )
