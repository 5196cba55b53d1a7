"""A record from its folder, and what makes a run or a static map unfit for use: refusals that name file, row and
column, and warnings."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.files.quantity import format_quantity
from msl_fem.record.calibration import CalibrationCurve, read_curve, with_position
from msl_fem.record.clipping import doubtful_sensors
from msl_fem.record.clock import LARGEST_JITTER, evened
from msl_fem.record.columns import (
    FIRST_ROW,
    Column,
    numbers,
    place,
    read_columns,
    require_columns,
    side_columns,
)
from msl_fem.record.duty import with_voltages
from msl_fem.record.linear_law import linear_laws
from msl_fem.record.plausibility import (
    doubtful_against_command,
    doubtful_channels,
    doubtful_map,
    refuse_impossible,
)
from msl_fem.record.record import Record, Run, StaticMap
from msl_fem.record.rig_file import RIG_FILE, STATIC_FILE, Mover, RigFile, RunEntry, Sampling, read_rig, rig_actuator
from msl_fem.record.static_file import read_static
from msl_fem.record.validity import VALID, mask_of, masked, valid_stretches

FEWEST_SAMPLES = 200
"""Of a run; whether all of them together tell enough is what a diagnosis asks."""

RATE_TOLERANCE = 1e-3


def load_record(folder: str | Path) -> Record:
    """The record that a folder holds.

    Raises
    ------
    RecordError : the folder is no record, or its data cannot be what they say; names file, row and column
    ActuatorError : the actuator file that rig.toml names is none
    """
    folder = Path(folder)
    rig = read_rig(folder)
    actuator = rig_actuator(rig, folder)
    supply = None if rig.supply is None else rig.supply.voltage
    curve = None if rig.position_sensor_curve is None else read_curve(folder / rig.position_sensor_curve)
    read = [_read_runs(entry, actuator, folder, supply=supply, curve=curve) for entry in rig.run]
    runs = tuple(run for one in read for run in one.runs)
    static = read_static(rig, folder / STATIC_FILE)
    record = Record(
        origin=rig.origin,
        actuator=actuator,
        sampling=rig.sampling,
        noise=rig.noise,
        tolerance=rig.tolerance,
        belief=rig.belief,
        controller=_of_parts(rig.controller, read),
        runs=runs,
        static=static,
        causes=rig.causes(folder),
        scheduling=rig.scheduling,
        warnings=(
            *(told for one in read for told in one.told),
            *_warnings(runs, static, actuator, measured=rig.origin == "measured", named=_named(rig)),
        ),
        folder=folder,
    )
    check_record(record, rig_file=folder / RIG_FILE)
    for one in read:
        for run, where in zip(one.runs, one.where, strict=True):
            assert rig.sampling is not None  # check_record saw to it
            check_run(run, actuator, rig.sampling, file=where)
    return record


class _Read(NamedTuple):
    """The runs that a file holds: one, or the stretches between rows that are not valid; where each begins, for
    messages, and what has to be told."""

    name: str
    runs: tuple[Run, ...]
    where: tuple[Path | str, ...]
    told: tuple[str, ...] = ()


def _read_runs(
    entry: RunEntry, actuator: Actuator, folder: Path, *, supply: float | None, curve: CalibrationCurve | None
) -> _Read:
    path = folder / entry.file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RecordError(f"{path}: the file lies outside the record's folder; copy it there")
    table = _with_levels(with_position(read_columns(path), curve, file=path), entry, file=path)
    name = entry.file.removesuffix(path.suffix)
    stretches = valid_stretches(table, file=path)
    if stretches is None:
        return _Read(name, (_run_of(table, name, entry, actuator, file=path, supply=supply),), (path,))
    long = [part for part in stretches if part.stop - part.start >= FEWEST_SAMPLES]
    if not long:
        raise RecordError(
            f"{path}: row 1: column {VALID} leaves no stretch of {FEWEST_SAMPLES} samples, which a run needs; "
            "record longer"
        )
    names = [name] if len(long) == 1 else [f"{name}_{n + 1}" for n in range(len(long))]
    where = [f"{path} from {place('', part.start + FIRST_ROW[path.suffix]).removeprefix(': ')}" for part in long]
    runs = []
    for part, own, at in zip(long, names, where, strict=True):
        rows = {column: values[part] for column, values in table.items()}
        runs.append(_run_of(rows, own, entry, actuator, file=at, supply=supply))
    return _Read(name, tuple(runs), tuple(where), (_cut(path, table, stretches, long, names),))


def _with_levels(table: dict[str, Column], entry: RunEntry, *, file: Path) -> dict[str, Column]:
    """The columns with those that the run's entry states by their one value."""
    count = len(next(iter(table.values()), ()))
    for name, value in entry.levels.items():
        if name in table:
            raise RecordError(f"{file}: row 1: column {name} is there, and rig.toml states levels.{name}; remove one")
        table = table | {name: np.full(count, value)}
    return table


