"""One step of the coupled model.

The classical Runge-Kutta scheme with a fixed step (Hairer, Norsett, Wanner, Solving ODEs I, II.1), of order 4 where the
right-hand side is smooth. Commands are held over a call of `advance`, so their jumps fall between steps. The drive's
voltage limit is a kink of the right-hand side: a step in which the limit begins or ceases to act errs by O(step^2)
in the current, once for each such event, and by O(step^3) in the velocity. So it is with a stop of friction or
hysteresis that begins or ceases to slide.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, first, fma, some
from msl_fem.plant.cell import Cells
from msl_fem.plant.coefficients import EDDY_MODE, MODE_READING
from msl_fem.plant.effect_rates import rates_with_effects
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.rates import rates
from msl_fem.plant.state import (
    EDDY_FLUX_1,
    HELD,
    MODE,
    MODE_RATE,
    N_INTEGRATED,
    N_PLAIN,
    OUTPUT_1,
    PHASE_COSINE,
    SENSOR,
    SLEW_1,
    V,
    X,
)
from msl_fem.plant.work import (
    INPUTS,
    N_INPUT,
    OUTPUT_OF_1,
    PHASE_COSINE_END,
    SENSOR_WEIGHTS,
    SLEW_END_1,
    SLOPES,
    Y,
)


@compiled
def slopes(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, stage: int, instant: int) -> Flag:
    """The slopes of `stage` (0 to 3) at Y, under the inputs of begin, middle or end (0, 1, 2); False outside the table.

    A mover that lies on an end stop does not move.
    """
    dy, inputs = SLOPES + stage * N_INTEGRATED, INPUTS + instant * N_INPUT
    if e is None:
        inside = rates(cells, p, work, inputs, dy)
    else:
        inside = rates_with_effects(cells, p, e, state, work, inputs, dy, stage == 0)
    if first(state[HELD]) != 0.0:
        work[dy + MODE_RATE] = work[dy + MODE_RATE] + work[dy + V]
        work[dy + X] = 0.0
        work[dy + V] = 0.0
    return inside


@compiled
def look_at(e: Rows, state: Rows, work: Rows) -> None:
    """Puts the state into Y."""
    for n in range(integrated(e)):
        work[Y + n] = state[n]


@compiled
def integrated(e: Rows) -> int:
    """How many states Runge-Kutta integrates."""
    if e is None:
        return N_PLAIN
    else:
        return N_INTEGRATED if some(e[EDDY_MODE] > 0.0) else EDDY_FLUX_1


@compiled
def try_step(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> Flag:
    """The integrated states after one step into Y; False where a stage left the table."""
    n_integrated = integrated(e)
    look_at(e, state, work)
    inside = state[X] == state[X]
    for stage in range(4):
        if stage > 0:
            share = step if stage == 3 else 0.5 * step
            before = SLOPES + (stage - 1) * N_INTEGRATED
            for n in range(n_integrated):
                work[Y + n] = fma(share, work[before + n], state[n])
        inside = inside & slopes(cells, p, e, state, work, stage, (stage + 1) // 2)
    for n in range(n_integrated):
        k = SLOPES + n
        middle = work[k + N_INTEGRATED] + work[k + 2 * N_INTEGRATED]
        together = work[k] + 2.0 * middle + work[k + 3 * N_INTEGRATED]
        work[Y + n] = fma(step / 6.0, together, state[n])
    return inside


@compiled
def keep_step(p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Makes Y the state, and carries on what is known in closed form: sensor, drive, periodic force."""
    x_0, v_0 = seen(e, state, 0)
    x_1, v_1 = seen(e, work, Y)
    sensor = work[SENSOR_WEIGHTS] * state[SENSOR]
    sensor = sensor + work[SENSOR_WEIGHTS + 1] * x_0 + work[SENSOR_WEIGHTS + 2] * v_0
    state[SENSOR] = sensor + (work[SENSOR_WEIGHTS + 3] * x_1 + work[SENSOR_WEIGHTS + 4] * v_1)
    for n in range(integrated(e)):
        state[n] = work[Y + n]
    for j in range(2):
        state[OUTPUT_1 + j] = work[INPUTS + 2 * N_INPUT + OUTPUT_OF_1 + j]
    if e is not None:
        for j in range(4):
            state[SLEW_1 + j] = work[SLEW_END_1 + j]
        for j in range(2):
            state[PHASE_COSINE + j] = work[PHASE_COSINE_END + j]


@compiled
def seen(e: Rows, rows: Rows, y: int) -> tuple[Value, Value]:
    """Position and velocity (m, m/s) that the position sensor looks at: the armature's, or the load's."""
    if e is None:
        return rows[y + X], rows[y + V]
    else:
        share = e[MODE_READING]
        return rows[y + X] + share * rows[y + MODE], rows[y + V] + share * rows[y + MODE_RATE]
