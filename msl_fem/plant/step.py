"""One step of the coupled model, and the step in which the mover meets an end stop.

The classical Runge-Kutta scheme with a fixed step (Hairer, Norsett, Wanner, Solving ODEs I, II.1), of order 4 where the
right-hand side is smooth. Commands are held over a call of `advance`, so their jumps fall between steps. The drive's
voltage limit is a kink of the right-hand side: a step in which the limit begins or ceases to act errs by O(step^2)
in the current, once for each such event, and by O(step^3) in the velocity. So it is with a stop of friction or
hysteresis that begins or ceases to slide.

End stops: the instant of contact is found within the step (the step is cut there); the velocity turns round and is
multiplied by the coefficient of restitution (Newton; Goldsmith, Impact, 1960, ch. 2). A mover that would be back before
the step's time has passed once more, accelerated as it is, comes to rest on the stop, until the forces pull it off.
"""

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, first, fma, lane_of, size, some, width
from msl_fem.plant.effects import magnetic, mechanical, sensing
from msl_fem.plant.equations import gives_way, rates, rates_with_effects, warms
from msl_fem.plant.fast_loop import (
    begin_corners,
    end_known_currents,
    is_fast,
    keep_begin,
    keep_corner_slopes,
    put_corner_currents,
    put_known_currents,
    set_aside_limits,
    set_known_currents,
)
from msl_fem.plant.layout import (
    COIL_READING,
    COIL_READING_SLOPE,
    COIL_READING_WEIGHTS,
    ENERGY_IMPACT,
    HELD,
    I1,
    INPUTS_BEGIN,
    LIMITED_1,
    MODE,
    MODE_RATE,
    N_INPUT,
    N_INTEGRATED,
    N_MOVING,
    N_OF_EFFECTS,
    N_PLAIN,
    OUTPUT_1,
    OUTPUT_END_1,
    PHASE_COSINE,
    PHASE_COSINE_END,
    SENSOR,
    SENSOR_WEIGHTS,
    SLEW_1,
    SLEW_END_1,
    SLOPES,
    SLOPES_2,
    SLOPES_3,
    SLOPES_4,
    V,
    X,
    Y,
)
from msl_fem.plant.plant import EndStop, PlantParameters
from msl_fem.plant.poles import lag_weights
from msl_fem.plant.side import Cells

MOST_IMPACTS = 50  # in one step; the last one ends at rest
_CORNERS = 3  # iterations, each of which leaves R/(w L) of the error before


@compiled
def slopes(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, stage: int, instant: int, settle: bool
) -> Flag:  # fmt: skip
    """The slopes of `stage` (0 to 3) at Y, under the inputs of begin, middle or end (0, 1, 2); False outside the table.

    With `settle` the memory of iron and friction is moved to Y. A mover that lies on an end stop does not move.
    """
    dy, inputs = SLOPES + stage * N_INTEGRATED, INPUTS_BEGIN + instant * N_INPUT
    if e is None:
        inside = rates(cells, p, work, inputs, dy)
    else:
        inside = rates_with_effects(cells, p, e, state, work, inputs, dy, settle)
    if first(state[HELD]) != 0.0:
        work[dy + MODE_RATE] = work[dy + MODE_RATE] + work[dy + V]
        work[dy + X] = 0.0
        work[dy + V] = 0.0
    return inside


@compiled
def look_at(e: Rows, state: Rows, work: Rows) -> None:
    """Puts the state into Y."""
    for n in range(moving(e)):
        work[Y + n] = state[n]
    for n in range(first_energy(state), N_INTEGRATED):
        work[Y + n] = state[n]


@compiled
def moving(e: Rows) -> int:
    """How many of the first states Runge-Kutta integrates, beside energies: those that move in one lane at least."""
    if e is None:
        return N_PLAIN
    else:
        if some(e[magnetic.EDDY_MODE] > 0.0):
            return N_MOVING
        reads = some(size(e[sensing.COIL_READING_1]) + size(e[sensing.COIL_READING_2]) > 0.0)
        return N_OF_EFFECTS if reads or warms(e) or gives_way(e) else N_PLAIN


@compiled
def first_energy(rows: Rows) -> int:
    """Where the states begin that are integrated to tell energies: of lanes none are."""
    return N_MOVING if width(rows) == 1 else N_INTEGRATED


