"""Laws that users state, where the equations of motion and the position sensor call them.

A law of voltage sees the current that its coil has without eddy currents in a shorted winding, laws of force and
reading the coil's own. Without declared laws nothing is computed and nothing added.
"""

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, Value, keep, rows_of, some
from msl_fem.plant.effects import magnetic
from msl_fem.plant.effects.expressions import (
    LAW_FORCE,
    LAW_G1,
    LAW_I1,
    LAW_READING,
    LAW_V,
    LAW_X,
    LAWS,
    motion_laws,
    voltage_laws,
)
from msl_fem.plant.layout import (
    ADDED_READING,
    CIRCUIT_1,
    COIL_1,
    COIL_CURRENT,
    MMF,
    N_CIRCUIT,
    V,
    X,
    Y,
    workspace,
)
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.side import side_gap


@compiled
def add_law_voltages(p: PlantParameters, e: Rows, work: Rows) -> None:
    """Voltages (V) of the sides at Y into their rows; the circuits' rows hold u + h + G e."""
    if some(e[LAWS] > 0.0):
        _put_motion(p, e, work)
        share, unmix = e[magnetic.SHARE], e[magnetic.UNMIX]
        for j in range(p.sides):
            own, other = work[CIRCUIT_1 + j * N_CIRCUIT + MMF], work[CIRCUIT_1 + (1 - j) * N_CIRCUIT + MMF]
            work[LAW_I1 + j] = unmix * (own - share * other)
        voltage_laws(e, work)


@compiled
def law_force(p: PlantParameters, e: Rows, work: Rows) -> Value:
    """The force along +x (N) of users' laws at Y, with the coils' currents that the circuits' rows hold."""
    if not some(e[LAWS] > 0.0):
        return work[Y + X] - work[Y + X]
    _put_motion(p, e, work)
    for j in range(p.sides):
        work[LAW_I1 + j] = work[CIRCUIT_1 + j * N_CIRCUIT + COIL_CURRENT]
    motion_laws(e, work)
    return work[LAW_FORCE]


@compiled
def set_added_reading(p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """What users' laws add to the position reading of a state into its row; Y is the state."""
    if some(e[LAWS] > 0.0):
        _put_motion(p, e, work)
        for j in range(p.sides):
            work[LAW_I1 + j] = state[COIL_1 + j]
        motion_laws(e, work)
        state[ADDED_READING] = work[LAW_READING]


@compiled
def begin_reading(p: PlantParameters, effects: Array, state: Array) -> None:
    """`set_added_reading` for the first state (N_STATE,) of a run."""
    memory = workspace()
    work, rows = rows_of(memory), rows_of(state)
    work[Y + X], work[Y + V] = rows[X], rows[V]
    set_added_reading(p, rows_of(effects), rows, work)
    keep(memory)


@compiled
def _put_motion(p: PlantParameters, e: Rows, work: Rows) -> None:
    work[LAW_X] = work[Y + X]
    work[LAW_V] = work[Y + V]
    for j in range(p.sides):
        work[LAW_G1 + j] = side_gap(p, e, work, j)
