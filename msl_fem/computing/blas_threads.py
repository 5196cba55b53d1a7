"""One BLAS thread a process: the dense problems here are small, and a BLAS's own threads cost more than they bring.

Dot products of ten thousand entries and QR of thin matrices run up to a hundred times slower with two threads on a busy
machine of two cores. Parallel work is done by processes.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Parameters = ParamSpec("Parameters")
Answer = TypeVar("Answer")


def one_blas_thread(function: Callable[Parameters, Answer]) -> Callable[Parameters, Answer]:
    """The function, run with one BLAS thread; the caller's setting is back when it returns."""

    @wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Answer:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return run
