"""End stops: the step in which the mover meets one, and the mover that lies on one.

The instant of contact is found within the step (the step is cut there); the velocity turns round and is multiplied by
the coefficient of restitution (Newton; Goldsmith, Impact, 1960, ch. 2). A mover that would be back before the step's
time has passed once more, accelerated as it is, comes to rest on the stop, until the forces pull it off.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows
from msl_fem.plant.cell import Cells
from msl_fem.plant.coefficients import MODE_KEPT
from msl_fem.plant.lag import lag_weights
from msl_fem.plant.plant import EndStop, PlantParameters
from msl_fem.plant.state import ENERGY_IMPACT, HELD, MODE_RATE, V, X
from msl_fem.plant.step import keep_step, look_at, slopes, try_step
from msl_fem.plant.work import INPUTS, N_INPUT, SENSOR_WEIGHTS, SLOPES, Y

Array = NDArray[np.float64]

MOST_IMPACTS = 50  # in one step; the last one ends at rest


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
        kept[n] = work[INPUTS + n]
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
            lag_weights(sensor_bandwidth, part * step, work, SENSOR_WEIGHTS)
            keep_step(p, e, state, work)
            if abs(state[X]) >= stop.position and state[HELD] == 0.0:
                _bounce(stop, cells, p, e, state, work, step, impacts >= MOST_IMPACTS)
            done = done + part if part < 1.0 - done else 1.0
    lag_weights(sensor_bandwidth, step, work, SENSOR_WEIGHTS)
    return inside


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
            work[INPUTS + k * N_INPUT + n] = a + s * (b + s * curvature)
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
    slopes(cells, p, e, state, work, 0, 2)
    outward = work[SLOPES + V] * np.sign(state[X])
    if last or (outward > 0.0 and 2.0 * abs(after) < outward * step):
        after = 0.0
        state[HELD] = np.sign(state[X])
    if e is not None:
        mass *= e[MODE_KEPT]
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
        slopes(cells, p, e, state, work, 0, 0)
        if work[SLOPES + V] * side > 0.0:
            state[HELD] = side
