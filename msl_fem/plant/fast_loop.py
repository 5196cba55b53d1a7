"""Currents of a current loop that is fast against the step: known in closed form instead of integrated (`poles.py`).

Within its voltage limit the loop makes di/dt = w (target - i), whatever circuit and motion do. With effects the same
holds of what the loop sees: the magnetising currents u go to where the coils' currents are their targets, at the rate
w/(1 + w L G) that eddy currents leave of w, times 1 + h where iron takes h of the current on the way. What eddy
currents in sheets change of it stands in `sheet_modes.py`. What couples two sides couples their loops,
D du/dt = w (target - i) with the matrix D of `coupled_rows`: two exponentials a side, in steps in which no voltage
limit acts. The limit acts in a straight line first, at the mean of the slopes that it allows when the step begins and
where it will cease to act: an error of the step's third order, once for each such event.

Volt-seconds and electrical energy of a step are those of resistance and motion, and the changes of flux linkage and
field energy, as in an ideal drive whose current jumps.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, exponential, first, size, some, width
from msl_fem.plant.effects import electrical, magnetic
from msl_fem.plant.iron_beside_loop import NO_WAY, no_eddies, put_beside_iron, with_memory
from msl_fem.plant.known_currents import put_fall, rates_together
from msl_fem.plant.layout import (
    CIRCUIT_1,
    CIRCUIT_2,
    EMF,
    ENERGY_ELECTRICAL,
    GIVEN_BEGIN_1,
    GIVEN_BEGIN_2,
    GIVEN_END_1,
    GIVEN_END_2,
    I1,
    INDUCTANCE,
    KNOWN_1,
    KNOWN_2,
    KNOWN_ABOVE,
    KNOWN_ACTS,
    KNOWN_CORNER,
    KNOWN_FIELD,
    KNOWN_FLUX,
    KNOWN_IRON,
    KNOWN_LAST,
    KNOWN_LIMITED,
    KNOWN_LINE,
    KNOWN_MEAN,
    KNOWN_MEMORY,
    KNOWN_MISSING,
    KNOWN_RISES,
    KNOWN_SHARED,
    KNOWN_SLOPE,
    KNOWN_SLOPES,
    KNOWN_TAKEN,
    KNOWN_TOOK,
    KNOWN_TURN,
    KNOWN_VALUE,
    LIMITED_1,
    MMF,
    MUTUAL,
    N_CIRCUIT,
    N_EDDY,
    N_KNOWN,
    RESISTANCE,
    SHARED_BEFORE,
    SHARED_ENERGY,
    SHARED_FLUX,
    SLOPES,
    SLOPES_4,
    VOLT_SECONDS_1,
    Y,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import CURRENT_DRIVE, PlantParameters
from msl_fem.plant.poles import (
    FAST,
    answers_to_ends,
    fall_moments,
    falls_together,
    limited_line,
    moments_together,
)
from msl_fem.plant.sheet_modes import (
    beside_modes,
    end_modes,
    forget_modes,
    have_modes,
    mean_target,
    put_beside_modes,
    put_modes,
    set_mode_weights,
    solve_nodes,
    target_rise,
)
from msl_fem.plant.side import Cells, side_flux, side_gap


@compiled
def is_fast(p: PlantParameters, e: Rows, step: float) -> bool:
    """Whether a current loop is fast against the step, or modes are known in closed form, in one lane at least."""
    if p.drive != CURRENT_DRIVE:
        return False
    if e is None:
        return not np.isinf(first(p.bandwidth)) and some(p.bandwidth * step > FAST)
    else:
        w = e[electrical.BANDWIDTH]
        return not np.isinf(first(w)) and (some(w * step > FAST) or have_modes(e))


@compiled
def set_aside_limits(work: Rows) -> None:
    """Keeps whether the sides have met their voltage limits in the sample, and clears that."""
    for j in range(2):
        work[KNOWN_1 + j * N_KNOWN + KNOWN_LIMITED] = work[LIMITED_1 + j]
        work[LIMITED_1 + j] = 0.0


@compiled
def keep_begin(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> None:
    """Keeps flux linkages and field energies of a step's begin, Y = `state`."""
    if e is not None:
        set_mode_weights(e, work, step)
    if p.sides == 2:
        set_mutual_flux(cells, p, e, work, state[I1], state[I1 + 1])
        work[SHARED_BEFORE] = work[SHARED_ENERGY]
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        _, flux, stored = side_flux(cells, p, e, work, j, state[I1 + j], side_gap(p, e, work, j))
        if p.sides == 2:
            own = work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
            flux = flux + own
            work[row + KNOWN_SHARED] = own
        work[row + KNOWN_FLUX] = flux
        work[row + KNOWN_FIELD] = stored


