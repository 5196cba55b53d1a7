"""The current loop of a controller as C, printed from the compiled Python with its numbers put in."""

from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control import current_step as rows
from msl_fem.control.current_loop import CurrentLoopDesign
from msl_fem.control.current_step import N_STATE, current_step
from msl_fem.export.c_printer import Printer
from msl_fem.export.c_types import REAL, Pointer

_CHECKED = 48


def print_current_loop(printer: Printer, design: CurrentLoopDesign) -> None:
    """The step of a current loop, beside what the printer has of its controller."""
    two = {name: Pointer((2,)) for name in ("wanted", "read", "voltage")}
    known = {"parameters": design.parameters, "state": Pointer((N_STATE,)), "position": REAL, "aim": REAL}
    printer.add(current_step, known | two)


def current_loop_content(design: CurrentLoopDesign | None) -> dict[str, Any] | None:
    """What the header's template tells of a current loop; None without one."""
    if design is None:
        return None
    return {
        "rate": design.rate,
        "periods": design.stage.periods,
        "doubles": N_STATE,
        "limited": rows.N_LIMITED,
        "check": check_periods(design),
    }


def check_periods(design: CurrentLoopDesign) -> dict[str, Array]:
    """Wanted and read currents (n, 2), positions, aims (n,), the compiled loop's voltages (n, 2); also beyond."""
    p = design.parameters
    k, end = np.arange(_CHECKED), float(p.inverse.surface_1.current[-1]) / p.inverse.current_share
    wanted = np.column_stack([np.maximum(0.0, np.sin(0.3 * k)), np.maximum(0.0, -np.sin(0.3 * k))]) * (0.4 * end)
    read = wanted + np.column_stack([0.01 * np.sin(1.7 * k), -0.02 * np.sin(2.3 * k)]) * end
    read[-6:] *= 4.0
    position = 0.8 * p.inverse.gap_1 * np.sin(0.2 * k)
    position[-3:] *= 2.0
    aim = 1.02 * position
    state, voltage = np.zeros(N_STATE), np.zeros((_CHECKED, 2))
    for n in range(_CHECKED):
        current_step(p, state, wanted[n], read[n], float(position[n]), float(aim[n]), voltage[n])
    return {"wanted": wanted, "read": read, "position": position, "aim": aim, "voltage": voltage}
