"""Inductance and resistance of a coil over frequency and stroke, as an LCR meter reads them: impedance.csv."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import numbers, place, read_columns
from msl_fem.record.record import read_only
from msl_fem.record.rig_file import STATIC_FILE, read_rig

IMPEDANCE_FILE = "impedance.csv"
PLACES = ("stroke_m", "gap_m")
LEAST, MOST = 1e-12, 1e12  # of a frequency, an inductance and a resistance: no meter reads beyond


@dataclass(frozen=True, eq=False)
class ImpedanceMap:
    """Series inductance of one magnet, rows in any order.

    Attributes
    ----------
    stroke : (n_row,) m, stroke or gap
    frequency : (n_row,) Hz
    inductance : (n_row,) H, the imaginary part of the impedance over the angular frequency
    resistance : (n_row,) ohm, its real part; None where not measured
    """

    stroke: Array
    frequency: Array
    inductance: Array
    resistance: Array | None = None


def read_impedance(path: Path) -> ImpedanceMap:
    """The map in a file: columns stroke_m or gap_m, frequency_hz, inductance_H and, where measured, resistance_ohm.

    Raises
    ------
    RecordError : no such file, no rows, a column is missing, a value not finite, a frequency, an inductance or a
        resistance that is not above 0
    """
    table = read_columns(path)
    along = next((name for name in PLACES if name in table), None)
    if along is None:
        raise RecordError(f"{path}: row 1: column stroke_m or gap_m is missing; the file has {', '.join(table)}")
    for name in ("frequency_hz", "inductance_H"):
        if name not in table:
            raise RecordError(f"{path}: row 1: column {name} is missing; the file has {', '.join(table)}")
    known = (along, "frequency_hz", "inductance_H", "resistance_ohm")
    values = {name: read_only(numbers(table[name], name, path)) for name in known if name in table}
    if not values[along].size:
        raise RecordError(f"{path}: row 2: there are no rows; write what was measured")
    for name in (one for one in known[1:] if one in values):
        odd = np.flatnonzero(~((values[name] >= LEAST) & (values[name] <= MOST)))
        if odd.size:
            at = int(odd[0])
            raise RecordError(
                f"{place(path, at)}, column {name}: {values[name][at]:g} is not above 0, or no reading "
                f"({LEAST:g} ... {MOST:g}); correct the cell"
            )
    resistance = values.get("resistance_ohm")
    return ImpedanceMap(values[along], values["frequency_hz"], values["inductance_H"], resistance)


def is_impedance_alone(folder: Path) -> bool:
    """Whether a record's rig.toml names no run and no static map beside its impedance.csv.

    Raises
    ------
    RecordError : the folder is no record
    """
    rig = read_rig(folder)
    return not rig.run and rig.static is None and not (folder / STATIC_FILE).exists()