def _named(rig: RigFile) -> set[str]:
    """Columns that are no part of the format by themselves, and that rig.toml says how to take."""
    return {one.column for one in rig.scheduling}


def _cut(path: Path, table: Mapping[str, Column], stretches: list[slice], long: list[slice], names: list[str]) -> str:
    """What rows that are not valid leave of a run, in words."""
    count = len(next(iter(table.values())))
    lost = count - sum(part.stop - part.start for part in stretches)
    told = f"{path.name}: {lost} of {count} samples are not {VALID}; taken as {', '.join(names)}"
    short = len(stretches) - len(long)
    return told + (f"; {short} stretches of fewer than {FEWEST_SAMPLES} samples are left out" if short else "")


def _run_of(
    table: Mapping[str, Column], name: str, entry: RunEntry, actuator: Actuator, *, file: Path | str,
    supply: float | None,
) -> Run:  # fmt: skip
    """The run of a file's rows."""
    given = with_voltages(table, supply, file=file)
    check_columns([column for column in given if not mask_of(column)], actuator, file=file, mover=entry.mover)
    given, valid = masked(given, driving_columns(actuator, given), file=file)
    known = known_columns(actuator)
    columns = {column: numbers(given[column], column, file) for column in known if column in given}
    columns["time_s"] = evened(columns["time_s"])[0]
    return Run(
        name=name,
        excitation=entry.excitation,
        role=entry.role,
        columns=columns,
        extra={column: values for column, values in given.items() if column not in known},
        file_format="nc" if entry.file.endswith(".nc") else "csv",
        valid={column: flags for column, flags in valid.items() if column in known},
        mover=entry.mover,
    )


def _of_parts(controller: Mapping[str, Any] | None, read: Sequence[_Read]) -> Mapping[str, Any] | None:
    """What is stated of the controller, where it names runs that were cut their parts instead."""
    parts = {one.name: [run.name for run in one.runs] for one in read}
    laws = (controller or {}).get("linear")
    if controller is None or not isinstance(laws, list) or all(len(names) == 1 for names in parts.values()):
        return controller
    made = []
    for law in laws:
        named = law.get("runs") if isinstance(law, dict) else None
        every = [part for name in named for part in parts.get(name, [name])] if isinstance(named, list) else named
        made.append(law if every is None else {**law, "runs": every})
    return {**controller, "linear": made}


def _warnings(
    runs: tuple[Run, ...], static: StaticMap | None, actuator: Actuator, *, measured: bool, named: Collection[str]
) -> tuple[str, ...]:
    """What is odd about the data without being refused."""
    warnings: list[str] = []
    for run in runs:
        warnings += doubtful_sensors(run, actuator, file=run.file)
        warnings += doubtful_against_command(run, file=run.file)
        if measured:  # a simulated sensor may be without noise
            warnings += doubtful_channels(run, actuator, file=run.file)
    if measured and static is not None:
        warnings += doubtful_map(static, file=STATIC_FILE)
    extras = {run.file: [name for name in run.extra if name not in named] for run in runs}
    if static is not None:
        extras[STATIC_FILE] = list(static.extra)
    for file, extra in extras.items():
        if extra:
            warnings.append(f"{file}: column {', '.join(extra)} is not part of the format; kept, not used")
    return tuple(warnings)


def sides_of(actuator: Actuator) -> int:
    """Number of sides that have columns of their own: 0 for a rig without magnets."""
    if actuator.sides is not None:
        return actuator.sides.count
    return 0 if actuator.magnet is None else 1