@compiled
def begin_corners(p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """Into the rows of each side where its current goes and at what rate, from Y = the step's begin, and the slope of
    the begin as that where its voltage limit ceases to act, to begin with."""
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        above, rate = beside_modes(e, state, work, j, _missing(p, e, work, j), _rate(p, e, work, j))
        work[row + KNOWN_VALUE] = work[Y + I1 + j] - above
        work[row + KNOWN_VALUE + 1] = rate
        work[row + KNOWN_CORNER] = work[SLOPES + I1 + j]
        work[row + KNOWN_LINE] = work[SLOPES + I1 + j]
        work[row + KNOWN_RISES] = work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] * work[SLOPES + I1 + j]
        work[row + KNOWN_TURN] = work[Y + I1 + j]
        work[row + KNOWN_TOOK] = work[CIRCUIT_1 + j * N_CIRCUIT + MMF] - work[Y + I1 + j]
        work[row + KNOWN_TAKEN] = 0.0
        work[row + KNOWN_ACTS] = work[LIMITED_1 + j]


@compiled
def put_corner_currents(p: PlantParameters, state: Rows, work: Rows, step: float) -> None:
    """Puts the currents at which voltage limits will cease to act within the step into Y, where they act at its begin:
    what is missing to the target is the slope there over the loop's rate."""
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        goes = work[row + KNOWN_VALUE] - work[row + KNOWN_TAKEN]
        at_corner = goes - work[row + KNOWN_CORNER] / work[row + KNOWN_VALUE + 1]
        moved, whole = at_corner - state[I1 + j], step * work[SLOPES + I1 + j]
        within_step = (moved * whole > 0.0) & (size(moved) < size(whole)) & (work[row + KNOWN_ACTS] > 0.0)
        work[Y + I1 + j] = choose(within_step, at_corner, state[I1 + j])
        work[LIMITED_1 + j] = 0.0


