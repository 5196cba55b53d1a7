"""A record from its folder: rig.toml, the actuator, static.csv and a file for each run."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import RecordError
from msl_fem.record.checks import check_columns, check_record, check_run, doubtful_sensors, known_columns
from msl_fem.record.column_file import Column, numbers, place, read_columns
from msl_fem.record.record import Record, Role, Run, StaticMap, read_only
from msl_fem.record.rig_file import RIG_FILE, STATIC_FILE, RigFile, RunEntry, read_rig, rig_actuator

STATIC_NUMBERS = ("gap_m", "current_A", "force_N", "flux_linkage_Wb", "sequence")
STATIC_WORDS = {"direction": ("up", "down"), "role": ("fit", "held-out")}


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
    runs = tuple(_read_run(entry, actuator, folder) for entry in rig.run)
    static = _read_static(rig, folder / STATIC_FILE)
    record = Record(
        origin=rig.origin, actuator=actuator, sampling=rig.sampling, noise=rig.noise, tolerance=rig.tolerance,
        controller=rig.controller, runs=runs, static=static, warnings=_warnings(runs, static, actuator), folder=folder,
    )  # fmt: skip
    check_record(record, rig_file=folder / RIG_FILE)
    for run in runs:
        assert rig.sampling is not None  # check_record saw to it
        check_run(run, actuator, rig.sampling, file=folder / run.file)
    return record


def _read_run(entry: RunEntry, actuator: Actuator, folder: Path) -> Run:
    path = folder / entry.file
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RecordError(f"{path}: the file lies outside the record's folder; copy it there")
    table = read_columns(path)
    check_columns(list(table), actuator, file=path)
    known = known_columns(actuator)
    return Run(
        name=entry.file.removesuffix(path.suffix),
        excitation=entry.excitation,
        role=entry.role,
        columns={name: numbers(table[name], name, path) for name in known if name in table},
        extra={name: column for name, column in table.items() if name not in known},
        file_format="nc" if path.suffix == ".nc" else "csv",
    )


def _read_static(rig: RigFile, path: Path) -> StaticMap | None:
    if rig.static is None and not path.exists():
        return None
    table = read_columns(path)
    if rig.static is None and "role" not in table:
        raise RecordError(f"{path.parent / RIG_FILE}: static: {STATIC_FILE} is there; state its role in [static]")
    return read_static_map(table, role=rig.static.role if rig.static else None, file=path)


def _warnings(runs: tuple[Run, ...], static: StaticMap | None, actuator: Actuator) -> tuple[str, ...]:
    """What is odd about the data without being refused."""
    said = [text for run in runs for text in doubtful_sensors(run, actuator, file=run.file)]
    extras = [(run.file, run.extra) for run in runs] + ([(STATIC_FILE, static.extra)] if static else [])
    for file, extra in extras:
        if extra:
            said.append(f"{file}: column {', '.join(extra)} is not part of the format; kept, not used")
    return tuple(said)


def read_static_map(table: Mapping[str, Column], *, role: Role | None, file: Path | str) -> StaticMap:
    """The static map made of columns with RECORDS' names, (n_row,) each; a column `role` goes before `role`.

    Raises
    ------
    RecordError : a column is missing, a value not finite, a gap below zero, a word that is none of the allowed
    """
    for alternatives in (("gap_m",), ("current_A",), ("force_N", "flux_linkage_Wb")):
        if not set(alternatives) & set(table):
            raise RecordError(
                f"{file}: row 1: column {' or '.join(alternatives)} is missing; the file has {', '.join(table)}"
            )
    value = {name: read_only(numbers(table[name], name, file)) for name in STATIC_NUMBERS if name in table}
    words = {name: _words(table[name], name, file) for name in STATIC_WORDS if name in table}
    gap = value["gap_m"]
    if not gap.size:
        raise RecordError(f"{file}: row 2: there are no rows; remove the file or fill it")
    if gap.min() < 0:
        at = int(np.argmax(gap < 0))
        raise RecordError(f"{place(file, at)}, column gap_m: {gap[at]:g} m is below zero; a gap is positive")
    if "role" not in words and role is None:
        raise RecordError(f"{file}: row 1: column role is missing; add it, or a role to [static] of rig.toml")
    return StaticMap(
        gap=gap,
        current=value["current_A"],
        force=value.get("force_N"),
        flux_linkage=value.get("flux_linkage_Wb"),
        role=words.get("role", np.full(gap.size, role)),
        direction=words.get("direction"),
        sequence=value.get("sequence"),
        extra={name: c for name, c in table.items() if name not in (*STATIC_NUMBERS, *STATIC_WORDS)},
    )


def _words(column: Column, name: str, file: Path | str) -> NDArray[np.str_]:
    words = np.array([str(cell).strip() for cell in column], dtype=str)
    bad = np.flatnonzero(~np.isin(words, STATIC_WORDS[name]))
    if bad.size:
        at = int(bad[0])
        raise RecordError(f"{place(file, at)}, column {name}: '{words[at]}' is none of {', '.join(STATIC_WORDS[name])}")
    return words
