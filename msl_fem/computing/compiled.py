"""The decorator of compiled functions, with a cache on disk that notices every change of compiled code."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., object])


def _digest() -> str:
    """A name for the present state of all sources that hold compiled functions."""
    content = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        source = path.read_bytes()
        if b"msl_fem.computing.compiled import" in source or path.samefile(__file__):
            content.update(source)
    return content.hexdigest()[:12]


DIGEST = _digest()


def compiled(function: Function) -> Function:
    """The function compiled by numba at its first call, and from the cache on disk at the first call of later runs.

    Numba's cache looks at the file of the function called, not at those of the functions that it calls in turn, so a
    change there would leave stale machine code behind. The digest in the cached name makes every change count.
    Division by zero gives inf or nan, as in numpy. Other threads may run meanwhile.
    """
    function.__qualname__ = f"{function.__qualname__}_{DIGEST}"
    made: Function = njit(cache=True, nogil=True, error_model="numpy")(function)
    return made
