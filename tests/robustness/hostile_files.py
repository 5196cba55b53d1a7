"""Files made bad: TOML, JSON, CSV and NetCDF from good ones, by a random generator."""

import contextlib
import io
import json
import math
import re
import sqlite3
import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from hostile_values import TEXTS, hostile_value, scaled, spoilt_bytes, spoilt_document

DEPTHS = (60, 450, 900, 5000)
"""Of nesting: what a reader bears and what uses its answer may not, and beyond what any recursive reader bears."""


def toml_of(value: Any) -> str:
    """A TOML value of anything; what TOML cannot say is written as if it could."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, list):
        return "[" + ", ".join(map(toml_of, value)) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {toml_of(v)}" for k, v in value.items()) + "}"
    return json.dumps(value) if isinstance(value, str) else str(value)


def spoilt_toml(rng: np.random.Generator, good: bytes) -> bytes:
    """A TOML file with the good one's structure and bad values, or with bad bytes, or nested beyond reason."""
    action = rng.random()
    if action < 0.72:
        document = spoilt_document(rng, tomllib.loads(good.decode()))
        if not isinstance(document, dict):
            document = {"x": document}
        return "\n".join(f"{json.dumps(str(k))} = {toml_of(v)}" for k, v in document.items()).encode("utf-8", "replace")
    if action < 0.97:
        return spoilt_bytes(rng, good)
    n = DEPTHS[rng.integers(4)]
    if rng.random() < 0.5:
        return good + b"\nx = " + b"[" * n + b"]" * n
    opening = ("a = " + "[" * n, "a = " + "{b=" * n, "[" + "a." * n + "b]", "a." * n + "b = 1")
    return good + b"\n" + opening[rng.integers(4)].encode()


def spoilt_json(rng: np.random.Generator, good: bytes) -> bytes:
    """A JSON file alike."""
    action = rng.random()
    if action < 0.72:
        return json.dumps(spoilt_document(rng, json.loads(good))).encode("utf-8", "replace")
    if action < 0.97:
        return spoilt_bytes(rng, good)
    n = DEPTHS[rng.integers(4)]
    if rng.random() < 0.5:
        at = good.index(b"[")
        return good[:at] + b"[" * n + b"]" * n + good[at:].partition(b"]")[2]
    return (b"[" * n, b'{"a":' * n, b"9" * 20_000, b'"' + b"x" * 100_000)[rng.integers(4)]


def spoilt_csv(rng: np.random.Generator, good: bytes) -> bytes:
    """A CSV file with bad cells, rows or names, or with bad bytes."""
    if rng.random() < 0.3:
        return spoilt_bytes(rng, good)
    rows = [line.split(",") for line in good.decode().splitlines()]
    for _ in range(int(rng.integers(1, 4))):
        action, at = rng.integers(0, 9), int(rng.integers(0, max(len(rows), 1)))
        if not rows:
            break
        column = int(rng.integers(0, max(len(rows[at]), 1)))
        if action <= 3 and rows[at]:
            place = min(column, len(rows[at]) - 1)
            rows[at][place] = _cell(rng) if rng.random() < 0.5 else str(scaled(rng, rows[at][place]))
        elif action == 4 and rows[0]:
            rows[0] = [*rows[0][:-1], rows[0][0]]
        elif action == 5:
            rows = rows[:at]
        elif action == 6:
            rows[at] = rows[at] + rows[at]
        elif action == 7:
            rows = [row[:-1] for row in rows]
        else:
            value = _cell(rng)
            rows = [rows[0], *([*row[:-1], value] for row in rows[1:])]
    return "\n".join(map(",".join, rows)).encode("utf-8", "replace")


def spoilt_text(rng: np.random.Generator, good: bytes) -> bytes:
    """A line of words and quantities with words exchanged for hostile ones."""
    if rng.random() < 0.3:
        return spoilt_bytes(rng, good)
    words = re.split(r"([:,= ])", good.decode())
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(words)))
        words[at] = str(scaled(rng, words[at])) if rng.random() < 0.6 else str(hostile_value(rng))[:10_000]
    return "".join(words).encode("utf-8", "replace")


def spoilt_mat(rng: np.random.Generator, good: bytes) -> bytes:
    """A MATLAB file of version 5 or 7.3 with flipped bits, wrong sizes, or cut."""
    if rng.random() < 0.5:
        return spoilt_bytes(rng, good)
    changed = bytearray(good)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, max(len(changed) // 4 - 1, 1))) * 4  # tags and sizes lie on words
        changed[at : at + 4] = int(
            (0, 1, 2**31, 2**32 - 1, 15, 14, 9, int(rng.integers(2**32)))[rng.integers(8)]
        ).to_bytes(4, "little")
    return bytes(changed)


def spoilt_mesh(rng: np.random.Generator, good: bytes) -> bytes:
    """A gmsh file with odd numbers: coordinates, corners, tags, counts."""
    if rng.random() < 0.3:
        return spoilt_bytes(rng, good)
    lines = good.decode().splitlines()
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(len(lines)))
        words = lines[at].split()
        action = rng.integers(0, 8)
        if action == 0:
            del lines[at]
        elif action == 1:
            lines.insert(at, lines[int(rng.integers(len(lines)))])
        elif words:
            place = int(rng.integers(len(words)))
            words[place] = (
                str(scaled(rng, words[place])), "nan", "inf", "-1", "0", "1", str(2**40), str(int(rng.integers(2000))),
            )[rng.integers(8)]  # fmt: skip
            lines[at] = " ".join(words)
        if not lines:
            break
    return "\n".join(lines).encode() + b"\n"


