"""Currents of a fast loop beside what iron takes of them: memory, iron in series, remanence.

The loop makes u' = w (target - i) of the magnetising current u; the coil's current is i = u + h with what iron takes,
h, a function of the flux linkage and so of u. Over a step of length 1 that is h_0 + m (u - u_0) + r(s): beside the
share m the loop's answer is one exponential, and what it answers to r, a parabola, is exact. In a step in which a
voltage limit acts, or beside eddy currents, m is the share over the way to the target, or from where the limit ceases
to act.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, every, exponential, larger, size, some
from msl_fem.plant.effects import electrical, magnetic
from msl_fem.plant.equations import hysteresis, series_iron, taken_by_iron
from msl_fem.plant.known_currents import put_fall, rates_together
from msl_fem.plant.layout import (
    CIRCUIT_1,
    I1,
    KNOWN_1,
    KNOWN_2,
    KNOWN_BEYOND,
    KNOWN_IRON,
    KNOWN_MEMORY,
    KNOWN_MISSING,
    KNOWN_MOVED,
    KNOWN_OF_IRON,
    KNOWN_TAKEN,
    KNOWN_TURN,
    LIMITED_1,
    MMF,
    N_CIRCUIT,
    N_KNOWN,
    SHARED_FLUX,
    V,
    X,
    Y,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.poles import fall_moments, falls_together, moments_together
from msl_fem.plant.sheet_modes import target_rise
from msl_fem.plant.side import Cells, side_flux, side_gap

_ITERATIONS = 5
_TRIALS = 2  # of the currents beside what iron takes: the first looks at the end alone
NO_WAY = 1e-12  # A


@compiled
def iron_takes(e: Rows) -> bool:
    """Whether memory or iron in series take part of a coil's current in one lane at least."""
    return some(has_iron(e))


@compiled
def has_iron(e: Rows) -> Flag:
    """Where memory or iron in series take part of a coil's current."""
    return e[magnetic.HYSTERESIS_SLOPE] + e[magnetic.IRON_LOW] + e[magnetic.IRON_KNEE] > 0.0


@compiled
def iron_alone(e: Rows, free: Flag) -> Flag:
    """Where no voltage limit acts, and no eddy currents are beside what iron takes."""
    return free & no_eddies(e)


@compiled
def no_eddies(e: Rows) -> Flag:
    return e[magnetic.EDDY] + e[magnetic.EDDY_MODE] == 0.0


@compiled
def with_memory(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, above: Value, free: Flag
) -> Value:  # fmt: skip
    """What the magnetising current of side j is above where it goes: there, memory and iron in series take another
    part of the coil's current than here. Fixed-point iteration; that part is a small share of the current."""
    row = KNOWN_1 + j * N_KNOWN + KNOWN_MEMORY
    work[row] = 0.0
    if not iron_takes(e) or every(iron_alone(e, free)):
        return above
    u, gap, moved = work[Y + I1 + j], side_gap(p, e, work, j), above
    taken = above - above
    for n in range(_ITERATIONS):
        inside, flux, _ = side_flux(cells, p, e, work, j, u if n == 0 else u - moved, gap)
        part = hysteresis(e, state, j, flux, False) + series_iron(e, flux)
        if n == 0:
            taken = part
        else:
            moved = choose(inside, above + (part - taken), moved)
    moves = size(moved) > NO_WAY
    work[row] = choose(moves, larger((above - moved) / choose(moves, moved, 1.0), 0.0), 0.0)
    side, limited = KNOWN_1 + j * N_KNOWN, (work[LIMITED_1 + j] > 0.0) & no_eddies(e)
    if some(limited):
        rest = u - moved - work[side + KNOWN_TURN]
        turns = limited & (size(rest) > NO_WAY)
        later = (0.0 - (above - moved) - work[side + KNOWN_TAKEN]) / choose(turns, rest, 1.0)
        work[row] = choose(turns, larger(later, 0.0), work[row])
    return moved


@compiled
def put_beside_iron(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, free: Flag, step: float
) -> None:  # fmt: skip
    """Into the rows of the sides their currents beside what iron takes, in lanes where that is alone.

    What it takes is h_0 + m (u - u_0) + r(s), m the slope from begin to end and r a parabola through what it takes
    beyond that at middle and end; to these the answer of the loops is exact. Iterated, from m = r = 0.
    """
    if not iron_takes(e):
        return
    where = iron_alone(e, free)
    for j in range(p.sides):
        where = where & (work[KNOWN_1 + j * N_KNOWN] > 0.0)
    if not some(where):
        return
    for j in range(p.sides):
        row, circuit = KNOWN_1 + j * N_KNOWN, CIRCUIT_1 + j * N_CIRCUIT
        for n in range(2):
            work[row + KNOWN_BEYOND + n] = 0.0
        work[row + KNOWN_MEMORY] = choose(where, 0.0, work[row + KNOWN_MEMORY])
        work[row + KNOWN_OF_IRON] = work[circuit + MMF] - state[I1 + j]
        work[row + KNOWN_IRON] = choose(where & has_iron(e), 1.0, 0.0)
    for n in range(_TRIALS):
        _answer_to_iron(p, e, state, work, where, step, False)
        _look_at_iron(cells, p, e, state, work, where, step, 1 + n)
    _answer_to_iron(p, e, state, work, where, step, True)


