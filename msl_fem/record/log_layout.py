"""Where the names, the units and the numbers of a text log stand: tables with and without a header, preambles of
oscilloscopes, decimal commas."""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from msl_fem.errors import RecordError
from msl_fem.record.columns import is_number

Row = tuple[int, str]
"""Number of a row in its file, counted from 1, and its text."""
HEAD = 400
"""Rows that holds cells in which the numbers have to begin."""
STEADY = 8
"""Rows of numbers alike in a row that are taken for the log's body."""
COMMENTS = ("#", "%")
SEPARATORS = ((",", False), (";", False), ("\t", False), (";", True), ("\t", True), (None, False), (None, True))
"""What parts the cells, None: blanks, and whether numbers have a decimal comma."""
UNIT_WORDS = {
    *("s", "sec", "second", "seconds", "ms", "us", "µs", "ns", "min", "hz", "counts", "sequence"),
    *("v", "volt", "volts", "mv", "kv", "a", "amp", "ampere", "amps", "ma", "n", "newton", "mn", "kn"),
    *("m", "mm", "um", "µm", "nm", "k", "degc", "°c"),
}
"""What stands in a row of units below the names; a row of Rigol's begins with Sequence there."""
LENGTHS, SEGMENTS = ("segmentsize", "record length", "points"), "segments"
"""Words of preambles behind which the number of rows stands: LeCroy (in each segment), Tektronix, Keysight."""
_UNIT_IN_BRACKETS = re.compile(r"[(\[].{0,12}[)\]]")
_INCREMENT = re.compile(r"sample interval|(x ?|time )?inc(rement)?|dt|delta ?t", re.IGNORECASE)
_ORIGIN = re.compile(r"x ?org|x ?origin|x ?zero|start( time)?", re.IGNORECASE)
_TIME = re.compile(r"(time|t|x-axis|x|seconds?|zeit)\b.*", re.IGNORECASE)


@dataclass(frozen=True)
class TextLayout:
    """How a text log is laid out.

    Attributes
    ----------
    delimiter : between cells; None: blanks
    comma : whether numbers have a decimal comma
    lead, width : cells before the first column, and columns
    cells : of a whole row, empty ones at its end too
    names : (width,) of the columns; their numbers from "1" where the log has none
    units : by name, where the log tells
    first : number of the first row of numbers
    clock : (start, step) in s where the preamble tells them and no column is the time
    stated : how many rows the preamble states, and by which word; None where it states none
    """

    delimiter: str | None
    comma: bool
    lead: int
    width: int
    cells: int
    names: tuple[str, ...]
    first: int
    units: dict[str, str] = field(default_factory=dict)
    clock: tuple[float, float] | None = None
    stated: tuple[int, str] | None = None

    def split(self, line: str) -> list[str]:
        """The cells of a row."""
        return row_cells(line, self.delimiter)

    def number_text(self, cell: str) -> str:
        """The cell with a decimal point."""
        return cell.replace(",", ".") if self.comma else cell


def row_cells(line: str, delimiter: str | None) -> list[str]:
    """The cells of a row, without blanks around them."""
    if delimiter is None:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def text_layout(head: Sequence[Row], comments: Sequence[Row], *, file: Path) -> TextLayout:
    """The layout that the first rows show; `comments` are rows that begin with # or %.

    Raises
    ------
    RecordError : no rows, or rows before the numbers that are neither names nor a preamble
    """
    delimiter, comma = _separators(head)
    rows = [(number, row_cells(line, delimiter)) for number, line in head]
    tail = [cells for _, cells in rows[-STEADY:]]
    lead, behind = _empty_at_all(tail), _empty_at_all([cells[::-1] for cells in tail])
    cells = max(map(len, tail))
    width = cells - lead - behind
    inner = [(number, row[lead : lead + width] if len(row) == cells else row) for number, row in rows]
    if lead:
        return _beside_preamble(rows, inner, delimiter, comma, (lead, width, cells))
    begin = _first_of_body(inner, width, comma)
    above = inner[:begin]
    names, units, begin = _names(above, begin, width, file=file)
    if not names:
        names = _names_in_comment(comments, width, before=inner[begin][0] if begin < len(inner) else 0)
    clock = None
    pairs = {row[0]: row[1] for _, row in above if len(row) > 1}
    if begin and not any(_TIME.fullmatch(name) for name in names):
        clock = _clock(pairs, comma)
    start = _sequence(rows[:begin], width, comma)
    if start is not None:
        clock, names = start, ("sequence", *names[1:])
    first = rows[begin][0] if begin < len(rows) else rows[-1][0] + 1
    numbered = tuple(name or str(k + 1) for k, name in enumerate(names or ("",) * width))
    stated = stated_rows([row for _, row in rows[:begin]], comma)
    layout = TextLayout(delimiter, comma, 0, width, cells, _distinct(numbered), first, {}, clock, stated)
    layout.units.update({name: unit for name, unit in zip(layout.names, units, strict=False) if unit})
    layout.units.update(_units_in_names(layout.names))
    return layout


