"""Eddy currents in sheets over a step in which a fast loop makes the magnetising current.

A side's modes take sum_k c_k psi_k of its current, psi_k' = Lambda' - r_k psi_k. Over a step of length h their answer
to a flux linkage is exact, whatever their rates; approximated is the flux alone. Where no voltage limit acts, u' is the
parabola through three values d_m/h, at which the loop's equation holds,

    D u'(c_i h) = w (target - i)(c_i h),   Lambda_j' = L_j u_j' + M u_o' + e_j,   D that of `coupled_rows`,

with the nodes c_i of Radau's rule (collocation of order 5, which damps what is faster than the step: Hairer and Wanner,
Solving Ordinary Differential Equations II, 1996, IV.5); L, M and e are those of the step's begin. Then the flux is that
of the table: what it differs from the parabola's integral is spread evenly over the step. Where the parabola is not
known the flux goes in a straight line.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Flag, Rows, Value, choose, first, lane_of, set_lane, some, width
from msl_fem.plant.effects import electrical, magnetic
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.equations import coupled_rows
from msl_fem.plant.layout import (
    CIRCUIT_1,
    CIRCUIT_2,
    EDDY_FLUX_1,
    EMF,
    I1,
    INDUCTANCE,
    INPUTS_BEGIN,
    INPUTS_END,
    INPUTS_MIDDLE,
    KNOWN_1,
    KNOWN_2,
    KNOWN_FLUX,
    KNOWN_LAST,
    KNOWN_MEMORY,
    KNOWN_MISSING,
    KNOWN_SLOPES,
    KNOWN_VALUE,
    MODE_DECAY,
    MODE_EVEN,
    MODE_FOLLOWS,
    MODE_FOLLOWS_NOW,
    MODE_MATRIX,
    MODE_NODES_1,
    MODE_RISE_1,
    MODE_STEP,
    MODE_STILL_1,
    MODE_SUM,
    MUTUAL,
    N_CIRCUIT,
    N_KNOWN,
    N_NODE,
    TARGET_1,
    Y,
)
from msl_fem.plant.plant import PlantParameters
from msl_fem.plant.poles import mean_and_rise

_ROOT_6 = 6.0**0.5
NODES = np.array([0.4 - 0.1 * _ROOT_6, 0.4 + 0.1 * _ROOT_6, 1.0])
"""Of Radau's rule with three, as shares of a step."""
INSTANTS = np.array([*NODES, 0.5])
END = 2  # of these
_FALLING = 20  # terms of a series of moments, for a mode that decays by less than e over the time


def _powers() -> np.ndarray:
    """(N_NODE, N_NODE) coefficients of s^j (row j) of Lagrange's polynomials of the nodes."""
    return np.asarray(np.linalg.inv(np.vander(NODES, increasing=True)))


def _integrals(instant: float) -> np.ndarray:
    """(N_NODE,) integrals of these polynomials from 0 to an instant."""
    powers = np.arange(1, N_NODE + 1)
    return np.asarray(instant**powers / powers @ _powers())


POWERS = _powers().ravel()
INTEGRALS = np.concatenate([_integrals(instant) for instant in INSTANTS])
"""What a unit slope at each node brings until each instant, one instant after the other."""
MOVED = np.concatenate([_integrals(instant) for instant in (0.0, 0.5, 1.0)])
"""The same until begin, middle and end of a step."""
SLOPES_THEN = np.concatenate([np.array([1.0, s, s * s]) @ _powers() for s in (0.0, 0.5, 1.0)])
"""The slope at begin, middle and end."""


@compiled
def set_mode_weights(e: Rows, work: Rows, step: float) -> None:
    """Weights of the modes over a step of that length into the workspace, where they are not there yet."""
    if not have_modes(e) or first(work[MODE_STEP]) == step:
        return
    work[MODE_STEP] = step
    for n in range(N_NODE * N_NODE):
        work[MODE_SUM + n] = 0.0
    for lane in range(width(work)):
        for k in range(N_EDDY):
            taken, rate = lane_of(e, magnetic.EDDY_MODE + k, lane), lane_of(e, magnetic.EDDY_RATE + k, lane)
            for n in range(N_NODE + 1):
                _set_weights_until(work, lane, k, n, taken, rate * step * INSTANTS[n])


