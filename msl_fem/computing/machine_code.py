"""Python functions to machine code, with a cache on disk that notices every change of what they depend on.

Numba's cache looks at the file of the function called, not at those of the functions that it calls in turn, so a change
there would leave stale machine code behind. Here each function is cached under a name that holds a digest of all it was
compiled from: its byte code and that of every compiled function it calls, the constants and the record types they name,
and the source of whatever else of the package they use. What it does not use may change and recompiles nothing.

What Python calls becomes machine code. What compiled functions call is only linked into these and optimised there, once
with all around it; numba by itself would optimise each function, with all that it calls, at every level of calls anew.
"""

import hashlib
import inspect
from collections.abc import Callable, Iterator, Sequence
from functools import cache, cached_property, partial
from importlib import import_module
from types import CodeType, FunctionType, ModuleType
from typing import Any

from numba import njit, types
from numba.core.caching import FunctionCache, NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target

from msl_fem.computing import operator_types  # noqa: F401 - numba types operators by it
from msl_fem.computing.linked_code import LinkedLibrary, WholeLibrary

OPTIONS = {"nogil": True, "error_model": "numpy"}
_LINKED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_PACKAGE = __name__.partition(".")[0]


def dispatcher_of(function: Callable[..., object]) -> Any:
    """Numba's compiler of one function that Python calls, with our cache."""
    with global_compiler_lock:  # numba's registries bear one thread at a time
        make_ready(function)
        dispatcher = njit(**OPTIONS)(function)
    dispatcher._cache = _LazyCache(function)
    dispatcher.compile = partial(_compile_whole, dispatcher, dispatcher.compile)
    return dispatcher


def linked_dispatcher_of(function: Callable[..., object]) -> Any:
    """The same for a function that compiled functions call; Python cannot call it."""
    with global_compiler_lock:
        make_ready(function)
        dispatcher = njit(**OPTIONS, **_LINKED)(function)
    dispatcher._cache = _LazyCache(function, "linked")
    dispatcher.compile = partial(_compile_into, LinkedLibrary, dispatcher.compile)
    dispatcher.get_call_template = partial(_call_template, dispatcher.get_call_template)
    return dispatcher


def make_ready(function: Callable[..., object]) -> None:
    """What the function names is there before it compiles."""
    for _, value in named_values(function):
        if getattr(value, "py_func", None) is not function:
            getattr(value, "_numba_type_", None)


def _compile_into(library: type[JITCodeLibrary], numba_s: Callable[..., Any], sig: Any) -> Any:
    """Numba's compiler, with the code kept in a library of that kind."""
    codegen = cpu_target.target_context.codegen()
    with global_compiler_lock:
        before = codegen._library_class
        codegen._library_class = library
        try:
            return numba_s(sig)
        finally:
            codegen._library_class = before


def _compile_whole(dispatcher: Any, numba_s: Callable[..., Any], sig: Any) -> Any:
    entry = _compile_into(WholeLibrary, numba_s, sig)
    set_environments(next(reversed(dispatcher.overloads.values())).library)
    return entry


def set_environments(library: Any) -> None:
    """Constants that linked functions keep outside of their code are found by the machine code they are part of."""
    for variable in library._final_module.global_variables:
        environment = lookup_environment(variable.name)
        if environment is not None:
            library.codegen.set_env(variable.name, environment)


def _call_template(numba_s: Callable[..., Any], kinds: Sequence[Any], named: dict[str, Any]) -> Any:
    """What a compiled function calls: one machine code for all constants of a type.

    Numba would compile the function once for `slopes(0)`, once for `slopes(2)` and once for `slopes(n)`; constants are
    followed all the same where the optimiser inlines the call.
    """
    return numba_s(tuple(map(types.unliteral, kinds)), {name: types.unliteral(kind) for name, kind in named.items()})


def digest(function: Any) -> str:
    """12 hexadecimal digits for what a compiled function, or the Python function behind it, is compiled from."""
    content = hashlib.sha256(repr(sorted((OPTIONS | _LINKED).items())).encode())
    python_function = getattr(function, "py_func", function)
    reached = {_name(python_function): python_function}
    waiting = [python_function]
    while waiting:
        for callee in _callees(waiting.pop()):
            if _name(callee) not in reached:
                reached[_name(callee)] = callee
                waiting.append(callee)
    for name in sorted(reached):
        content.update(name.encode() + _own_digest(reached[name]))
    return content.hexdigest()[:12]


