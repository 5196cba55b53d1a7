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
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Style:
    """How functions are printed.

    Attributes
    ----------
    prefix : of all names, so that a header can stand beside others; without it, names begin with their modules'
    storage : "static", or "static inline" where not all functions are called
    first : the first line of every function
    symbolic : whether constants keep their names
    unrolled : names of loops and parameters that are decided where the C is printed
    arrays : id of a constant array and the name that it has in C already
    """

    prefix: str = ""
    storage: str = "static"
    first: str = ""
    symbolic: bool = True
    unrolled: frozenset[str] = frozenset()
    arrays: tuple[tuple[int, str], ...] = ()


def header_style(prefix: str, *, exact: str, **more: Any) -> Style:
    """Of functions in a header whose macro EXACT begins with `exact`: nothing is fused, whoever compiles it."""
    return Style(prefix=prefix, storage="static inline", first=f"{exact.upper()}_EXACT", symbolic=False, **more)


class Printer:
    """Collects functions, and what they need, in the order in which C wants them."""

    def __init__(self, style: Style | None = None, *, instead: Mapping[Any, Any] | None = None) -> None:
        """`instead` names functions that stand for others, as those that compiled code calls by their address."""
        self._instead = {getattr(one, "py_func", one): other for one, other in (instead or {}).items()}
        self._style = style or Style()
        self._arrays: dict[int, tuple[str, Any]] = {}
        self._records: dict[str, str] = {}
        self._names: dict[str, int | float] = {}
        self._functions: dict[tuple[Any, ...], PrintedFunction] = {}
        self._open: list[str] = []
        self._open_functions: list[Any] = []
        self._seen: set[Any] = set()

    def add(self, function: Callable[..., Any], types: Mapping[str, Any]) -> PrintedFunction:
        """The function for arguments of these types, or of a value that is known; None and functions are.

        Raises
        ------
        PrintError : it has something that is not printed as C; names function, line and what it is
        """
        given = {name: kind if isinstance(kind, Expression) else _argument(kind) for name, kind in types.items()}
        names = inspect.signature(getattr(function, "py_func", function)).parameters
        return self.printed(function, {name: given[name] for name in names if name in given})

    def printed(self, function: Any, arguments: Mapping[str, Expression]) -> PrintedFunction:
        """The function for such arguments, by the names of its parameters."""
        function = self._instead.get(getattr(function, "py_func", function), function)
        python = getattr(function, "py_func", function)
        pinned = {n for n, a in arguments.items() if a.type == FIXED or (a.known and n in self._style.unrolled)}
        arguments = {n: a if n in pinned else Expression(a.type, a.text) for n, a in arguments.items()}
        key = (python, *((n, a.type, _identity(a.constant) if n in pinned else None) for n, a in arguments.items()))
        if key not in self._functions:
            if python in self._open_functions:
                raise PrintError(f"{python.__name__} calls itself")
            name = self._c_name(python)
            self._open.append(name)
            self._open_functions.append(python)
            found = self._new(function, python, name, arguments)
            self._open.pop()
            self._open_functions.pop()
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

    def unrolled(self, name: str) -> bool:
        """Whether what a name stands for is decided where the C is printed."""
        return name in self._style.unrolled

    def array(self, values: Any, name: str) -> Expression:
        """A constant array: under the name that it has in C already, or put before the functions."""
        known = dict(self._style.arrays)
        if id(values) not in self._arrays:
            taken = {n for n, _ in self._arrays.values()}
            base = f"{self._style.prefix}{name}_"
            new = base if base not in taken else f"{base}{len(taken)}_"
            self._arrays[id(values)] = (known.get(id(values), new), values)
        return Expression(Pointer(values.shape, fixed=True), self._arrays[id(values)][0])

    @property
    def arrays(self) -> list[tuple[str, Any]]:
        """Name and values of the constant arrays that have to be put before the functions."""
        return [pair for key, pair in self._arrays.items() if key not in dict(self._style.arrays)]

    def named(self, name: str, value: float) -> Expression:
        """A constant by a name in C; by its value where the name means another one already."""
        if (
            not (name.isupper() and self._style.symbolic)
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
        return self._with_prefix("\n".join([*lines, names if whole else "", *self._records.values()]))

    def _with_prefix(self, text: str) -> str:
        """The structs of several values, and what stands before the functions: two headers may have the same."""
        return re.sub(r"\b(?=of_[rn_]+\b|printed_)", self._style.prefix, text)

    @property
    def definitions(self) -> str:
        """All functions, each behind those that it calls."""
        texts = [f.text for f in self._functions.values() if f.result != FIXED]
        prelude = [text for text in _PRELUDE.split("\n\n") if any(_name_of(text) in one for one in texts)]
        if any("printed_rest" in one for one in prelude):
            prelude = [text for text in _PRELUDE.split("\n\n") if text in prelude or "int printed_quotient" in text]
        return self._with_prefix("\n".join([*(f"{text.strip()}\n" for text in prelude), *texts]))

    def _c_name(self, python: Any) -> str:
        own = python.__name__.strip("_")
        module = f"{python.__module__.rpartition('.')[2].strip('_')}_"
        base = f"{self._style.prefix}{own}_" if self._style.prefix else f"{module}{own}"
        taken = {*self._open, *(f.name for f in self._functions.values())}
        names = (f"{base}{'' if self._style.prefix else '_'}{n}" for n in range(2, len(taken) + 3))
        free = base if python not in self._seen else next(name for name in names if name not in taken)
        self._seen.add(python)
        return free

    def _new(self, function: Any, python: Any, name: str, arguments: Mapping[str, Expression]) -> PrintedFunction:
        for argument in arguments.values():
            if isinstance(argument.type, RecordType):
                self.record(argument.type)
        tree = definition(python)
        body = FunctionBody(self, python, isinstance(function, Compiled), arguments)
        lines = body.print(tree)
        taken = tuple((n, a.type) for n, a in arguments.items() if a.type != FIXED and not a.known)
        head = ", ".join(_parameter(kind, n in body.writes).declared(body.c_name(n)) for n, kind in taken) or "void"
        if isinstance(body.result, Several):
            self.several(body.result)
        said = c_comment((ast.get_docstring(tree) or "").split("\n")[0])
        comment = f"/* {said} */\n" if said else ""
        words = set(re.findall(r"\w+", "\n".join(lines)))
        unused = [f"    (void){body.c_name(n)};" for n, _ in taken if body.c_name(n) not in words]
        if body.result == FIXED:
            return PrintedFunction(name, taken, FIXED, frozenset(), "", body.value)
        start = f"{comment}{self._style.storage} {body.result.declared(name)}({head})\n{{\n"
        first = [f"    {self._style.first}"] if self._style.first else []
        text = start + "\n".join([*first, *unused, *lines]) + "\n}\n"
        return PrintedFunction(name, taken, body.result, frozenset(body.writes), text)


def _parameter(kind: Any, written: bool) -> Any:
    """The type of a parameter: rows that are not written to are constant."""
    flat = isinstance(kind, Pointer) and len(kind.shape) < 2
    return Pointer(kind.shape, fixed=True) if flat and not written else kind


def _identity(value: Any) -> Any:
    """What tells known values apart: numbers by value, all else by being the same."""
    return value if isinstance(value, int | float) else id(value)


def _name_of(text: str) -> str:
    """The name of the first function in C."""
    found = re.search(r"printed_\w+", text)
    assert found
    return found[0]


def _argument(kind: Any) -> Expression:
    if kind is None or callable(kind) or hasattr(kind, "_fields"):
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