@compiled
def _set_weights_until(work: Rows, lane: int, k: int, n: int, taken: float, z: float) -> None:
    """Those of mode k, which takes `taken` A/Wb and decays by exp(-z) until the instant n, in a lane."""
    until, decay = INSTANTS[n], np.exp(-z)
    if z > 1.0:
        j_0 = (1.0 - decay) / z
        j_1 = (1.0 - j_0) / z
        j_2 = (1.0 - 2.0 * j_1) / z
    else:
        j_2 = 0.0
        for order in range(_FALLING, 2, -1):
            j_2 = (1.0 - z * j_2) / order
        j_1 = 0.5 * (1.0 - z * j_2)
        j_0 = 1.0 - z * j_1
    set_lane(work, MODE_DECAY + n * N_EDDY + k, lane, decay)
    for m in range(N_NODE):
        answer = until * (j_0 * POWERS[m] + until * (j_1 * POWERS[N_NODE + m] + until * j_2 * POWERS[2 * N_NODE + m]))
        if n <= END:
            row = MODE_SUM + n * N_NODE + m
            set_lane(work, row, lane, lane_of(work, row, lane) + taken * answer)
        if n >= END:
            uneven = answer - j_0 * INTEGRALS[n * N_NODE + m]
            set_lane(work, MODE_EVEN + ((n - END) * N_NODE + m) * N_EDDY + k, lane, uneven)
    if n >= END:
        set_lane(work, MODE_FOLLOWS + (n - END) * N_EDDY + k, lane, j_0)


@compiled
def solve_nodes(p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float) -> None:
    """Slopes of each side's magnetising current at the nodes, times the step (A), with modes that stay as they were and
    with those that go on, into its rows; and the slopes of its flux linkage that go with the latter (Wb)."""
    n = N_NODE * p.sides
    _solve(p, e, state, work, step, 0.0)
    for j in range(p.sides):
        for m in range(N_NODE):
            work[MODE_STILL_1 + j * N_NODE + m] = work[MODE_MATRIX + (j * N_NODE + m) * (n + 1) + n]
    _solve(p, e, state, work, step, 1.0)
    for j in range(p.sides):
        for m in range(N_NODE):
            found = work[MODE_MATRIX + (j * N_NODE + m) * (n + 1) + n]
            work[MODE_NODES_1 + j * N_NODE + m] = found
            rise = work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] * found
            if p.sides == 2:
                rise = rise + work[MUTUAL] * work[MODE_MATRIX + ((1 - j) * N_NODE + m) * (n + 1) + n]
            work[MODE_RISE_1 + j * N_NODE + m] = rise


@compiled
def put_beside_modes(e: Rows, state: Rows, work: Rows, j: int, where: Flag, step: float) -> None:
    """Makes the current of side j, which is known as if modes stayed as they were, what it is with them, in some lanes.

    Without modes the closed form is exact and collocation is not, with many it is the better one: of the closed form's
    difference from collocation with modes that stay a share counts that falls from 1 with what they take.
    """
    row, nodes, still = KNOWN_1 + j * N_KNOWN, MODE_NODES_1 + j * N_NODE, MODE_STILL_1 + j * N_NODE
    total = e[magnetic.EDDY_MODE]
    for k in range(1, N_EDDY):
        total = total + e[magnetic.EDDY_MODE + k]
    kept, rate = 1.0 / (1.0 + work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] * total), 1.0 / step
    for k in range(3):
        value, slope = row + KNOWN_VALUE + k, row + KNOWN_SLOPES + k
        stays = kept * (work[value] - state[I1 + j] - _moved_until(work, still, k))
        work[value] = choose(where, state[I1 + j] + _moved_until(work, nodes, k) + stays, work[value])
        stays = kept * (work[slope] - rate * _slope_at(work, still, k))
        work[slope] = choose(where, rate * _slope_at(work, nodes, k) + stays, work[slope])
    stays = kept * (work[row + KNOWN_LAST] - state[I1 + j] - _moved_until(work, still, 2))
    last = state[I1 + j] + _moved_until(work, nodes, 2) + stays
    work[row + KNOWN_LAST] = choose(where, last, work[row + KNOWN_LAST])
    for m in range(N_NODE):
        rise = MODE_RISE_1 + j * N_NODE + m
        work[rise] = choose(where, work[rise], 0.0)


@compiled
def _moved_until(work: Rows, nodes: int, instant: int) -> Value:
    """What slopes in rows from `nodes`, times the step, bring until its begin, middle or end (0, 1, 2)."""
    n = instant * N_NODE
    return MOVED[n] * work[nodes] + MOVED[n + 1] * work[nodes + 1] + MOVED[n + 2] * work[nodes + 2]


