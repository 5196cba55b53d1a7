"""What of a run counts, as columns of it say: `valid` of whole rows, `valid_position_m` of the readings of one channel.

Rows that are not valid cut the run: what the rig did meanwhile nobody knows (levitation lost, caught by a stop, clamped
by hand), so what lies between them are runs by themselves. Readings that are not valid cut nothing: the plant went on,
one instrument did not see it.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import CHANNELS, Column, numbers, place

VALID = "valid"
MASK = "valid_"
LEAST_SHARE = 0.5
"""Of a channel's readings that have to be valid."""
Mask = NDArray[np.bool_]


def mask_of(name: str) -> str:
    """The channel's column that a column `valid_...` speaks of; empty of any other column."""
    column = name.removeprefix(MASK)
    return column if name.startswith(MASK) and column in CHANNELS else ""


def _flags(column: Column, name: str, file: Path | str) -> Mask:
    values = numbers(column, name, file)
    strange = np.flatnonzero((values != 0) & (values != 1))
    if strange.size:
        at = int(strange[0])
        raise RecordError(f"{place(file, at)}, column {name}: {values[at]:g} is neither 1 (valid) nor 0")
    return np.asarray(values == 1)


def valid_stretches(table: Mapping[str, Column], *, file: Path | str) -> list[slice] | None:
    """The rows between those that are not valid; None where all of them are.

    Raises
    ------
    RecordError : a cell of `valid` is neither 0 nor 1
    """
    if VALID not in table:
        return None
    flags = _flags(table[VALID], VALID, file)
    if flags.all():
        return None
    change = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(int)))
    return [slice(int(first), int(behind)) for first, behind in zip(change[::2], change[1::2], strict=True)]


def masked(
    table: Mapping[str, Column], driving: list[str], *, file: Path | str
) -> tuple[dict[str, Any], dict[str, Mask]]:
    """The columns without those that mask, and for each channel that is masked (n_row,) whether its readings are valid.

    Cells that are not valid may hold anything; a straight line between valid neighbours takes their place.

    Raises
    ------
    RecordError : a mask without its channel, of a column in `driving`, or one that leaves less than half of it
    """
    columns = {name: column for name, column in table.items() if name != VALID and not mask_of(name)}
    valid = {}
    for name in table:
        channel = mask_of(name)
        if not channel:
            continue
        flags = _flags(table[name], name, file)
        if channel not in columns:
            raise RecordError(f"{file}: row 1: column {name} speaks of {channel}, which is missing")
        if channel in driving or channel == "time_s":
            raise RecordError(
                f"{file}: row 1: column {name}: {channel} drives the plant and has to be known throughout; cut the run "
                f"at such rows by a column {VALID}"
            )
        if flags.mean() < LEAST_SHARE:
            raise RecordError(
                f"{file}: row 1: column {name} leaves {flags.mean():.0%} of the readings of {channel}, at least "
                f"{LEAST_SHARE:.0%} are needed; cut the run by a column {VALID}, or leave the channel out"
            )
        columns[channel] = _filled(columns[channel], flags, channel, file)
        if not flags.all():
            valid[channel] = flags
    return columns, valid


def _filled(column: Column, flags: Mask, name: str, file: Path | str) -> Array:
    """The readings as numbers, those that are not valid on a straight line between their neighbours."""
    told = column.copy()
    told[~flags] = 0.0 if column.dtype.kind == "f" else "0"
    return bridged(numbers(told, name, file), np.flatnonzero(~flags))


def bridged(values: Array, at: NDArray[np.intp]) -> Array:
    """Values (..., n_sample) with a straight line between neighbours in place of the samples `at`; beyond the first and
    the last that stays, its own value."""
    if not at.size:
        return values
    stays = np.ones(values.shape[-1], dtype=bool)
    stays[at] = False
    rest = np.flatnonzero(stays)
    after = np.clip(np.searchsorted(rest, at), 1, rest.size - 1)
    left, right = rest[after - 1], rest[after]
    share = np.clip((at - left) / (right - left), 0.0, 1.0)
    found = values.copy()
    found[..., at] = (1 - share) * values[..., left] + share * values[..., right]
    return found
