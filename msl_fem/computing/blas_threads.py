"""One BLAS thread a process: the dense problems here are small, and a BLAS's own threads cost more than they bring.

Dot products of ten thousand entries and QR of thin matrices run up to a hundred times slower with two threads on a busy
machine of two cores. Parallel work is done by processes.
"""

import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")
_limited = threading.local()


def one_blas_thread(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
    """The function, run with one BLAS thread; the caller's setting is back when it returns.

    Finding the libraries takes 3 ms; within a function that runs so already it is not done again.
    """

    @wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Answer:
        if getattr(_limited, "already", False):
            return function(*args, **kwargs)
        _limited.already = True
        try:
            with threadpool_limits(limits=1, user_api="blas"):
                return function(*args, **kwargs)
        finally:
            _limited.already = False

    return run
