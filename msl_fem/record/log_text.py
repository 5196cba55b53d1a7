"""The columns of a text log by name or number, converted in blocks; a cell that is no number is kept as such."""

import codecs
import math
import os
from collections.abc import Collection, Iterator
from itertools import chain, islice
from pathlib import Path
from typing import TextIO

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import is_number
from msl_fem.record.log_layout import COMMENTS, HEAD, Row, TextLayout, text_layout
from msl_fem.record.log_limits import not_read, refuse_many_values

BLOCK = 100_000
"""Rows of a text that are converted at once."""
LONGEST_ROW = 1_000_000
"""Characters."""


def read_text_log(path: Path, only: Collection[str] | None) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns by name, nan in those that are not asked for, and the units that the log tells.

    An empty cell is nan; what is neither empty nor a number is inf.

    Raises
    ------
    RecordError : no rows, a row that does not fit, fewer rows than the preamble states, an endless row, too many
        numbers
    """
    with path.open(encoding=encoding_of(path), errors="surrogateescape") as stream:
        comments: list[Row] = []
        rows = _rows(stream, path, comments)
        head = list(islice(rows, HEAD))
        if not head:
            raise RecordError(f"{path}: is empty; it needs a row of names and rows of numbers")
        layout = text_layout(head, comments, file=path)
        body = (row for row in chain(head, rows) if row[0] >= layout.first)
        parts, count = _parts(body, layout, _asked(layout.names, only), path)
    if count < 2:
        return {}, {}
    if layout.stated is not None and count < layout.stated[0]:
        length, word = layout.stated
        raise RecordError(
            f"{path}: holds {count} rows and states {length} ('{word}'): it is cut; export it once more, or correct "
            "that number where a part was meant"
        )
    signals = {}
    for k, name in enumerate(layout.names):
        signals[name] = np.concatenate(parts[k]) if k in parts else not_read((count,))
    if layout.clock is not None:
        start, step = layout.clock
        signals["time"] = start + step * np.arange(count, dtype=np.float64)
    return signals, layout.units | ({"time": "s"} if layout.clock else {})


def _asked(names: tuple[str, ...], only: Collection[str] | None) -> list[int]:
    """Indices of the columns that are asked for by name, or by number where no name is that number."""
    numbers = {str(k + 1): k for k in range(len(names))}
    if only is None:
        return list(numbers.values())
    by_name = {k for k, name in enumerate(names) if name in only}
    by_number = {numbers[text] for text in only if text not in names and text in numbers}
    return sorted(by_name | by_number)


def _parts(body: Iterator[Row], layout: TextLayout, read: list[int], path: Path) -> tuple[dict[int, list[Array]], int]:
    """Blocks of each column that is read, and the number of rows."""
    parts: dict[int, list[Array]] = {k: [] for k in read}
    count = 0
    while block := list(islice(body, BLOCK)):
        count += len(block)
        refuse_many_values(count * len(read), path)
        for k, values in zip(read, _columns(block, layout, read, path), strict=True):
            parts[k].append(values)
    return parts, count


def encoding_of(path: Path) -> str:
    """UTF-16 where the file begins so, else UTF-8, or Latin-1 where its beginning is none: degree and micro signs."""
    with path.open("rb") as stream:
        head = stream.read(1 << 16)
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def ends_in_a_row(path: Path) -> bool:
    """Whether no end of line stands behind a log's last row, as where it was cut."""
    with path.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(max(size - 2, 0))
        return not any(end in stream.read() for end in (b"\n", b"\r"))


def _rows(stream: TextIO, path: Path, comments: list[Row]) -> Iterator[Row]:
    """Number and text of each row that holds cells; comments are put aside until the numbers begin."""
    number = 0
    while line := stream.readline(LONGEST_ROW):
        number += 1
        if len(line) == LONGEST_ROW:
            raise RecordError(f"{path}: row {number}: longer than {LONGEST_ROW} characters; is it a CSV log?")
        if line.lstrip().startswith(COMMENTS):
            if len(comments) < HEAD:
                comments.append((number, line.strip()))
        elif line.strip():
            yield number, line.rstrip("\r\n")


def _columns(block: list[Row], layout: TextLayout, read: list[int], path: Path) -> list[Array]:
    """The columns (n_row,) that are read."""
    fast = _by_numpy([line for _, line in block], layout, read)
    if fast is not None:
        return fast
    columns: list[list[float]] = [[] for _ in read]
    for number, line in block:
        cells = layout.split(line)
        if len(cells) != layout.cells:
            raise RecordError(
                f"{path}: row {number}: {len(cells)} cells under {layout.cells} names; give each column one"
            )
        for column, k in zip(columns, read, strict=True):
            column.append(_number(layout.number_text(cells[layout.lead + k])))
    return [np.array(column, dtype=np.float64) for column in columns]


def _by_numpy(lines: list[str], layout: TextLayout, read: list[int]) -> list[Array] | None:
    """The columns where all rows are plain numbers alike, fast; None where one is not."""
    delimiter = layout.delimiter
    if not read or any('"' in line for line in lines):
        return None
    if delimiter is not None and any(line.count(delimiter) != layout.cells - 1 for line in lines):
        return None
    if delimiter is None and any(len(line.split()) != layout.cells for line in lines):
        return None
    if layout.comma:
        lines = [line.replace(",", ".") for line in lines]
    try:
        values = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=[layout.lead + k for k in read], ndmin=2)
    except ValueError:
        return None  # a cell is no number: cell by cell
    return list(np.ascontiguousarray(values.T))


def _number(cell: str) -> float:
    """The cell's number; nan where it is empty, inf where it is anything else."""
    if not cell or cell.lower() == "nan":
        return math.nan
    return float(cell) if is_number(cell) else math.inf
