"""A log of another program as a run of a record, new or grown by it."""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.files.schema import reason
from msl_fem.files.toml_text import toml_text
from msl_fem.files.whole_file import whole_file
from msl_fem.record.checks import check_columns, check_run, known_columns
from msl_fem.record.column_file import numbers, write_columns
from msl_fem.record.column_map import ColumnSource
from msl_fem.record.log_file import read_log, signal
from msl_fem.record.reader import load_record
from msl_fem.record.record import Record, Role, Run, Sampling
from msl_fem.record.rig_file import RIG_FILE
from msl_fem.record.writer import write_record

LONG = 100_000  # samples from which a run is written as NetCDF


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
    signals = read_log(log)
    columns = {}
    for it in sources:
        raw = numbers(signal(signals, it.source, file=log), it.source, log)
        columns[it.column] = it.scale * raw + it.offset
    lengths = {name: values.size for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} {size}" for name, size in lengths.items())
        raise RecordError(f"{log}: the signals have different lengths: {said}; name signals of one run")
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
    rig_file, target = folder / RIG_FILE, folder / run.file
    if there.origin != "measured":
        raise RecordError(f"{folder}: holds simulated data, and a log is measured; choose another folder")
    if there.sampling is None:
        raise RecordError(f"{rig_file}: states no [sampling]; add its rate, then import")
    if target.exists() or run.name in {it.name for it in there.runs}:
        raise RecordError(f"{target}: is there already; choose another --name")
    check_run(run, there.actuator, there.sampling, file=target)
    entry = toml_text({"run": [{"file": run.file, "excitation": run.excitation, "role": run.role}]})
    try:
        with tempfile.TemporaryDirectory(prefix=".", dir=folder) as partial_folder:
            write_columns(Path(partial_folder) / run.file, {**run.columns, **run.extra})
            os.replace(Path(partial_folder) / run.file, target)
        with whole_file(rig_file) as partial:
            partial.write_text(f"{rig_file.read_text(encoding='utf-8').rstrip()}\n\n{entry}", encoding="utf-8")
    except OSError as err:
        raise RecordError(f"{folder}: cannot be written ({reason(err)}); look at its permissions") from err


def _rate(run: Run, rate: float | None) -> float:
    """Samples a second, rounded to six digits: a log's time often has no more."""
    if rate is not None:
        return rate
    if run.time.size < 2 or not run.time[-1] > run.time[0]:
        raise RecordError(f"run {run.name}: the time does not increase; look at the source of time_s")
    return float(f"{1 / run.sampling_period:.6g}")
