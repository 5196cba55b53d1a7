"""The magnets' iron: the coenergy surface of a side, hysteresis, eddy currents in the sheets.

Hysteresis is a Preisach operator on the flux linkage that gives the pinned part of the magnetising current.
Its Everett function is closed: from a turning point at flux b0 on to b the current changes by

    2 Y((h(b) - h(b0))/2),   Y(z) = A (1 - exp(-z)) for z > 0, odd;   h(b) = s asinh(b/(s b_c))

with Y the virgin curve. That is the Preisach plane of an exponential spread of coercive fields (Krasnosel'skii and
Pokrovskii, Systems with Hysteresis, 1989, sect. 34), stretched by h, so that loops at high flux are wider. It has
return point memory, congruent minor loops, Rayleigh's parabolas at small amplitude, and takes energy on every loop: the
current leads the flux. Memory is a stack of turning points; evaluation leaves it as it is, `settle_memory` carries it
on.

Eddy currents in sheets are magnetic diffusion across their thickness, as a ladder of resistors and inductors.
In a sheet of thickness d, conductivity s and permeability mu the field at the surface and the mean flux density obey

    H_s / B_mean = q coth(q) / mu,   q^2 = j w T,   T = mu s d^2/4

(Stoll, The Analysis of Eddy Currents, 1974, ch. 2). The excess q coth(q) - 1 = q^2/(3 + q^2/(5 + q^2/(7 + ...))) is a
ladder (Cauer's second form; Krah, IEEE Trans. Magn. 41, 2005): seen from a coil, the rate of its flux linkage e drives
3 G through resistors 3, 7, 11 ... and inductors T/5, T/9, T/13 ... to ground, and the sum of the inductors' currents is
what the eddy currents take from the coil. G = s d^2 l/(12 n N^2 A) for a path of length l and section A linked by n
coils of N turns in series: the classical loss of thin sheets.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.bench.plant import IRON_NODES, Array, Hysteresis, Ladder, Magnets, MagnetSurface, SeriesIron
from msl_fem.computing.compiled import compiled

N = 6  # coefficients a direction of a cell
DEPTH = 400
# A side's memory: how many turning points, the last flux (stretched) and current, the direction; then the points
COUNT, LAST, LAST_CURRENT, DIRECTION, POINTS = range(5)
MEMORY = POINTS + 2 * DEPTH


@compiled
def _below(nodes: Array, value: float) -> int:
    """The cell of a value between the nodes."""
    low, high = 0, nodes.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if value < nodes[middle]:
            high = middle
        else:
            low = middle
    return low


@compiled
def side_magnet(t: MagnetSurface, m: Magnets, current: float, gap: float) -> tuple[bool, float, float, float, float]:
    """(inside the table, flux linkage Wb, pull N, dlambda/di H, dlambda/dgap Wb/m) of a side.

    The side's n magnets carry `share` of its current each: lambda = n share W'_i, F = -n W'_g, with W' the coenergy of
    one magnet; the slope of the flux over the gap is minus that of the pull over the current.
    """
    size = abs(m.share * current)
    if not (t.gap[0] <= gap <= t.gap[-1] and size <= t.current[-1]):
        return False, np.nan, np.nan, np.nan, np.nan
    a, b = _below(t.gap, gap), _below(t.current, size)
    y, x = gap - t.gap[a], size - t.current[b]
    w_i = w_ii = w_g = w_ig = w = 0.0
    for p in range(N - 1, -1, -1):
        c = t.coefficients[a, b, p]
        along = c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))
        along_i = c[1] + x * (2.0 * c[2] + x * (3.0 * c[3] + x * (4.0 * c[4] + x * 5.0 * c[5])))
        along_ii = 2.0 * c[2] + x * (6.0 * c[3] + x * (12.0 * c[4] + x * 20.0 * c[5]))
        w_g = w_g * y + w
        w = w * y + along
        w_ig = w_ig * y + w_i
        w_i = w_i * y + along_i
        w_ii = w_ii * y + along_ii
    linked = m.per_side * m.share
    sign = -1.0 if current < 0 else 1.0
    return True, sign * linked * w_i, -m.per_side * w_g, linked * m.share * w_ii, sign * linked * w_ig


@compiled
def side_coenergy(t: MagnetSurface, m: Magnets, current: float, gap: float) -> float:
    """Coenergy of a side's magnets in J; the point lies inside the table."""
    size = abs(m.share * current)
    a, b = _below(t.gap, gap), _below(t.current, size)
    y, x = gap - t.gap[a], size - t.current[b]
    w = 0.0
    for p in range(N - 1, -1, -1):
        along = 0.0
        for q in range(N - 1, -1, -1):
            along = along * x + t.coefficients[a, b, p, q]
        w = w * y + along
    return m.per_side * w


