"""Columns of a run: the channels that they hold, and the CSV or NetCDF files that hold them, read with full precision
and every doubtful cell refused."""

import csv
import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.netcdf_file import read_netcdf, write_netcdf
from msl_fem.files.schema import LARGEST, reason

Column = NDArray[Any]
Quantity = Literal[
    "time",
    "position",
    "velocity",
    "force",
    "reference",
    "injection",
    "temperature",
    "voltage",
    "current",
    "command",
    "flux_linkage",
]
UNITS: dict[Quantity, str] = {
    "time": "s",
    "position": "m",
    "velocity": "m/s",
    "force": "N",
    "reference": "m",
    "injection": "m",
    "temperature": "K",
    "voltage": "V",
    "current": "A",
    "command": "A",
    "flux_linkage": "Wb",
}
SIDED: tuple[Quantity, ...] = ("voltage", "current", "command", "flux_linkage")
"""Quantities that each side has of its own."""
MOST_VALUES = 100_000_000  # of a NetCDF file, 0.8 GB: what uses them holds some copies
LARGEST_TEXT = 500_000_000  # bytes of a CSV file, which takes some times as much while it is read
FIRST_ROW = {".csv": 2, ".nc": 0}
"""Row of the first sample: a spreadsheet counts from 1 and has the names there; NetCDF counts from 0."""


@dataclass(frozen=True)
class Channel:
    """A signal of a run: its quantity, and the side (1 or 2) where each side has one of its own."""

    quantity: Quantity
    side: int | None = None

    @property
    def unit(self) -> str:
        return UNITS[self.quantity]

    @property
    def column(self) -> str:
        """The column's name in files, with the SI unit in it: `position_m`, `current_1_A`, `velocity_m_per_s`."""
        side = "" if self.side is None else f"_{self.side}"
        return f"{self.quantity}{side}_{self.unit.replace('/', '_per_')}"

    @property
    def index(self) -> int:
        """Of the side, counted from 0: for arrays with one column a side."""
        if self.side is None:
            raise ValueError(f"{self.column} belongs to no side")
        return self.side - 1

    @staticmethod
    def of(column: str) -> "Channel":
        """The channel of a column's name; RecordError where no run has such a column."""
        if column not in CHANNELS:
            raise RecordError(f"{column} is no column of a run; there are {', '.join(CHANNELS)}")
        return CHANNELS[column]


def _all_channels() -> dict[str, Channel]:
    plain = [Channel(quantity) for quantity in UNITS if quantity not in SIDED]
    sided = [Channel(quantity, side) for quantity in SIDED for side in (1, 2)]
    return {channel.column: channel for channel in (*plain, *sided)}


CHANNELS = _all_channels()
"""Every channel that a run can have, by its column's name."""


def name_and_unit(column: str) -> tuple[str, str]:
    """What a column is called without its unit, and the unit: `current_1` and A of `current_1_A`."""
    ratio = re.fullmatch(r"(.+?)_([^_]+)_per_([^_]+)", column)
    if ratio:
        return ratio[1], f"{ratio[2]}/{ratio[3]}"
    name, _, unit = column.rpartition("_")
    return name, unit


def side_columns(quantity: Quantity, sides: int) -> list[str]:
    """The columns of a quantity that each of so many sides has: `current_1_A`, `current_2_A`."""
    return [Channel(quantity, side).column for side in range(1, sides + 1)]


def place(file: Path | str, sample: int) -> str:
    """Where a sample stands in its file, for messages."""
    row = FIRST_ROW.get(Path(file).suffix, 0)
    return f"{file}: row {row + sample}" + (f" (sample {sample})" if row else "")


def read_columns(path: Path) -> dict[str, Column]:
    """The columns of a file by name, (n_row,) each: float64, or the cells' texts where one is not a number.

    A CSV file has its names in the first row and commas between the cells. A NetCDF file has one variable a column, all
    over the dimension `time`. Numbers are rounded correctly to float64.

    Raises
    ------
    RecordError : no such file, another format, no or double column names, rows of unequal length
    """
    if path.suffix not in FIRST_ROW:
        raise RecordError(f"{path}: the ending '{path.suffix}' is unknown; use .csv or .nc (NetCDF)")
    if not path.is_file():
        raise RecordError(f"{path}: no such file; name one that is there")
    try:
        return _read_netcdf(path) if path.suffix == ".nc" else _read_csv(path)
    except RecordError:
        raise
    except (OSError, ValueError, csv.Error) as err:
        raise RecordError(f"{path}: cannot be read ({reason(err)}); write it as CSV in UTF-8 or NetCDF") from err


def require_columns(needed: list[tuple[str, ...]], names: list[str], *, file: Path | str) -> None:
    """RecordError where of some alternatives no name is there."""
    for alternatives in needed:
        if not set(alternatives) & set(names):
            raise RecordError(
                f"{file}: row 1: column {' or '.join(alternatives)} is missing; the file has {', '.join(names)}"
            )


