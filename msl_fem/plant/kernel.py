"""The coupled model's time loop, compiled: commands in, state on, rows out.

The plain model (`rates.py`) and the one with effects (`effect_rates.py`) share it: `effects` is None, or the
coefficients of `kernel_coefficients` for the step and the number of steps of a call.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, first, keep, lane_of, rows_of, set_lane, width
from msl_fem.plant import coefficients as c
from msl_fem.plant.acting import act, act_with_effects
from msl_fem.plant.cell import Cells, Surface, cells_of
from msl_fem.plant.drive import jump, take_command
from msl_fem.plant.end_stop import step_with_stop
from msl_fem.plant.lag import lag_weights
from msl_fem.plant.plant import CURRENT_DRIVE, EndStop, PlantParameters
from msl_fem.plant.side import side_flux, side_gap
from msl_fem.plant.state import (
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    COIL_1,
    COIL_SLOPE_1,
    COIL_START_1,
    I1,
    N_INTEGRATED,
    NOT_FINITE,
    OK,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    QUEUE_1,
    QUEUE_2,
    SENSOR,
    VOLT_SECONDS_1,
    VOLT_SECONDS_2,
    V,
    X,
)
from msl_fem.plant.step import keep_step, look_at, seen, slopes, try_step
from msl_fem.plant.work import (
    CIRCUITS,
    COIL_CURRENT,
    COMMAND_1,
    DRIVE_HALF,
    DRIVE_WHOLE,
    FORMER_1,
    INPUTS,
    LIMITED_1,
    N_CIRCUIT,
    N_INPUT,
    SENSOR_WEIGHTS,
    SLOPES,
    Y,
    workspace,
)

Array = NDArray[np.float64]

# Columns of `run`: the state before the command acts (currents of the coils, what the position sensor gives before
# noise), mean voltages until the next row, flux linkages of the coils, limits reached; then slopes in time of the
# sensor, of the currents behind the row's instant and before the next one (with effects only)
OUT_I1, OUT_I2, OUT_X, OUT_V, OUT_SENSOR, OUT_VOLTAGE_1, OUT_VOLTAGE_2, OUT_FLUX_1, OUT_FLUX_2 = range(9)
OUT_AT_CURRENT_LIMIT_1, OUT_AT_CURRENT_LIMIT_2, OUT_AT_VOLTAGE_LIMIT_1, OUT_AT_VOLTAGE_LIMIT_2 = range(9, 13)
OUT_SENSOR_SLOPE, OUT_SLOPE_AFTER_1, OUT_SLOPE_AFTER_2, OUT_SLOPE_BEFORE_1, OUT_SLOPE_BEFORE_2 = range(13, 18)
N_OUT = 18


@compiled
def advance(
    surface: Surface, parameters: PlantParameters, effects: Rows, state: Array, command: Array, disturbance: float,
    step: float, n_step: int, voltage_mean: Array,
) -> int:  # fmt: skip
    """OK, or why the model stopped, after n_step Runge-Kutta steps of `step` seconds from `state`, which is updated.

    Parameters
    ----------
    effects : (N_COEFFICIENT,) of `kernel_coefficients` for this step and n_step, or None for the plain model
    state : (N_STATE,), see `state.py`; `initial_state` makes one
    command : (2,) held over the call: A, V, or N (its first entry) by the drive's kind
    disturbance : N on the mass, held over the call
    voltage_mean : (2,), receives the mean voltages of the sides in V, in force drive the mean force in N

    OUTSIDE_TABLE, OUTSIDE_RANGE (beyond `travel`) and NOT_FINITE leave the state of the last good step. Commands beyond
    the drive's limit are clipped as an amplifier does, and counted in the state. The voltage limit of an ideal current
    drive (infinite bandwidth) is checked on the mean voltage and counted, not acted on.
    """
    memory = workspace()
    e, rows, work = rows_of(effects), rows_of(state), rows_of(memory)
    set_timing(parameters, e, step, work)
    cells = cells_of(surface)
    status = _advance(cells, parameters, e, rows, work, command, disturbance, step, n_step, voltage_mean)
    keep(memory)
    return status


@compiled
def rates_at(
    surface: Surface, parameters: PlantParameters, effects: Rows, state: Array, inputs: Array, dy: Array
) -> bool:  # fmt: skip
    """The slopes of the integrated states (N_INTEGRATED,) of a state into dy; False outside the table.

    `inputs` (N_INPUT,) are targets of current loops (A), outputs of a voltage or force drive, forces from outside (N).
    The memory of iron and friction in `state` is moved to it.
    """
    memory = workspace()
    e, rows, work = rows_of(effects), rows_of(state), rows_of(memory)
    for n in range(N_INPUT):
        work[INPUTS + n] = inputs[n]
    look_at(e, rows, work)
    inside = slopes(cells_of(surface), parameters, e, rows, work, 0, 0)
    for n in range(N_INTEGRATED):
        dy[n] = work[SLOPES + n]
    keep(memory)
    return inside


@compiled
def set_timing(p: PlantParameters, e: Rows, step: float, work: Rows) -> None:
    """Weights of the sensor's and the drive's lag over a step into the workspace."""
    drive = p.bandwidth if e is None else e[c.BANDWIDTH]
    sensor = p.sensor_bandwidth if e is None else e[c.SENSOR_BANDWIDTH]
    lag_weights(sensor, step, work, SENSOR_WEIGHTS)
    work[DRIVE_HALF], work[DRIVE_WHOLE] = np.exp(-0.5 * drive * step), np.exp(-drive * step)


@compiled
def _advance(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, command: Array, disturbance: float,
    step: float, n_step: int, voltage_mean: Array,
) -> int:  # fmt: skip
    state[VOLT_SECONDS_1] = state[VOLT_SECONDS_2] = 0.0
    work[LIMITED_1] = work[LIMITED_1 + 1] = 0.0
    status = OK if take_command(p, state, work, command) else NOT_FINITE
    ideal = np.isinf(p.bandwidth if e is None else e[c.BANDWIDTH])
    if status == OK and e is not None:
        queue_command(e, state, work)
    if status == OK and ideal and (e is None or p.drive == CURRENT_DRIVE):
        look_at(e, state, work)
        status = OK if jump(cells, p, e, state, work) else OUTSIDE_TABLE
    push = disturbance + p.constant_force
    done = 0
    while done < n_step and status == OK:
        if e is None:
            act(p, state, work, push)
        else:
            act_with_effects(p, e, state, work, push, done, step)
        status = _step(p.end_stop, cells, p, e, state, work, step)
        if status == OK:
            if e is not None and done == 0:
                state[COIL_START_1], state[COIL_START_1 + 1] = work[SLOPES + I1], work[SLOPES + I1 + 1]
            done += 1
    for j in range(2):
        voltage_mean[j] = state[VOLT_SECONDS_1 + j] / (max(done, 1) * step)
        if p.drive == CURRENT_DRIVE:
            unheeded = ideal and abs(voltage_mean[j]) > p.voltage_limit
            state[AT_VOLTAGE_LIMIT_1 + j] += unheeded or work[LIMITED_1 + j] > 0.0
    if e is None:
        state[COIL_1], state[COIL_1 + 1] = state[I1], state[I1 + 1]
    elif status == OK:
        settle(cells, p, e, state, work)
    return status


@compiled
def _step(stop: EndStop | None, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> int:
    """OK and a step taken, or why it cannot be; then the state is that of the last good step."""
    if stop is None:
        status = _judge(p, work, try_step(cells, p, e, state, work, step))
        if status == OK:
            keep_step(p, e, state, work)
        return status
    else:
        bandwidth = p.sensor_bandwidth if e is None else e[c.SENSOR_BANDWIDTH]
        return _judge(p, work, step_with_stop(stop, cells, p, e, state, work, step, bandwidth))


@compiled
def queue_command(e: Rows, state: Rows, work: Rows) -> None:
    """Puts the call's command last in the queues, and takes out those that act now."""
    for j in range(2):
        queue = QUEUE_1 if j == 0 else QUEUE_2
        for k in range(queue + c.N_QUEUE, queue, -1):
            state[k] = state[k - 1]
        state[queue] = work[COMMAND_1 + j]
        for lane in range(width(state)):
            acts = queue + int(lane_of(e, c.DELAY_SAMPLES, lane))
            set_lane(work, COMMAND_1 + j, lane, lane_of(state, acts, lane))
            set_lane(work, FORMER_1 + j, lane, lane_of(state, acts + 1, lane))


