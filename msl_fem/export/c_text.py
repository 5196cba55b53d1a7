"""Numbers, names and foreign texts as C99 source that means exactly them, and what every exported header shares."""

import math
import re
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import ArrayLike

from msl_fem.errors import InputError
from msl_fem.files.whole_file import whole_file

_WORD = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
_LONGEST_NAME = 24  # with what follows below the 63 characters of a name that C99 tells apart
_LONGEST_LINE = 100
_FOREIGN = re.compile(r"[^A-Za-z0-9 .,:;()<>=+%@_-]")
NO_NAME = "magnet"


def c_number(value: float) -> str:
    """The literal of exactly this double: hexadecimal, so that no compiler rounds it; NAN and INFINITY of math.h."""
    value = float(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    mantissa, _, exponent = value.hex().partition("p")
    return f"{mantissa.rstrip('0').rstrip('.')}p{exponent}"


def c_rows(values: ArrayLike, *, of: str = "double") -> str:
    """The initialiser of an array of any dimensions, without its outermost braces; `of` double or an integer type."""
    array = np.asarray(values)
    if array.ndim > 1:
        return ",\n".join("{" + c_rows(row, of=of) + "}" for row in array)
    texts = [c_number(v) if of == "double" else str(int(v)) for v in array]
    return ",\n".join(", ".join(line) for line in _lines(texts))


def _lines(texts: list[str]) -> Iterable[list[str]]:
    """As many on a line as fit."""
    line: list[str] = []
    length = -len(", ")
    for text in texts:
        length += len(", ") + len(text)
        if line and length > _LONGEST_LINE:
            yield line
            line, length = [], len(text)
        line.append(text)
    yield line


def index_type(largest: int) -> str:
    """The unsigned type of an array of indices."""
    return "unsigned char" if largest < 256 else "unsigned short" if largest < 65536 else "unsigned long"


def c_prefix(actuator: str, wanted: str | None) -> str:
    """The prefix of all names in a header: what is wanted, or the actuator's name made a C identifier.

    Small letters, digits and single underscores, a letter first: no such name with a word behind it is a keyword or
    reserved. Whatever else stands in an actuator's name becomes an underscore.

    Raises
    ------
    InputError : a wanted prefix that is none
    """
    if wanted is not None:
        if not _WORD.fullmatch(wanted) or len(wanted) > _LONGEST_NAME:
            raise InputError(
                f"--name {wanted!r} cannot begin the names of a C header; use small letters, digits and single "
                f"underscores, a letter first, at most {_LONGEST_NAME} characters, like servo_2"
            )
        return wanted
    words = re.sub(r"[^a-z0-9]+", "_", actuator.lower()).strip("_")
    if not words or words[0].isdigit():
        words = f"{NO_NAME}_{words}"
    return words[:_LONGEST_NAME].strip("_")


def c_comment(text: object) -> str:
    """A foreign text on one line inside a comment, which it cannot end: what is no plain character becomes '_'.

    Among the others are the star, slash, backslash (it joins lines) and question mark (trigraphs).
    """
    said = _FOREIGN.sub("_", str(text).replace("µ", "u"))
    return said if len(said) <= _LONGEST_LINE else f"{said[:_LONGEST_LINE]} (shortened)"


_TEMPLATES = Environment(
    loader=PackageLoader("msl_fem.export", "."),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    autoescape=False,  # C, no page; foreign texts pass c_comment, numbers c_number
)
_TEMPLATES.filters |= {"number": c_number, "rows": c_rows, "comment": c_comment}


def c_header(template: str, prefix: str, content: dict[str, Any]) -> str:
    """The header of a template: ASCII, the same for the same input."""
    names = {"p": prefix, "P": prefix.upper(), "version": version("msl-fem"), "index_type": index_type}
    return c_source(template, names | content)


def c_source(template: str, content: dict[str, Any]) -> str:
    """A template filled in: ASCII, the same for the same input."""
    made = _TEMPLATES.get_template(template).render(content)
    made.encode("ascii")
    return made


def write_header(text: str, target: Path) -> tuple[Path, ...]:
    """The file written, whole or not at all. Raises InputError where the folder cannot be written."""
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return (target,)
