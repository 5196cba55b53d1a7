"""The calibration curve of a gauge that is not linear: what it read at known values, and what its readings mean."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import Column, numbers, place, read_columns

FEWEST_POINTS = 3
POSITION, SENSOR = "position_m", "position_sensor_V"


@dataclass(frozen=True, eq=False)
class CalibrationCurve:
    """A gauge's readings (n_point,), rising, and the values that belong to them, monotone.

    Between the points runs the monotone cubic of Fritsch and Carlson (SIAM J. Numer. Anal. 17, 1980, 238-246): no
    reading between two points means anything outside their values.
    """

    file: str
    readings: Array
    values: Array

    def values_of(self, readings: Array, *, source: str, file: Path | str) -> Array:
        """What readings (n_sample,) mean; nan stays nan.

        Raises
        ------
        RecordError : a reading beyond the curve's points, where nothing was calibrated; names the sample
        """
        beyond = np.flatnonzero((readings < self.readings[0]) | (readings > self.readings[-1]))
        if beyond.size:
            at = int(beyond[0])
            raise RecordError(
                f"{file}: sample {at} (from 0), column {source}: {readings[at]:.6g} lies beyond the curve {self.file}, "
                f"{self.readings[0]:.6g} ... {self.readings[-1]:.6g}; calibrate further, or leave the part out"
            )
        from scipy.interpolate import PchipInterpolator

        return np.asarray(PchipInterpolator(self.readings, self.values)(readings))


def read_curve(path: Path) -> CalibrationCurve:
    """The curve of a CSV file with the columns `reading` and `value`, in the units that the log's column is in.

    Raises
    ------
    RecordError : no such file or columns, fewer than three points, a reading twice, values that go both ways
    """
    table = read_columns(path)
    missing = [name for name in ("reading", "value") if name not in table]
    if missing:
        raise RecordError(f"{path}: row 1: column {missing[0]} is missing; a curve has reading and value")
    readings, values = (numbers(table[name], name, path) for name in ("reading", "value"))
    if readings.size < FEWEST_POINTS:
        raise RecordError(f"{path}: {readings.size} points are no curve, at least {FEWEST_POINTS} are needed")
    order = np.argsort(readings, kind="stable")
    readings, values = readings[order], values[order]
    double, step = np.flatnonzero(np.diff(readings) == 0), np.diff(values)
    if double.size:
        at = int(order[double[0] + 1])
        raise RecordError(f"{place(path, at)}, column reading: {readings[double[0]]:.6g} is there twice; keep one")
    if not ((step > 0).all() or (step < 0).all()):
        way = np.sign(values[-1] - values[0]) or 1.0  # of a curve that comes back to where it began, or is level
        turn = int(order[np.flatnonzero(np.sign(step) != way)[0] + 1])
        raise RecordError(
            f"{place(path, turn)}, column value: the curve turns back there, so that a reading has no one value; "
            "look at the point, or use a part of the curve"
        )
    return CalibrationCurve(path.name, readings, values)


def calibrated(
    table: Mapping[str, Column], curves: Mapping[str, CalibrationCurve], *, file: Path | str
) -> dict[str, Column]:
    """The columns with those that have a curve by what their readings mean; an empty cell stays one (nan).

    Raises
    ------
    RecordError : a curve's column is missing, a cell is no number, a reading lies beyond its curve
    """
    found = dict(table)
    for name, curve in curves.items():
        if name not in table:
            raise RecordError(f"{file}: row 1: column {name} is missing, which {curve.file} is the curve of")
        cells = table[name]
        empty = np.array([str(cell).strip().lower() in ("", "nan") for cell in cells])
        readings = np.full(len(cells), np.nan)
        readings[~empty] = numbers(cells[~empty], name, file)
        found[name] = curve.values_of(readings, source=name, file=file)
    return found


def with_position(
    table: Mapping[str, Column], curve: CalibrationCurve | None, *, file: Path | str
) -> dict[str, Column]:
    """The columns of a run with `position_m` made of its sensor's signal, `position_sensor_V`.

    Raises
    ------
    RecordError : the signal has no curve; both columns are there, though a curve is stated
    """
    if SENSOR not in table or (POSITION in table and curve is None):
        return dict(table)
    if POSITION in table:
        raise RecordError(f"{file}: row 1: {POSITION} is there, and {SENSOR} has a curve that makes it; remove one")
    if curve is None:
        raise RecordError(
            f"{file}: row 1: {SENSOR} is a signal; name a file with the columns reading and value (V, m) in rig.toml, "
            'position_sensor_curve = "probe.csv"'
        )
    made = calibrated(table, {SENSOR: curve}, file=file)
    return {POSITION if name == SENSOR else name: values for name, values in made.items()}