@compiled
def series_current(iron: SeriesIron, flux: float) -> float:
    """Current in A that the iron takes beyond the table's at a flux linkage (Wb); straight on beyond the nodes.

    It stands in series with the table's magnet: at given flux the pull is that of the table, and the energy stored in
    the iron is the integral of this current over the flux, whatever the gap.
    """
    size = abs(flux)
    sign = -1.0 if flux < 0 else 1.0
    n = int(size / iron.step)
    if n >= IRON_NODES - 1:
        return sign * (iron.value[-1] + iron.slope[-1] * (size - iron.step * (IRON_NODES - 1)))
    s = size / iron.step - n
    v0 = iron.value[n]
    v1 = iron.value[n + 1]
    d0 = iron.step * iron.slope[n]
    d1 = iron.step * iron.slope[n + 1]
    third = d0 + d1 - 2.0 * (v1 - v0)
    second = 3.0 * (v1 - v0) - 2.0 * d0 - d1
    return sign * (v0 + s * (d0 + s * (second + s * third)))


@compiled
def stretched(h: Hysteresis, flux: float) -> float:
    """h(b) of a flux linkage in Wb."""
    return h.stretch * np.arcsinh(flux / (h.flux_scale * h.stretch))


@compiled
def _branch(memory: Array, z: float) -> tuple[int, bool, float, float]:
    """(turning points left, whether the last point is a new one, start of the branch and its current) at z."""
    count = int(memory[COUNT])
    ahead = z - memory[LAST]
    turned = ahead * memory[DIRECTION] < 0.0
    # Turning points from the newest: the start of the branch, then the one that the branch heads for, and so on
    if not turned:
        while count >= 2 and (z - memory[POINTS + 2 * (count - 2)]) * memory[DIRECTION] >= 0.0:
            count -= 2
        if count <= 1:  # what is left is the mirrored point: on the virgin curve again
            return 0, False, 0.0, 0.0
        return count, False, memory[POINTS + 2 * (count - 1)], memory[POINTS + 2 * (count - 1) + 1]
    if count == 0:  # leaving the virgin curve: the branch heads for the mirrored point
        if (z + memory[LAST]) * memory[DIRECTION] <= 0.0:
            return 0, False, 0.0, 0.0
        return 0, True, memory[LAST], memory[LAST_CURRENT]
    if (z - memory[POINTS + 2 * (count - 1)]) * memory[DIRECTION] > 0.0:
        return count, True, memory[LAST], memory[LAST_CURRENT]
    count -= 1  # the loop closes at the start of the branch that was left: go on where that one came from
    while count >= 2 and (z - memory[POINTS + 2 * (count - 2)]) * memory[DIRECTION] <= 0.0:
        count -= 2
    if count <= 1:
        return 0, False, 0.0, 0.0
    return count, False, memory[POINTS + 2 * (count - 1)], memory[POINTS + 2 * (count - 1) + 1]


