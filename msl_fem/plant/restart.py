"""A run put to another start on its way, its history kept: what the next stretch of a record begins from."""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, Value, choose, exponential, size, some
from msl_fem.plant.effects import magnetic, mechanical, stray_flux
from msl_fem.plant.effects.electrical import N_QUEUE
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.equations import taken_by_iron
from msl_fem.plant.layout import (
    ANCHOR_X,
    CIRCUIT_1,
    COIL_1,
    COIL_2,
    CREEP,
    EDDY_FLUX_1,
    HELD,
    I1,
    KNOWN_1,
    KNOWN_FLUX,
    KNOWN_MEMORY,
    KNOWN_VALUE,
    LAG_1,
    LAG_2,
    MODE_FOLLOWS_NOW,
    N_CIRCUIT,
    N_KNOWN,
    N_STATE,
    OUTPUT_1,
    OUTPUT_2,
    PHASE_COSINE,
    PHASE_SINE,
    QUEUE_1,
    QUEUE_2,
    SENSOR,
    SHARED_FLUX,
    SLEW_1,
    SLEW_2,
    SLOW_CREEP,
    V,
    X,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.side import Cells, side_gap, side_with_effects
from msl_fem.plant.step import look_at

_ITERATIONS = 3
_OF_TIME = np.zeros(N_STATE, dtype=bool)
"""Rows that time and commands alone move."""
_OF_TIME[[PHASE_COSINE, PHASE_SINE, OUTPUT_1, OUTPUT_2, SLEW_1, SLEW_2, LAG_1, LAG_2]] = True
for _begin in (QUEUE_1, QUEUE_2):
    _OF_TIME[_begin : _begin + N_QUEUE + 1] = True


@compiled
def restart(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, kept: Rows, starts: Rows, work: Rows, length: float
) -> None:  # fmt: skip
    """Puts a state (N_STATE rows) to a start (4 rows), `length` seconds behind the one before: currents, position,
    velocity.

    Where a stretch has left table or range, its state is taken from `kept`, the state at the begin of that stretch;
    phases and commands that wait have gone on. Sensor and friction's memory are moved with the position, for which that
    is no motion; magnetising currents with those of the coils. Eddy currents and a flexure's relaxation go on as if
    what flux linkage and position were off had grown evenly since the start before: fast ones have followed it, slow
    ones hardly have.
    """
    known = state[X] + state[V] + state[COIL_1] + state[COIL_2]
    stands = known - known == 0.0
    for n in range(N_STATE):
        value = choose(stands, state[n], kept[n])
        if _OF_TIME[n]:
            value = choose(state[n] - state[n] == 0.0, state[n], value)
        state[n] = value
    if e is not None:
        _keep_currents(cells, p, e, state, work, length)
    first, second = starts[0] - state[COIL_1], starts[1] - state[COIL_2]
    for side in range(2):
        own, other = (first, second) if side == 0 else (second, first)
        by = own
        if e is not None:
            by = own + e[magnetic.SHARE] * other
        state[I1 + side] = state[I1 + side] + by
        state[COIL_1 + side] = state[COIL_1 + side] + own
        work[KNOWN_1 + side * N_KNOWN + KNOWN_VALUE] = work[KNOWN_1 + side * N_KNOWN + KNOWN_VALUE] + by
    by = starts[2] - state[X]
    state[SENSOR] = state[SENSOR] + by
    state[ANCHOR_X] = state[ANCHOR_X] + by
    if e is not None:
        state[CREEP] = state[CREEP] + _followed(e[mechanical.CREEP_RATE] * length) * by
        state[SLOW_CREEP] = state[SLOW_CREEP] + _followed(e[mechanical.SLOW_CREEP_RATE] * length) * by
    state[X] = starts[2]
    state[V] = starts[3]
    state[HELD] = 0.0
    if e is not None:
        _carry_currents(cells, p, e, state, work)


@compiled
def _followed(z: Value) -> Value:
    """Which share of a quantity that rose evenly its lag of the rate r has followed, z = r times the time that it took:
    y' = r (s/time - y) ends at 1 - (1 - exp(-z))/z."""
    lags = z > 0.0
    return choose(lags, 1.0 - (1.0 - exponential(0.0 - z)) / choose(lags, z, 1.0), 0.0)


@compiled
def _keep_currents(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, length: float) -> None:
    """Flux linkages (Wb) and currents with what iron takes of them (A) before a state is moved; and which share of a
    flux linkage that was reached evenly within `length` seconds the modes of eddy currents follow."""
    if not _iron_takes(e):
        return
    _look(cells, p, e, state, work)
    for k in range(N_EDDY):
        work[MODE_FOLLOWS_NOW + k] = _followed(e[magnetic.EDDY_RATE + k] * length)
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        flux, _ = _linkage(cells, p, e, state, work, j)
        work[row + KNOWN_FLUX] = flux
        work[row + KNOWN_MEMORY] = _taken(e, state, work, j, flux)
        work[row + KNOWN_VALUE] = state[I1 + j] + work[row + KNOWN_MEMORY]


@compiled
def _carry_currents(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Magnetising currents are what iron leaves of the coils': Newton's iteration, with the chord from the flux linkage
    before. The modes of eddy currents are moved by their share of what the flux linkage is moved by."""
    if not _iron_takes(e):
        return
    for _ in range(_ITERATIONS):
        _look(cells, p, e, state, work)
        for j in range(p.sides):
            row = KNOWN_1 + j * N_KNOWN
            flux, inductance = _linkage(cells, p, e, state, work, j)
            taken, moved = _taken(e, state, work, j, flux), flux - work[row + KNOWN_FLUX]
            missed = state[I1 + j] + taken - work[row + KNOWN_VALUE]
            moves = size(moved) > 0.0
            stiff = choose(moves, (taken - work[row + KNOWN_MEMORY]) / choose(moves, moved, 1.0), 0.0)
            state[I1 + j] = state[I1 + j] - missed / (1.0 + inductance * stiff)
    _look(cells, p, e, state, work)
    for j in range(p.sides):
        moved = _linkage(cells, p, e, state, work, j)[0] - work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX]
        for k in range(N_EDDY):
            row = EDDY_FLUX_1 + j * N_EDDY + k
            state[row] = state[row] + work[MODE_FOLLOWS_NOW + k] * moved
    for k in range(N_EDDY):
        work[MODE_FOLLOWS_NOW + k] = 0.0


@compiled
def _iron_takes(e: Rows) -> bool:
    """Whether a part of any coil's current goes with its flux linkage."""
    return (
        some(e[magnetic.EDDY_MODE] > 0.0)
        or some(e[magnetic.HYSTERESIS_SLOPE] > 0.0)
        or some(e[magnetic.IRON_LOW] + e[magnetic.IRON_KNEE] > 0.0)
        or some(size(e[stray_flux.REMANENT_1]) + size(e[stray_flux.REMANENT_1 + 1]) > 0.0)
    )


@compiled
def _look(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """The state into Y, and what the sides have in common there."""
    look_at(e, state, work)
    if p.sides == 2:
        set_mutual_flux(cells, p, e, work, state[I1], state[I1 + 1])


@compiled
def _linkage(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int) -> tuple[Value, Value]:
    """(flux linkage in Wb, incremental inductance in H) of side j."""
    _, _, inductance, _, flux, _ = side_with_effects(cells, p, e, work, j, state[I1 + j], side_gap(p, e, work, j))
    if p.sides == 2:
        flux = flux + work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
    return flux, inductance


@compiled
def _taken(e: Rows, state: Rows, work: Rows, j: int, flux: Value) -> Value:
    """The current (A) that the iron of side j takes at a flux linkage, which the modes of its eddy currents follow from
    the one that is kept."""
    moved = flux - work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX]
    taken = taken_by_iron(e, state, j, flux, False)
    for k in range(N_EDDY):
        behind = flux - work[MODE_FOLLOWS_NOW + k] * moved - state[EDDY_FLUX_1 + j * N_EDDY + k]
        taken = taken + e[magnetic.EDDY_MODE + k] * behind
    return taken
