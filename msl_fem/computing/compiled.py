"""The decorator of compiled functions. Numba is loaded at the first call of one, not before."""

import functools
import sys
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., object])


class Compiled:
    """A function as Python source, and from its first call on as machine code.

    Attributes
    ----------
    py_func : the function as it was written
    """

    def __init__(self, function: Callable[..., object]) -> None:
        functools.update_wrapper(self, function)
        self.py_func: Any = function

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """Numba's function, which compiles for each set of argument types or takes what the cache on disk has."""
        from msl_fem.computing.machine_code import dispatcher_of

        return dispatcher_of(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        """What a compiled function sees where it names this one."""
        return self.linked_dispatcher._numba_type_

    @functools.cached_property
    def linked_dispatcher(self) -> Any:
        from msl_fem.computing.machine_code import linked_dispatcher_of

        return linked_dispatcher_of(self.py_func)

    @functools.cached_property
    def interpreted(self) -> Callable[..., Any]:
        """The function run by Python, and with it all compiled functions that it calls: equal to the last bit."""
        f: Any = self.py_func
        names = {n: v.interpreted if isinstance(v, Compiled) else v for n, v in f.__globals__.items()
                 if n in f.__code__.co_names or n == "__builtins__"}  # fmt: skip
        return FunctionType(f.__code__, names, f.__name__, f.__defaults__, f.__closure__)

    def __reduce__(self) -> str:
        return str(self.py_func.__qualname__)  # by name, in the process that reads it


def compiled(function: Function) -> Function:
    """The function compiled by numba at its first call, and from the cache on disk at the first call of later runs.

    Division by zero gives inf or nan, as in numpy. Other threads may run meanwhile.
    """
    return Compiled(function)  # type: ignore[return-value]


def for_few(function: Function) -> Function:
    """The compiled function for a few points: run by Python where numba, whose import takes longer, is not loaded."""
    if "numba" in sys.modules or not isinstance(function, Compiled):
        return function

    def quietly(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function.interpreted(*arguments)

    return quietly  # type: ignore[return-value]
