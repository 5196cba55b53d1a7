"""Logs whose formats are read by libraries that are not installed with the package: xlsx, TDMS, MDF 4."""

import importlib
import logging
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.log_apart import SignalsAndUnits, read_apart
from msl_fem.record.log_layout import text_layout
from msl_fem.record.log_limits import not_read, refuse_many_values


def _library(module: str, package: str, path: Path) -> Any:
    try:
        return importlib.import_module(module)
    except ImportError as err:
        raise RecordError(f"{path}: reading {path.suffix} needs {package}; pip install {package}") from err


@contextmanager
def _heard(library: str, path: Path) -> Iterator[None]:
    """What a library logs stays here; RecordError where it has warned, for what it reads then may be other numbers than
    meant."""
    said = _Said()
    known = [name for name in logging.root.manager.loggerDict if f"{name}.".startswith(f"{library}.")]
    before = [(logger, logger.handlers, logger.propagate) for logger in map(logging.getLogger, known)]
    for logger, _, _ in before:
        logger.handlers, logger.propagate = [said], False
    try:
        yield
    finally:
        for logger, handlers, passed_on in before:
            logger.handlers, logger.propagate = handlers, passed_on
    if said.lines:
        raise RecordError(f"{path}: cannot be read ({said.lines[0]}); save it anew as .mat or CSV")


class _Said(logging.Handler):
    """Keeps warnings."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keeps the line."""
        self.lines.append(record.getMessage())


def _wanted(name: str, only: Collection[str] | None) -> bool:
    return only is None or name in only


def read_workbook(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    """The columns of a workbook's first sheet, laid out as a text log is.

    Raises
    ------
    RecordError : openpyxl is not there, a row that does not fit
    """
    openpyxl = _library("openpyxl", "openpyxl", path)
    with path.open("rb") as stream:  # openpyxl leaves a damaged file open
        book = openpyxl.load_workbook(stream, read_only=True, data_only=True)
        try:
            rows = [list(row) for row in book.worksheets[0].iter_rows(values_only=True)]
        finally:
            book.close()
    width = max((k + 1 for row in rows for k, cell in enumerate(row) if cell is not None), default=0)
    refuse_many_values(len(rows) * width, path)
    texts = []
    for k, row in enumerate(rows):
        cells = ["" if cell is None else str(cell) for cell in (*row, *[None] * width)[:width]]
        if any(cells):
            texts.append((k + 1, cells))
    if len(texts) < 2:
        return {}, {}
    quoted = [
        (k, ",".join('"' + cell.replace('"', "'").replace("\n", " ") + '"' for cell in cells)) for k, cells in texts
    ]
    layout = text_layout(quoted[:400], [], file=path)
    body = [cells for k, cells in texts if k >= layout.first]
    signals = {}
    for k, name in enumerate(layout.names):
        signals[name] = np.array([_cell_number(row[layout.lead + k]) for row in body])
    return signals, layout.units


def _cell_number(text: str) -> float:
    """nan of an empty cell, inf of one that is no number."""
    if not text:
        return np.nan
    try:
        return float(text)
    except ValueError:
        return np.inf


def read_tdms(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    """The channels of a TDMS file as `group/channel`, or `channel` where no other group has one of this name, and the
    time of each that states its increment as `channel.time`.

    Raises
    ------
    RecordError : npTDMS is not there
    """
    tdms = _library("nptdms", "npTDMS", path)
    signals: dict[str, Array] = {}
    units: dict[str, str] = {}
    # npTDMS leaves a damaged file open
    with _heard("nptdms", path), path.open("rb") as stream, tdms.TdmsFile.open(stream) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        names = [channel.name for channel in channels]
        for channel in channels:
            name = channel.name if names.count(channel.name) == 1 else f"{channel.group_name}/{channel.name}"
            if channel.dtype.kind not in "iuf" or len(channel) < 2:
                continue
            refuse_many_values(len(channel), path)
            taken = _wanted(name, only)
            signals[name] = np.asarray(channel[:], dtype=np.float64) if taken else not_read((len(channel),))
            units[name] = str(channel.properties.get("unit_string", ""))
            step = channel.properties.get("wf_increment")
            if step:
                offset = float(channel.properties.get("wf_start_offset", 0.0))
                signals[f"{name}.time"] = offset + float(step) * np.arange(len(channel), dtype=np.float64)
    return signals, {name: unit for name, unit in units.items() if unit}


def read_mdf(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    """`channels_of_mdf` in a process of its own, which native code of asammdf ends where a damaged file says so."""
    _library("asammdf", "asammdf", path)
    return read_apart(channels_of_mdf, path, only)


def channels_of_mdf(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    """The channels of an MDF 4 file, and the time of each as `channel.time`.

    Raises
    ------
    RecordError : asammdf is not there
    """
    asammdf = _library("asammdf", "asammdf", path)
    signals: dict[str, Array] = {}
    units: dict[str, str] = {}
    with _heard("asammdf", path), asammdf.MDF(path) as file:
        for channel in file.iter_channels(skip_master=True):
            values = np.asarray(channel.samples)
            if values.dtype.kind not in "iuf" or values.size < 2 or values.ndim != 1:
                continue
            if channel.name in signals or not (_wanted(channel.name, only) or _wanted(f"{channel.name}.time", only)):
                signals.setdefault(channel.name, not_read(values.shape))
                continue
            refuse_many_values(values.size, path)
            signals[channel.name] = values.astype(np.float64)
            signals[f"{channel.name}.time"] = np.asarray(channel.timestamps, dtype=np.float64)
            units[channel.name] = str(channel.unit or "")
    return signals, {name: unit for name, unit in units.items() if unit}


READERS: dict[str, Callable[[Path, Collection[str] | None], SignalsAndUnits]] = {
    ".xlsx": read_workbook,
    ".tdms": read_tdms,
    ".mf4": read_mdf,
}
