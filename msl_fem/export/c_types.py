"""What values of printed C are: numbers, flags, rows of numbers, arrays of a known shape, records, several at once."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from msl_fem.export.c_text import c_number

NO_CONSTANT: Any = object()
"""Of a value that is known only when the C runs."""
ATOM, UNARY, PRODUCT, SUM, COMPARISON, BITS, CONJUNCTION, DISJUNCTION, CHOICE = range(9, 0, -1)
"""How strongly the parts of an expression hold together."""


class PrintError(TypeError):
    """A compiled function has something that is not printed as C."""


@dataclass(frozen=True)
class Number:
    """A type of C that is one number: REAL, WHOLE or FLAG."""

    c: str
    rank: int

    def declared(self, name: str) -> str:
        return f"{self.c} {name}"


FLAG, WHOLE, REAL = Number("int", 0), Number("int", 1), Number("double", 2)


@dataclass(frozen=True)
class Pointer:
    """The rows of an array of numbers; `shape` where it is known, so that parts, length and its end are."""

    shape: tuple[int, ...] = ()
    fixed: bool = False  # not written to

    def declared(self, name: str) -> str:
        kind = "const double" if self.fixed else "double"
        inner = "".join(f"[{n}]" for n in self.shape[1:])
        return f"{kind} (*{name}){inner}" if inner else f"{kind} *{name}"


@dataclass(frozen=True)
class RecordType:
    """A named tuple as a struct, passed on by its address.

    Attributes
    ----------
    fields : name to type, of what the C knows when it runs
    known : name to value, of what is known when it is printed
    optional : whether it may be None; then its member `there` is 0
    """

    name: str
    fields: tuple[tuple[str, Any], ...]
    known: tuple[tuple[str, Any], ...] = ()
    optional: bool = False

    def declared(self, name: str) -> str:
        return f"const {self.name} *{name}"

    def member(self, name: str) -> "tuple[Any, Any] | None":
        """(type, constant) of a field."""
        known = dict(self.known)
        if name in known:
            return c_type_of(known[name]), known[name]
        found = dict(self.fields).get(name)
        return None if found is None else (found, NO_CONSTANT)

    @property
    def text(self) -> str:
        members = ["    int there;"] if self.optional else []
        for name, kind in self.fields:
            if isinstance(kind, RecordType):
                members.append(f"    {kind.name} {name};")
            elif isinstance(kind, Pointer) and kind.shape:
                members.append(f"    double {name}{''.join(f'[{n}]' for n in kind.shape)};")
            else:
                members.append(f"    {kind.declared(name)};")
        return "typedef struct {\n" + "\n".join(members) + f"\n}} {self.name};\n"


@dataclass(frozen=True)
class Several:
    """A tuple, as a struct by value."""

    parts: tuple[Any, ...]

    @property
    def name(self) -> str:
        letters = [f"_{p.name[3:]}_" if isinstance(p, Several) else "r" if p == REAL else "n" for p in self.parts]
        return f"of_{''.join(letters)}"

    def declared(self, name: str) -> str:
        return f"{self.name} {name}"

    @property
    def text(self) -> str:
        members = "".join(f"    {part.declared(f'a{n}')};\n" for n, part in enumerate(self.parts))
        return "typedef struct {\n" + members + f"}} {self.name};\n"


@dataclass(frozen=True)
class Values:
    """The parameters of all effects: a number for every key of a dictionary."""

    index: Any = field(hash=False, compare=False)

    def declared(self, name: str) -> str:
        return f"const double *{name}"


@dataclass(frozen=True)
class Nothing:
    """What a function returns that returns nothing."""

    def declared(self, name: str) -> str:
        return f"void {name}"


@dataclass(frozen=True)
class Fixed:
    """What is known when the C is printed and is no number: None, a function, a module, a tuple of constants."""

    def declared(self, name: str) -> str:
        raise PrintError(f"{name} is no number")


NOTHING, FIXED = Nothing(), Fixed()


@dataclass(frozen=True)
class Expression:
    """An expression of C.

    Attributes
    ----------
    constant : its value where that is known when it is printed
    level : how strongly its parts hold together
    parts : of a tuple that is written out
    """

    type: Any
    text: str
    constant: Any = NO_CONSTANT
    level: int = ATOM
    parts: "tuple[Expression, ...]" = ()
    pointer: bool = True  # of a record: its address, not itself

    @property
    def known(self) -> bool:
        return self.constant is not NO_CONSTANT

    def at(self, level: int) -> str:
        """Its text, in brackets where it holds together less strongly."""
        return self.text if self.level >= level else f"({self.text})"


@dataclass(frozen=True)
class PrintedFunction:
    """A function as C.

    Attributes
    ----------
    name : in C
    parameters : name to type, of those that the C takes
    result : type of what it returns
    writes : parameters whose rows it changes
    """

    name: str
    parameters: tuple[tuple[str, Any], ...]
    result: Any
    writes: frozenset[str]
    text: str
    value: Any = None  # of one that returns what is no number and known


def c_type_of(value: Any) -> Any:
    """The type of a constant."""
    if isinstance(value, bool | np.bool_):
        return FLAG
    if isinstance(value, int | np.integer):
        return WHOLE
    return REAL if isinstance(value, float) else FIXED


def constant(value: Any, name: str | None = None) -> Expression:
    """The expression of a constant, under a name if it has one."""
    kind = c_type_of(value)
    if kind == FIXED:
        return Expression(FIXED, "", value)
    text = name or (str(int(value)) if kind != REAL else c_real(value))
    level = UNARY if text.startswith("-") else ATOM
    return Expression(kind, text, value, level)


def c_real(value: float) -> str:
    """A literal of exactly this double, in decimals where these are short."""
    short = repr(value)
    if math.isfinite(value) and len(short) <= 6 and "e" not in short and float(short).as_integer_ratio()[1] <= 1024:
        return short
    return c_number(value)


def joined_type(one: Any, other: Any) -> Any:
    """The type of what is of one type or of another."""
    if one is None or one == other:
        return other
    if isinstance(one, Number) and isinstance(other, Number):
        return max(one, other, key=lambda t: t.rank)
    if isinstance(one, Several) and isinstance(other, Several) and len(one.parts) == len(other.parts):
        return Several(tuple(joined_type(a, b) for a, b in zip(one.parts, other.parts, strict=True)))
    raise PrintError(f"a name is {one} and then {other}")
