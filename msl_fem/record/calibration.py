"""The calibration curve of a gauge that is not linear: what it read at known values, and what its readings mean."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import numbers, place, read_columns

FEWEST_POINTS = 3


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
        turn = int(order[np.flatnonzero(np.sign(step) != np.sign(values[-1] - values[0]))[0] + 1])
        raise RecordError(
            f"{place(path, turn)}, column value: the curve turns back there, so that a reading has no one value; "
            "look at the point, or use a part of the curve"
        )
    return CalibrationCurve(path.name, readings, values)
