"""Records from data frames, as a notebook has them: columns by the record's names, or a log's own to be imported."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.record.clipping import doubtful_sensors
from msl_fem.record.clock import evened
from msl_fem.record.columns import numbers
from msl_fem.record.reader import (
    check_columns,
    check_record,
    check_run,
    doubtful_against_command,
    driving_columns,
    known_columns,
)
from msl_fem.record.record import Record, Run, StaticMap
from msl_fem.record.rig_file import GapZero, Mover, Noise, Origin, Role, Sampling, Tolerance
from msl_fem.record.static_file import read_static_map
from msl_fem.record.validity import VALID, mask_of, masked, valid_stretches

if TYPE_CHECKING:
    import pandas as pd

NOTEBOOK = "data frame"
TIME = "time_s"


@dataclass(frozen=True)
class FrameLabels:
    """What frames do not say of themselves.

    Attributes
    ----------
    origin : "measured" or "simulated"
    held_out : names of the runs that no fit may see
    excitation : by run, in words
    mover : of runs in which it is not free, by run: "locked" or "imposed"
    noise, tolerance : one sigma of the instruments, and of what is believed
    static_role : of the rows of a static map without a column `role`
    static_gap : whose gaps a static map has, of a "gauge" with a zero of its own, or of the "mover"
    """

    origin: Origin = "measured"
    held_out: Collection[str] = ()
    excitation: Mapping[str, str] = field(default_factory=dict)
    mover: Mapping[str, Mover] = field(default_factory=dict)
    noise: Noise = field(default_factory=Noise)
    tolerance: Tolerance = field(default_factory=Tolerance)
    static_role: Role = "fit"
    static_gap: GapZero = "gauge"


def record_from_frames(
    actuator: Actuator,
    runs: "Mapping[str, pd.DataFrame] | None" = None,
    *,
    static: "pd.DataFrame | None" = None,
    labels: FrameLabels | None = None,
) -> Record:
    """The record of runs by name and of a static map, checked as `load_record` checks a folder.

    Columns have the names and SI units of a record's files (`position_m`, `current_1_A`); the time is the column
    `time_s` or the index of that name, in equal steps.

    Raises
    ------
    RecordError : a column is missing or no number, the time is not even, runs of different rates, a name in `labels`
        that is no run, or anything else that `load_record` would refuse
    """
    labels = labels or FrameLabels()
    runs = runs or {}
    for name in (*labels.held_out, *labels.excitation, *labels.mover):
        if name not in runs:
            raise RecordError(f"no run '{name}' among the frames; there are {', '.join(runs) or 'none'}")
    made = tuple(_run(name, frame, actuator, labels) for name, frame in runs.items())
    record = Record(
        origin=labels.origin,
        actuator=actuator,
        sampling=_sampling(made),
        noise=labels.noise,
        tolerance=labels.tolerance,
        runs=made,
        static=None if static is None else _static(static, labels),
        warnings=_doubts(made, actuator),
    )
    check_record(record, rig_file=NOTEBOOK)
    for run in made:
        assert record.sampling is not None
        check_run(run, actuator, record.sampling, file=run.name)
    return record


def _static(frame: "pd.DataFrame", labels: FrameLabels) -> StaticMap:
    rows = read_static_map(_columns(frame), role=labels.static_role, file=NOTEBOOK)
    return replace(rows, gap_zero=labels.static_gap)


def _run(name: str, frame: "pd.DataFrame", actuator: Actuator, labels: FrameLabels) -> Run:
    given = _columns(frame)
    check_columns([column for column in given if not mask_of(column)], actuator, file=name)
    if valid_stretches(given, file=name) is not None:
        raise RecordError(f"run {name}: rows are not {VALID}; give the frames between them, each as a run")
    given, valid = masked(given, driving_columns(actuator, given), file=name)
    known = known_columns(actuator)
    columns = {column: numbers(given[column], column, name) for column in known if column in given}
    columns[TIME] = evened(columns[TIME])[0]
    return Run(
        name=name,
        excitation=labels.excitation.get(name, "as logged"),
        role="held-out" if name in labels.held_out else "fit",
        columns=columns,
        extra={column: values for column, values in given.items() if column not in known},
        valid={column: flags for column, flags in valid.items() if column in known},
        mover=labels.mover.get(name, "free"),
    )


def _columns(frame: "pd.DataFrame") -> dict[str, NDArray[Any]]:
    """The columns by name, an index that has a name among them."""
    whole = frame.reset_index() if frame.index.name is not None else frame
    return {str(name): np.asarray(whole[name]) for name in whole.columns}


def _sampling(runs: tuple[Run, ...]) -> Sampling | None:
    """The rate of all runs; None where there are none."""
    if not runs:
        return None
    for run in runs:
        if run.time.size < 2 or not run.time[-1] > run.time[0]:
            raise RecordError(f"run {run.name}: the time does not increase; look at time_s")
    return Sampling(rate=float(f"{1 / runs[0].sampling_period:.6g}"))


def _doubts(runs: tuple[Run, ...], actuator: Actuator) -> tuple[str, ...]:
    return tuple(
        doubt
        for run in runs
        for doubt in (
            *doubtful_sensors(run, actuator, file=run.name),
            *doubtful_against_command(run, file=run.name),
        )
    )


def frame_signals(frame: "pd.DataFrame") -> dict[str, NDArray[np.float64]]:
    """The signals of a frame as `read_log` gives them of a file: columns of numbers, and a named index.

    Raises
    ------
    RecordError : there is no column of numbers
    """
    kinds = "fiub"
    signals = {name: np.asarray(v, dtype=float) for name, v in _columns(frame).items() if v.dtype.kind in kinds}
    if not signals:
        raise RecordError(f"the {NOTEBOOK} holds no columns of numbers; it has {', '.join(map(str, frame.columns))}")
    return signals
