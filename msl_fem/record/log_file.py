"""Logs of other programs: the signals of a MATLAB .mat or a CSV file, by name."""

import csv
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from msl_fem.errors import RecordError
from msl_fem.files.netcdf_file import refuse_endless_heap
from msl_fem.files.schema import reason

Array = NDArray[np.float64]
DELIMITERS = ",;\t"
COMMENTS = ("#", "%")
_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")


def read_log(path: str | Path) -> dict[str, Array]:
    """The numeric arrays of a log by name: (n_sample,) each, or a matrix whose longer side runs over the samples.

    A .mat file of any version; members of a structure are named `structure.member`. A text file (.csv, .txt, .tsv)
    has its names in the first row that is no comment (# or %), cells parted by comma, semicolon or tab.

    Raises
    ------
    RecordError : no such file, another format, no numbers in it, a row that does not fit the names
    """
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such file; give a .mat or CSV log")
    try:
        if path.suffix.lower() == ".mat":
            signals = _read_mat(path)
        elif path.suffix.lower() in (".csv", ".txt", ".tsv"):
            signals = _read_text(path)
        else:
            raise RecordError(f"{path}: the ending '{path.suffix}' is unknown; give a .mat or a .csv file")
    except RecordError:
        raise
    except (OSError, ValueError, TypeError, KeyError, IndexError, NotImplementedError, MatReadError, csv.Error) as err:
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
        raise RecordError(
            f"{file}: '{source}' is a matrix of {values.shape[0]} signals; write {source}[0] ... "
            f"{source}[{values.shape[0] - 1}]"
        )
    match = _ELEMENT.fullmatch(source)
    matrix = signals.get(match["name"]) if match else None
    if match is None or matrix is None or matrix.ndim == 1:
        raise RecordError(f"{file}: there is no signal '{source}'; it has {_listed(signals)}")
    if int(match["index"]) >= matrix.shape[0]:
        raise RecordError(f"{file}: '{match['name']}' has the rows 0 to {matrix.shape[0] - 1}, not {match['index']}")
    return np.asarray(matrix[int(match["index"])])


def _listed(signals: dict[str, Array]) -> str:
    names = [n if v.ndim == 1 else f"{n}[0..{v.shape[0] - 1}]" for n, v in signals.items()]
    return ", ".join(names[:20]) + (f" and {len(names) - 20} more" if len(names) > 20 else "")


def _read_mat(path: Path) -> dict[str, Array]:
    if h5py.is_hdf5(path):  # version 7.3
        refuse_endless_heap(path)
        found: dict[str, Array] = {}
        with h5py.File(path, "r") as stream:
            stream.visititems(lambda name, item: _add(found, name.replace("/", "."), _dataset(item)))
        return {name: values for name, values in found.items() if not name.startswith("#")}
    signals: dict[str, Array] = {}
    for name, value in loadmat(path, squeeze_me=True, struct_as_record=True).items():
        if not name.startswith("__"):
            _add(signals, name, value)
    return signals


def _dataset(item: Any) -> Any:
    return item[()] if isinstance(item, h5py.Dataset) else None


def _add(signals: dict[str, Array], name: str, value: Any) -> None:
    """Keeps a numeric vector or matrix; a structure's members one by one; nothing else."""
    array = np.asarray(value)
    if array.dtype.names:
        for member in array.dtype.names:
            if array.size == 1:
                _add(signals, f"{name}.{member}", np.asarray(array[member]).item())
    elif array.dtype.kind in "iuf" and array.size > 1:
        squeezed = np.squeeze(array).astype(np.float64)
        if squeezed.ndim == 1:
            signals[name] = squeezed
        elif squeezed.ndim == 2:
            signals[name] = squeezed if squeezed.shape[0] <= squeezed.shape[1] else squeezed.T.copy()


def _read_text(path: Path) -> dict[str, Array]:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    first = next((k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(COMMENTS)), None)
    if first is None:
        raise RecordError(f"{path}: is empty; it needs a row of names and rows of numbers")
    delimiter = max(DELIMITERS, key=lines[first].count)
    names = [name.strip() for name in next(csv.reader([lines[first]], delimiter=delimiter))]
    columns: list[list[float]] = [[] for _ in names]
    for number, line in enumerate(lines[first + 1 :], start=first + 2):
        if not line.strip() or line.lstrip().startswith(COMMENTS):
            continue
        cells = next(csv.reader([line], delimiter=delimiter))
        if len(cells) != len(names):
            raise RecordError(
                f"{path}: row {number}: {len(cells)} cells under {len(names)} names; give each column one"
            )
        for column, cell in zip(columns, cells, strict=True):
            column.append(_number(cell))
    return {name: np.array(column) for name, column in zip(names, columns, strict=True) if name and len(column) > 1}


def _number(cell: str) -> float:
    """The cell's number, nan where it is none: whether that matters depends on whether the column is asked for."""
    try:
        return float(cell)
    except ValueError:
        return float("nan")
