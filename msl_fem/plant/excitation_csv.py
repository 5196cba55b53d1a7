"""A signal that stands in a CSV file: times, and the values of one of its columns."""

import csv
import io

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.files.schema import reason, small_text

TIME = "time_s"


def read_signal(file: str, column: str | None = None) -> tuple[Array, Array]:
    """Times in s and values of a column, both (n_row,); without a name the one that stands beside `time_s`.

    Raises
    ------
    ValueError : no such file, too large or no text, no such column, or several to choose from; fewer than
        two rows, what is no finite number, a time that is below 0 or does not increase; the message names the file and
        the line
    """
    try:
        rows = [row for row in csv.reader(io.StringIO(small_text(file, encoding="utf-8-sig"))) if row]
    except (OSError, ValueError, csv.Error) as err:
        why = "no text of comma-separated values" if isinstance(err, UnicodeError | csv.Error) else reason(err)
        raise ValueError(f"{file}: cannot be read ({why})") from err
    names = [name.strip() for name in rows[0]] if rows else []
    if TIME not in names:
        raise ValueError(f"{file}: no column {TIME}; its first line names the columns, like '{TIME},voltage_1_V'")
    chosen = _chosen(file, [name for name in names if name != TIME], column)
    places = names.index(TIME), names.index(chosen)
    points = np.array([_numbers(file, line, row, places) for line, row in enumerate(rows[1:], start=2)]).reshape(-1, 2)
    time, values = points.T
    if time.size < 2:
        raise ValueError(f"{file}: has {time.size} rows of numbers; a signal takes two or more")
    odd = np.flatnonzero(~(np.diff(time) > np.spacing(time[-1])))
    if odd.size or time[0] < 0:
        line = int(odd[0]) + 3 if odd.size else 2
        raise ValueError(
            f"{file}: line {line}: {TIME} must begin at 0 or later and increase from row to row by more than a rounding"
        )
    return time, values


def _chosen(file: str, others: list[str], column: str | None) -> str:
    if column is None and len(others) == 1:
        return others[0]
    if column not in others:
        said = "state which" if column is None else f"no column {column}"
        raise ValueError(f"{file}: {said}; beside {TIME} there are {', '.join(others) or 'none'} (column=NAME)")
    return column


def _numbers(file: str, line: int, row: list[str], places: tuple[int, int]) -> tuple[float, float]:
    try:
        time, value = (float(row[place]) for place in places)
    except (IndexError, ValueError):
        time = value = np.nan
    if not (np.isfinite(time) and np.isfinite(value)):
        raise ValueError(f"{file}: line {line}: '{','.join(row)[:60]}' has no finite numbers where they belong")
    return time, value
