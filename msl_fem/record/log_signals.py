"""The signals of a log of another program, MATLAB .mat of any version or text, by name: only those that are asked for,
in bounded memory, and never from another file."""

import csv
import math
import re
import warnings
import zlib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import h5py
import numpy as np
from scipy.io import loadmat, whosmat

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.netcdf_file import look_through, refuse_endless_heap
from msl_fem.files.schema import reason
from msl_fem.record.columns import is_number

MOST_VALUES = 50_000_000
"""Numbers that are taken of a log, 400 MB: what uses them holds some copies."""
MOST_OBJECTS = 100_000
"""Of a .mat file of version 7.3, whose cells are an object each."""
DELIMITERS = ",;\t"
COMMENTS = ("#", "%")
BLOCK = 100_000
"""Rows of a text that are converted at once."""
LONGEST_ROW = 1_000_000
"""Characters."""
_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")
_COMPRESSED = 15  # miCOMPRESSED of the MAT-File Format, version 5, table 1-1
_WAY_OUT = "name fewer columns, or cut the log into parts and import each as a run"


def read_log(path: str | Path, *, only: Collection[str] | None = None) -> dict[str, Array]:
    """The numeric arrays of a log by name: (n_sample,) each, or a matrix whose longer side runs over the samples.

    A .mat file of any version; members of a structure are named `structure.member`. A text file (.csv, .txt, .tsv)
    has its names in the first row that is no comment (# or %), cells parted by comma, semicolon or tab.

    Parameters
    ----------
    path : the log
    only : sources as `signal` takes them; of other arrays only the shape is right, their values are nan and not read

    Raises
    ------
    RecordError : no such file, another format, no numbers in it, a row that does not fit the names, parts that lie in
        another file, or more than `MOST_VALUES` numbers asked for
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such file; give a .mat or CSV log")
    ending = path.suffix.lower()
    if ending not in (".mat", ".csv", ".txt", ".tsv"):
        raise RecordError(f"{path}: the ending '{path.suffix}' is unknown; give a .mat or a .csv file")
    try:
        with warnings.catch_warnings():
            for doubtful in (UserWarning, RuntimeWarning):  # what a library warns of may be other numbers than meant
                warnings.simplefilter("error", doubtful)
            signals = _read_mat(path, only) if ending == ".mat" else _read_text(path, only)
    except RecordError:
        raise
    except Exception as err:  # the readers of .mat raise errors of many kinds on a damaged file
        raise RecordError(f"{path}: cannot be read ({reason(err)}); save it anew as .mat or CSV") from err
    if not signals:
        raise RecordError(f"{path}: holds no numeric arrays; save the signals as vectors or one matrix")
    return signals


def signal(signals: dict[str, Array], source: str, *, file: Path | str) -> Array:
    """The samples (n_sample,) of a signal by its name, or of one row of a matrix by `name[row]`, counted from 0.

    Raises
    ------
    RecordError : no such signal or row, or a matrix without a row
    """
    if source in signals:
        values = signals[source]
        if values.ndim == 1:
            return values
        count = values.shape[0]
        raise RecordError(
            f"{file}: '{source}' is a matrix of {count} signals; write {source}[0] ... {source}[{count - 1}]"
        )
    match = _ELEMENT.fullmatch(source)
    matrix = signals.get(match["name"]) if match else None
    if match is None or matrix is None or matrix.ndim == 1:
        raise RecordError(f"{file}: there is no signal '{source}'; it has {_listed(signals)}")
    row, count = int(match["index"]), matrix.shape[0]
    if row >= count:
        raise RecordError(f"{file}: '{match['name']}' has the rows 0 to {count - 1}, not {match['index']}")
    return np.asarray(matrix[row])


def _listed(signals: dict[str, Array]) -> str:
    names = [n if v.ndim == 1 else f"{n}[0..{v.shape[0] - 1}]" for n, v in signals.items()]
    more = f" and {len(names) - 20} more" if len(names) > 20 else ""
    return ", ".join(names[:20]) + more


def _read_mat(path: Path, only: Collection[str] | None) -> dict[str, Array]:
    if h5py.is_hdf5(path):  # version 7.3
        return _read_hdf5(path, only)
    names = None if only is None else {re.split(r"[.\[]", source)[0] for source in only}
    there = whosmat(path)
    _check_unpacked_size(path, [name for name, _, _ in there], names)
    signals: dict[str, Array] = {}
    for name, shape, kind in there:
        if names is not None and name not in names and kind not in ("cell", "char", "struct", "object", "function"):
            _add(signals, name, _not_read(shape))
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=True, variable_names=names).items():
        if not name.startswith("__"):
            _add(signals, name, value)
    return signals


def _not_read(shape: tuple[int, ...]) -> Array:
    """An array of nan of this shape that takes no memory."""
    return np.broadcast_to(np.float64(np.nan), shape)


def _check_values(count: float, file: Path) -> None:
    if count > MOST_VALUES:
        raise RecordError(f"{file}: more than the {MOST_VALUES} numbers that are taken of a log; {_WAY_OUT}")


def _check_unpacked_size(path: Path, order: list[str], names: set[str] | None) -> None:
    """RecordError where a variable that is asked for would unpack to more than is read of a log.

    A compressed element of a few kB may hold gigabytes, and what it says of its own size need not be true; so it is
    unpacked once piece by piece, and counted.
    """
    with path.open("rb") as stream:
        if stream.read(128)[124:128] not in (b"\x00\x01IM", b"\x01\x00MI"):
            return  # version 4: nothing is compressed, so nothing is larger than the file
        stream.seek(126)
        order_of_bytes = "little" if stream.read(2) == b"IM" else "big"
        for name in order:
            tag = stream.read(8)
            kind, size = (int.from_bytes(part, order_of_bytes) for part in (tag[:4], tag[4:]))  # type: ignore[arg-type]
            behind = stream.tell() + size
            if names is None or name in names:
                _check_values((_unpacked(stream, size) if kind == _COMPRESSED else size) / 8, path)
            stream.seek(behind)


def _unpacked(stream: BinaryIO, size: int) -> int:
    """Bytes that a compressed element unpacks to, counted up to what is read of a log."""
    unpacker, count = zlib.decompressobj(), 0
    while size > 0 and count <= 8 * MOST_VALUES:
        piece = stream.read(min(size, 1 << 16))
        if not piece:
            break
        size -= len(piece)
        while piece and count <= 8 * MOST_VALUES:
            count += len(unpacker.decompress(piece, 1 << 20))
            piece = unpacker.unconsumed_tail
    return count


def _read_hdf5(path: Path, only: Collection[str] | None) -> dict[str, Array]:
    refuse_endless_heap(path)
    look_through(path, most_values=math.inf, most_objects=MOST_OBJECTS)
    names = None if only is None else {*only, *(m["name"] for m in map(_ELEMENT.fullmatch, only) if m)}
    signals: dict[str, Array] = {}
    count = 0

    def visit(place: str, item: Any) -> None:
        nonlocal count
        name = place.replace("/", ".")
        if not isinstance(item, h5py.Dataset) or item.dtype.kind not in "iuf" or name.startswith("#"):
            return
        if names is None or name in names:
            count += item.size
            _check_values(count, path)
            _add(signals, name, item[()])
        else:
            _add(signals, name, _not_read(item.shape))

    with h5py.File(path, "r") as stream:
        stream.visititems(visit)
    return signals


def _add(signals: dict[str, Array], name: str, value: Any) -> None:
    """Keeps a numeric vector or matrix; a structure's members one by one; nothing else."""
    array = np.asarray(value)
    if array.dtype.names:
        for member in array.dtype.names:
            if array.size == 1:
                _add(signals, f"{name}.{member}", np.asarray(array[member]).item())
    elif array.dtype.kind in "iuf" and array.size > 1:
        squeezed = np.squeeze(array).astype(np.float64, copy=False)
        if squeezed.ndim == 1:
            signals[name] = squeezed
        elif squeezed.ndim == 2:
            signals[name] = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T


