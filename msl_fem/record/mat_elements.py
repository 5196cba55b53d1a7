"""The elements of a MATLAB file of version 5, looked through before scipy reads them.

scipy takes the type of a number's data as an index without a look at it: a type that is none ends the process. Only
tags are looked at here, whatever lies between is passed over; what else is damaged scipy says itself. Source of the
format: MAT-File Format, version 5, tables 1-1 and 1-3.
"""

import zlib
from typing import BinaryIO, Literal

ByteOrder = Literal["little", "big"]

MATRIX, COMPRESSED = 14, 15  # miMATRIX and miCOMPRESSED
NUMBERS = (1, 2, 3, 4, 5, 6, 7, 9, 12, 13)
TEXTS = (*NUMBERS, 16, 17, 18)
_CHAR, _OF_NUMBERS = 4, range(5, 16)  # classes of arrays: text; sparse and all numbers
_HEAD = 3  # flags, dimensions and name of an array
_FLAGS = 16  # bytes of the flags with their tag
_DEEPEST = 40  # structures in structures


class Bytes:
    """The bytes of an element, as they lie in a file or unpacked from there, piece by piece.

    Parameters
    ----------
    stream : at the element's first byte
    size : bytes of the element in the file
    packed : it is compressed
    order : of the bytes of a number
    """

    def __init__(self, stream: BinaryIO, size: int, *, packed: bool, order: ByteOrder) -> None:
        self.order = order
        self._stream, self._left = stream, size
        self._unpacker = zlib.decompressobj() if packed else None
        self._held = b""

    def take(self, count: int) -> bytes:
        """The next bytes; ValueError where there are fewer."""
        if self._unpacker is None:
            content = self._stream.read(min(count, self._left))
            self._left -= len(content)
        else:
            content = self._unpacked(count)
        if len(content) < count:
            raise ValueError("an element ends early")
        return content

    def skip(self, count: int) -> None:
        """Passes over bytes; ValueError as `take`."""
        while count > 0:
            count -= len(self.take(min(count, 1 << 20)))

    def number(self, content: bytes) -> int:
        """The number that some bytes are."""
        return int.from_bytes(content, self.order)

    def _unpacked(self, count: int) -> bytes:
        unpacker = self._unpacker
        assert unpacker is not None
        while len(self._held) < count and not unpacker.eof:
            piece = unpacker.unconsumed_tail
            if not piece:
                piece = self._stream.read(min(self._left, 1 << 16))
                self._left -= len(piece)
            made = unpacker.decompress(piece, 1 << 20)
            if not made and not piece:
                break
            self._held += made
        content, self._held = self._held[:count], self._held[count:]
        return content


def check_types(stream: BinaryIO, kind: int, size: int, order: ByteOrder) -> None:
    """Looks through the element of this type and size whose first byte behind its tag is the stream's next.

    Raises
    ------
    ValueError : data of an array of numbers, or of text, are of no type that has any; an element ends early
    """
    content = Bytes(stream, size, packed=kind == COMPRESSED, order=order)
    if kind == COMPRESSED:
        kind, size, _ = _tag(content)
    if kind == MATRIX:
        _check_array(content, size, 0)


def _check_array(content: Bytes, size: int, depth: int) -> None:
    if size <= 0:  # an empty cell
        return
    if depth > _DEEPEST:
        raise ValueError(f"structures lie more than {_DEEPEST} deep in one another")
    flags = content.take(_FLAGS)
    array_class, left, place = content.number(flags[8:12]) & 0xFF, size - _FLAGS, 1
    allowed = TEXTS if array_class == _CHAR else NUMBERS if array_class in _OF_NUMBERS else ()
    while left > 0:
        kind, length, small = _tag(content)
        left -= 8
        if allowed and place >= _HEAD and kind not in allowed:
            raise ValueError(f"an array's data are of the type {kind}, which has none")
        behind = 0 if small else min(-(-length // 8) * 8, left)
        if kind == MATRIX and not allowed:
            _check_array(content, behind, depth + 1)
        else:
            content.skip(behind)
        left -= behind
        place += 1


def _tag(content: Bytes) -> tuple[int, int, bool]:
    """(type, bytes of data, whether they lie in the tag itself)."""
    first, second = content.take(4), content.take(4)
    word = content.number(first)
    if word >> 16:
        return word & 0xFFFF, word >> 16, True
    return word, content.number(second), False
