"""What makes a run or a static map unfit for use: refusals that name file, row and column, and warnings."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.files.quantity import format_quantity
from msl_fem.record.column_file import numbers, place
from msl_fem.record.linear_law import linear_laws
from msl_fem.record.record import Array, Record, Run, Sampling

FEWEST_SAMPLES = 1000
LARGEST_JITTER = 0.01
RATE_TOLERANCE = 1e-3
STUCK_SHARE = 0.01


def sides_of(actuator: Actuator) -> int:
    """Number of sides that have columns of their own: 0 for a rig without magnets."""
    if actuator.sides is not None:
        return actuator.sides.count
    return 0 if actuator.magnet is None else 1


def _drive_kind(actuator: Actuator) -> str | None:
    return actuator.drive.kind if actuator.drive else None


def known_columns(actuator: Actuator) -> list[str]:
    """Names of the columns that a run of this actuator may have, in their usual order."""
    sides = range(1, sides_of(actuator) + 1)
    return [
        "time_s",
        *(f"voltage_{j}_V" for j in sides),
        *(f"current_{j}_A" for j in sides),
        "position_m",
        *(f"command_{j}_A" for j in sides),
        "force_N",
        "reference_m",
        "temperature_K",
        *(f"flux_linkage_{j}_Wb" for j in sides),
    ]


def needed_columns(actuator: Actuator) -> list[tuple[str, ...]]:
    """One tuple of alternatives for each thing that a run must tell: the position and what drives each side."""
    sides = range(1, sides_of(actuator) + 1)
    drive: dict[str | None, list[tuple[str, ...]]] = {
        None: [],
        "current": [(f"current_{j}_A", f"command_{j}_A") for j in sides],
        "voltage": [(f"voltage_{j}_V",) for j in sides],
        "force": [("force_N",)],
    }
    return [("time_s",), ("position_m",), *drive[_drive_kind(actuator)]]


def check_record(record: Record, *, rig_file: Path | str) -> None:
    """RecordError where the parts do not make a record: runs without rate or drive, nothing to fit, a name twice."""
    said = None
    names = [run.name for run in record.runs]
    if record.runs and record.sampling is None:
        said = "sampling: is missing; a rig with runs needs its rate"
    elif record.runs and record.actuator.drive is None:
        said = f"run: the actuator '{record.actuator.name}' has no [drive]; state its kind"
    elif len(set(names)) < len(names):
        said = f"run: the names {', '.join(names)} are not all different; name each run once"
    elif said_of_law := _unfit_law(record):
        said = said_of_law
    elif not record.runs_of("fit") and (record.static is None or not record.static.rows("fit").size):
        said = 'run, static: no run or map has the role "fit"; give one of them role = "fit"'
    if said:
        raise RecordError(f"{rig_file}: {said}")


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
    for alternatives in needed_columns(actuator):
        if not set(alternatives) & set(names):
            raise RecordError(
                f"{file}: row 1: column {' or '.join(alternatives)} is missing; the file has {', '.join(names)}"
            )


def check_run(run: Run, actuator: Actuator, sampling: Sampling, *, file: Path | str) -> None:
    """Refuses a run that cannot be what it says.

    Raises
    ------
    RecordError : a column is missing, a value not finite, fewer than 1000 samples, time that does not increase, a
        jitter above 1 % of the period, a rate more than 0.1 % off the stated one, a position outside the gap
    """
    check_columns(list(run.columns), actuator, file=file)
    for name, values in run.columns.items():
        numbers(values, name, file)
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
    if jitter.max() > LARGEST_JITTER:
        at = int(np.argmax(jitter > LARGEST_JITTER)) + 1
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
    said: list[str] = []
    if run.time.size == 0:  # which `check_run` refuses
        return said
    for name, values in run.columns.items():
        sensor = name == "position_m" or name.startswith(("current_", "flux_linkage_"))
        if not sensor and not (name.startswith("voltage_") and _drive_kind(actuator) != "voltage"):
            continue
        told = run.columns.get(f"command_{name[8:9]}_A") if name.startswith("current_") else None
        start, end = _equal_stretches(values)
        doubtful = _stuck(start, end, told=told) | np.isin(values[start], _clipped_levels(values, told=told))
        if doubtful.any():
            share = (end - start)[doubtful].sum() / values.size
            said.append(
                f"{file}: {name} is stuck or clipped in {share:.2g} of the run, "
                f"samples {_ranges(start[doubtful], end[doubtful])}"
            )
    return said


def _equal_stretches(values: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample and the sample behind the last one of each stretch of equal values."""
    change = np.flatnonzero(np.diff(values)) + 1
    return np.concatenate(([0], change)), np.concatenate((change, [values.size]))


def _stuck(start: NDArray[np.intp], end: NDArray[np.intp], *, told: Array | None) -> NDArray[np.bool_]:
    """Which stretches are too long for a live sensor; not those in which a standing command tells it to stand still."""
    stuck = end - start > STUCK_SHARE * end[-1]
    for k in np.flatnonzero(stuck):
        stuck[k] = told is None or np.ptp(told[start[k] : end[k]]) > 0
    return stuck


def _clipped_levels(values: Array, *, told: Array | None) -> list[float]:
    """The smallest and the largest value, where a sensor spends so much time there that it seems to be clipped."""
    levels, counts = np.unique(values, return_counts=True)
    return [
        levels[edge]
        for edge, beside in ((0, 1), (-1, -2))
        if levels.size > 2
        and counts[edge] > max(STUCK_SHARE * values.size, 5 * counts[beside])
        and (told is None or np.ptp(told[values == levels[edge]]) > 0)
    ]


def _ranges(start: NDArray[np.intp], end: NDArray[np.intp], *, shown: int = 3) -> str:
    texts = [f"{a} ... {b - 1}" if b - a > 1 else f"{a}" for a, b in zip(start[:shown], end[:shown], strict=True)]
    more = f" and {start.size - shown} stretches more up to {end[-1] - 1}" if start.size > shown else ""
    return ", ".join(texts) + more