def _read_text(path: Path, only: Collection[str] | None) -> dict[str, Array]:
    with path.open(encoding="utf-8-sig") as stream:
        rows = _rows(stream, path)
        header = next(rows, None)
        if header is None:
            raise RecordError(f"{path}: is empty; it needs a row of names and rows of numbers")
        delimiter = max(DELIMITERS, key=header[1].count)
        names = [name.strip() for name in next(csv.reader([header[1]], delimiter=delimiter))]
        read = [k for k, name in enumerate(names) if name and (only is None or name in only)]
        parts: dict[str, list[Array]] = {names[k]: [] for k in read}
        count = 0
        for block in _blocks(rows):
            columns = _columns(block, delimiter, len(names), read, path)
            named = {names[k]: values for k, values in zip(read, columns, strict=True)}
            count += len(block)
            _check_values(count * len(read), path)
            for name, values in named.items():
                parts[name].append(values)
    if count < 2:
        return {}
    signals = {name: np.concatenate(blocks) for name, blocks in parts.items()}
    return {name: signals.get(name, _not_read((count,))) for name in names if name}


def _rows(stream: TextIO, path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each row that holds cells."""
    number = 0
    while line := stream.readline(LONGEST_ROW):
        number += 1
        if len(line) == LONGEST_ROW:
            raise RecordError(f"{path}: row {number}: longer than {LONGEST_ROW} characters; is it a CSV log?")
        if line.strip() and not line.lstrip().startswith(COMMENTS):
            yield number, line.rstrip("\r\n")


def _blocks(rows: Iterator[tuple[int, str]]) -> Iterator[list[tuple[int, str]]]:
    block: list[tuple[int, str]] = []
    for row in rows:
        block.append(row)
        if len(block) == BLOCK:
            yield block
            block = []
    if block:
        yield block


def _columns(block: list[tuple[int, str]], delimiter: str, width: int, read: list[int], path: Path) -> list[Array]:
    """The columns (n_row,) that are read, of rows with so many cells each; nan where a cell is no number.

    Whether that matters depends on whether the column is asked for.
    """
    lines = [line for _, line in block]
    plain = not any('"' in line or line.count(delimiter) != width - 1 for line in lines)
    if plain and read:
        try:
            values = np.loadtxt(lines, delimiter=delimiter, comments=None, usecols=read, ndmin=2)
            return list(np.ascontiguousarray(values.T))
        except ValueError:
            pass  # a cell is no number: cell by cell
    columns: list[list[float]] = [[] for _ in read]
    for number, line in block:
        cells = next(csv.reader([line], delimiter=delimiter))
        if len(cells) != width:
            raise RecordError(f"{path}: row {number}: {len(cells)} cells under {width} names; give each column one")
        for column, k in zip(columns, read, strict=True):
            column.append(_number(cells[k]))
    return [np.array(column, dtype=np.float64) for column in columns]


def _number(cell: str) -> float:
    """The cell's number, nan where it is none."""
    return float(cell) if is_number(cell) else math.nan
