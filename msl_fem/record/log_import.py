"""A log of another program as a run of a record, new or grown by it: its signals as columns, its clock, its noise."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.toml_text import quantity_text, toml_text
from msl_fem.files.whole_file import cannot_be_written, staging_folder, whole_file
from msl_fem.record.clock import common_span, evened, resample, timed_by
from msl_fem.record.columns import CHANNELS, UNITS, Quantity, numbers, write_columns
from msl_fem.record.frames import NOTEBOOK, frame_signals
from msl_fem.record.log_columns import ColumnSource, column_sources
from msl_fem.record.log_noise import estimated_noise
from msl_fem.record.log_signals import cut_remark, read_log, signal
from msl_fem.record.reader import check_columns, check_run, known_columns, load_record
from msl_fem.record.record import Record, Run
from msl_fem.record.rig_file import RIG_FILE, Mover, Noise, Role, Sampling
from msl_fem.record.writer import run_entry, write_record

if TYPE_CHECKING:
    import pandas as pd

LONG = 100_000  # samples from which a run is written as NetCDF
TIME = "time_s"
INSTRUMENTS: tuple[Quantity, ...] = ("position", "velocity", "current", "voltage", "flux_linkage")
"""Whose noise is estimated where no data sheet states it; a force is the drive's own command in most logs."""
NOISE_REMARK = "estimated from run {run}; take the data sheet's where there is one"


@dataclass(frozen=True)
class RunLabel:
    """What the log does not say of itself: name, excitation and role of the run, the part in s that is taken, and what
    became of the mover."""

    name: str
    excitation: str = ""
    role: Role = "fit"
    start: float = -np.inf
    end: float = np.inf
    mover: Mover = "free"


@dataclass(frozen=True)
class LogTiming:
    """Rates in Hz: `rate` is that of the log's samples and goes before its time column; to `resampled` signals of
    irregular or several clocks are brought."""

    rate: float | None = None
    resampled: float | None = None