def _separators(head: Sequence[Row]) -> tuple[str | None, bool]:
    """What parts the cells and whether numbers have a decimal comma: what makes the most numbers of the last rows."""
    lines = [line for _, line in head[-STEADY:]]
    best: tuple[int, str | None, bool] = (0, ",", False)
    for delimiter, comma in SEPARATORS:
        rows = [row_cells(line, delimiter) for line in lines]
        count = sum(is_number(c.replace(",", ".") if comma else c) for row in rows for c in row)
        if count > best[0]:
            best = (count, delimiter, comma)
    if best[0] == 0:  # no row holds a number: the names tell
        most = max((",", ";", "\t"), key=head[0][1].count)
        return most, False
    return best[1], best[2]


def _empty_at_all(rows: Sequence[Sequence[str]]) -> int:
    """How many cells at the beginning are empty in every row."""
    count = 0
    while rows and all(len(row) > count + 1 and not row[count] for row in rows):
        count += 1
    return count


def _is_body(cells: Sequence[str], width: int, comma: bool) -> bool:
    texts = [cell.replace(",", ".") if comma else cell for cell in cells if cell]
    return len(cells) == width and bool(texts) and all(map(is_number, texts))


def _first_of_body(rows: Sequence[tuple[int, list[str]]], width: int, comma: bool) -> int:
    """Index of the first row from which some rows are numbers alike; 1, below the names, where none is."""
    good = [_is_body(cells, width, comma) for _, cells in rows]
    for k in range(len(rows)):
        if all(good[k : k + STEADY]):
            return k
    return 1


def _is_unit(cell: str) -> bool:
    return cell.lower() in UNIT_WORDS or bool(_UNIT_IN_BRACKETS.fullmatch(cell))


def _has_number(cells: Sequence[str]) -> bool:
    return any(map(is_number, cells))


