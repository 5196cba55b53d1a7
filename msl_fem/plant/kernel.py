"""The coupled model's time loop, compiled: commands in, state on, rows out; one loop for one run and for eight lanes.

The plain model and the one with effects share it: `effects` is None, or the coefficients of `kernel_coefficients` for
the step and the number of steps of a call. A single run ends where it cannot go on; a lane becomes nan there, and the
others go on.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, every, first, keep, rows_of, size, some, width
from msl_fem.plant.drive import (
    count,
    jump,
    queue_command,
    set_inputs,
    set_inputs_with_effects,
    set_ramps,
    set_timing,
    take_command,
)
from msl_fem.plant.effects import electrical, expressions, magnetic, mechanical, sensing, stray_flux
from msl_fem.plant.effects.expressions import LAW_READING
from msl_fem.plant.layout import (
    ADDED_READING,
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    CIRCUIT_1,
    COIL_1,
    COIL_2,
    COIL_CURRENT,
    COIL_SLOPE_1,
    COIL_START_1,
    COIL_START_2,
    I1,
    I2,
    INPUTS_BEGIN,
    LIMITED_1,
    LIMITED_2,
    MEAN_VOLTAGE_1,
    N_CIRCUIT,
    N_INPUT,
    N_INTEGRATED,
    N_OUT,
    NOT_FINITE,
    OK,
    OUT_AT_CURRENT_LIMIT_1,
    OUT_FLUX_1,
    OUT_I1,
    OUT_I2,
    OUT_SENSOR,
    OUT_SENSOR_SLOPE,
    OUT_SLOPE_AFTER_1,
    OUT_SLOPE_BEFORE_1,
    OUT_V,
    OUT_VOLTAGE_1,
    OUT_X,
    OUTSIDE_RANGE,
    OUTSIDE_TABLE,
    SENSOR,
    SHARED_FLUX,
    SLOPES,
    STEPS_DONE,
    VOLT_SECONDS_1,
    VOLT_SECONDS_2,
    V,
    X,
    Y,
    workspace,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import CURRENT_DRIVE, EndStop, PlantParameters, Surface
from msl_fem.plant.restart import restart
from msl_fem.plant.side import Cells, cells_of, side_flux, side_gap
from msl_fem.plant.step import keep_step, look_at, seen, slopes, step_with_stop, try_step
from msl_fem.plant.user_laws import set_added_reading


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
    wanted = rows_of(command)
    status = advance_rows(cells_of(surface), parameters, e, rows, work, wanted, disturbance, step, n_step)
    for j in range(2):
        voltage_mean[j] = work[MEAN_VOLTAGE_1 + j]
    keep(memory)
    keep(command)
    return status


@compiled
def advance_rows(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, command: Rows, disturbance: float,
    step: float, n_step: int,
) -> int:  # fmt: skip
    """`advance` on rows, with timing set for the step."""
    return _hold(p.end_stop, cells, p, e, state, work, np.inf, command, 0, 0, disturbance, step, n_step, False, True)


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
        work[INPUTS_BEGIN + n] = inputs[n]
    look_at(e, rows, work)
    inside = slopes(cells_of(surface), parameters, e, rows, work, 0, 0, True)
    for n in range(N_INTEGRATED):
        dy[n] = work[SLOPES + n]
    keep(memory)
    return inside


def run(
    surface: Surface, parameters: PlantParameters, effects: Array | None, state: Array, commands: Array,
    disturbance: Array, step: float, n_sub: int, out: Array, linear: bool,
    stretches: tuple[NDArray[np.int64], Array] | None = None,
) -> tuple[int, int]:  # fmt: skip
    """(status, whole samples done) of an open-loop run of n samples of n_sub steps each.

    commands (n, 2) and disturbance (n,) are held over their samples, with `linear` the commands run straight from one
    to the next, the last one is held; out (n, N_OUT) receives a row a sample (the
    OUT_ columns), taken before the sample's command acts. The state ends where the last good step ended.

    Of stretches (samples (n_stretch, 2) from and to, starts (n_stretch, 4)) all but the first are put to starts of
    their own; rows are nan behind where one before the last ends early, and what is told is of the last.
    """
    stop, others = parameters.end_stop, parameters._replace(end_stop=None)  # what asks for no stop is compiled once
    parts, starts = (np.array([[0, len(out)]]), np.zeros((1, 4))) if stretches is None else stretches
    return _run(stop, surface, others, effects, state, commands, disturbance, step, n_sub, out, linear, parts, starts)


@compiled
def _run(
    stop: EndStop | None, surface: Surface, parameters: PlantParameters, effects: Rows, state: Array, commands: Array,
    disturbance: Array, step: float, n_sub: int, out: Array, linear: bool, parts: NDArray[np.int64], starts: Array,
) -> tuple[int, int]:  # fmt: skip
    """`run` with the end stop apart."""
    memory, before = workspace(), state.copy()
    e, rows, kept, work, cells = (
        rows_of(effects), rows_of(state), rows_of(before), rows_of(memory), cells_of(surface),
    )  # fmt: skip
    wanted, pushes, every, each = commands.ravel(), disturbance.ravel(), out.ravel(), starts.ravel()
    asked, pushed = rows_of(wanted), rows_of(pushes)
    status, done = OK, 0
    for n in range(len(parts)):
        begin, end = parts[n, 0], parts[n, 1]
        if n:
            if status != OK:
                out[done:begin] = np.nan
                state[X] = np.nan
            length = (begin - parts[n - 1, 0]) * n_sub * step
            restart(cells, parameters, e, rows, kept, rows_of(each[4 * n :]), work, length)
            before[:] = state
        begin_rows(parameters, e, rows, work, step)
        status, done = rows_between(
            stop, cells, parameters, e, rows, work, np.inf, asked, pushed, len(out), begin, end, step, n_sub,
            rows_of(every[begin * N_OUT :]), linear, True,
        )  # fmt: skip
    keep(memory)
    keep(before)
    keep(wanted)
    keep(pushes)
    keep(every)
    keep(each)
    return status, done


@compiled
def begin_rows(p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> None:
    """Makes a run's begin ready for `rows_between`."""
    set_timing(p, e, step, work)
    if e is not None:
        look_at(e, state, work)
        set_added_reading(p, e, state, work)