@compiled
def _find_corners(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> Flag:
    """The slopes where voltage limits will cease to act, by fixed-point iteration; Y and its circuits are those of the
    step's begin, before and behind."""
    inside = state[X] == state[X]
    begin_corners(p, e, state, work)
    for _ in range(_CORNERS):
        put_corner_currents(p, state, work, step)
        inside = inside & slopes(cells, p, e, state, work, 3, 0, False)
        keep_corner_slopes(cells, p, e, state, work)
    look_at(e, state, work)
    return inside & slopes(cells, p, e, state, work, 0, 0, False)


@compiled
def try_step(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> Flag:
    """The integrated states after one step into Y; False where a stage left the table."""
    n_moving, energies = moving(e), first_energy(state)
    look_at(e, state, work)
    inside = state[X] == state[X]
    fast = is_fast(p, e, step)
    if fast:
        set_aside_limits(work)
        inside = inside & slopes(cells, p, e, state, work, 0, 0, True)
        keep_begin(cells, p, e, state, work, step)
        if some(work[LIMITED_1] + work[LIMITED_1 + 1] > 0.0):
            inside = inside & _find_corners(cells, p, e, state, work, step)
        set_known_currents(cells, p, e, state, work, step)
    for stage in range(4):
        if stage > 0:
            share = step if stage == 3 else 0.5 * step
            before = SLOPES + (stage - 1) * N_INTEGRATED
            for n in range(n_moving):
                work[Y + n] = fma(share, work[before + n], state[n])
        if fast:
            put_known_currents(p, e, state, work, (stage + 1) // 2)
        inside = inside & slopes(cells, p, e, state, work, stage, (stage + 1) // 2, stage == 0 and not fast)
    _sum_stages(state, work, step, 0, n_moving)
    _sum_stages(state, work, step, energies, N_INTEGRATED)
    if fast:
        inside = inside & end_known_currents(cells, p, e, state, work)
    return inside


@compiled
def _sum_stages(state: Rows, work: Rows, step: float, begin: int, end: int) -> None:
    """States from `begin` to `end` behind a step into Y, by the slopes of its stages."""
    for n in range(begin, end):
        middle = work[SLOPES_2 + n] + work[SLOPES_3 + n]
        together = work[SLOPES + n] + 2.0 * middle + work[SLOPES_4 + n]
        work[Y + n] = fma(step / 6.0, together, state[n])


@compiled
def keep_step(p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Makes Y the state, and carries on what is known in closed form: sensor, drive, periodic force."""
    if e is not None:
        _carry_coil_reading(e, state, work)
    x_0, v_0 = seen(e, state, 0)
    x_1, v_1 = seen(e, work, Y)
    sensor = work[SENSOR_WEIGHTS] * state[SENSOR]
    sensor = sensor + work[SENSOR_WEIGHTS + 1] * x_0 + work[SENSOR_WEIGHTS + 2] * v_0
    state[SENSOR] = sensor + (work[SENSOR_WEIGHTS + 3] * x_1 + work[SENSOR_WEIGHTS + 4] * v_1)
    for n in range(moving(e)):
        state[n] = work[Y + n]
    for n in range(first_energy(state), N_INTEGRATED):
        state[n] = work[Y + n]
    for j in range(2):
        state[OUTPUT_1 + j] = work[OUTPUT_END_1 + j]
    if e is not None:
        for j in range(4):
            state[SLEW_1 + j] = work[SLEW_END_1 + j]
        for j in range(2):
            state[PHASE_COSINE + j] = work[PHASE_COSINE_END + j]


@compiled
def _carry_coil_reading(e: Rows, state: Rows, work: Rows) -> None:
    """Puts what the sensor sees of the coils' field at the step's begin and end, and its slopes, into state and Y:
    its lag's answer to a cubic through the currents and their slopes."""
    first_side, second_side = e[sensing.COIL_READING_1], e[sensing.COIL_READING_2]
    if not (some(size(first_side) > 0.0) or some(size(second_side) > 0.0)):
        return
    weights, rate = COIL_READING_WEIGHTS, e[sensing.COIL_READING_RATE]
    begin = first_side * state[I1] + second_side * state[I1 + 1]
    rise = first_side * work[SLOPES + I1] + second_side * work[SLOPES + I1 + 1]
    end = first_side * work[Y + I1] + second_side * work[Y + I1 + 1]
    last = first_side * work[SLOPES_4 + I1] + second_side * work[SLOPES_4 + I1 + 1]
    lags = rate < np.inf
    slow = choose(lags, rate, 0.0)
    state[COIL_READING] = choose(lags, state[COIL_READING], begin)
    before = state[COIL_READING]
    after = work[weights] * before + work[weights + 1] * begin + work[weights + 2] * rise
    after = after + (work[weights + 3] * end + work[weights + 4] * last)
    state[COIL_READING_SLOPE] = choose(lags, slow * (begin - before), rise)
    work[Y + COIL_READING] = after
    work[Y + COIL_READING_SLOPE] = choose(lags, slow * (end - after), last)


@compiled
def seen(e: Rows, rows: Rows, y: int) -> tuple[Value, Value]:
    """Position and velocity (m, m/s) that the position sensor looks at: the armature's, or the load's, with what it
    sees of the coils' field."""
    if e is None:
        return rows[y + X], rows[y + V]
    else:
        share = e[mechanical.MODE_READING]
        x, v = rows[y + X] + share * rows[y + MODE], rows[y + V] + share * rows[y + MODE_RATE]
        return x + rows[y + COIL_READING], v + rows[y + COIL_READING_SLOPE]


@compiled
def step_with_stop(
    stop: EndStop, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float,
    sensor_bandwidth: float,
) -> bool:  # fmt: skip
    """Takes one step from `state`, which is carried to its end, through all impacts; False outside the table."""
    _release(cells, p, e, state, work)
    inside = try_step(cells, p, e, state, work, step)
    if inside and abs(work[Y + X]) <= stop.position:
        keep_step(p, e, state, work)
        return True
    kept = np.empty(3 * N_INPUT)
    for n in range(3 * N_INPUT):
        kept[n] = work[INPUTS_BEGIN + n]
    done, impacts = 0.0, 0
    inside = True
    while inside and done < 1.0:
        part = 1.0 - done
        inside = _part(cells, p, e, state, work, kept, done, part, step)
        if not inside or abs(work[Y + X]) > stop.position:
            side = np.sign(work[Y + X] if inside else state[V])
            part = _contact(stop, cells, p, e, state, work, kept, done, part, step, side)
            inside = part >= 0.0
            impacts += 1
        if inside:
            _set_sensor_weights(e, work, sensor_bandwidth, part * step)
            keep_step(p, e, state, work)
            if abs(state[X]) >= stop.position and state[HELD] == 0.0:
                _bounce(stop, cells, p, e, state, work, step, impacts >= MOST_IMPACTS)
            done = done + part if part < 1.0 - done else 1.0
    _set_sensor_weights(e, work, sensor_bandwidth, step)
    return inside


@compiled
def _set_sensor_weights(e: Rows, work: Rows, bandwidth: float, step: float) -> None:
    """Weights of the position sensor's lag, and of the coils' field on its way there, for a step of that length."""
    lag_weights(bandwidth, step, work, SENSOR_WEIGHTS, 0)
    if e is not None:
        lag_weights(lane_of(e, sensing.COIL_READING_RATE, 0), step, work, COIL_READING_WEIGHTS, 0)


@compiled
def _part(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, kept: Array, done: float, part: float,
    step: float,
) -> bool:  # fmt: skip
    """A trial over `part` of the step after `done` of it; inputs are those of the whole step, a parabola each."""
    for n in range(N_INPUT):
        a, middle, end = kept[n], kept[N_INPUT + n], kept[2 * N_INPUT + n]
        b, curvature = 4.0 * middle - 3.0 * a - end, 2.0 * (a - 2.0 * middle + end)
        for k in range(3):
            s = done + 0.5 * k * part
            work[INPUTS_BEGIN + k * N_INPUT + n] = a + s * (b + s * curvature)
    return try_step(cells, p, e, state, work, part * step)


@compiled
def _contact(
    stop: EndStop, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, kept: Array, done: float,
    part: float, step: float, side: float,
) -> float:  # fmt: skip
    """The part of the step after which the mover touches its stop on that side, and Y there; -1 if it never does.

    Newton's iteration, kept between a share that does not reach the stop and one that does, or that leaves the table.
    """
    low, high = 0.0, part
    share = part * 0.5
    for _ in range(200):
        inside = _part(cells, p, e, state, work, kept, done, share, step)
        beyond = side * work[Y + X] - stop.position
        if inside and (abs(beyond) <= 1e-14 * stop.position or high - low <= 1e-15):
            work[Y + X] = side * stop.position
            return share
        if not inside or beyond > 0.0:
            high = share
        else:
            low = share
        share -= beyond / (side * work[Y + V] * step)
        if not (inside and low < share < high):
            share = 0.5 * (low + high)
    return -1.0


@compiled
def _bounce(
    stop: EndStop, cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float, last: bool
) -> None:  # fmt: skip
    """Turns the velocity round at the stop, or ends it there, and writes the energy down."""
    before, mass = state[V], p.mass
    after = -stop.restitution * before
    look_at(e, state, work)
    slopes(cells, p, e, state, work, 0, 2, True)
    outward = work[SLOPES + V] * np.sign(state[X])
    if last or (outward > 0.0 and 2.0 * abs(after) < outward * step):
        after = 0.0
        state[HELD] = np.sign(state[X])
    if e is not None:
        mass *= e[mechanical.MODE_KEPT]
        state[MODE_RATE] += before - after  # the second mass goes on as it went
    state[V] = after
    state[ENERGY_IMPACT] += 0.5 * mass * (before * before - after * after)


@compiled
def _release(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Lets a mover go that nothing presses to its stop any more."""
    if state[HELD] != 0.0:
        side = state[HELD]
        state[HELD] = 0.0
        look_at(e, state, work)
        slopes(cells, p, e, state, work, 0, 0, True)
        if work[SLOPES + V] * side > 0.0:
            state[HELD] = side