def _drive_kind(actuator: Actuator) -> str | None:
    return actuator.drive.kind if actuator.drive else None


def known_columns(actuator: Actuator) -> list[str]:
    """Names of the columns that a run of this actuator may have, in their usual order."""
    sides = sides_of(actuator)
    return [
        "time_s",
        *side_columns("voltage", sides),
        *side_columns("current", sides),
        "position_m",
        "velocity_m_per_s",
        *side_columns("command", sides),
        "force_N",
        "reference_m",
        "injection_m",
        "temperature_K",
        *side_columns("flux_linkage", sides),
    ]


def driving_columns(actuator: Actuator, names: Collection[str]) -> list[str]:
    """The columns of a run that drive the plant: in current drive the commands where all of them are there."""
    driving = [
        alternatives for alternatives in needed_columns(actuator) if alternatives[0] not in ("time_s", "position_m")
    ]
    commanded = [alternatives[-1] for alternatives in driving]
    return commanded if all(name in names for name in commanded) else [alternatives[0] for alternatives in driving]


def needed_columns(actuator: Actuator, mover: Mover = "free") -> list[tuple[str, ...]]:
    """One tuple of alternatives for each thing that a run must tell: the position and what drives each side; without a
    mover no position, of a magnet that is moved its current and the force that moves it."""
    if mover == "imposed" and _drive_kind(actuator) != "force":
        return [("time_s",), ("position_m",), ("current_1_A",), ("force_N",)]
    sides = sides_of(actuator)
    drive: dict[str | None, list[tuple[str, ...]]] = {
        None: [],
        "current": list(zip(side_columns("current", sides), side_columns("command", sides), strict=True)),
        "voltage": [(column,) for column in side_columns("voltage", sides)],
        "force": [("force_N",)],
    }
    place = [] if mover == "absent" else [("position_m",)]
    return [("time_s",), *place, *drive[_drive_kind(actuator)]]


def check_record(record: Record, *, rig_file: Path | str) -> None:
    """RecordError where the parts do not make a record: runs without rate or drive, nothing to fit, a name twice."""
    complaint = _unfit_record(record)
    if complaint:
        raise RecordError(f"{rig_file}: {complaint}")


def _unfit_record(record: Record) -> str:
    """What is wrong with a record as a whole, or an empty text."""
    names = [run.name for run in record.runs]
    if record.runs and record.sampling is None:
        return "sampling: is missing; a rig with runs needs its rate"
    if record.runs and record.actuator.drive is None:
        return f"run: the actuator '{record.actuator.name}' has no [drive]; state its kind"
    if len(set(names)) < len(names):
        return f"run: the names {', '.join(names)} are not all different; name each run once"
    complaint = _unfit_movers(record) or _unfit_law(record)
    if complaint:
        return complaint
    if not record.runs_of("fit") and (record.static is None or not record.static.rows("fit").size):
        return 'run, static: no run or map has the role "fit"; give one of them role = "fit"'
    return ""


def _unfit_movers(record: Record) -> str:
    """Why runs tell nothing with the mover as they state it, or an empty text."""
    driven = _drive_kind(record.actuator) == "force"
    for run in record.runs:
        if run.mover == "locked" and driven:
            return f"run: {run.name}: a rig without magnets tells nothing while its mover is locked; leave the run out"
        if run.mover == "absent" and (driven or "current_1_A" not in run):
            return f"run: {run.name}: without its mover a magnet tells its resistance by its voltage and current"
        if run.mover == "imposed" and not driven and sides_of(record.actuator) != 1:
            return (
                f'run: {run.name}: mover = "imposed" is of a magnet on one side; of two, whose forces one '
                f"machine cannot tell apart, write force and flux linkage of each into {STATIC_FILE}"
            )
    if record.runs and record.static is None and all(run.mover == "absent" for run in record.runs):
        return "run: the mover is absent in all runs, so nothing moves; add a run with it, or a static map"
    movers = {run.mover for run in record.runs}
    if (
        driven
        and len(movers) > 1
        and "imposed" in movers
        and record.actuator.motion
        and record.actuator.motion.stiffness
    ):
        return "run: a mover on a spring is free in some runs and moved by a machine in others; make a record of each"
    return ""


