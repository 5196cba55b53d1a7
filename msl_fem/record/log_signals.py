"""The signals of a log of another program by name or number: MATLAB, text of any layout, and what libraries read."""

import warnings
from collections.abc import Collection
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.schema import reason
from msl_fem.record.log_libraries import READERS, SignalsAndUnits
from msl_fem.record.log_limits import ELEMENT
from msl_fem.record.log_mat import read_mat
from msl_fem.record.log_text import ends_in_a_row, read_text_log

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm")
ENDINGS = (".mat", *TEXTS, *READERS)


def read_log(path: str | Path, *, only: Collection[str] | None = None) -> dict[str, Array]:
    """The numeric arrays of a log by name: (n_sample,) each, or a matrix whose longer side runs over the samples.

    A .mat file of any version; members of a structure are named `structure.member`. A text file (.csv, .txt, ...) has
    its names in a row or a comment above the numbers, or none: then its columns are "1", "2", ... A channel of a .tdms
    or .mf4 file has a time of its own, `channel.time`.

    Parameters
    ----------
    path : the log
    only : sources as `signal` takes them; of other arrays only the shape is right, their values are nan and not read

    Raises
    ------
    RecordError : no such file, another format, a library is not there, no numbers in it, a row that does not fit the
        names, parts that lie in another file, or more numbers asked for than are taken of a log
    """
    return signals_and_units(path, only=only)[0]


def signals_and_units(path: str | Path, *, only: Collection[str] | None = None) -> SignalsAndUnits:
    """`read_log`, and the units of the signals that the log tells of."""
    path = Path(path)
    if not path.is_file():
        raise RecordError(f"{path}: no such file; give a .mat or CSV log")
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise RecordError(f"{path}: the ending '{path.suffix}' is unknown; give a log as {', '.join(ENDINGS)}")
    try:
        with warnings.catch_warnings():
            for doubtful in (UserWarning, RuntimeWarning):  # what a library warns of may be other numbers than meant
                warnings.simplefilter("error", doubtful)
            signals, units = _read(path, ending, only)
    except RecordError:
        raise
    except Exception as err:  # the readers raise errors of many kinds on a damaged file
        raise RecordError(f"{path}: cannot be read ({reason(err)}); save it anew as .mat or CSV") from err
    if not signals:
        raise RecordError(f"{path}: holds no numeric arrays; save the signals as vectors or one matrix")
    return signals, units


def _read(path: Path, ending: str, only: Collection[str] | None) -> SignalsAndUnits:
    if ending == ".mat":
        return read_mat(path, only), {}
    if ending in READERS:
        return READERS[ending](path, only)
    return read_text_log(path, only)


def signal(signals: dict[str, Array], source: str, *, file: Path | str) -> Array:
    """The samples (n_sample,) of a signal by its name, by the number of its column of a text or a sheet from 1, or of
    one row of a matrix by `name[row]`, counted from 0.

    Raises
    ------
    RecordError : no such signal or row, or a matrix without a row
    """
    if source not in signals and Path(file).suffix.lower() in (*TEXTS, ".xlsx") and source.isdecimal():
        source = dict(enumerate(signals, 1)).get(int(source), source)
    if source in signals:
        values = signals[source]
        if values.ndim == 1:
            return values
        count = values.shape[0]
        raise RecordError(
            f"{file}: '{source}' is a matrix of {count} signals; write {source}[0] ... {source}[{count - 1}]"
        )
    match = ELEMENT.fullmatch(source)
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


def cut_remark(path: Path) -> str:
    """That a text log may have been cut, in words; empty where nothing shows it."""
    if path.suffix.lower() not in TEXTS or not path.is_file() or not ends_in_a_row(path):
        return ""
    return f"{path.name} ends without an end of line: if it was cut, its last row is no reading; look at it"