def spoilt_sqlite(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    """A database with rows removed, values replaced, tables dropped, or bad bytes."""
    if rng.random() < 0.3:
        return spoilt_bytes(rng, good)
    file = scratch / "odd.sqlite3"
    file.write_bytes(good)
    with contextlib.closing(sqlite3.connect(file)) as base:
        tables = [row[0] for row in base.execute("select name from sqlite_master where type = 'table'")]
        for _ in range(int(rng.integers(1, 3))):
            table = tables[rng.integers(len(tables))]
            columns = [row[1] for row in base.execute(f"pragma table_info('{table}')")]
            if not columns:
                continue
            column = columns[rng.integers(len(columns))]
            value = hostile_value(rng, depth=3)
            value = value if isinstance(value, str | float) else str(value)
            where = f"where rowid % {int(rng.integers(1, 4))} = 0"
            change = rng.integers(0, 4)
            with contextlib.suppress(sqlite3.Error, UnicodeError):
                if change == 0:
                    base.execute(f"delete from '{table}' {where}")
                elif change == 1:
                    base.execute(f"drop table '{table}'")
                else:
                    base.execute(f"update '{table}' set '{column}' = ? {where}", (value,))
        base.commit()
    try:
        return file.read_bytes()
    finally:
        for path in scratch.glob("odd.sqlite3*"):
            path.unlink()


def _cell(rng: np.random.Generator) -> str:
    known = ("", "nan", "inf", "-1e999", "1e300", "0", "-1", '"', '"a,b', "1;2", "1 2", "=1+1", "\x00", "\r", "1e-320")
    cells = (*known, "9" * 500, TEXTS[rng.integers(len(TEXTS))], repr(float(rng.normal())))
    return cells[rng.integers(len(cells))]


def spoilt_netcdf(rng: np.random.Generator, good: bytes, scratch: Path) -> bytes:
    """A NetCDF file with bad variables, coordinates and attributes, or with bad bytes."""
    if rng.random() < 0.45:
        return spoilt_bytes(rng, good)
    target, data = scratch / "bad.nc", _data_set(good)
    for _ in range(int(rng.integers(1, 3))):
        data = _spoil_dataset(rng, data)
    try:
        data.to_netcdf(target, engine="h5netcdf")
        return target.read_bytes()
    except Exception:  # a dataset that cannot be written is no file
        return spoilt_bytes(rng, good)
    finally:
        target.unlink(missing_ok=True)


@lru_cache(maxsize=4)
def _data_set(good: bytes) -> xr.Dataset:
    """The data set of a good file, read once for all its bad ones, which change none of its arrays."""
    with xr.open_dataset(io.BytesIO(good), engine="h5netcdf", decode_times=False) as opened:
        return opened.load()


def _spoil_dataset(rng: np.random.Generator, data: xr.Dataset) -> xr.Dataset:
    names = [str(name) for name in data.variables]
    name = names[rng.integers(len(names))] if names else "gap"
    action = rng.integers(0, 10)
    try:
        if action == 0:
            return data.drop_vars(name)
        if action == 1:
            return data.rename({name: str(TEXTS[rng.integers(len(TEXTS))])})
        if action == 2:
            return data.assign_attrs({("provenance", "schema", "mesh_error", "x")[rng.integers(4)]: _attribute(rng)})
        if action == 3:
            return data.isel({str(d): slice(0, int(rng.integers(0, 3))) for d in data.dims if rng.random() < 0.6})
        if action == 4:
            return data.isel({str(d): slice(None, None, -1) for d in data.dims if rng.random() < 0.6})
        values = np.array(data[name].values, copy=True)
        if action == 5:
            return data.assign({name: (data[name].dims, values.astype(str))})
        if action == 6:
            with np.errstate(over="ignore"):
                return data.assign({name: (data[name].dims, values * 10.0 ** float(rng.integers(-320, 309)))})
        if action == 7:
            return data.assign({name: (data[name].dims[::-1], values.T), "extra": ("e", np.arange(3))})
        flat = values.astype(float).ravel()
        for at in rng.integers(0, max(flat.size, 1), rng.integers(1, 4)):
            if flat.size:
                flat[at] = (np.nan, np.inf, -1e300, 0.0, 1e19, -flat[at], 1e-320)[rng.integers(7)]
        return data.assign({name: (data[name].dims, flat.reshape(values.shape), data[name].attrs)})
    except (ValueError, KeyError, TypeError, OverflowError):
        return data


def _attribute(rng: np.random.Generator) -> Any:
    value = hostile_value(rng)
    return value if isinstance(value, str | float) else json.dumps(value)[:1000]