def _unfit_law(record: Record) -> str:
    """What is wrong with the laws of `[[controller.linear]]`, or an empty text."""
    try:
        laws = linear_laws(record.controller)
    except RecordError as err:
        return str(err)
    names = [run.name for run in record.runs]
    for n, law in enumerate(laws):
        for name in law.runs:
            if name not in names:
                return f"controller.linear.{n}.runs: no run '{name}' in the record; it has {', '.join(names)}"
        for name in (*law.inputs, *law.outputs):
            for run in record.runs:
                if name not in run and run.name in (law.runs or (run.name,)):
                    return f"controller.linear.{n}: run {run.name} has no column {name}, which the law reads or makes"
    return ""


def check_columns(names: list[str], actuator: Actuator, *, file: Path | str, mover: Mover = "free") -> None:
    """RecordError where a column is missing that the drive does not make redundant."""
    require_columns(needed_columns(actuator, mover), names, file=file)


def check_run(run: Run, actuator: Actuator, sampling: Sampling, *, file: Path | str) -> None:
    """Refuses a run that cannot be what it says.

    Raises
    ------
    RecordError : a column is missing, a value not finite, fewer than 200 samples, time that does not increase, a
        jitter above 1 % of the period, a rate more than 0.1 % off the stated one, a position outside the gap, a
        value that no machine shows
    """
    check_columns(list(run.columns), actuator, file=file, mover=run.mover)
    for name, values in run.columns.items():
        numbers(values, name, file)
    refuse_impossible(run.columns, file=file)
    if run.time.size < FEWEST_SAMPLES:
        raise RecordError(
            f"{file}: column time_s: the run has {run.time.size} samples, at least {FEWEST_SAMPLES} are needed; "
            "record longer"
        )
    _check_time(run, sampling, file)
    _check_position(run, actuator, file)


def _check_time(run: Run, sampling: Sampling, file: Path | str) -> None:
    step = np.diff(run.time)
    if step.min() <= 0:
        at = int(np.argmax(step <= 0)) + 1
        raise RecordError(
            f"{place(file, at)}, column time_s: time does not increase "
            f"({run.time[at]:.12g} s after {run.time[at - 1]:.12g} s); sort the rows or cut the run there"
        )
    period = float(np.median(step))
    jitter = np.abs(step / period - 1)
    allowed = LARGEST_JITTER * (1 + 1e-9)  # 10.1 ms at 10 ms are 0.01 and a rounding error
    if jitter.max() > allowed:
        at = int(np.argmax(jitter > allowed)) + 1
        raise RecordError(
            f"{place(file, at)}, column time_s: a step of {format_quantity(step[at - 1], 's')} is "
            f"{jitter[at - 1]:.2g} of the sampling period {format_quantity(period, 's')} off it, at most "
            f"{LARGEST_JITTER:g} is allowed; resample the run, cut it there, or write the time with more digits"
        )
    rate = 1 / run.sampling_period
    if abs(rate / sampling.rate - 1) > RATE_TOLERANCE:
        raise RecordError(
            f"{place(file, 0)}, column time_s: the steps are {rate:.7g} Hz, rig.toml states sampling.rate "
            f"{sampling.rate:.7g} Hz, at most {RATE_TOLERANCE:.1%} apart are allowed; correct one of them"
        )


def _check_position(run: Run, actuator: Actuator, file: Path | str) -> None:
    gap = actuator.motion.nominal_gap if actuator.motion else None
    if gap is None or "position_m" not in run:
        return
    x = run["position_m"]
    lowest = -gap if sides_of(actuator) == 2 else -np.inf
    outside = (x > gap) | (x < lowest)
    if outside.any():
        at = int(np.argmax(outside))
        allowed = f"{-gap * 1e3:.6g} ... {gap * 1e3:.6g} mm" if lowest == -gap else f"up to {gap * 1e3:.6g} mm"
        raise RecordError(
            f"{place(file, at)}, column position_m: {x[at] * 1e3:.6g} mm lies outside the mechanical gap, {allowed}; "
            "correct the zero or the unit of the position, or motion.nominal_gap"
        )
