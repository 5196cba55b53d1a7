"""The power amplifier of a side: what becomes of a command, and the voltage it gives."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, first, size, some, within
from msl_fem.plant.cell import Cells
from msl_fem.plant.coefficients import SHARE
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.plant.side import side_flux, side_gap
from msl_fem.plant.state import (
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    COIL_1,
    ENERGY_ELECTRICAL,
    I1,
    OUTPUT_1,
    VOLT_SECONDS_1,
    X,
)
from msl_fem.plant.work import COMMAND_1

Array = NDArray[np.float64]


@compiled
def terminal_voltage(
    p: PlantParameters, current: Value, drop: Value, inductance: Value, target: Value, output: Value
) -> tuple[Value, Value, Flag]:
    """(voltage V, di/dt A/s, whether the voltage limit acts) of a side.

    `drop` is R i + lambda_g dg/dt, what is left of the voltage where the current stands still. A voltage drive gives
    its `output`. A current drive's inner loop of bandwidth w knows the coil: v = drop + L_inc w (target - i) makes the
    current a first-order lag of its target, -3 dB at w, until v meets the voltage limit (Krishnan, Electric Motor
    Drives, 2001, ch. 3: current control with decoupling of the back-EMF). Without a bandwidth the current stands at its
    target and v = drop.
    """
    never = inductance < 0.0
    if p.drive != CURRENT_DRIVE:
        return output, (output - drop) / inductance, never
    if np.isinf(first(p.bandwidth)):
        return drop, drop - drop, never
    slope = p.bandwidth * (target - current)
    voltage = drop + inductance * slope
    over = size(voltage) > p.voltage_limit
    most = choose(voltage < 0.0, 0.0 - p.voltage_limit, p.voltage_limit)
    return choose(over, most, voltage), choose(over, (most - drop) / inductance, slope), over


@compiled
def take_command(p: PlantParameters, state: Rows, work: Rows, wanted: Array) -> Flag:
    """Puts what was `wanted` (2,), clipped at the drive's limit and counted there, into the call's command.

    False where it is not a number. A voltage drive does not limit its current; calls that begin beyond the current
    limit are counted.
    """
    good = state[X] == state[X]
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        command = choose(good, wanted[j], wanted[j])  # the same in all lanes
        good = good & (command - command == 0.0)
        if p.drive == CURRENT_DRIVE:
            _count(state, AT_CURRENT_LIMIT_1 + j, size(command) > p.current_limit)
            command = within(command, p.current_limit)
        elif p.drive == VOLTAGE_DRIVE:
            _count(state, AT_VOLTAGE_LIMIT_1 + j, size(command) > p.voltage_limit)
            _count(state, AT_CURRENT_LIMIT_1 + j, size(state[COIL_1 + j]) > p.current_limit)
            command = within(command, p.voltage_limit)
        work[COMMAND_1 + j] = command
    return good


@compiled
def _count(state: Rows, n: int, flag: Flag) -> None:
    state[n] = state[n] + choose(flag, 1.0, 0.0)


@compiled
def jump(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> Flag:
    """Sets the currents of an ideal drive to the call's command; False outside the table.

    They jump at constant gap, that of Y: the jump of flux goes into the volt-seconds, that of field energy into the
    electrical input. An ideal voltage or force drive gives its command at once.
    """
    inside = state[X] == state[X]
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        command = work[COMMAND_1 + j]
        state[OUTPUT_1 + j] = command
        if p.drive == CURRENT_DRIVE:
            current = command
            if e is not None:
                current = command + e[SHARE] * work[COMMAND_1 + 1 - j]
            inside = inside & _jump_of_side(cells, p, e, state, work, j, current)
    return inside


@compiled
def _jump_of_side(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, current: Value) -> Flag:
    gap = side_gap(p, e, work, j)
    was_inside, flux_before, stored_before = side_flux(cells, p, e, work, j, state[I1 + j], gap)
    inside, flux, stored = side_flux(cells, p, e, work, j, current, gap)
    inside = inside & was_inside
    if some(inside):
        change = choose(inside, flux - flux_before, np.nan)
        state[VOLT_SECONDS_1 + j] = state[VOLT_SECONDS_1 + j] + change
        if e is not None:
            other = VOLT_SECONDS_1 + 1 - j
            state[other] = state[other] + e[SHARE] * change
        state[ENERGY_ELECTRICAL] = state[ENERGY_ELECTRICAL] + (stored - stored_before)
        state[I1 + j] = choose(inside, current, np.nan)
    return inside