@compiled
def rows_between(
    stop: EndStop | None, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, reach: float,
    commands: Rows, disturbance: Rows, n_sample: int, begin: int, end: int, step: float, n_sub: int, table: Rows,
    linear: bool, whole: bool,
) -> tuple[int, int]:  # fmt: skip
    """(status, samples done) of the time loop of `run` from the sample `begin` to `end` of n_sample, for one run or for
    lanes, the first into the first N_OUT rows of `table`; beyond `reach` (m) a lane ends. Commands (2 n_sample rows,
    those of a sample behind each other) and disturbance are those of all lanes, or of each. Not `whole`, rows are
    without flux linkages, slopes of currents and limits reached."""
    status, done = OK, begin
    while done < end and status == OK:
        row = (done - begin) * N_OUT
        inside = write_row(cells, p, e, state, work, table, row, whole)
        if width(state) == 1 and not every(inside):
            status = OUTSIDE_TABLE
        else:
            for n in range(4 if whole else 0):
                table[row + OUT_AT_CURRENT_LIMIT_1 + n] = 0.0 - state[AT_CURRENT_LIMIT_1 + n]
            now, push = 2 * done, disturbance[done]
            ahead = now + 2 if linear and done + 1 < n_sample else now
            status = _hold(
                stop, cells, p, e, state, work, reach, commands, now, ahead, push, step, n_sub, linear, whole
            )
            for n in range(4 if whole else 0):
                limit = row + OUT_AT_CURRENT_LIMIT_1 + n
                table[limit] = table[limit] + state[AT_CURRENT_LIMIT_1 + n]
            for j in range(2):
                table[row + OUT_VOLTAGE_1 + j] = work[MEAN_VOLTAGE_1 + j]
                table[row + OUT_SLOPE_AFTER_1 + j] = state[COIL_START_1 + j]
                table[row + OUT_SLOPE_BEFORE_1 + j] = state[COIL_SLOPE_1 + j]
        done += status == OK
    return status, done


@compiled
def _hold(
    stop: EndStop | None, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, reach: float,
    commands: Rows, now: int, ahead: int, disturbance: Value, step: float, n_step: int, linear: bool, whole: bool,
) -> int:  # fmt: skip
    """A disturbance held over n_step steps and the command `now` that is held, or `linear` on its way to the one
    `ahead`: `advance`, for one run or for lanes."""
    alone = width(state) == 1
    state[VOLT_SECONDS_1] = 0.0
    state[VOLT_SECONDS_2] = 0.0
    work[LIMITED_1] = 0.0
    work[LIMITED_2] = 0.0
    good = take_command(p, state, work, commands, now, ahead)
    status = NOT_FINITE if alone and not every(good) else OK
    ideal = np.isinf(first(p.bandwidth if e is None else e[electrical.BANDWIDTH]))
    if status == OK and e is not None:
        queue_command(e, state, work, linear)
    if status == OK and ideal and (e is None or p.drive == CURRENT_DRIVE):
        look_at(e, state, work)
        inside = jump(cells, p, e, state, work)
        status = OUTSIDE_TABLE if alone and not every(inside) else OK
    push, part = disturbance + p.constant_force, 1.0 / n_step
    set_ramps(p, e, work, n_step * step)
    done = 0
    while done < n_step and status == OK:
        if e is None:
            set_inputs(p, state, work, push, done * part, part)
        else:
            set_inputs_with_effects(p, e, state, work, push, done, part, step, linear)
        status = _step(stop, cells, p, e, state, work, reach, step)
        if status == OK:
            if e is not None and done == 0:
                state[COIL_START_1] = work[SLOPES + I1]
                state[COIL_START_2] = work[SLOPES + I2]
            done += 1
    work[STEPS_DONE] = 1.0 * done
    for j in range(2):
        voltage = state[VOLT_SECONDS_1 + j] / (max(done, 1) * step) + 0.0 * state[X]  # nan where a lane has ended
        work[MEAN_VOLTAGE_1 + j] = voltage
        if p.drive == CURRENT_DRIVE:
            unheeded = choose(size(voltage) > p.voltage_limit, 1.0, 0.0) if ideal else work[LIMITED_1 + j]
            count(state, AT_VOLTAGE_LIMIT_1 + j, unheeded > 0.0)
    if e is not None and (whole or settles(e)):
        if status == OK:
            settle(cells, p, e, state, work)
    else:
        state[COIL_1], state[COIL_2] = state[I1], state[I2]
    return status


