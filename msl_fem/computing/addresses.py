"""Compiled functions by their address: what is called without being known when the caller is compiled."""

from collections.abc import Callable
from typing import Any

from numba import cfunc, types
from numba.core.compiler_lock import global_compiler_lock

from msl_fem.computing.lane_code import RowsType
from msl_fem.computing.machine_code import make_ready, set_environments

_OPTIONS = {"error_model": "numpy"}


def address_of(function: Callable[..., None], width: int) -> tuple[float, Any]:
    """(address as a number, what must live as long as it is called) of a function of two `Rows` of that many lanes."""
    with global_compiler_lock:  # fits in threads ask for them; numba's registries bear one at a time
        make_ready(function)
        rows = RowsType(width)
        made = cfunc(types.void(rows, rows), **_OPTIONS)(function)
        set_environments(made._library)
    return float(made.address), made
