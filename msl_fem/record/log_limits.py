"""What is taken of a log at most, and the arrays that are kept of it, for all its formats."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError

MOST_VALUES = 50_000_000
"""Numbers that are taken of a log, 400 MB: what uses them holds some copies."""
ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")
"""A source that is one row of a matrix, `logouts[3]`."""
WAY_OUT = "name fewer columns, or cut the log into parts and import each as a run"


def refuse_many_values(count: float, file: Path) -> None:
    """RecordError where so many numbers are more than is taken of a log."""
    if count > MOST_VALUES:
        raise RecordError(f"{file}: more than the {MOST_VALUES} numbers that are taken of a log; {WAY_OUT}")


def not_read(shape: tuple[int, ...]) -> Array:
    """An array of nan of this shape that takes no memory."""
    return np.broadcast_to(np.float64(np.nan), shape)


def keep_numeric(signals: dict[str, Array], name: str, value: Any) -> None:
    """Adds a numeric vector or matrix to the signals; a structure's members one by one; nothing else."""
    array = np.asarray(value)
    if array.dtype.names:
        for member in array.dtype.names:
            if array.size == 1:
                keep_numeric(signals, f"{name}.{member}", np.asarray(array[member]).item())
    elif array.dtype.kind in "iuf" and array.size > 1:
        squeezed = np.squeeze(array).astype(np.float64, copy=False)
        if squeezed.ndim == 1:
            signals[name] = squeezed
        elif squeezed.ndim == 2:
            signals[name] = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T