@compiled
def _step(
    stop: EndStop | None, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, reach: float, step: float
) -> int:
    """OK and a step taken, or why it cannot be; then the state is that of the last good step."""
    if stop is None:
        status = _outcome(p, work, reach, try_step(cells, p, e, state, work, step))
        if status == OK:
            keep_step(p, e, state, work)
        return status
    else:
        bandwidth = p.sensor_bandwidth if e is None else e[sensing.SENSOR_BANDWIDTH]
        inside = step_with_stop(stop, cells, p, e, state, work, step, bandwidth)
        return _outcome(p, work, reach, inside)


@compiled
def _outcome(p: PlantParameters, work: Rows, reach: float, inside: Flag) -> int:
    """Why a step of one run to Y cannot stand, or OK; of lanes always OK, those that cannot go on are nan in Y."""
    near = size(work[Y + X]) <= p.travel
    if width(work) == 1:
        for n in range(N_INTEGRATED):
            if not every(work[Y + n] - work[Y + n] == 0.0):
                return NOT_FINITE
        if not every(inside):
            return OUTSIDE_TABLE
        return OK if every(near) else OUTSIDE_RANGE
    stands = inside & near & (size(work[Y + X]) <= reach)
    if not every(stands):
        work[Y + X] = choose(stands, work[Y + X], np.nan)
    return OK


@compiled
def settle(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Moves the memory of iron and friction to the state, and finds the coils' currents there."""
    look_at(e, state, work)
    slopes(cells, p, e, state, work, 0, 2, True)
    state[ADDED_READING] = work[LAW_READING]
    for j in range(p.sides):
        state[COIL_1 + j] = work[CIRCUIT_1 + j * N_CIRCUIT + COIL_CURRENT]
        state[COIL_SLOPE_1 + j] = work[SLOPES + I1 + j]


@compiled
def settles(e: Rows) -> bool:
    """Whether anything of a state is found by `settle` alone, in one lane at least: a memory of iron or friction, coil
    currents that are not the magnetising ones, what laws add to a reading."""
    iron = e[magnetic.HYSTERESIS_SLOPE] + e[magnetic.IRON_LOW] + e[magnetic.IRON_KNEE]
    remanent = size(e[stray_flux.REMANENT_1]) + size(e[stray_flux.REMANENT_2])
    eddies = e[magnetic.EDDY] + e[magnetic.EDDY_MODE] + size(e[magnetic.SHARE])
    friction = e[mechanical.FRICTION_SLOPE] + e[mechanical.SMOOTH_FRICTION]
    return some(iron + remanent + eddies + friction + e[expressions.LAWS] > 0.0)


@compiled
def write_row(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, row: Rows, start: int, whole: bool
) -> Flag:  # fmt: skip
    """The state before a command acts into the columns of a row from `start`; False outside the table, if that is
    looked for: in a `whole` row, with flux linkages."""
    x, v = seen(e, state, 0)
    bandwidth = p.sensor_bandwidth if e is None else e[sensing.SENSOR_BANDWIDTH]
    for n in range(N_OUT if whole else 0):
        row[start + n] = 0.0
    row[start + OUT_I1], row[start + OUT_I2] = state[COIL_1], state[COIL_2]
    row[start + OUT_X], row[start + OUT_V], row[start + OUT_SENSOR] = (
        state[X],
        state[V],
        state[SENSOR] + state[ADDED_READING],
    )
    lags = bandwidth < np.inf
    row[start + OUT_SENSOR_SLOPE] = choose(lags, choose(lags, bandwidth, 0.0) * (x - state[SENSOR]), v)
    inside = x == x
    if not whole:
        return inside
    look_at(e, state, work)
    if p.sides == 2:
        inside = set_mutual_flux(cells, p, e, work, state[I1], state[I2])
    for j in range(p.sides):
        found, flux, _ = side_flux(cells, p, e, work, j, state[I1 + j], side_gap(p, e, work, j))
        inside = inside & found
        if p.sides == 2:
            flux = flux + work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
        row[start + OUT_FLUX_1 + j] = row[start + OUT_FLUX_1 + j] + flux
        if e is not None:
            row[start + OUT_FLUX_1 + 1 - j] = row[start + OUT_FLUX_1 + 1 - j] + e[magnetic.SHARE] * flux
    return inside
