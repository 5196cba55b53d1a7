"""Which signal of a log becomes which column of a run, in which unit: from the option's text, or a file of columns."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import QuantityError, RecordError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import read_toml
from msl_fem.record.calibration import CalibrationCurve, read_curve
from msl_fem.record.columns import CHANNELS

COLUMN_KEYS = ("source", "unit", "scale", "offset", "time", "curve")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class ColumnSource:
    """One column of a run: column = scale * source + offset, scale and offset in the column's SI unit.

    `time` is the signal that holds the instants of this one, where it has a clock of its own; `curve` what the source
    means, of a gauge that is not linear: the values of the curve take the source's place.
    """

    column: str
    source: str
    scale: float
    offset: float
    time: str = ""
    curve: CalibrationCurve | None = None

    def in_si(self, raw: Array, *, file: Path | str) -> Array:
        """The column (n_sample,) of its source's values; RecordError where one lies beyond the curve."""
        linear = raw if self.curve is None else self.curve.values_of(raw, source=self.source, file=file)
        return np.asarray(self.scale * linear + self.offset)


def column_sources(text: str) -> tuple[ColumnSource, ...]:
    """The sources that a text names, or those of a TOML file where the text ends in .toml.

    The text lists `column=source`, parted by commas, each with `:unit=mm`, `:scale=-1` (a number times the unit, or a
    quantity like `0.5 mm` for one of the log's units) and `:offset=14 mm` where needed. The file has a table for each
    column, `[position_m]`, with the keys source, unit, scale, offset, and curve: a CSV file with the calibration
    of a gauge that is not linear, columns `reading` and `value`, the value in `unit`.

    Raises
    ------
    RecordError : an unknown column or key, a column twice, a unit or quantity that is none; says what there is
    """
    if text.strip().endswith(".toml"):
        entries = _from_file(Path(text.strip()))
    else:
        entries = [_from_text(part) for part in text.split(",") if part.strip()]
    if not entries:
        raise RecordError('--columns is empty; write like "time_s=t, position_m=q:unit=mm"')
    columns = [column for column, _ in entries]
    double = next((c for k, c in enumerate(columns) if c in columns[:k]), None)
    if double:
        raise RecordError(f"--columns: {double} is there twice; give each column one source")
    return tuple(_source(column, keys) for column, keys in entries)


def _from_text(part: str) -> tuple[str, dict[str, str]]:
    head, *options = part.split(":")
    column, equals, source = (word.strip() for word in head.partition("="))
    if not (equals and column and source):
        raise RecordError(f"--columns: {part.strip()!r} names no source; write like position_m=q:unit=mm")
    keys = {"source": source}
    for option in options:
        key, equals, value = (word.strip() for word in option.partition("="))
        if not (equals and value) or key in keys:
            raise RecordError(f"--columns: {part.strip()!r}: write options like :unit=mm:scale=-1:offset=14 mm")
        keys[key] = value
    return column, keys


def _from_file(path: Path) -> list[tuple[str, dict[str, str]]]:
    content = read_toml(path, error=RecordError, wanted="a file of columns")
    for column, keys in content.items():
        if not isinstance(keys, dict):
            raise RecordError(f"{path}: {column}: write a table, [{column}] with a source")
    entries = [(column, {key: str(value) for key, value in keys.items()}) for column, keys in content.items()]
    for _, keys in entries:
        if "curve" in keys:  # beside the file of columns
            keys["curve"] = str(path.parent / keys["curve"])
    return entries


def _source(column: str, keys: dict[str, str]) -> ColumnSource:
    if column not in CHANNELS:
        raise RecordError(f"--columns: {column} is no column of a run; there are {', '.join(CHANNELS)}")
    unknown = [key for key in keys if key not in COLUMN_KEYS]
    if unknown or "source" not in keys:
        problem = f"{unknown[0]} is unknown" if unknown else "source is missing"
        raise RecordError(f"--columns: {column}: {problem}; the keys are {', '.join(COLUMN_KEYS)}")
    unit = CHANNELS[column].unit
    try:
        scale, offset = _scale(keys, unit), _offset(keys, unit)
    except QuantityError as err:
        raise RecordError(f"--columns: {column}: {err}") from err
    curve = read_curve(Path(keys["curve"])) if "curve" in keys else None
    return ColumnSource(column, keys["source"], scale, offset, keys.get("time", ""), curve)


def _scale(keys: dict[str, str], unit: str) -> float:
    """SI units of the column for one unit of the log."""
    scale = keys.get("scale", "1")
    if _NUMBER.fullmatch(scale):
        value = float(scale) * (parse_quantity(f"1 {keys['unit']}", unit) if "unit" in keys else 1.0)
    elif "unit" in keys:
        raise QuantityError(f"scale {scale!r} has a unit, and unit says {keys['unit']!r}; give one of them")
    else:
        value = parse_quantity(scale, unit)
    if value == 0:
        raise QuantityError("scale is 0 and would erase the signal; give another")
    return value


def _offset(keys: dict[str, str], unit: str) -> float:
    offset = keys.get("offset", "0")
    return 0.0 if _NUMBER.fullmatch(offset) and float(offset) == 0 else parse_quantity(offset, unit)


def describe(sources: Sequence[ColumnSource]) -> dict[str, dict[str, object]]:
    """What was understood, for a JSON object: source, scale and offset in the column's unit."""
    described: dict[str, dict[str, object]] = {}
    for source in sources:
        described[source.column] = {
            "source": source.source,
            "unit": CHANNELS[source.column].unit,
            "scale": source.scale,
            "offset": source.offset,
        }
        if source.curve is not None:
            described[source.column]["curve"] = source.curve.file
    return described