class _LazyCache(NullCache):
    """The cache of one function, opened at its first call: by then all that the function names is defined."""

    def __init__(self, function: Callable[..., object], kind: str = "") -> None:
        self._function, self._kind = function, kind

    @cached_property
    def _opened(self) -> FunctionCache:
        f: Any = self._function
        named = FunctionType(f.__code__, f.__globals__, f.__name__, f.__defaults__, f.__closure__)
        named.__qualname__ = f"{f.__qualname__}_{self._kind}{digest(f)}"
        return _Cache(named)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._opened.load_overload(sig, target_context)
        except (ImportError, AttributeError):  # a saved signature names a record that stands elsewhere now
            self._opened.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        self._opened.save_overload(sig, data)


class _Cache(FunctionCache):
    """Numba's cache, which also tells apart records of the same class and types with fields in another order."""

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return (*super()._index_key(sig, codegen), tuple(_fields(sig)))


def _fields(kinds: Any) -> Iterator[tuple[str, ...]]:
    """The fields' names of all records among the arguments."""
    for kind in kinds:
        if isinstance(kind, types.BaseNamedTuple):
            yield tuple(kind.fields)
        if isinstance(kind, types.BaseTuple):
            yield from _fields(kind)


def _name(function: Any) -> str:
    return f"{function.__module__}.{function.__qualname__}"


def _callees(function: Any) -> Iterator[Any]:
    """The Python functions behind the compiled functions that a function names."""
    values = [value for _, value in named_values(function)]
    for value in values:  # grows by what lies in tuples
        if hasattr(value, "py_func"):
            yield value.py_func
        elif isinstance(value, tuple):
            values.extend(value)


@cache
def _own_digest(function: Any) -> bytes:
    """A digest of a function's byte code, and of the values it names that are no compiled functions."""
    content = hashlib.sha256("".join(_code_texts(function.__code__)).encode())
    content.update(f"{function.__defaults__}{function.__kwdefaults__}".encode())
    for name, value in named_values(function):
        content.update(name.encode() + _value_bytes(value))
    return content.digest()


def _code_texts(code: CodeType) -> Iterator[str]:
    names = (code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars)
    yield f"{code.co_code!r}{code.co_exceptiontable!r}{names}"
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code_texts(constant)
        else:
            yield repr(sorted(map(repr, constant)) if isinstance(constant, frozenset) else constant)


def _names(code: CodeType) -> set[str]:
    """Names of globals and attributes in a function and in the functions inside it."""
    return set(code.co_names).union(*(_names(c) for c in code.co_consts if isinstance(c, CodeType)))


def named_values(function: Any) -> list[tuple[str, Any]]:
    """What a function's names mean: its closure, its globals, and attributes of modules among these."""
    names = sorted(_names(function.__code__))
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    values = [(name, cell.cell_contents) for name, cell in cells]
    values += [(name, function.__globals__[name]) for name in names if name in function.__globals__]
    seen = set()
    for _, value in values:  # grows by the modules among modules
        if isinstance(value, ModuleType) and value.__name__ not in seen:
            seen.add(value.__name__)
            values += [(f"{value.__name__}.{name}", vars(value)[name]) for name in names if name in vars(value)]
    return values


def _value_bytes(value: Any) -> bytes:
    """What identifies a value in the next run too; nothing of what numba and numpy bring."""
    if hasattr(value, "py_func"):
        return _name(value.py_func).encode()
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return b"(" + b",".join(map(_value_bytes, value)) + b")"
    if isinstance(value, type) and hasattr(value, "_fields"):
        record: Any = value
        return f"{record.__qualname__}{record._fields}{record._field_defaults}".encode()
    if isinstance(value, ModuleType):
        return value.__name__.encode()
    home = getattr(value, "__module__", None) or type(value).__module__
    if home.partition(".")[0] == _PACKAGE:
        return _source_digest(home)
    if callable(value):
        return home.encode()
    if hasattr(value, "tobytes"):
        return f"{value.dtype}{value.shape}".encode() + value.tobytes()
    return repr(value).encode()


@cache
def _source_digest(module: str) -> bytes:
    return hashlib.sha256(inspect.getsource(import_module(module)).encode()).digest()
