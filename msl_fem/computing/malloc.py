"""What the GNU C library's malloc keeps of what is freed: of many threads, and between two large pieces of work.

Each thread has an arena of its own, and fits that wait for each other's simulations have a thread each: of what they
let go a third stays in the process. Of what is freed a system takes back the end alone, unless it is asked to (The GNU
C Library Reference Manual, "Malloc Tunable Parameters"; malloc_trim(3)).
"""

import ctypes
import os
import sys
from collections.abc import Callable
from functools import cache
from typing import Any

_ARENA_MAX = -8  # of mallopt, as malloc.h has it
FEW = 2


@cache
def few_arenas() -> bool:
    """Whether malloc makes `FEW` arenas from now on, in all of the process; it does not where MALLOC_ARENA_MAX says
    otherwise, or the C library is another one."""
    mallopt = None if "MALLOC_ARENA_MAX" in os.environ else _function("mallopt")
    return mallopt is not None and bool(mallopt(_ARENA_MAX, FEW))


def give_back() -> bool:
    """What is free to the system, in some milliseconds; whether anything was. Another C library keeps it."""
    malloc_trim = _function("malloc_trim")
    return malloc_trim is not None and bool(malloc_trim(0))


@cache
def _function(name: str) -> Callable[..., Any] | None:
    """One of the GNU C library; None where that is another one."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform.startswith("linux") else None