@compiled
def pinned_current(h: Hysteresis, memory: Array, flux: float) -> float:
    """Current in A at a flux linkage (Wb) reached from where the memory (MEMORY,) stands."""
    z = stretched(h, flux)
    count, new, start, current = _branch(memory, z)
    if count == 0 and not new:
        return np.copysign(h.amplitude * (1.0 - np.exp(-abs(z))), z)
    half = 0.5 * (z - start)
    return current + np.copysign(2.0 * h.amplitude * (1.0 - np.exp(-abs(half))), half)


@compiled
def settle_memory(h: Hysteresis, memory: Array, flux: float) -> None:
    """Carry the memory (MEMORY,) to a flux linkage: a turn is remembered, closed loops are wiped out."""
    z = stretched(h, flux)
    if z == memory[LAST]:
        return
    current = pinned_current(h, memory, flux)
    count, new, start, at_start = _branch(memory, z)
    if new:
        if count == 0:
            memory[POINTS] = -start
            memory[POINTS + 1] = -at_start
            count = 1
        if count >= DEPTH - 1:  # forget the two innermost points: a loop of next to no size
            count -= 2
        memory[POINTS + 2 * count], memory[POINTS + 2 * count + 1] = start, at_start
        count += 1
    memory[COUNT] = count
    memory[DIRECTION] = 1.0 if z > memory[LAST] else -1.0
    memory[LAST], memory[LAST_CURRENT] = z, current


def virgin_memory() -> Array:
    """The memory (MEMORY,) of demagnetised iron."""
    memory = np.zeros(MEMORY)
    memory[DIRECTION] = 1.0
    return memory


@compiled
def ladder_current(ladder: Ladder, currents: Array) -> float:
    """What the eddy currents take from the side's coil, A; `currents` (stages,) are those of the inductors."""
    total = 0.0
    for k in range(ladder.stages):
        total += currents[k]
    return 3.0 * ladder.conductance * total


@compiled
def ladder_rates(ladder: Ladder, currents: Array, flux_rate: float, rates: Array) -> None:
    """Rates of the inductors' currents into `rates` (stages,).

    The node behind resistor 4k - 1 is at e - sum over l <= k of (4l - 1) (sum over m >= l of J_m).
    """
    beyond = 0.0
    for k in range(ladder.stages):
        beyond += currents[k]
    level = flux_rate
    for k in range(1, ladder.stages + 1):
        level -= (4.0 * k - 1.0) * beyond
        beyond -= currents[k - 1]
        rates[k - 1] = (4.0 * k + 1.0) / ladder.diffusion_time * level


def ladder_matrix(ladder: Ladder) -> Array:
    """The matrix (stages, stages) of the ladder's own motion, 1/s: for its poles and its transfer function."""
    columns = []
    for unit in np.eye(ladder.stages):
        rates = np.empty(ladder.stages)
        ladder_rates(ladder, unit, 0.0, rates)
        columns.append(rates)
    return np.array(columns).T


def ladder_response(ladder: Ladder, frequency: Array) -> NDArray[np.complex128]:
    """Current over flux rate, A/V, at frequencies in rad/s (n,): what `sheet_response` is approached by."""
    matrix = ladder_matrix(ladder)
    drive = np.empty(ladder.stages)
    ladder_rates(ladder, np.zeros(ladder.stages), 1.0, drive)
    identity = np.eye(ladder.stages)
    return np.array(
        [3 * ladder.conductance * np.linalg.solve(1j * w * identity - matrix, drive).sum() for w in frequency]
    )


def sheet_response(ladder: Ladder, frequency: Array) -> NDArray[np.complex128]:
    """The closed form 3 G (q coth q - 1)/q^2, A/V, at frequencies in rad/s (n,)."""
    q = np.sqrt(1j * np.asarray(frequency) * ladder.diffusion_time)
    return 3 * ladder.conductance * (q / np.tanh(q) - 1) / q**2


def fastest_ladder_rate(ladder: Ladder) -> float:
    """The largest pole of the ladder in 1/s; 0 without one."""
    return float(np.abs(np.linalg.eigvals(ladder_matrix(ladder))).max()) if ladder.stages else 0.0