def _read_csv(path: Path) -> dict[str, Column]:
    if path.stat().st_size > LARGEST_TEXT:
        raise RecordError(f"{path}: more than {LARGEST_TEXT // 1_000_000} MB; write it as NetCDF, or cut it into runs")
    header, _, body = path.read_text(encoding="utf-8-sig").partition("\n")
    names = [name.strip() for name in next(csv.reader([header], skipinitialspace=True), [])]
    double = next((name for k, name in enumerate(names) if name in names[:k] and name), None)
    if not any(names) or double:
        problem = f"column {double} is there twice" if double else "there are no column names"
        raise RecordError(f"{path}: row 1: {problem}; name each column once in the first row")
    columns = _numeric_columns(body, width=len(names)) or _cell_columns(body, width=len(names), path=path)
    for k, name in enumerate(names):
        if not name and columns[k].size and (columns[k].dtype.kind == "f" or any(columns[k])):
            raise RecordError(f"{path}: row 1: column {k + 1} has no name; name it or remove it")
    return {name: columns[k] for k, name in enumerate(names) if name}


def _numeric_columns(body: str, *, width: int) -> list[Column] | None:
    """The columns of a text of numbers alone, fast; None where a cell or a row is anything else."""
    if not body.strip():
        return None
    try:
        values = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    whole = values.shape == (body.rstrip("\n").count("\n") + 1, width)  # no empty rows were skipped
    return list(np.ascontiguousarray(values.T)) if whole else None


def _cell_columns(body: str, *, width: int, path: Path) -> list[Column]:
    """The columns of any text, cell by cell: numbers where all cells are, else the texts."""
    rows = [row or [""] * width for row in csv.reader(io.StringIO(body), skipinitialspace=True)]
    while rows and not any(cell.strip() for cell in rows[-1]):
        rows.pop()
    for k, row in enumerate(rows):
        if len(row) != width:
            raise RecordError(f"{place(path, k)}: {len(row)} cells under {width} names; give each column one")
    columns: list[Column] = []
    for k in range(width):
        cells = [row[k].strip() for row in rows]
        if all(map(is_number, cells)):
            columns.append(np.array([float(cell) for cell in cells]))
        else:
            columns.append(np.array(cells, dtype=object))
    return columns


def is_number(cell: str) -> bool:
    """Whether a cell is a number as all programs write it; Python alone takes "1_000" and full-width digits."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell and cell.isascii()


def _is_finite(cell: str) -> bool:
    return is_number(cell) and bool(np.isfinite(float(cell)))


def _read_netcdf(path: Path) -> dict[str, Column]:
    columns = {}
    for name, variable in read_netcdf(path, most_values=MOST_VALUES).variables.items():
        if variable.dims != ("time",):
            raise RecordError(f"{path}: {name} has the dimensions {variable.dims}; it must have `time` alone")
        numeric = variable.dtype.kind in "iuf"
        columns[str(name)] = variable.to_numpy().astype(np.float64 if numeric else object, copy=False)
    return columns


def numbers(column: Column, name: str, file: Path | str) -> Array:
    """The column as float64; RecordError naming file, row and column of the first cell that is not a finite number."""
    if column.dtype.kind == "f":
        bad = np.flatnonzero(~np.isfinite(column))
    else:
        bad = np.array([k for k, cell in enumerate(column) if not _is_finite(cell)])
    if bad.size:
        cell = column[bad[0]]
        missing = str(cell).lower() in ("", "nan")
        problem = "the value is missing" if missing else f"{str(cell)!r} is not a finite number"
        raise RecordError(f"{place(file, int(bad[0]))}, column {name}: {problem}; write a number or cut the run there")
    values = np.asarray(column, dtype=np.float64)
    beyond = np.flatnonzero(np.abs(values) > LARGEST)
    if beyond.size:
        raise RecordError(
            f"{place(file, int(beyond[0]))}, column {name}: {values[beyond[0]]:g} is beyond {LARGEST:g}, more than any "
            "sensor shows; look at the unit, or cut the run there"
        )
    return values


def write_columns(path: Path, columns: Mapping[str, Column]) -> None:
    """Writes columns (n_row,) under their names, as CSV or NetCDF by the path's ending.

    CSV cells carry nine significant digits (a relative rounding of at most 5e-10, four decades below the noise of a
    16-bit sensor, at half the length of a full float64), the time twelve, so that rounding is no jitter. NetCDF keeps
    float64 as it is. The unit attribute of NetCDF is the name's last part.
    """
    if path.suffix == ".nc":
        import xarray as xr  # here, for its import takes longer than all the rest of a record

        dataset = xr.Dataset({name: ("time", values) for name, values in columns.items()})
        for name in columns:
            dataset[name].attrs["units"] = name_and_unit(name)[1]
        numeric = [name for name, values in columns.items() if values.dtype.kind == "f"]
        packed = {name: {"zlib": True, "shuffle": True} for name in numeric}
        write_netcdf(dataset, path, encoding=packed)
        return
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        texts = [_cell_texts(name, values) for name, values in columns.items()]
        writer.writerows(zip(*texts, strict=True))


def _cell_texts(name: str, values: Column) -> list[str]:
    if values.dtype.kind != "f":
        return [str(value) for value in values]
    digits = "%.12g" if name == "time_s" else "%.9g"
    return [digits % value for value in values.tolist()]
