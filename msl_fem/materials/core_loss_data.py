"""Loss data of electrical steels: measured points, the coefficients fitted to them, and which iron they belong to."""

import copy
import csv
import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import MaterialError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import small_text
from msl_fem.materials.material import LIBRARY

INDEX = LIBRARY / "core_loss.json"
COLUMNS = ("frequency_Hz", "B_T", "loss_W_per_kg")
SAME_THICKNESS = 0.03  # relative: a gauge's 0.014 inch is sold as 0.35 and 0.36 mm
THINNEST, THICKEST = 1e-5, 5e-2  # m


@dataclass(frozen=True, eq=False)
class LossPoints:
    """Measured specific total losses under sinusoidal flux density.

    Attributes
    ----------
    frequency, flux_density, loss : (n_point,) Hz, T (peak), W/kg
    """

    frequency: Array
    flux_density: Array
    loss: Array


@dataclass(frozen=True)
class LossCoefficients:
    """Bertotti's three terms of a sheet: p = k_h f B^a + pi^2 sigma d^2 f^2 B^2/(6 rho) + k_ex (f B)^1.5 in W/kg.

    Attributes
    ----------
    hysteresis, exponent, excess : k_h in W s/(kg T^a), a, k_ex in W s^1.5/(kg T^1.5)
    density : rho in kg/m3
    frequency_max : Hz; the data's range that the fit used
    flux_density_min, flux_density_max : T, likewise
    rms_error, largest_error : of the fit, relative to the data
    source : of the data
    """

    hysteresis: float
    exponent: float
    excess: float
    density: float
    frequency_max: float
    flux_density_min: float
    flux_density_max: float
    rms_error: float
    largest_error: float
    source: str


@dataclass(frozen=True)
class Sheet:
    """What is known of an iron's sheets as to losses.

    Attributes
    ----------
    iron : its name
    thickness, conductivity : m, S/m; None where not known, and then there is no eddy-current term either
    coefficients : None where no measured losses are known for this iron at this thickness
    reason : why there are none, and the way out; empty where there are
    """

    iron: str
    thickness: float | None
    conductivity: float | None
    coefficients: LossCoefficients | None = None
    reason: str = ""


def sheet_of(iron: str, *, thickness: float | None = None) -> Sheet:
    """The sheet of an iron, as the library or `thickness` in m has it; with losses only where they were measured.

    Raises
    ------
    MaterialError : a thickness outside 0.01 ... 50 mm
    """
    if thickness is not None and not THINNEST <= thickness <= THICKEST:
        raise MaterialError(
            f"a sheet of {format_quantity(thickness, 'm')} is not allowed; it must be 0.01 ... 50 mm thick"
        )
    stated = _library().get(iron)
    if stated is None:
        return Sheet(iron, thickness, None, reason=f"no loss data for iron '{iron}'; those of the library have some")
    conductivity = stated.get("conductivity_S_per_m") or 1 / stated.get("resistivity_ohm_m", math.inf) or None
    known = [entry for entry in _losses().values() if iron in entry["irons"]]
    gauge = thickness or stated.get("lamination_thickness_m") or None
    for entry in known:
        measured = entry["thickness_m"]
        if gauge and abs(measured - gauge) <= SAME_THICKNESS * gauge:
            numbers = entry["coefficients"]
            losses = LossCoefficients(**numbers, density=entry["density_kg_per_m3"], source=entry["source"])
            return Sheet(iron, measured, entry["conductivity_S_per_m"], losses)
    return Sheet(iron, gauge, conductivity, reason=_why_not(iron, gauge, known))


def _why_not(iron: str, thickness: float | None, known: list[dict[str, Any]]) -> str:
    if not known:
        irons = sorted({name for entry in _losses().values() for name in entry["irons"]})
        return f"no loss data with a source for iron '{iron}'; there are some for {', '.join(irons)}"
    measured = ", ".join(f"{entry['thickness_m'] * 1e3:.2f} mm" for entry in known)
    sheet = f"sheets of {thickness * 1e3:.3g} mm" if thickness else "a sheet of unknown thickness"
    return f"no loss data for {sheet} of iron '{iron}'; there are some at {measured} (--sheet)"


@cache
def _library() -> dict[str, Any]:
    """The irons of the library with what their source states."""
    irons: dict[str, Any] = json.loads((LIBRARY / "index.json").read_text())
    return irons


@cache
def _losses() -> dict[str, Any]:
    """The sheets with measured losses, see materials/SOURCE.md."""
    sheets: dict[str, Any] = json.loads(INDEX.read_text())
    return sheets


def loss_sheets() -> dict[str, Any]:
    """All sheets with measured losses: name to what core_loss.json says of it."""
    return copy.deepcopy(_losses())


def read_loss_points(path: str | Path) -> LossPoints:
    """The points of a CSV file with the columns frequency_Hz, B_T, loss_W_per_kg.

    Raises
    ------
    MaterialError : unreadable, other columns, a value that is no positive number; the message names file and line
    """
    try:
        lines = small_text(path, encoding="utf-8-sig").splitlines()
    except (OSError, ValueError) as err:
        raise MaterialError(f"{path}: cannot be read; give a CSV file with columns {', '.join(COLUMNS)}") from err
    try:
        rows = list(csv.reader(lines))
    except csv.Error as err:
        raise MaterialError(f"{path}: not comma-separated values ({err}); write columns {', '.join(COLUMNS)}") from err
    header = [name.strip() for name in rows[0]] if rows else []
    if sorted(header) != sorted(COLUMNS):
        raise MaterialError(f"{path}: the first line must name the columns {', '.join(COLUMNS)}")
    values = []
    for number, row in enumerate(rows[1:], start=2):
        if row:
            values.append(_positive_numbers(path, number, row, len(header)))
    table = np.array(values, dtype=float).reshape(-1, len(COLUMNS))
    return LossPoints(*(table[:, header.index(name)] for name in COLUMNS))


def _positive_numbers(path: str | Path, number: int, row: list[str], count: int) -> list[float]:
    try:
        values = [float(cell) for cell in row]
    except ValueError:
        values = []
    if len(values) != count or not all(0 < v < math.inf for v in values):
        raise MaterialError(f"{path}: line {number}: expected {count} positive numbers, found {','.join(row)[:40]!r}")
    return values
