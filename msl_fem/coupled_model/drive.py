"""The power amplifier of a side: what becomes of a command, and the voltage it gives."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.compiled import compiled
from msl_fem.coupled_model.plant import (
    CURRENT_DRIVE,
    FORCE_DRIVE,
    VOLTAGE_DRIVE,
    PlantParameters,
    Surface,
)
from msl_fem.coupled_model.side import side_flux
from msl_fem.coupled_model.state import (
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    ENERGY_ELECTRICAL,
    I1,
    NOT_FINITE,
    OK,
    OUTPUT_1,
    OUTSIDE_TABLE,
    VOLT_SECONDS_1,
    X,
)

Array = NDArray[np.float64]


@compiled
def terminal_voltage(
    p: PlantParameters, current: float, drop: float, inductance: float, target: float, output: float
) -> tuple[float, float, int]:
    """(voltage V, di/dt A/s, 1 where the voltage limit acts else 0) of a side.

    `drop` is R i + lambda_g dg/dt, what is left of the voltage where the current stands still. A voltage drive gives
    its `output`. A current drive's inner loop of bandwidth w knows the coil: v = drop + L_inc w (target - i) makes the
    current a first-order lag of its target, -3 dB at w, until v meets the voltage limit (Krishnan, Electric Motor
    Drives, 2001, ch. 3: current control with decoupling of the back-EMF). Without a bandwidth the current stands at its
    target and v = drop.
    """
    if p.drive != CURRENT_DRIVE:
        return output, (output - drop) / inductance, 0
    if np.isinf(p.bandwidth):
        return drop, 0.0, 0
    slope = p.bandwidth * (target - current)
    voltage = drop + inductance * slope
    if abs(voltage) <= p.voltage_limit:
        return voltage, slope, 0
    voltage = np.copysign(p.voltage_limit, voltage)
    return voltage, (voltage - drop) / inductance, 1


@compiled
def take_command(
    surface: Surface, p: PlantParameters, state: Array, command: Array, target: Array, magnet: Array
) -> int:
    """OK, or why not: puts the command (2,), clipped at the drive's limit and counted there, into target (2,).

    In an ideal current drive the currents jump here, at constant gap: the jump of flux goes into the volt-seconds, that
    of field energy into the electrical input. A voltage drive does not limit its current; calls that begin beyond the
    current limit are counted.
    """
    ideal = np.isinf(p.bandwidth)
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        if not np.isfinite(command[j]):
            return NOT_FINITE
        limit = np.inf
        if p.drive == CURRENT_DRIVE:
            limit = p.current_limit
            state[AT_CURRENT_LIMIT_1 + j] += abs(command[j]) > limit
        elif p.drive == VOLTAGE_DRIVE:
            limit = p.voltage_limit
            state[AT_VOLTAGE_LIMIT_1 + j] += abs(command[j]) > limit
            state[AT_CURRENT_LIMIT_1 + j] += abs(state[I1 + j]) > p.current_limit
        target[j] = min(max(command[j], -limit), limit)
        if ideal:
            state[OUTPUT_1 + j] = target[j]
            if p.drive == CURRENT_DRIVE and not _jump(surface, p, state, target, j, magnet):
                return OUTSIDE_TABLE
    return OK


@compiled
def _jump(surface: Surface, p: PlantParameters, state: Array, target: Array, j: int, magnet: Array) -> bool:
    """Sets the current of side j to its target; False outside the table."""
    gap = p.nominal_gap - (1.0 - 2.0 * j) * state[X]
    was_inside, flux_before, stored_before = side_flux(surface, p, state[I1 + j], gap, magnet)
    inside, flux, stored = side_flux(surface, p, target[j], gap, magnet)
    if not (was_inside and inside):
        return False
    state[VOLT_SECONDS_1 + j] += flux - flux_before
    state[ENERGY_ELECTRICAL] += stored - stored_before
    state[I1 + j] = target[j]
    return True
