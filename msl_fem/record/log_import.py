"""A log of another program, MATLAB .mat or CSV, as a run of a record, new or grown by it: which of its signals becomes
which column, and the run."""

import os
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.errors import QuantityError, RecordError
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import read_toml
from msl_fem.files.toml_text import toml_text
from msl_fem.files.whole_file import cannot_be_written, whole_file
from msl_fem.record.columns import CHANNELS, numbers, write_columns
from msl_fem.record.log_signals import read_log, signal
from msl_fem.record.reader import check_columns, check_run, known_columns, load_record
from msl_fem.record.record import Record, Run
from msl_fem.record.rig_file import RIG_FILE, Role, Sampling
from msl_fem.record.writer import run_entry, write_record

LONG = 100_000  # samples from which a run is written as NetCDF
COLUMN_KEYS = ("source", "unit", "scale", "offset")
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")


@dataclass(frozen=True)
class ColumnSource:
    """One column of a run: column = scale * source + offset, scale and offset in the column's SI unit."""

    column: str
    source: str
    scale: float
    offset: float


@dataclass(frozen=True)
class RunLabel:
    """What the log does not say of itself: name, excitation and role of the run, and the part in s that is taken."""

    name: str
    excitation: str = ""
    role: Role = "fit"
    start: float = -np.inf
    end: float = np.inf


def imported_run(
    log: str | Path, sources: Sequence[ColumnSource], actuator: Actuator, *, label: RunLabel, rate: float | None = None
) -> Run:
    """The run that a log holds; time from the log, or from `rate` (Hz) where no source is named for it.

    Raises
    ------
    RecordError : the log cannot be read, a signal is missing or of another length, a value is no number, a column does
        not belong to the actuator, or neither time nor rate is given
    """
    signals = read_log(log, only={it.source for it in sources})
    columns = {}
    for source in sources:
        raw = numbers(signal(signals, source.source, file=log), source.source, log)
        columns[source.column] = source.scale * raw + source.offset
    lengths = {name: values.size for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"{name} {size}" for name, size in lengths.items())
        raise RecordError(f"{log}: the signals have different lengths: {each}; name signals of one run")
    if "time_s" not in columns:
        if rate is None:
            raise RecordError(f"{log}: no source for time_s; name one, or give --rate")
        columns = {"time_s": np.arange(next(iter(lengths.values()))) / rate, **columns}
    time = columns["time_s"]
    kept = (time >= label.start) & (time <= label.end)
    if not kept.any():
        raise RecordError(f"{log}: nothing lies between --from and --to; the time runs {time[0]:g} ... {time[-1]:g} s")
    check_columns(list(columns), actuator, file=log)
    strange = [name for name in columns if name not in known_columns(actuator)]
    if strange:
        raise RecordError(f"{log}: {strange[0]} does not belong to {actuator.name}; leave it out")
    return Run(
        name=label.name,
        excitation=label.excitation,
        role=label.role,
        columns={name: values[kept] for name, values in columns.items()},
        file_format="nc" if kept.sum() >= LONG else "csv",
    )


def import_into(folder: str | Path, run: Run, *, actuator: Actuator | None = None, rate: float | None = None) -> Path:
    """The run's file, after it became part of the record in a folder, or of a new record of the actuator.

    Where a record is, its files stay as they are: the run's file is added, and a [[run]] at the end of rig.toml. `rate`
    is that of the samples in Hz; without, that of the run's own time.

    Raises
    ------
    RecordError : no record there and no actuator given; the record is simulated, or has a run of this name; the run
        would be refused by `load_record`
    """
    folder = Path(folder)
    if (folder / RIG_FILE).exists():
        _append(folder, run)
    elif actuator is None:
        raise RecordError(f"{folder}: is no record yet; name its actuator with --actuator")
    else:
        sampling = Sampling(rate=_rate(run, rate))
        write_record(Record("measured", actuator, sampling=sampling, runs=(run,)), folder)
    return folder / run.file


def _append(folder: Path, run: Run) -> None:
    there = load_record(folder)
    rig_file = folder / RIG_FILE
    target = folder / run.file
    if there.origin != "measured":
        raise RecordError(f"{folder}: holds simulated data, and a log is measured; choose another folder")
    if there.sampling is None:
        raise RecordError(f"{rig_file}: states no [sampling]; add its rate, then import")
    if target.exists() or run.name in {other.name for other in there.runs}:
        raise RecordError(f"{target}: is there already; choose another --name")
    check_run(run, there.actuator, there.sampling, file=target)
    entry = toml_text({"run": [run_entry(run)]})
    try:
        with tempfile.TemporaryDirectory(prefix=".", dir=folder) as partial_folder:
            written = Path(partial_folder) / run.file
            write_columns(written, {**run.columns, **run.extra})
            os.replace(written, target)
        with whole_file(rig_file) as partial:
            partial.write_text(f"{rig_file.read_text(encoding='utf-8').rstrip()}\n\n{entry}", encoding="utf-8")
    except OSError as err:
        raise cannot_be_written(folder / run.file, err, "look at the folder's permissions", error=RecordError) from err


def _rate(run: Run, rate: float | None) -> float:
    """Samples a second, rounded to six digits: a log's time often has no more."""
    if rate is not None:
        return rate
    if run.time.size < 2 or not run.time[-1] > run.time[0]:
        raise RecordError(f"run {run.name}: the time does not increase; look at the source of time_s")
    return float(f"{1 / run.sampling_period:.6g}")


def column_sources(text: str) -> tuple[ColumnSource, ...]:
    """The sources that a text names, or those of a TOML file where the text ends in .toml.

    The text lists `column=source`, parted by commas, each with `:unit=mm`, `:scale=-1` (a number times the unit, or a
    quantity like `0.5 mm` for one of the log's units) and `:offset=14 mm` where needed. The file has a table for each
    column, `[position_m]`, with the keys source, unit, scale and offset.

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
    return [(column, {key: str(value) for key, value in keys.items()}) for column, keys in content.items()]


def _source(column: str, keys: dict[str, str]) -> ColumnSource:
    if column not in CHANNELS:
        raise RecordError(f"--columns: {column} is no column of a run; there are {', '.join(CHANNELS)}")
    unknown = [key for key in keys if key not in COLUMN_KEYS]
    if unknown or "source" not in keys:
        problem = f"{unknown[0]} is unknown" if unknown else "source is missing"
        raise RecordError(f"--columns: {column}: {problem}; the keys are {', '.join(COLUMN_KEYS)}")
    unit = CHANNELS[column].unit
    try:
        return ColumnSource(column, keys["source"], _scale(keys, unit), _offset(keys, unit))
    except QuantityError as err:
        raise RecordError(f"--columns: {column}: {err}") from err


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
    return described
