"""C99 printed from compiled Python: one source for the kernel and for what runs without Python.

The compiled functions are written in a small part of Python: numbers, rows of numbers, named tuples, `if`, `while`,
`for range`, calls of one another. A `Printer` takes such a function with the types of its arguments, prints it with all
functions that it calls, and keeps the order of the operations; so the C gives the same bits where neither compiler
fuses products with sums but where `fma` says it. What is known when it is printed (None, a kind of drive, the number of
sides) decides its branches there, as it does for the compiled code.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from msl_fem.computing.compiled import Compiled
from msl_fem.export.c_statements import FunctionBody
from msl_fem.export.c_text import c_comment, c_number
from msl_fem.export.c_types import (
    FIXED,
    NO_CONSTANT,
    Expression,
    Pointer,
    PrintedFunction,
    PrintError,
    RecordType,
    Several,
    constant,
)

_PRELUDE = """\
static inline double printed_fma(double a, double b, double c)
{
#ifdef __FMA__
    return __builtin_fma(a, b, c);
#else
    return a * b + c; /* as the compiled Python does where the machine cannot fuse them */
#endif
}

static inline double printed_sign(double a)
{
    return a > 0.0 ? 1.0 : a < 0.0 ? -1.0 : a;
}

static inline double printed_square(double a)
{
    return a * a;
}

static inline int printed_quotient(int a, int b)
{
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}

static inline int printed_rest(int a, int b)
{
    return a - b * printed_quotient(a, b);
}
"""


class Printer:
    """Collects functions, and what they need, in the order in which C wants them."""

    def __init__(self) -> None:
        self._records: dict[str, str] = {}
        self._names: dict[str, int | float] = {}
        self._functions: dict[tuple[Any, ...], PrintedFunction] = {}
        self._open: list[str] = []

    def add(self, function: Callable[..., Any], types: Mapping[str, Any]) -> PrintedFunction:
        """The function for arguments of these types, or of a value that is known; None and functions are.

        Raises
        ------
        PrintError : it has something that is not printed as C; names function, line and what it is
        """
        arguments = {name: kind if isinstance(kind, Expression) else _argument(kind) for name, kind in types.items()}
        return self.printed(function, arguments)

    def printed(self, function: Any, arguments: Mapping[str, Expression]) -> PrintedFunction:
        """The function for such arguments, by the names of its parameters."""
        python = getattr(function, "py_func", function)
        key = (python, *((name, a.type, a.constant if a.type == FIXED else None) for name, a in arguments.items()))
        if key not in self._functions:
            name = self._c_name(python)
            if name in self._open:
                raise PrintError(f"{name} calls itself")
            self._open.append(name)
            found = self._new(function, python, name, arguments)
            self._open.pop()
            self._functions[key] = found
        return self._functions[key]

    def record(self, kind: RecordType) -> RecordType:
        """The record, declared with all that it holds."""
        for _, member in kind.fields:
            if isinstance(member, RecordType):
                self.record(member)
        if self._records.setdefault(kind.name, kind.text) != kind.text:
            raise PrintError(f"there are two records {kind.name}")
        return kind

    def several(self, kind: Several) -> None:
        """Declares a tuple, with the tuples in it."""
        for part in kind.parts:
            if isinstance(part, Several):
                self.several(part)
        self._records[kind.name] = kind.text

    def named(self, name: str, value: float) -> Expression:
        """A constant by a name in C; by its value where the name means another one already."""
        if (
            not name.isupper()
            or self._names.setdefault(name, value) != value
            or type(self._names[name]) is not type(value)
        ):
            return constant(value)
        return constant(value, name)

    @property
    def declarations(self) -> str:
        """Constants and records of all that was collected."""
        whole = {n: v for n, v in self._names.items() if isinstance(v, int)}
        lines = [f"#define {n} {c_number(v)} /* {v:.17g} */" for n, v in self._names.items() if n not in whole]
        names = "enum {\n" + textwrap.fill(", ".join(f"{n} = {v}" for n, v in whole.items()), 118,
                                           initial_indent="    ", subsequent_indent="    ") + "\n};\n"  # fmt: skip
        return "\n".join([*lines, names if whole else "", *self._records.values()])

    @property
    def definitions(self) -> str:
        """All functions, each behind those that it calls."""
        return "\n".join([_PRELUDE, *(f.text for f in self._functions.values())])

    def _c_name(self, python: Any) -> str:
        base = f"{python.__module__.rpartition('.')[2].strip('_')}_{python.__name__.strip('_')}"
        count = sum(f.name == base or f.name.startswith(f"{base}__") for f in self._functions.values())
        return f"{base}__{count + 1}" if count else base

    def _new(self, function: Any, python: Any, name: str, arguments: Mapping[str, Expression]) -> PrintedFunction:
        for argument in arguments.values():
            if isinstance(argument.type, RecordType):
                self.record(argument.type)
        tree = definition(python)
        body = FunctionBody(self, python, isinstance(function, Compiled), arguments)
        lines = body.print(tree)
        taken = tuple((n, a.type) for n, a in arguments.items() if a.type != FIXED)
        head = ", ".join(_parameter(kind, n in body.writes).declared(body.c_name(n)) for n, kind in taken) or "void"
        if isinstance(body.result, Several):
            self.several(body.result)
        said = c_comment((ast.get_docstring(tree) or "").split("\n")[0])
        comment = f"/* {said} */\n" if said else ""
        words = set(re.findall(r"\w+", "\n".join(lines)))
        unused = [f"    (void){body.c_name(n)};" for n, _ in taken if body.c_name(n) not in words]
        start = f"{comment}static {body.result.declared(name)}({head})\n{{\n"
        text = start + "\n".join([*unused, *lines]) + "\n}\n"
        return PrintedFunction(name, taken, body.result, frozenset(body.writes), text)


def _parameter(kind: Any, written: bool) -> Any:
    """The type of a parameter: rows that are not written to are constant."""
    flat = isinstance(kind, Pointer) and len(kind.shape) < 2
    return Pointer(kind.shape, fixed=True) if flat and not written else kind


def _argument(kind: Any) -> Expression:
    if kind is None or callable(kind):
        return Expression(FIXED, "", kind)
    return Expression(kind, "", NO_CONSTANT)


@cache
def definition(python: Any) -> ast.FunctionDef:
    """The syntax tree of a function."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(python)))
    except (OSError, TypeError) as err:
        raise PrintError(f"{python!r} has no Python source ({err})") from err
    [found] = tree.body
    if not isinstance(found, ast.FunctionDef):
        raise PrintError(f"{python!r} is no function")
    return found