@compiled
def keep_corner_slopes(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> None:
    """The slopes of the fourth stage's rows as those where voltage limits cease to act, where they act: to the side to
    which they do at the step's begin. Beyond it they are what the resistance leaves of the slope at the begin.

    Up to there the flux linkage goes nearly in a straight line, and of the current the table tells it: its mean slope
    is the mean of what it makes the flux linkage rise by over the inductance between both ends. Where the limit ceases
    to act iron takes another part of the coil's current than at the begin.
    """
    for j in range(p.sides):
        row, circuit = KNOWN_1 + j * N_KNOWN, CIRCUIT_1 + j * N_CIRCUIT
        inductance, moved = work[circuit + INDUCTANCE], work[Y + I1 + j] - state[I1 + j]
        more, resistance = moved - moved, p.resistance + (moved - moved)
        if e is not None:
            more = choose(no_eddies(e), work[circuit + MMF] - work[Y + I1 + j] - work[row + KNOWN_TOOK], 0.0)
            resistance = work[circuit + RESISTANCE]
        rises = work[row + KNOWN_RISES] - resistance * (moved + more)
        beyond = work[LIMITED_1 + j] == 0.0
        found = choose(beyond, rises / inductance, work[SLOPES_4 + I1 + j])
        work[LIMITED_1 + j] = work[row + KNOWN_ACTS]
        acts = (work[row + KNOWN_ACTS] > 0.0) & (found * work[SLOPES + I1 + j] > 0.0)
        work[row + KNOWN_CORNER] = choose(acts, found, work[row + KNOWN_CORNER])
        inside, flux, _ = side_flux(cells, p, e, work, j, work[Y + I1 + j], side_gap(p, e, work, j))
        before = work[row + KNOWN_FLUX]
        if p.sides == 2:
            before = before - work[row + KNOWN_SHARED]
        moves = acts & inside & (size(moved) > NO_WAY)
        mean = 0.5 * (work[row + KNOWN_RISES] + inductance * found) * moved / choose(moves, flux - before, 1.0)
        work[row + KNOWN_LINE] = choose(moves, mean, 0.5 * (work[SLOPES + I1 + j] + work[row + KNOWN_CORNER]))
        work[row + KNOWN_TURN] = choose(moves, work[Y + I1 + j], work[row + KNOWN_TURN])
        work[row + KNOWN_TAKEN] = choose(moves, more, 0.0)


@compiled
def set_known_currents(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> None:
    """Currents of a step into the rows of each side, from Y = `state` with its slopes in the first stage's rows and
    whether the voltage limit acts there."""
    free = (work[LIMITED_1] + work[LIMITED_1 + 1]) == 0.0
    for j in range(p.sides):
        above = _above(p, e, work, j)
        work[KNOWN_1 + j * N_KNOWN + KNOWN_MISSING] = above
        if e is not None:
            above = with_memory(cells, p, e, state, work, j, above, free)
            _heed_limit(p, e, state, work, j, above, step)
        work[KNOWN_1 + j * N_KNOWN + KNOWN_ABOVE] = above
    free = (work[LIMITED_1] + work[LIMITED_1 + 1]) == 0.0
    for j in range(p.sides):
        _set_side(p, e, state, work, j, free, step)
    if p.sides == 2:
        _couple_sides(p, e, state, work, free, step)
    if e is not None:
        _with_modes(p, e, state, work, free, step)
        put_beside_iron(cells, p, e, state, work, free, step)
        _follow_ends(p, e, state, work, free, step)


@compiled
def _above(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """What the magnetising current of side j is above where it goes, at the mean target of the step."""
    above = _missing(p, e, work, j)
    if e is not None:
        above = above + e[magnetic.SHARE] * _missing(p, e, work, 1 - j)
    return above


@compiled
def _rate(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """The rate in 1/s at which the current of side j goes to its target."""
    if e is None:
        return p.bandwidth + (work[Y] - work[Y])
    else:
        w = e[electrical.BANDWIDTH]
        if some(e[magnetic.EDDY] > 0.0):
            w = w / (1.0 + w * work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] * (e[magnetic.UNMIX] * e[magnetic.EDDY]))
        return w


@compiled
def _missing(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """What the coil's current of side j is above the mean target of the step, in A."""
    current = work[Y + I1 + j]
    if e is not None:
        share = e[magnetic.SHARE]
        own, other = work[CIRCUIT_1 + j * N_CIRCUIT + MMF], work[CIRCUIT_2 - j * N_CIRCUIT + MMF]
        current = e[magnetic.UNMIX] * (own - share * other)
        if some(size(share) > 0.0):
            inductance, of_other = work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE], work[CIRCUIT_2 - j * N_CIRCUIT + EMF]
            current = current + share * of_other / (e[electrical.BANDWIDTH] * inductance)
    return current - mean_target(work, j)[0]


@compiled
def _heed_limit(p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, above: Value, step: float) -> None:
    """Lets the voltage limit of side j be where the current has to go the other way, or is not as far off as the limit
    asks: where modes of eddy currents fade, or the target begins elsewhere than the value that stands for it."""
    ends = _ends_count(e)
    if not (have_modes(e) or some(ends)):
        return
    stays, rate = beside_modes(e, state, work, j, above, _rate(p, e, work, j))
    z = rate * step
    away = stays + target_rise(p, e, work, j) * (0.5 + 1.0 / z)
    if some(ends):
        away = away - choose(ends, answers_to_ends(z, _off_line(p, e, work, j))[0], 0.0)
    slope, looked_at = work[SLOPES + I1 + j], choose(ends, 1.0, e[magnetic.EDDY_EXACT]) > 0.0
    acts = (slope * away < 0.0) & (choose(ends, rate * size(away) - size(slope), 1.0) > 0.0)
    work[LIMITED_1 + j] = choose(looked_at, choose(acts, work[LIMITED_1 + j], 0.0), work[LIMITED_1 + j])


@compiled
def _ends_count(e: Rows) -> Flag:
    """Where targets may begin and end elsewhere than the line with their mean and first moment: they fall, or jump
    within a step."""
    return e[electrical.DECAY] + e[electrical.JUMP_SHARE] + e[electrical.SLEW_TIME] > 0.0


@compiled
def _off_line(p: PlantParameters, e: Rows, work: Rows, j: int) -> tuple[Value, Value]:
    """What the target of side j, and its share of the other one's, is at begin and end above that line, in A."""
    mean, rise = mean_target(work, j)
    begin, end = work[GIVEN_BEGIN_1 + j] - mean, work[GIVEN_END_1 + j] - mean
    if p.sides == 2:
        share, (other, others_rise) = e[magnetic.SHARE], mean_target(work, 1 - j)
        begin, end = begin + share * (work[GIVEN_BEGIN_2 - j] - other), end + share * (work[GIVEN_END_2 - j] - other)
        rise = rise + share * others_rise
    return begin + 0.5 * rise, end - 0.5 * rise


@compiled
def _follow_ends(p: PlantParameters, e: Rows, state: Rows, work: Rows, free: Flag, step: float) -> None:
    """Into the rows of the sides, no voltage limit in the way, what their loops make of targets that begin and end
    elsewhere than the lines that have stood for them."""
    ends = free & _ends_count(e)
    if not some(ends):
        return
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        modes = e[magnetic.EDDY_MODE]
        for k in range(1, N_EDDY):
            modes = modes + e[magnetic.EDDY_MODE + k]
        stiffer = (1.0 + work[row + KNOWN_MEMORY]) * (1.0 + work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] * modes)
        z = _rate(p, e, work, j) * step * stiffer
        begin, end = answers_to_ends(z, _off_line(p, e, work, j))
        last = (end - begin * exponential(0.0 - z)) / stiffer
        last = choose(ends & (work[row] > 0.0), last, 0.0)
        for k in range(3):
            work[row + KNOWN_VALUE + k] = work[row + KNOWN_VALUE + k] - last / z
            work[row + KNOWN_SLOPES + k] = work[row + KNOWN_SLOPES + k] + last / step
        work[row + KNOWN_LAST] = work[row + KNOWN_LAST] + last


@compiled
def _set_side(p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, free: Flag, step: float) -> None:
    """The rows of side j, for itself; `free` where no voltage limit is in the way of any."""
    row, rate = KNOWN_1 + j * N_KNOWN, _rate(p, e, work, j)
    above, fast = work[row + KNOWN_ABOVE], choose(rate * step > FAST, 1.0, 0.0)
    if e is not None:
        rate = rate * (1.0 + work[row + KNOWN_MEMORY])
        among, stiffer = beside_modes(e, state, work, j, above, rate)
        above, rate = choose(free, above, among), choose(free, rate, stiffer)
        fast = choose(free & (e[magnetic.EDDY_EXACT] > 0.0), 1.0, fast)
    rise, limited = target_rise(p, e, work, j), work[LIMITED_1 + j] > 0.0
    z = rate * step
    away = above + rise * (0.5 + 1.0 / z)
    line, corner = z - z, 1.0 + (z - z)
    if some(limited):
        line, corner = limited_line(away, work[row + KNOWN_LINE] * step, work[row + KNOWN_CORNER] * step, z)
        line, corner = choose(limited, line, 0.0), choose(limited, corner, 1.0)
    known = (fast > 0.0) & (line < 1.0)
    work[LIMITED_1 + j] = work[row + KNOWN_LIMITED]
    work[row] = choose(known, 1.0, 0.0)
    m_0, square, m_s, last = fall_moments(z, line, corner)
    fall = away * m_0, away * away * square, away * m_s, away * last
    put_fall(state, work, j, known, away, rise, z - z, fall, step)


@compiled
def _couple_sides(p: PlantParameters, e: Rows, state: Rows, work: Rows, free: Flag, step: float) -> None:
    """The rows of both sides where mutual flux, or currents, couple them: both known, no voltage limit in the way.

    Their loops make D du/dt = w (targets - i), D the rows of `coupled_rows`.
    """
    second = KNOWN_1 + N_KNOWN
    coupled = size(work[MUTUAL]) > 0.0
    if e is not None:
        coupled = size(work[MUTUAL]) + size(e[magnetic.SHARE]) > 0.0
    free = free & coupled
    if not some(free):
        return
    z_11, z_12, z_21, z_22 = rates_together(p, e, work, step)
    determinant = z_11 * z_22 - z_12 * z_21
    rise_1, rise_2 = target_rise(p, e, work, 0), target_rise(p, e, work, 1)
    away_1 = work[KNOWN_1 + KNOWN_ABOVE] + 0.5 * rise_1 + (z_22 * rise_1 - z_12 * rise_2) / determinant
    away_2 = work[second + KNOWN_ABOVE] + 0.5 * rise_2 + (z_11 * rise_2 - z_21 * rise_1) / determinant
    faster, slower, (p_1, q_1, p_2, q_2) = falls_together((z_11, z_12, z_21, z_22), away_1, away_2)
    both = free & (work[KNOWN_1] > 0.0) & (work[second] > 0.0) & (slower > 0.0)
    if not some(both):
        return
    none = slower - slower
    fast, slow = fall_moments(faster, none, 1.0 + none), fall_moments(slower, none, 1.0 + none)
    between = (1.0 - (fast[3] * slow[3])) / (faster + slower)
    put_fall(state, work, 0, both, away_1, rise_1, none, moments_together(fast, slow, between, p_1, q_1), step)
    put_fall(state, work, 1, both, away_2, rise_2, none, moments_together(fast, slow, between, p_2, q_2), step)


@compiled
def _with_modes(p: PlantParameters, e: Rows, state: Rows, work: Rows, free: Flag, step: float) -> None:
    """Into the rows of the sides what eddy currents in sheets change, no voltage limit in the way."""
    if not have_modes(e):
        return
    solve_nodes(p, e, state, work, step)
    where = free & (e[magnetic.EDDY_EXACT] > 0.0)
    for j in range(p.sides):
        put_beside_modes(e, state, work, j, where, step)
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        work[row] = choose(where, 2.0, work[row])
        work[row + KNOWN_MEAN] = _mean_current(p, e, state, work, j, step)


@compiled
def _mean_current(p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, step: float) -> Value:
    """Of the coil of side j over the step, by what its loop makes of the magnetising currents (A)."""
    share, own, other = e[magnetic.SHARE], KNOWN_1 + j * N_KNOWN, KNOWN_2 - j * N_KNOWN
    inductance, mutual = work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE], work[MUTUAL]
    moved = (1.0 + share * (mutual / inductance)) * (work[own + KNOWN_LAST] - state[I1 + j])
    if p.sides == 2:
        of_other = work[CIRCUIT_2 - j * N_CIRCUIT + INDUCTANCE]
        moved = moved + (mutual + share * of_other) / inductance * (work[other + KNOWN_LAST] - state[I1 + 1 - j])
        moved = moved + share * work[CIRCUIT_2 - j * N_CIRCUIT + EMF] / inductance * step
    return mean_target(work, j)[0] - moved / (e[electrical.BANDWIDTH] * step)


@compiled
def put_known_currents(p: PlantParameters, e: Rows, state: Rows, work: Rows, instant: int) -> None:
    """The currents of begin, middle or end (0, 1, 2) of a step into Y, where they are known, and the modes of eddy
    currents."""
    if e is not None:
        put_modes(p, e, state, work, instant)
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        work[Y + I1 + j] = choose(work[row] > 0.0, work[row + KNOWN_VALUE + instant], work[Y + I1 + j])
        work[row + KNOWN_SLOPE] = work[row + KNOWN_SLOPES + instant]


@compiled
def end_known_currents(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> Flag:
    """Puts the known currents of the step's end into Y, and what they add to volt-seconds and energy."""
    inside = work[Y] == work[Y]
    if e is not None:
        put_modes(p, e, state, work, 2)
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        work[Y + I1 + j] = choose(work[row] > 0.0, work[row + KNOWN_LAST], work[Y + I1 + j])
    if p.sides == 2:
        inside = inside & set_mutual_flux(cells, p, e, work, work[Y + I1], work[Y + I1 + 1])
        if width(work) == 1:
            work[Y + ENERGY_ELECTRICAL] = work[Y + ENERGY_ELECTRICAL] + _shared_energy(state, work)
    for j in range(p.sides):
        row = KNOWN_1 + j * N_KNOWN
        known = work[row] > 0.0
        found, flux, stored = side_flux(cells, p, e, work, j, work[Y + I1 + j], side_gap(p, e, work, j))
        inside = inside & found
        if p.sides == 2:
            flux = flux + work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX]
        change = choose(known, flux - work[row + KNOWN_FLUX], 0.0)
        work[Y + VOLT_SECONDS_1 + j] = work[Y + VOLT_SECONDS_1 + j] + change
        if e is not None and p.sides == 2:
            other = Y + VOLT_SECONDS_1 + 1 - j
            work[other] = work[other] + e[magnetic.SHARE] * change
        energy = stored - work[row + KNOWN_FIELD]
        if e is not None:
            energy = energy + end_modes(e, state, work, j, flux)
        if width(work) == 1:
            work[Y + ENERGY_ELECTRICAL] = work[Y + ENERGY_ELECTRICAL] + choose(known, energy, 0.0)
        work[LIMITED_1 + j] = choose(known, work[row + KNOWN_LIMITED], work[LIMITED_1 + j])
        work[row] = 0.0
        work[row + KNOWN_IRON] = 0.0
    if e is not None:
        forget_modes(e, work)
    return inside


@compiled
def _shared_energy(state: Rows, work: Rows) -> Value:
    """What known currents took from their circuits for the field that both sides have in common, in J.

    Where both are known it is the change of that field's energy; beside the power of its force (`equations.py`). Where
    one is known, its mean current times what its flux linkage changed by.
    """
    nothing = work[Y] - work[Y]
    alone = nothing
    both = nothing == nothing
    for j in range(2):
        row = KNOWN_1 + j * N_KNOWN
        known = work[row] > 0.0
        both = both & known
        change = work[CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX] - work[row + KNOWN_SHARED]
        taken = 0.5 * (work[Y + I1 + j] + state[I1 + j]) * change
        alone = alone + choose(known, taken, nothing)
    return choose(both, work[SHARED_ENERGY] - work[SHARED_BEFORE], alone)
