"""Hysteresis of the iron: a Preisach operator on the flux linkage gives the pinned part of the magnetising current.

Its Everett function is closed: from a turning point at flux b0 on to b the current changes by

    2 Y((h(b) - h(b0))/2),   Y(z) = A (1 - exp(-z)) for z > 0, odd;   h(b) = s asinh(b/(s b_c))

with Y the virgin curve. That is the Preisach plane of an exponential spread of coercive fields (Krasnosel'skii and
Pokrovskii, Systems with Hysteresis, 1989, sect. 34), stretched by h, so that loops at high flux are wider. It has
return point memory, congruent minor loops, Rayleigh's parabolas at small amplitude, and takes energy on every loop: the
current leads the flux. Memory is a stack of turning points; evaluation leaves it as it is, `settle` carries it on.
"""

import numpy as np

from msl_fem.bench.plant import Array, Hysteresis
from msl_fem.computing.compiled import compiled

DEPTH = 400
# A side's memory: how many turning points, the last flux (stretched) and current, the direction; then the points
COUNT, LAST, LAST_CURRENT, DIRECTION, POINTS = range(5)
MEMORY = POINTS + 2 * DEPTH


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
def settle(h: Hysteresis, memory: Array, flux: float) -> None:
    """Carry the memory (MEMORY,) to a flux linkage: a turn is remembered, closed loops are wiped out."""
    z = stretched(h, flux)
    if z == memory[LAST]:
        return
    current = pinned_current(h, memory, flux)
    count, new, start, at_start = _branch(memory, z)
    if new:
        if count == 0:
            memory[POINTS], memory[POINTS + 1] = -start, -at_start
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
