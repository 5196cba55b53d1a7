"""What a file's columns say against themselves before they are a record."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from msl_fem.errors import InputError
from msl_fem.files.schema import LARGEST
from msl_fem.record.columns import read_columns
from msl_fem.record.doubts import doubtful_signals, too_slow
from msl_fem.record.label_doubts import doubtful_table
from msl_fem.record.log_signals import read_log


def doubts_of_file(path: Path, labels: Sequence[str] = (), *, ordered: bool = False) -> list[str]:
    """What a file's columns say against themselves, and its readings against its labels; columns with holes are left
    out.

    Raises
    ------
    InputError : the file cannot be read, or has no such label
    """
    read = read_columns(path) if path.suffix == ".csv" else read_log(path)
    columns = {name: v for name, v in read.items() if v.ndim == 1 and (v.dtype.kind != "f" or np.isfinite(v).all())}
    missing = [name for name in labels if name not in columns]
    if missing:
        raise InputError(f"{path}: no column '{missing[0]}'; there are {', '.join(columns)}")
    sizes = {name: float(np.abs(v).max(initial=0.0)) for name, v in columns.items() if v.dtype.kind == "f"}
    measured = {name: columns[name] for name, size in sizes.items() if name not in labels and size <= LARGEST}
    beyond = [f"{name} reaches {size:g}, more than any sensor shows" for name, size in sizes.items() if size > LARGEST]
    doubts = [*beyond, *doubtful_signals(measured), *(too_slow(measured) if ordered else [])]
    if labels:
        doubts += doubtful_table({name: columns[name] for name in labels}, measured)
    return doubts