@compiled
def _slope_at(work: Rows, nodes: int, instant: int) -> Value:
    """The slope then, times the step."""
    n = instant * N_NODE
    return SLOPES_THEN[n] * work[nodes] + SLOPES_THEN[n + 1] * work[nodes + 1] + SLOPES_THEN[n + 2] * work[nodes + 2]


@compiled
def _solve(p: PlantParameters, e: Rows, state: Rows, work: Rows, step: float, taking: float) -> None:
    """The slopes at the nodes into the matrix's last column, with modes that stay as they were (0), or go on (1)."""
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    w = e[electrical.BANDWIDTH]
    row_1, row_2 = coupled_rows(e, work, l_1, l_2, w * l_1, w * l_2)
    _put_equations(p, e, state, work, 0, row_1[0], row_1[1], step, taking)
    if p.sides == 2:
        _put_equations(p, e, state, work, 1, row_2[0], row_2[1], step, taking)
    _eliminate(work, N_NODE * p.sides)


@compiled
def _put_equations(
    p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, own: Value, other: Value, step: float, taking: float
) -> None:  # fmt: skip
    """The equations of side j at the nodes into the matrix's rows; `own` and `other` are those of its row of D."""
    n, mutual, share = N_NODE * p.sides, work[MUTUAL], e[magnetic.SHARE]
    whole = e[electrical.BANDWIDTH] * step * e[magnetic.UNMIX]
    mine, others = work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE], work[CIRCUIT_2 - j * N_CIRCUIT + INDUCTANCE]
    memory, others_memory = work[KNOWN_1 + j * N_KNOWN + KNOWN_MEMORY], work[KNOWN_2 - j * N_KNOWN + KNOWN_MEMORY]
    for i in range(N_NODE):
        at = MODE_MATRIX + (j * N_NODE + i) * (n + 1)
        for m in range(N_NODE):
            moved, modes = INTEGRALS[i * N_NODE + m], taking * work[MODE_SUM + i * N_NODE + m]
            by_own = whole * (moved * (1.0 + memory) + (mine - share * mutual) * modes)
            work[at + j * N_NODE + m] = own + by_own if m == i else by_own
            if p.sides == 2:
                by_other = whole * (mutual * modes - share * (moved * (1.0 + others_memory) + others * modes))
                work[at + (1 - j) * N_NODE + m] = other + by_other if m == i else by_other
        left = _left(p, e, state, work, j, i, step, taking)
        if p.sides == 2:
            left = left - share * _left(p, e, state, work, 1 - j, i, step, taking)
        work[at + n] = 0.0 - whole * left


@compiled
def _left(
    p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, i: int, step: float, taking: float
) -> Value:  # fmt: skip
    """What the current of side j, with what its modes take, would be above where it goes at a node, were u to stand
    still: in A."""
    left = work[KNOWN_1 + j * N_KNOWN + KNOWN_MISSING] - (NODES[i] - 0.5) * target_rise(p, e, work, j)
    sums, emf = MODE_SUM + i * N_NODE, work[CIRCUIT_1 + j * N_CIRCUIT + EMF]
    left = left + taking * step * emf * (work[sums] + work[sums + 1] + work[sums + 2])
    flux = work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX]
    for k in range(N_EDDY):
        behind = flux - state[EDDY_FLUX_1 + j * N_EDDY + k]
        left = left + taking * e[magnetic.EDDY_MODE + k] * (work[MODE_DECAY + i * N_EDDY + k] - 1.0) * behind
    return left


@compiled
def beside_modes(e: Rows, state: Rows, work: Rows, j: int, above: Value, rate: Value) -> tuple[Value, Value]:
    """What the magnetising current of side j is above where it goes, and its rate (1/s), where its modes decay until
    the step's end and take their share of a change that is even over the step."""
    if e is None:
        return above, rate
    else:
        if not have_modes(e):
            return above, rate
        flux, inductance = work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX], work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE]
        faded = followed = flux - flux
        for k in range(N_EDDY):
            taken, behind = e[magnetic.EDDY_MODE + k], flux - state[EDDY_FLUX_1 + j * N_EDDY + k]
            faded = faded + taken * (work[MODE_DECAY + END * N_EDDY + k] - 1.0) * behind
            followed = followed + taken * work[MODE_FOLLOWS + k]
        exact, stiffer = e[magnetic.EDDY_EXACT] > 0.0, 1.0 + inductance * followed
        return choose(exact, (above + faded) / stiffer, above), choose(exact, rate * stiffer, rate)


