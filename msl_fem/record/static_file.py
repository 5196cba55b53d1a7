"""static.csv: a magnet at rest, row after row, and what rig.toml states of how the rows were taken."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.calibration import calibrated, read_curve
from msl_fem.record.columns import Column, numbers, place, read_columns, require_columns
from msl_fem.record.plausibility import refuse_impossible
from msl_fem.record.record import MAP_READINGS, StaticMap, read_only
from msl_fem.record.rig_file import RIG_FILE, STATIC_FILE, RigFile, Role, StaticEntry

SIGMAS = tuple(f"sigma_{name}" for name in MAP_READINGS)
NUMBERS = ("gap_m", "current_A", *MAP_READINGS, *SIGMAS, "sequence")
WORDS = {"direction": ("up", "down"), "role": ("fit", "held-out")}
UNIT = "unit"


def read_static(rig: RigFile, path: Path) -> StaticMap | None:
    """The static map beside a rig.toml; None where there is none.

    Raises
    ------
    RecordError : its role is not stated, or `read_static_map` refuses it
    """
    if rig.static is None and not path.exists():
        return None
    table = read_columns(path)
    if rig.static is None and "role" not in table:
        raise RecordError(f"{path.parent / RIG_FILE}: static: {STATIC_FILE} is there; state its role in [static]")
    entry = rig.static or StaticEntry()
    curves = {column: read_curve(path.parent / file) for column, file in entry.curves.items()}
    table = calibrated(table, curves, file=path)
    static = read_static_map(table, role=entry.role, file=path)
    return replace(static, gap_zero=entry.gap, order=entry.order, before=entry.before, scale=entry.scale)


def read_static_map(table: Mapping[str, Column], *, role: Role | None, file: Path | str) -> StaticMap:
    """The static map made of columns with RECORDS' names, (n_row,) each; a column `role` goes before `role`.

    Raises
    ------
    RecordError : a column is missing, a value not finite, a gap or a sigma below zero, a word that is none of the
        allowed
    """
    require_columns([("gap_m",), ("current_A",), tuple(MAP_READINGS)], list(table), file=file)
    value = {name: read_only(numbers(c, name, file)) for name, c in table.items() if name in NUMBERS}
    words = {name: _words(c, name, file) for name, c in table.items() if name in WORDS}
    refuse_impossible(value, file=file)
    if not value["gap_m"].size:
        raise RecordError(f"{file}: row 2: there are no rows; remove the file or fill it")
    _refuse_below(value, file)
    if "role" not in words and role is None:
        raise RecordError(f"{file}: row 1: column role is missing; add it, or a role to [static] of rig.toml")
    sigma = {name: value[f"sigma_{name}"] for name in MAP_READINGS if name in value and f"sigma_{name}" in value}
    return StaticMap(
        gap=value["gap_m"],
        current=value["current_A"],
        force=value.get("force_N"),
        flux_linkage=value.get("flux_linkage_Wb"),
        flux_density=value.get("flux_density_T"),
        role=words.get("role", np.full(value["gap_m"].size, role)),
        direction=words.get("direction"),
        sequence=value.get("sequence"),
        unit=_units(table[UNIT], file) if UNIT in table else None,
        sigma=sigma,
        extra={name: c for name, c in table.items() if name not in (*NUMBERS, *WORDS, UNIT)},
    )


def _refuse_below(value: Mapping[str, Array], file: Path | str) -> None:
    """RecordError for a gap below zero, or a sigma that is not above it."""
    for name, values in value.items():
        if name == "gap_m" and values.min() < 0:
            at = int(np.argmax(values < 0))
            raise RecordError(f"{place(file, at)}, column {name}: {values[at]:g} m is below zero; a gap is positive")
        if name in SIGMAS and values.min() <= 0:
            at = int(np.argmax(values <= 0))
            raise RecordError(
                f"{place(file, at)}, column {name}: {values[at]:g} is not above 0; a sigma is positive; leave out the "
                "row, or state the noise in [noise]"
            )


def _units(column: Column, file: Path | str) -> NDArray[np.str_]:
    """Names of the magnets of the rows; whole numbers as such."""
    names = [f"{cell:g}" if column.dtype.kind == "f" else str(cell).strip() for cell in column.tolist()]
    if not all(names) or "nan" in names:
        at = next(k for k, name in enumerate(names) if not name or name == "nan")
        raise RecordError(f"{place(file, at)}, column {UNIT}: the name of the magnet is missing; name each row's")
    return np.array(names, dtype=str)


def _words(column: Column, name: str, file: Path | str) -> NDArray[np.str_]:
    words = np.array([str(cell).strip() for cell in column], dtype=str)
    bad = np.flatnonzero(~np.isin(words, WORDS[name]))
    if bad.size:
        at = int(bad[0])
        raise RecordError(f"{place(file, at)}, column {name}: '{words[at]}' is none of {', '.join(WORDS[name])}")
    return words
