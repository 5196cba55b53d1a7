"""A record from its folder, and what makes a run or a static map unfit for use: refusals that name file, row and
column, and warnings."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.quantity import format_quantity
from msl_fem.record.clock import LARGEST_JITTER, evened
from msl_fem.record.columns import CHANNELS, Channel, numbers, place, read_columns, require_columns, side_columns
from msl_fem.record.duty import with_voltages
from msl_fem.record.linear_law import linear_laws
from msl_fem.record.plausibility import (
    doubtful_against_command,
    doubtful_channels,
    doubtful_map,
    refuse_impossible,
)
from msl_fem.record.record import Record, Run, StaticMap
from msl_fem.record.rig_file import RIG_FILE, STATIC_FILE, RunEntry, Sampling, read_rig, rig_actuator
from msl_fem.record.static_file import read_static

FEWEST_SAMPLES = 200
"""Of a run; whether all of them together tell enough is what a diagnosis asks."""

RATE_TOLERANCE = 1e-3
STUCK_SHARE = 0.01


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
    runs = tuple(_read_run(entry, actuator, folder, supply=supply) for entry in rig.run)
    static = read_static(rig, folder / STATIC_FILE)
    record = Record(
        origin=rig.origin,
        actuator=actuator,
        sampling=rig.sampling,
        noise=rig.noise,
        tolerance=rig.tolerance,
        belief=rig.belief,
        controller=rig.controller,
        runs=runs,
        static=static,
        causes=rig.causes(folder),
        warnings=_warnings(runs, static, actuator, measured=rig.origin == "measured"),
        folder=folder,
    )
    check_record(record, rig_file=folder / RIG_FILE)
    for run in runs:
        assert rig.sampling is not None  # check_record saw to it
        check_run(run, actuator, rig.sampling, file=folder / run.file)
    return record


def _read_run(entry: RunEntry, actuator: Actuator, folder: Path, *, supply: float | None) -> Run:
    path = folder / entry.file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RecordError(f"{path}: the file lies outside the record's folder; copy it there")
    table = with_voltages(read_columns(path), supply, file=path)
    check_columns(list(table), actuator, file=path)
    known = known_columns(actuator)
    columns = {name: numbers(table[name], name, path) for name in known if name in table}
    columns["time_s"] = evened(columns["time_s"])[0]
    return Run(
        name=entry.file.removesuffix(path.suffix),
        excitation=entry.excitation,
        role=entry.role,
        columns=columns,
        extra={name: column for name, column in table.items() if name not in known},
        file_format="nc" if path.suffix == ".nc" else "csv",
    )


def _warnings(
    runs: tuple[Run, ...], static: StaticMap | None, actuator: Actuator, *, measured: bool
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
    extras = {run.file: run.extra for run in runs}
    if static is not None:
        extras[STATIC_FILE] = static.extra
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
        *side_columns("command", sides),
        "force_N",
        "reference_m",
        "injection_m",
        "temperature_K",
        *side_columns("flux_linkage", sides),
    ]


def needed_columns(actuator: Actuator) -> list[tuple[str, ...]]:
    """One tuple of alternatives for each thing that a run must tell: the position and what drives each side."""
    sides = sides_of(actuator)
    drive: dict[str | None, list[tuple[str, ...]]] = {
        None: [],
        "current": list(zip(side_columns("current", sides), side_columns("command", sides), strict=True)),
        "voltage": [(column,) for column in side_columns("voltage", sides)],
        "force": [("force_N",)],
    }
    return [("time_s",), ("position_m",), *drive[_drive_kind(actuator)]]


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
    complaint = _unfit_law(record)
    if complaint:
        return complaint
    if not record.runs_of("fit") and (record.static is None or not record.static.rows("fit").size):
        return 'run, static: no run or map has the role "fit"; give one of them role = "fit"'
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


def check_columns(names: list[str], actuator: Actuator, *, file: Path | str) -> None:
    """RecordError where a column is missing that the drive does not make redundant."""
    require_columns(needed_columns(actuator), names, file=file)


def check_run(run: Run, actuator: Actuator, sampling: Sampling, *, file: Path | str) -> None:
    """Refuses a run that cannot be what it says.

    Raises
    ------
    RecordError : a column is missing, a value not finite, fewer than 200 samples, time that does not increase, a
        jitter above 1 % of the period, a rate more than 0.1 % off the stated one, a position outside the gap, a
        value that no machine shows
    """
    check_columns(list(run.columns), actuator, file=file)
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
    if gap is None:
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


def doubtful_sensors(run: Run, actuator: Actuator, *, file: Path | str) -> list[str]:
    """One warning for each sensor that is stuck or clipped for more than 1 % of the run, with the samples.

    Stuck is one stretch of equal values that long; clipped is that many samples at the largest or the smallest value,
    five times as many as at the value next to it (the crest of a quantised sine has 2.4 times as many).
    """
    warnings: list[str] = []
    if run.time.size == 0:  # which `check_run` refuses
        return warnings
    sensors = {"position", "current", "flux_linkage"}
    if _drive_kind(actuator) != "voltage":
        sensors.add("voltage")
    for name, values in run.columns.items():
        channel = CHANNELS.get(name)
        if channel is None or channel.quantity not in sensors:
            continue
        command = None
        if channel.quantity == "current":
            command = run.columns.get(Channel("command", channel.side).column)
        start, end = _equal_stretches(values)
        clipped = np.isin(values[start], _clipped_levels(values, command=command))
        doubtful = _stuck(start, end, command=command) | clipped
        if doubtful.any():
            share = (end - start)[doubtful].sum() / values.size
            warnings.append(
                f"{file}: {name} is stuck or clipped in {share:.2g} of the run, "
                f"samples {_ranges(start[doubtful], end[doubtful])}"
            )
    return warnings


def _equal_stretches(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample and the sample behind the last one of each stretch of equal values."""
    change = np.flatnonzero(np.diff(values)) + 1
    return np.concatenate(([0], change)), np.concatenate((change, [values.size]))


def _stuck(start: NDArray[np.intp], end: NDArray[np.intp], *, command: Array | None) -> NDArray[np.bool_]:
    """Which stretches are too long for a live sensor; not those in which a standing command tells it to stand still."""
    stuck = end - start > STUCK_SHARE * end[-1]
    for k in np.flatnonzero(stuck):
        stuck[k] = command is None or np.ptp(command[start[k] : end[k]]) > 0
    return stuck


def _clipped_levels(values: Array, *, command: Array | None) -> list[float]:
    """The smallest and the largest value, where a sensor spends so much time there that it seems to be clipped."""
    levels, counts = np.unique(values, return_counts=True)
    if levels.size <= 2:
        return []
    clipped = []
    for edge, beside in ((0, 1), (-1, -2)):
        often = counts[edge] > max(STUCK_SHARE * values.size, 5 * counts[beside])
        if often and (command is None or np.ptp(command[values == levels[edge]]) > 0):
            clipped.append(float(levels[edge]))
    return clipped


def _ranges(start: NDArray[np.intp], end: NDArray[np.intp], *, shown: int = 3) -> str:
    texts = []
    for first, behind in zip(start[:shown], end[:shown], strict=True):
        texts.append(f"{first} ... {behind - 1}" if behind - first > 1 else f"{first}")
    text = ", ".join(texts)
    if start.size > shown:
        text += f" and {start.size - shown} stretches more up to {end[-1] - 1}"
    return text
