"""One BLAS thread a process: the dense problems here are small, and a BLAS's own threads cost more than they bring.

Dot products of ten thousand entries and QR of thin matrices run up to a hundred times slower with two threads on a busy
machine of two cores. Parallel work is done by processes.
"""

import sys
import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import ThreadpoolController

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")
_limited = threading.local()


def one_blas_thread(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
    """The function, run with one BLAS thread; the caller's setting is back when it returns.

    Within a function that runs so already nothing is set.
    """

    @wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Answer:
        if getattr(_limited, "already", False):
            return function(*args, **kwargs)
        _limited.already = True
        try:
            with _libraries(len(sys.modules)).limit(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _limited.already = False

    return run


@lru_cache(maxsize=1)
def _libraries(modules: int) -> ThreadpoolController:
    """The loaded BLAS libraries. Finding them takes 5 ms: they are looked for again only after a further import."""
    return ThreadpoolController()