def _names(
    above: Sequence[tuple[int, list[str]]], begin: int, width: int, *, file: Path
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Names, units and where the body begins. A row below the names that holds a number is part of the body."""
    units: tuple[str, ...] = ()
    at = len(above) - 1
    if at > 0 and len(above[at][1]) >= width and all(_is_unit(cell) for cell in above[at][1][:width] if cell):
        units = tuple(cell.strip("()[]") for cell in above[at][1][:width])
        at -= 1
    while at >= 0 and (len(above[at][1]) < width or (_has_number(above[at][1][:width]) and not units)):
        at -= 1
    if at < 0 or not any(above[at][1][:width]):
        _refuse_strange(above, width, file, alone=len(above) == 1)
        return (), (), begin
    number, cells = above[at]
    extra = [cell for cell in cells[width:] if cell and not is_number(cell)]
    if extra and not {cell.lower() for cell in extra} <= {"comment", "start", "increment"}:
        raise RecordError(f"{file}: row {number + 1}: {width} cells under {len(cells)} names; give each column one")
    _refuse_strange(above[:at], width, file)
    below = at + 1 + bool(units)
    names = tuple(f"ch{cell}" if is_number(cell) else cell for cell in cells[:width])
    return names, units, below


def _refuse_strange(above: Sequence[tuple[int, list[str]]], width: int, file: Path, *, alone: bool = False) -> None:
    """RecordError where a row above the numbers is no text: a damaged row is not skipped."""
    for number, cells in above:
        if is_number(cells[0]) or (alone and len(cells) > 1):
            raise RecordError(
                f"{file}: row {number}: {len(cells)} cells, {width} in the rows below; give each column one"
            )


def _names_in_comment(comments: Sequence[Row], width: int, *, before: int) -> tuple[str, ...]:
    """Names in the last comment above the numbers, as numpy's savetxt writes them."""
    above = [line for number, line in comments if number < before]
    if not above:
        return ()
    text = above[-1].lstrip("#% ")
    for delimiter in (",", ";", "\t", None):
        names = row_cells(text, delimiter)
        if len(names) == width and width > 1 and not _has_number(names):
            return tuple(names)
    return ()


def _clock(pairs: dict[str, str], comma: bool) -> tuple[float, float] | None:
    """(start, step) of a preamble's keys, s."""
    found: dict[str, float] = {}
    for key, text in pairs.items():
        text = text.replace(",", ".") if comma else text
        for name, pattern in (("step", _INCREMENT), ("start", _ORIGIN)):
            if pattern.fullmatch(key.strip().rstrip(":")) and is_number(text):
                found[name] = float(text)
    return (found.get("start", 0.0), found["step"]) if found.get("step", 0.0) > 0 else None


def stated_rows(above: Sequence[Sequence[str]], comma: bool) -> tuple[int, str] | None:
    """How many rows a preamble states behind one of the words `LENGTHS`, times its segments, and the word."""
    cells = [cell.lower().strip(": ") for row in above for cell in row]
    numbers: dict[str, int] = {}
    for word, text in zip(cells, cells[1:], strict=False):
        text = text.replace(",", ".") if comma else text
        if word in (*LENGTHS, SEGMENTS) and is_number(text) and 0 < float(text) < 1e12:
            numbers[word] = round(float(text))
    words = [word for word in LENGTHS if word in numbers]
    return (numbers[words[0]] * numbers.get(SEGMENTS, 1), words[0]) if words else None


def _sequence(above: Sequence[tuple[int, list[str]]], width: int, comma: bool) -> tuple[float, float] | None:
    """(start, step) where the first column counts samples and the names tell both behind the columns (Rigol)."""
    if len(above) < 2:
        return None
    (_, names), (_, below) = above[-2:]
    if [name.lower() for name in names[width : width + 2]] != ["start", "increment"]:
        return None
    start, step = below[width : width + 2]
    return float(start), float(step)


def _beside_preamble(
    rows: Sequence[tuple[int, list[str]]],
    inner: Sequence[tuple[int, list[str]]],
    delimiter: str | None,
    comma: bool,
    shape: tuple[int, int, int],
) -> TextLayout:
    """Keys in the first cells of the first rows, numbers beside them from the first row on (Tektronix TDS)."""
    lead, width, cells = shape
    pairs = {row[0].lower(): row[1] for _, row in rows if row[0]}
    begin = _first_of_body(inner, width, comma)
    names = ("TIME", pairs.get("source", "CH1"))[:width] if width == 2 else tuple(str(k + 1) for k in range(width))
    units = {name: pairs.get(key, "") for name, key in zip(names, ("horizontal units", "vertical units"), strict=False)}
    first = rows[0][0] if begin <= 1 else rows[begin][0]
    stated = stated_rows([row for _, row in rows if row[0]], comma)
    layout = TextLayout(delimiter, comma, lead, width, cells, names, first, stated=stated)
    layout.units.update({name: unit for name, unit in units.items() if unit})
    return layout


def _distinct(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names, a second one of a kind with the number of its column."""
    return tuple(f"{name} (column {k + 1})" if name in names[:k] else name for k, name in enumerate(names))


def _units_in_names(names: Sequence[str]) -> dict[str, str]:
    """Units in brackets behind the names: `Time (ms)`, `CH1 [V]`."""
    matches = {name: re.search(r"[(\[]([^)\]]{1,12})[)\]]\s*$", name) for name in names}
    return {name: match[1] for name, match in matches.items() if match}
