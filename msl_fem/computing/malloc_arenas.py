"""Few arenas for many threads: the GNU C library's malloc gives each of them one of its own, which keeps what is freed.

Fits that wait for each other's simulations have a thread each, and of what they let go a third stays in the process
(malloc's M_ARENA_MAX: The GNU C Library Reference Manual, "Malloc Tunable Parameters").
"""

import ctypes
import os
import sys
from functools import cache

_ARENA_MAX = -8  # of mallopt, as malloc.h has it
FEW = 2


@cache
def few_arenas() -> bool:
    """Whether malloc makes `FEW` arenas from now on, in all of the process; it does not where MALLOC_ARENA_MAX says
    otherwise, or the C library is another one."""
    if not sys.platform.startswith("linux") or "MALLOC_ARENA_MAX" in os.environ:
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    return mallopt is not None and bool(mallopt(_ARENA_MAX, FEW))