@compiled
def settle(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Moves the memory of iron and friction to the state, and finds the coils' currents there."""
    look_at(e, state, work)
    slopes(cells, p, e, state, work, 0, 2)
    for j in range(p.sides):
        state[COIL_1 + j] = work[CIRCUITS + j * N_CIRCUIT + COIL_CURRENT]
        state[COIL_SLOPE_1 + j] = work[SLOPES + I1 + j]


@compiled
def _judge(p: PlantParameters, work: Rows, inside: bool) -> int:
    """Why a step to Y cannot stand, or OK."""
    for n in range(N_INTEGRATED):
        if not np.isfinite(work[Y + n]):
            return NOT_FINITE
    if not inside:
        return OUTSIDE_TABLE
    return OUTSIDE_RANGE if abs(work[Y + X]) > p.travel else OK


@compiled
def run(
    surface: Surface, parameters: PlantParameters, effects: Rows, state: Array, commands: Array, disturbance: Array,
    step: float, n_sub: int, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """(status, whole samples done) of an open-loop run of n samples of n_sub steps each.

    commands (n, 2) and disturbance (n,) are held over their samples; out (n, N_OUT) receives a row a sample (the
    OUT_ columns), taken before the sample's command acts. The state ends where the last good step ended.
    """
    memory = workspace()
    e, rows, work, cells = rows_of(effects), rows_of(state), rows_of(memory), cells_of(surface)
    set_timing(parameters, e, step, work)
    table = rows_of(out.ravel())
    status, done = OK, 0
    voltage_mean, counts = np.zeros(2), np.zeros(4)
    while done < commands.shape[0] and status == OK:
        row = out[done]
        if write_row(cells, parameters, e, rows, work, table, done * N_OUT):
            for n in range(4):
                counts[n] = rows[AT_CURRENT_LIMIT_1 + n]
            status = _advance(
                cells, parameters, e, rows, work, commands[done], disturbance[done], step, n_sub, voltage_mean
            )
            row[OUT_VOLTAGE_1], row[OUT_VOLTAGE_2] = voltage_mean[0], voltage_mean[1]
            for n in range(4):
                row[OUT_AT_CURRENT_LIMIT_1 + n] = rows[AT_CURRENT_LIMIT_1 + n] - counts[n]
            for j in range(2):
                row[OUT_SLOPE_AFTER_1 + j], row[OUT_SLOPE_BEFORE_1 + j] = rows[COIL_START_1 + j], rows[COIL_SLOPE_1 + j]
        else:
            status = OUTSIDE_TABLE
        done += status == OK
    keep(memory)
    keep(out)
    return status, done


@compiled
def write_row(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, row: Rows, start: int) -> Flag:
    """The state before a command acts into the columns of a row from `start`; False outside the table."""
    look_at(e, state, work)
    x, v = seen(e, state, 0)
    bandwidth = p.sensor_bandwidth if e is None else e[c.SENSOR_BANDWIDTH]
    for n in range(N_OUT):
        row[start + n] = 0.0
    row[start + OUT_I1], row[start + OUT_I2] = state[COIL_1], state[COIL_1 + 1]
    row[start + OUT_X], row[start + OUT_V], row[start + OUT_SENSOR] = state[X], state[V], state[SENSOR]
    row[start + OUT_SENSOR_SLOPE] = v if np.isinf(first(bandwidth)) else bandwidth * (x - state[SENSOR])
    inside = x == x
    for j in range(p.sides):
        found, flux, _ = side_flux(cells, p, e, work, j, state[I1 + j], side_gap(p, e, work, j))
        inside = inside & found
        row[start + OUT_FLUX_1 + j] = row[start + OUT_FLUX_1 + j] + flux
        if e is not None:
            row[start + OUT_FLUX_1 + 1 - j] = row[start + OUT_FLUX_1 + 1 - j] + e[c.SHARE] * flux
    return inside