@compiled
def _look_at_iron(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, where: Flag, step: float, instants: int
) -> None:
    """What iron takes at the currents of that many instants, end and middle, and at gaps that change as at the begin,
    into the rows."""
    position = work[Y + X]
    for n in range(instants):
        at = 1 - n  # the end first, whose slope is that of the step
        work[Y + X] = position + (0.5 + 0.5 * at) * step * work[Y + V]
        if p.sides == 2:
            u_1 = state[I1] + work[KNOWN_1 + KNOWN_MOVED + at]
            set_mutual_flux(cells, p, e, work, u_1, state[I1 + 1] + work[KNOWN_2 + KNOWN_MOVED + at])
        for j in range(p.sides):
            row, moved = KNOWN_1 + j * N_KNOWN, work[KNOWN_1 + j * N_KNOWN + KNOWN_MOVED + at]
            inside, flux, _ = side_flux(cells, p, e, work, j, state[I1 + j] + moved, side_gap(p, e, work, j))
            if p.sides == 2:
                flux = flux + work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
            taken = taken_by_iron(e, state, j, flux, False)
            work[row + KNOWN_OF_IRON + 1 + at] = taken
            more = taken - work[row + KNOWN_OF_IRON]
            if at == 1:
                tells = where & inside & (moved * more > 0.0) & (size(moved) > NO_WAY)
                slope = more / choose(tells, moved, 1.0)
                work[row + KNOWN_MEMORY] = choose(tells & (slope < 1.0), slope, work[row + KNOWN_MEMORY])
            beyond = more - work[row + KNOWN_MEMORY] * moved
            work[row + KNOWN_BEYOND + at] = choose(where & inside, beyond, 0.0)
    work[Y + X] = position


@compiled
def _answer_to_iron(p: PlantParameters, e: Rows, state: Rows, work: Rows, where: Flag, step: float, put: bool) -> None:
    """How far the currents move up to middle and end beside what iron takes, into the rows of the sides; with `put`
    the currents themselves.

    u - u_0 = a + b s + c s^2 - exp(-Z s) a solves u' = Z_0 (target - u - taken), Z = Z_0 (1 + m).
    """
    second, alone = KNOWN_1 + (p.sides - 1) * N_KNOWN, e[electrical.BANDWIDTH] * step
    share_1, share_2 = 1.0 / (1.0 + work[KNOWN_1 + KNOWN_MEMORY]), 1.0 / (1.0 + work[second + KNOWN_MEMORY])
    z_11, z_12, z_21, z_22 = alone / share_1, alone - alone, alone - alone, alone / share_2
    if p.sides == 2:
        z_11, z_12, z_21, z_22 = rates_together(p, e, work, step)
    determinant = z_11 * z_22 - z_12 * z_21
    d_1, b_1, c_1 = _line(p, e, work, 0, share_1)
    d_2, b_2, c_2 = _line(p, e, work, p.sides - 1, share_2)
    b_1, b_2 = b_1 - 2.0 * (z_22 * c_1 - z_12 * c_2) / determinant, b_2 - 2.0 * (z_11 * c_2 - z_21 * c_1) / determinant
    away_1 = 0.0 - d_1 + (z_22 * b_1 - z_12 * b_2) / determinant
    away_2 = 0.0 - d_2 + (z_11 * b_2 - z_21 * b_1) / determinant
    faster, slower, (p_1, q_1, p_2, q_2) = falls_together((z_11, z_12, z_21, z_22), away_1, away_2)
    if put:
        none = slower - slower
        fast, slow = fall_moments(faster, none, 1.0 + none), fall_moments(slower, none, 1.0 + none)
        between = (1.0 - (fast[3] * slow[3])) / (faster + slower)
        put_fall(state, work, 0, where, away_1, b_1 + c_1, c_1, moments_together(fast, slow, between, p_1, q_1), step)
        if p.sides == 2:
            fall = moments_together(fast, slow, between, p_2, q_2)
            put_fall(state, work, 1, where, away_2, b_2 + c_2, c_2, fall, step)
    else:
        half_fast, half_slow = exponential(0.0 - 0.5 * faster), exponential(0.0 - 0.5 * slower)
        end_fast, end_slow = half_fast * half_fast, half_slow * half_slow
        work[KNOWN_1 + KNOWN_MOVED] = (0.5 * b_1 + 0.25 * c_1 - away_1) + (p_1 * half_fast + q_1 * half_slow)
        work[KNOWN_1 + KNOWN_MOVED + 1] = (b_1 + c_1 - away_1) + (p_1 * end_fast + q_1 * end_slow)
        if p.sides == 2:
            work[second + KNOWN_MOVED] = (0.5 * b_2 + 0.25 * c_2 - away_2) + (p_2 * half_fast + q_2 * half_slow)
            work[second + KNOWN_MOVED + 1] = (b_2 + c_2 - away_2) + (p_2 * end_fast + q_2 * end_slow)


@compiled
def _line(p: PlantParameters, e: Rows, work: Rows, j: int, share: Value) -> tuple[Value, Value, Value]:
    """(d, b, c): where the current of side j would go if it were there at once, less where it begins, d + b s + c s^2
    of the step."""
    row, rise = KNOWN_1 + j * N_KNOWN, target_rise(p, e, work, j)
    middle, end = work[row + KNOWN_BEYOND], work[row + KNOWN_BEYOND + 1]
    away = 0.0 - work[row + KNOWN_MISSING] - 0.5 * rise
    return share * away, share * (rise - 4.0 * middle + end), share * (4.0 * middle - 2.0 * end)