@compiled
def target_rise(p: PlantParameters, e: Rows, work: Rows, j: int) -> Value:
    """What the target of side j, and its share of the other one's, rises by over the step, in A."""
    rise = mean_target(work, j)[1]
    if e is not None and p.sides == 2:
        rise = rise + e[magnetic.SHARE] * mean_target(work, 1 - j)[1]
    return rise


@compiled
def mean_target(work: Rows, j: int) -> tuple[Value, Value]:
    """(mean, rise) over a step of what the loop of side j aims at."""
    begin, middle = work[INPUTS_BEGIN + TARGET_1 + j], work[INPUTS_MIDDLE + TARGET_1 + j]
    return mean_and_rise(begin, middle, work[INPUTS_END + TARGET_1 + j])


@compiled
def _eliminate(work: Rows, n: int) -> None:
    """Solves the equations n by n in the matrix's rows, the right-hand side in its last column, in place: Gauss and
    Jordan without pivots, which are the diagonal's as `coupled_rows` and Radau's rule have it."""
    for a in range(n):
        own = MODE_MATRIX + a * (n + 1)
        over = 1.0 / work[own + a]
        for c in range(a + 1, n + 1):
            work[own + c] = over * work[own + c]
        for b in range(n):
            if b != a:
                other = MODE_MATRIX + b * (n + 1)
                factor = work[other + a]
                for c in range(a + 1, n + 1):
                    work[other + c] = work[other + c] - factor * work[own + c]


@compiled
def put_modes(p: PlantParameters, e: Rows, state: Rows, work: Rows, instant: int) -> None:
    """What the modes follow at begin, middle or end (0, 1, 2) of a step into Y, but for its part that goes with the
    flux linkage there: that times `MODE_FOLLOWS_NOW` is to be added."""
    if not have_modes(e):
        return
    exact, n = e[magnetic.EDDY_EXACT] > 0.0, 1 if instant == 1 else 0
    for j in range(p.sides):
        flux, rises = work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX], MODE_RISE_1 + j * N_NODE
        for k in range(N_EDDY):
            row = EDDY_FLUX_1 + j * N_EDDY + k
            if instant == 0:  # psi as it is, whatever stands for the current there
                work[Y + row] = choose(exact, state[row] - flux, work[Y + row])
                work[MODE_FOLLOWS_NOW + k] = choose(exact, 1.0, 0.0)
            else:
                follows, even = work[MODE_FOLLOWS + n * N_EDDY + k], MODE_EVEN + n * N_NODE * N_EDDY + k
                decay = work[MODE_DECAY + (END + n) * N_EDDY + k]
                bent = work[even] * work[rises] + work[even + N_EDDY] * work[rises + 1]
                bent = bent + work[even + 2 * N_EDDY] * work[rises + 2]
                base = follows * flux - decay * (flux - state[row]) - bent
                work[Y + row] = choose(exact, base, work[Y + row])
                work[MODE_FOLLOWS_NOW + k] = choose(exact, 1.0 - follows, 0.0)


@compiled
def end_modes(e: Rows, state: Rows, work: Rows, j: int, flux: Value) -> Value:
    """Puts what the modes of side j follow at the step's end, where its flux linkage is `flux`, into Y; the energy (J)
    of their currents that was added."""
    energy, begin = flux - flux, work[KNOWN_1 + j * N_KNOWN + KNOWN_FLUX]
    if not have_modes(e):
        return energy
    for k in range(N_EDDY):
        row = EDDY_FLUX_1 + j * N_EDDY + k
        work[Y + row] = work[Y + row] + work[MODE_FOLLOWS_NOW + k] * flux
        after, before = flux - work[Y + row], begin - state[row]
        energy = energy + 0.5 * e[magnetic.EDDY_MODE + k] * (after * after - before * before)
    return energy


@compiled
def forget_modes(e: Rows, work: Rows) -> None:
    """Behind a step, nothing is known of the modes but where they are."""
    if not have_modes(e):
        return
    for k in range(N_EDDY):
        work[MODE_FOLLOWS_NOW + k] = 0.0


@compiled
def have_modes(e: Rows) -> bool:
    """Whether eddy currents in sheets are known in closed form, in one lane at least."""
    return some(e[magnetic.EDDY_EXACT] > 0.0)
