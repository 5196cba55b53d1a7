"""A drive that is known by its duty: duty_1 and duty_2 times the supply's voltage are the voltages of the sides."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from msl_fem.errors import RecordError
from msl_fem.record.columns import Channel, Column, numbers, place

DUTIES = {"duty_1": Channel("voltage", 1).column, "duty_2": Channel("voltage", 2).column}


def with_voltages(table: Mapping[str, Column], supply: float | None, *, file: Path | str) -> dict[str, Column]:
    """The columns (n_row,) of a run, with the voltages of its duties in their place.

    A duty is the mean over its period, -1 to 1; how well the supply is known is the tolerance `voltage_gain`.

    Raises
    ------
    RecordError : no supply is stated, a duty beyond 1, or duty and voltage of one side together
    """
    columns = dict(table)
    for name, voltage in DUTIES.items():
        if name not in columns:
            continue
        if voltage in columns:
            raise RecordError(f"{file}: row 1: columns {name} and {voltage} state the same; leave one of them out")
        if supply is None:
            raise RecordError(
                f"{file}: row 1: column {name} needs the voltage of the supply; state [supply] voltage in rig.toml"
            )
        duty = numbers(columns.pop(name), name, file)
        beyond = np.flatnonzero(np.abs(duty) > 1)
        if beyond.size:
            at = int(beyond[0])
            raise RecordError(
                f"{place(file, at)}, column {name}: {duty[at]:g} is no duty, -1 ... 1; is it in per cent?"
            )
        columns[voltage] = duty * supply
    return columns
