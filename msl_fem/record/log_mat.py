"""The numeric arrays of a MATLAB file of any version: only those that are asked for, in bounded memory, and never from
another file. Tables and timetables lie in a form that MATLAB does not document; they are named, with the way out."""

import math
import re
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Any, BinaryIO

import h5py
from scipy.io import loadmat, whosmat

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.netcdf_file import look_through, refuse_endless_heap
from msl_fem.record import log_limits
from msl_fem.record.log_limits import ELEMENT, keep_numeric, not_read, refuse_many_values
from msl_fem.record.mat_elements import COMPRESSED, ByteOrder, check_types

MOST_OBJECTS = 100_000
"""Of a .mat file of version 7.3, whose cells are an object each."""
NOT_NUMERIC = ("cell", "char", "struct", "object", "function", "opaque", "unknown")
"""Classes of variables of which no number is read unless they are asked for."""


def read_mat(path: Path, only: Collection[str] | None) -> dict[str, Array]:
    """The numeric arrays by name, members of a structure as `structure.member`; of those not in `only` the shape alone.

    Raises
    ------
    RecordError : a table or timetable that is asked for or is all there is; too many numbers; a link to another file
    """
    signals, tables = _read_hdf5(path, only) if h5py.is_hdf5(path) else _read_version_5(path, only)
    asked = [name for name in tables if not signals or (only and any(one.startswith(name) for one in only))]
    if asked:
        name = asked[0]
        raise RecordError(
            f"{path}: '{name}' is a MATLAB table, timetable or object, which no open format describes; in MATLAB: "
            f"s = table2struct(timetable2table({name}), 'ToScalar', true); save('log.mat', '-struct', 's')"
        )
    return signals


def _read_version_5(path: Path, only: Collection[str] | None) -> tuple[dict[str, Array], list[str]]:
    names = None if only is None else {re.split(r"[.\[]", source)[0] for source in only}
    there = whosmat(path)
    tables = [name for name, _, kind in there if kind in ("opaque", "object")]
    _look_through(path, [name for name, _, _ in there], names)
    signals: dict[str, Array] = {}
    for name, shape, kind in there:
        if names is not None and name not in names and kind not in NOT_NUMERIC:
            keep_numeric(signals, name, not_read(shape))
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=True, variable_names=names).items():
        if not name.startswith("__") and name not in tables:
            keep_numeric(signals, name, value)
    return signals, tables


def _look_through(path: Path, order: list[str], names: set[str] | None) -> None:
    """RecordError where a variable that is asked for would unpack to more than is read of a log, ValueError where scipy
    would end the process (`check_types`).

    A compressed element of a few kB may hold gigabytes, and what it says of its own size need not be true; so it is
    unpacked once piece by piece, and counted.
    """
    with path.open("rb") as stream:
        if stream.read(128)[124:128] not in (b"\x00\x01IM", b"\x01\x00MI"):
            return  # version 4: nothing is compressed, so nothing is larger than the file
        stream.seek(126)
        order_of_bytes: ByteOrder = "little" if stream.read(2) == b"IM" else "big"
        for name in order:
            tag = stream.read(8)
            kind, size = (int.from_bytes(part, order_of_bytes) for part in (tag[:4], tag[4:]))
            begin = stream.tell()
            if names is None or name in names:
                refuse_many_values((_unpacked(stream, size) if kind == COMPRESSED else size) / 8, path)
                stream.seek(begin)
                check_types(stream, kind, size, order_of_bytes)
            stream.seek(begin + size)


def _unpacked(stream: BinaryIO, size: int) -> int:
    """Bytes that a compressed element unpacks to, counted up to what is read of a log."""
    unpacker, count = zlib.decompressobj(), 0
    most = 8 * log_limits.MOST_VALUES
    while size > 0 and count <= most:
        piece = stream.read(min(size, 1 << 16))
        if not piece:
            break
        size -= len(piece)
        while piece and count <= most:
            count += len(unpacker.decompress(piece, 1 << 20))
            piece = unpacker.unconsumed_tail
    return count


def _read_hdf5(path: Path, only: Collection[str] | None) -> tuple[dict[str, Array], list[str]]:
    """Version 7.3; a table is a data set of references, marked as an object."""
    refuse_endless_heap(path)
    look_through(path, most_values=math.inf, most_objects=MOST_OBJECTS)
    names = None if only is None else {*only, *(m["name"] for m in map(ELEMENT.fullmatch, only) if m)}
    signals: dict[str, Array] = {}
    tables: list[str] = []
    count = 0

    def visit(place: str, item: Any) -> None:
        nonlocal count
        name = place.replace("/", ".")
        if not isinstance(item, h5py.Dataset) or name.startswith("#"):
            return
        if "MATLAB_object_decode" in item.attrs:
            tables.append(name)
        elif item.dtype.kind in "iuf" and (names is None or name in names):
            count += item.size
            refuse_many_values(count, path)
            keep_numeric(signals, name, item[()])
        elif item.dtype.kind in "iuf":
            keep_numeric(signals, name, not_read(item.shape))

    with h5py.File(path, "r") as stream:
        stream.visititems(visit)
    return signals, tables
