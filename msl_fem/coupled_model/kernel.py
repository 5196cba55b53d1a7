"""The coupled model's time loop: circuits of both sides, drive and motion, compiled.

    v_j = R i_j + d lambda_j(i_j, g_j)/dt,   g_1 = g_0 - x,   g_2 = g_0 + x
    m x'' + c x' + k x = F_1(i_1, g_1) - F_2(i_2, g_2) + F_const + d(t)

(Woodson and Melcher, Electromechanical Dynamics I, 1968, ch. 3: flux linkage and force are derivatives of one
coenergy.) The currents are the electrical states: L_inc di/dt = v - R i - lambda_g dg/dt, with lambda_g = -dF/di.

The classical Runge-Kutta scheme with a fixed step (Hairer, Norsett, Wanner, Solving ODEs I, II.1), of order 4 where the
right-hand side is smooth. Commands are held over a call of `advance`, so their jumps fall between steps. The drive's
voltage limit is a kink of the right-hand side: a step in which the limit begins or ceases to act errs by O(step^2)
in the current, once for each such event, and by O(step^3) in the velocity.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.compiled import compiled
from msl_fem.coupled_model.drive import take_command, terminal_voltage
from msl_fem.coupled_model.lag import lag_weights
from msl_fem.coupled_model.plant import CURRENT_DRIVE, FORCE_DRIVE, PlantParameters, Surface
from msl_fem.coupled_model.side import side_flux, side_slopes
from msl_fem.coupled_model.state import (
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    I1,
    I2,
    N_INTEGRATED,
    NOT_FINITE,
    OK,
    OUTPUT_1,
    OUTPUT_2,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    SENSOR,
    VOLT_SECONDS_1,
    VOLT_SECONDS_2,
    V,
    X,
)

Array = NDArray[np.float64]

# Columns of `run`: the state before the command acts, mean voltages until the next row, flux linkages, limits reached
OUT_I1, OUT_I2, OUT_X, OUT_V, OUT_SENSOR, OUT_VOLTAGE_1, OUT_VOLTAGE_2, OUT_FLUX_1, OUT_FLUX_2 = range(9)
OUT_AT_CURRENT_LIMIT_1, OUT_AT_CURRENT_LIMIT_2, OUT_AT_VOLTAGE_LIMIT_1, OUT_AT_VOLTAGE_LIMIT_2 = range(9, 13)
N_OUT = 13


@compiled
def rates(
    surface: Surface, p: PlantParameters, y: Array, output: Array, target: Array, disturbance: float, dy: Array
) -> int:
    """dy/dt of the integrated states; bit j of the answer: side j is at its voltage limit; -1 outside the table.

    `output` (2,) is what a voltage or force drive gives, `target` (2,) what a current loop aims at; dy has
    N_INTEGRATED entries.
    """
    position, velocity = y[X], y[V]
    external = disturbance + p.constant_force
    if p.drive == FORCE_DRIVE:
        external += output[0]
        dy[VOLT_SECONDS_1] = output[0]
    limited, force, electrical, copper = 0, external, 0.0, 0.0
    for j in range(p.sides):
        toward = 1.0 - 2.0 * j  # side 1 pulls towards +x, side 2 towards -x
        current = y[I1 + j]
        inside, pull, inductance, flux_slope = side_slopes(surface, p, current, p.nominal_gap - toward * position)
        if not inside:
            return -1
        drop = p.resistance * current - flux_slope * toward * velocity
        voltage, slope, at_limit = terminal_voltage(p, current, drop, inductance, target[j], output[j])
        limited |= at_limit << j
        force += toward * pull
        electrical += voltage * current
        copper += p.resistance * current * current
        dy[I1 + j] = slope
        dy[VOLT_SECONDS_1 + j] = voltage
    dy[X] = velocity
    dy[V] = (force - p.damping * velocity - p.stiffness * position) / p.mass
    dy[ENERGY_ELECTRICAL] = electrical
    dy[ENERGY_COPPER] = copper
    dy[ENERGY_DAMPING] = p.damping * velocity * velocity
    dy[ENERGY_EXTERNAL] = external * velocity
    return limited


@compiled
def advance(
    surface: Surface, parameters: PlantParameters, state: Array, command: Array, disturbance: float, step: float,
    n_step: int, voltage_mean: Array,
) -> int:  # fmt: skip
    """OK, or why the model stopped, after n_step Runge-Kutta steps of `step` seconds from `state`, which is updated.

    Parameters
    ----------
    state : (N_STATE,), see `state.py`; `initial_state` makes one
    command : (2,) held over the call: A, V, or N (its first entry) by the drive's kind
    disturbance : N on the mass, held over the call
    voltage_mean : (2,), receives the mean voltages of the sides in V, in force drive the mean force in N

    OUTSIDE_TABLE, OUTSIDE_RANGE (beyond `travel`) and NOT_FINITE leave the state of the last good step. Commands beyond
    the drive's limit are clipped as an amplifier does, and counted in the state. The voltage limit of an ideal current
    drive (infinite bandwidth) is checked on the mean voltage and counted, not acted on.
    """
    p = parameters
    target, begin, middle, end, weights = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2), np.empty(5)
    k = np.zeros((4, N_INTEGRATED))
    trial = np.zeros(N_INTEGRATED)
    state[VOLT_SECONDS_1] = state[VOLT_SECONDS_2] = 0.0
    status = take_command(surface, p, state, command, target, trial)
    lag_weights(p.sensor_bandwidth, step, weights)
    half_decay, decay = np.exp(-0.5 * p.bandwidth * step), np.exp(-p.bandwidth * step)
    limited, done = 0, 0
    while done < n_step and status == OK:
        for j in range(2):
            begin[j] = state[OUTPUT_1 + j]
            middle[j] = target[j] + half_decay * (begin[j] - target[j])
            end[j] = target[j] + decay * (begin[j] - target[j])
        flag_1 = rates(surface, p, state, begin, target, disturbance, k[0])
        for n in range(N_INTEGRATED):
            trial[n] = state[n] + 0.5 * step * k[0, n]
        flag_2 = rates(surface, p, trial, middle, target, disturbance, k[1])
        for n in range(N_INTEGRATED):
            trial[n] = state[n] + 0.5 * step * k[1, n]
        flag_3 = rates(surface, p, trial, middle, target, disturbance, k[2])
        for n in range(N_INTEGRATED):
            trial[n] = state[n] + step * k[2, n]
        flag_4 = rates(surface, p, trial, end, target, disturbance, k[3])
        for n in range(N_INTEGRATED):
            trial[n] = state[n] + step / 6.0 * (k[0, n] + 2.0 * (k[1, n] + k[2, n]) + k[3, n])
        status = _judge(p, trial, min(flag_1, flag_2, flag_3, flag_4))
        if status == OK:
            limited |= flag_1 | flag_2 | flag_3 | flag_4
            state[SENSOR] = weights[0] * state[SENSOR] + weights[1] * state[X] + weights[2] * state[V]
            state[SENSOR] += weights[3] * trial[X] + weights[4] * trial[V]
            state[:N_INTEGRATED] = trial
            state[OUTPUT_1], state[OUTPUT_2] = end[0], end[1]
            done += 1
    for j in range(2):
        voltage_mean[j] = state[VOLT_SECONDS_1 + j] / (max(done, 1) * step)
        if p.drive == CURRENT_DRIVE:
            unheeded = np.isinf(p.bandwidth) and abs(voltage_mean[j]) > p.voltage_limit
            state[AT_VOLTAGE_LIMIT_1 + j] += unheeded or (limited >> j) & 1 == 1
    return status


@compiled
def _judge(p: PlantParameters, trial: Array, flag: int) -> int:
    """Why a step cannot stand, or OK."""
    for n in range(N_INTEGRATED):
        if not np.isfinite(trial[n]):
            return NOT_FINITE
    if flag < 0:
        return OUTSIDE_TABLE
    return OUTSIDE_RANGE if abs(trial[X]) > p.travel else OK


@compiled
def run(
    surface: Surface, parameters: PlantParameters, state: Array, commands: Array, disturbance: Array, step: float,
    n_sub: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """(status, whole samples done) of an open-loop run of n samples of n_sub steps each.

    commands (n, 2) and disturbance (n,) are held over their samples; out (n, N_OUT) receives a row a sample (the
    OUT_ columns), taken before the sample's command acts. The state ends where the last good step ended.
    """
    voltage_mean, magnet, counts = np.zeros(2), np.zeros(6), np.zeros(4)
    for k in range(commands.shape[0]):
        row = out[k]
        row[:] = 0.0
        row[OUT_I1], row[OUT_I2], row[OUT_X], row[OUT_V] = state[I1], state[I2], state[X], state[V]
        row[OUT_SENSOR] = state[SENSOR]
        for j in range(parameters.sides):
            gap = parameters.nominal_gap - (1.0 - 2.0 * j) * state[X]
            inside, row[OUT_FLUX_1 + j], _ = side_flux(surface, parameters, state[I1 + j], gap, magnet)
            if not inside:
                return OUTSIDE_TABLE, k
        for n in range(4):
            counts[n] = state[AT_CURRENT_LIMIT_1 + n]
        status = advance(surface, parameters, state, commands[k], disturbance[k], step, n_sub, voltage_mean)
        row[OUT_VOLTAGE_1], row[OUT_VOLTAGE_2] = voltage_mean[0], voltage_mean[1]
        for n in range(4):
            row[OUT_AT_CURRENT_LIMIT_1 + n] = state[AT_CURRENT_LIMIT_1 + n] - counts[n]
        if status != OK:
            return status, k
    return OK, commands.shape[0]