@dataclass(frozen=True, eq=False)
class ImportedRun:
    """A run made of a log.

    Attributes
    ----------
    run : in the record's columns and units
    noise : one sigma by quantity, estimated from the log's samples
    remarks : what was done to the time and the noise
    """

    run: Run
    noise: Mapping[Quantity, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Columns at common instants, what was done, and by what the noise of each column was changed."""

    columns: dict[str, Array]
    remarks: list[str]
    gains: dict[str, float] = field(default_factory=dict)


def imported_run(
    log: str | Path,
    sources: Sequence[ColumnSource],
    actuator: Actuator,
    *,
    label: RunLabel,
    timing: LogTiming | None = None,
) -> ImportedRun:
    """The run that a log holds; time from the log or from a rate, rounded times in equal steps, others resampled.

    Raises
    ------
    RecordError : the log cannot be read, a signal is missing or of another length, a value is no number, a column does
        not belong to the actuator, or neither time nor rate is given
    """
    own_clocks = {it.time for it in sources if it.time}
    signals = read_log(log, only={it.source for it in sources} | own_clocks)
    made = _imported(signals, sources, actuator, label=label, timing=timing or LogTiming(), log=log)
    told = cut_remark(Path(log))
    return replace(made, remarks=(*made.remarks, told)) if told else made


def import_log(
    log: "str | Path | pd.DataFrame",
    columns: str,
    actuator: Actuator,
    *,
    label: RunLabel | None = None,
    timing: LogTiming | None = None,
) -> ImportedRun:
    """The run of a log's file or of a frame, by the text or the file of columns that `msl-fem import` takes.

    `import_into` makes it part of a record. Raises as `column_sources` and `imported_run`.
    """
    sources = column_sources(columns)
    if isinstance(log, str | Path):
        named = label or RunLabel(Path(log).stem)
        return imported_run(log, sources, actuator, label=named, timing=timing)
    how = timing or LogTiming()
    return _imported(frame_signals(log), sources, actuator, label=label or RunLabel("frame"), timing=how, log=NOTEBOOK)


def _imported(
    signals: dict[str, Array],
    sources: Sequence[ColumnSource],
    actuator: Actuator,
    *,
    label: RunLabel,
    timing: LogTiming,
    log: str | Path,
) -> ImportedRun:
    raw = {it.column: signal(signals, it.source, file=log) for it in sources}
    for source in sources:
        _refuse_no_numbers(raw[source.column], source, log, empty=timing.resampled is not None)
    in_si = {it.column: it.in_si(raw[it.column], file=log) for it in sources}
    noise = {
        name: estimated_noise(v[np.isfinite(v)]) for name, v in in_si.items() if CHANNELS[name].quantity in INSTRUMENTS
    }
    if timing.resampled is not None:
        clocks = {it.column: it.time for it in sources if it.time}
        sampled = _resampled(in_si, _clocks(in_si, clocks, signals, sources, timing, log), timing.resampled, log)
    else:
        sampled = _as_sampled(in_si, timing.rate, log)
    return _run_of(sampled, noise, actuator, label=label, log=log)


def _run_of(
    sampled: _Sampled, noise: Mapping[str, float], actuator: Actuator, *, label: RunLabel, log: str | Path
) -> ImportedRun:
    columns = sampled.columns
    time = columns[TIME]
    kept = (time >= label.start) & (time <= label.end)
    if not kept.any():
        raise RecordError(f"{log}: nothing lies between --from and --to; the time runs {time[0]:g} ... {time[-1]:g} s")
    check_columns(list(columns), actuator, file=log, mover=label.mover)
    strange = [name for name in columns if name not in known_columns(actuator)]
    if strange:
        raise RecordError(f"{log}: {strange[0]} does not belong to {actuator.name}; leave it out")
    run = Run(
        name=label.name,
        excitation=label.excitation,
        role=label.role,
        columns={name: values[kept] for name, values in columns.items()},
        file_format="nc" if kept.sum() >= LONG else "csv",
        mover=label.mover,
    )
    by_quantity: dict[Quantity, float] = {}
    for name, sigma in noise.items():
        quantity = CHANNELS[name].quantity
        if sigma > 0:
            by_quantity[quantity] = max(by_quantity.get(quantity, 0.0), sigma * sampled.gains.get(name, 1.0))
    return ImportedRun(run, by_quantity, tuple(sampled.remarks))


def _refuse_no_numbers(raw: Array, source: ColumnSource, log: str | Path, *, empty: bool) -> None:
    """RecordError naming the first sample that is no finite number; an empty one may be where signals are resampled."""
    bad = np.flatnonzero(np.isinf(raw) if empty else ~np.isfinite(raw))
    if bad.size:
        at = int(bad[0])
        problem = "the value is missing" if np.isnan(raw[at]) else "is not a finite number"
        raise RecordError(
            f"{log}: sample {at} (from 0), column {source.source}: {problem}; write a number, or leave the part "
            "out with --from and --to; signals that are sampled at different times are brought together by --resample"
        )
    numbers(raw[np.isfinite(raw)], source.source, log)


def _as_sampled(columns: dict[str, Array], rate: float | None, log: str | Path) -> _Sampled:
    """The columns as they are, their time in equal steps where it is given by a rate or rounded."""
    lengths = {name: values.size for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"{name} {size}" for name, size in lengths.items())
        raise RecordError(
            f"{log}: the signals have different lengths: {each}; name signals of one run, or the time of each, "
            "and --resample"
        )
    if rate is None and TIME not in columns:
        raise RecordError(f"{log}: no source for time_s; name one, or give --rate")
    own = columns.get(TIME)
    if rate is not None:
        time, remark = timed_by(rate, own, next(iter(lengths.values())), file=log)
    else:
        assert own is not None
        time, remark = evened(own)
    return _Sampled({TIME: time, **{k: v for k, v in columns.items() if k != TIME}}, [remark] if remark else [])


def _clocks(
    columns: dict[str, Array],
    named: dict[str, str],
    signals: dict[str, Array],
    sources: Sequence[ColumnSource],
    timing: LogTiming,
    log: str | Path,
) -> dict[str, Array]:
    """The instants of each column in s: its own time, else that of time_s or of the rate."""
    scale = next((it.scale for it in sources if it.column == TIME), 1.0)
    clocks = {}
    for name, values in columns.items():
        if name in named:
            time = scale * signal(signals, named[name], file=log)
        elif TIME in columns:
            time = columns[TIME]
        elif timing.rate is not None:
            time = np.arange(values.size) / timing.rate
        else:
            raise RecordError(f"{log}: no source for the time of {name}; name one for time_s, or give --rate")
        if time.size != values.size:
            raise RecordError(
                f"{log}: {name} has {values.size} values and its time {time.size}; name a time of its own"
            )
        if name != TIME:
            clocks[name] = time
    return clocks


def _resampled(columns: dict[str, Array], clocks: dict[str, Array], rate: float, log: str | Path) -> _Sampled:
    kept = {name: clocks[name][np.isfinite(columns[name])] for name in clocks}
    for name, time in kept.items():
        if time.size < 2:
            raise RecordError(f"{log}: {name} has fewer than two values; look at its source")
    grid = common_span(list(kept.values()), rate, file=log)
    sampled = _Sampled({TIME: grid}, [])
    for name, time in clocks.items():
        result = resample(columns[name], time, grid, source=name, file=log)
        sampled.columns[name] = result.values
        sampled.gains[name] = result.noise_gain
        sampled.remarks.append(
            f"{name} resampled to {rate:.7g} Hz: white noise becomes {result.noise_gain:.2f} of what it was, and "
            f"neighbouring samples of it correlate by {result.correlation:.2f}"
        )
    return sampled


def import_into(
    folder: str | Path, imported: ImportedRun, *, actuator: Actuator | None = None, rate: float | None = None
) -> Path:
    """The run's file, after it became part of the record in a folder, or of a new record of the actuator.

    The [noise] of a new record holds what the actuator states of its sensors and, with a remark, what the log's samples
    show of the others.

    Where a record is, its files stay as they are: the run's file is added, and a [[run]] at the end of rig.toml. `rate`
    is that of the samples in Hz; without, that of the run's own time.

    Raises
    ------
    RecordError : no record there and no actuator given; the record is simulated, or has a run of this name; the run
        would be refused by `load_record`
    """
    folder = Path(folder)
    run = imported.run
    if (folder / RIG_FILE).exists():
        _append(folder, run)
    elif actuator is None:
        raise RecordError(f"{folder}: is no record yet; name its actuator with --actuator")
    else:
        sampling = Sampling(rate=_rate(run, rate))
        noise = stated_noise(run, actuator)
        write_record(Record("measured", actuator, sampling=sampling, noise=noise, runs=(run,)), folder)
        _state_noise(folder / RIG_FILE, unstated_noise(imported, actuator), run.name)
    return folder / run.file


def stated_noise(run: Run, actuator: Actuator) -> Noise:
    """What the actuator's file states of the sensors that the run has columns of."""
    position, current = actuator.position_sensor.noise, actuator.current_sensor.noise
    reads_current = any(name in run for name in ("current_1_A", "current_2_A"))
    return Noise(position=position or None, current=(current or None) if reads_current else None)


def unstated_noise(imported: ImportedRun, actuator: Actuator) -> dict[Quantity, float]:
    """What was estimated of instruments whose noise the actuator does not state; inputs of a drive have none."""
    stated = {"position": actuator.position_sensor.noise, "current": actuator.current_sensor.noise}
    driven = {"voltage": "voltage", "current": ""}.get(actuator.drive.kind if actuator.drive else "", "")
    return {name: s for name, s in imported.noise.items() if not stated.get(name) and name != driven}


def _state_noise(rig_file: Path, noise: Mapping[Quantity, float], run: str) -> None:
    """Writes estimates under [noise] of a new rig.toml, each with a remark."""
    lines = []
    for name, sigma in noise.items():
        text = quantity_text(float(f"{sigma:.2g}"), UNITS[name])
        lines.append(f'{name} = "{text}"  # {NOISE_REMARK.format(run=run)}\n')
    text = rig_file.read_text(encoding="utf-8")
    Noise.model_validate({name: float(sigma) for name, sigma in noise.items()})
    with whole_file(rig_file) as partial:
        partial.write_text(text.replace("[noise]\n", "[noise]\n" + "".join(lines), 1), encoding="utf-8")


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
        with staging_folder(target) as partial_folder:
            written = partial_folder / run.file
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
