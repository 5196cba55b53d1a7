"""Stops: the elements of rate-independent memory, and their sum, a Prandtl-Ishlinskii operator.

A stop of width r follows its input until it leaves [-r, r] and then slides: e <- cut(e + change, r). Six of them, of
widths r, 2 r ... 6 r and one slope s, give the force s sum_k e_k; s e_k^2/2 is stored, s r_k |slip_k| is lost (Brokate
and Sprekels, Hysteresis and Phase Transitions, 1996, ch. 2). It depends on the order of the input's extremes alone,
never on time; closed paths of the input give closed loops.
"""

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, Value, size, within
from msl_fem.plant.coefficients import N_STOP


@compiled
def stop_sum(state: Rows, start: int, width: Value, change: Value) -> Value:
    """Sum of the stops that stand from row `start`, after a `change` of their input that is not kept."""
    total = change - change
    for k in range(N_STOP):
        total = total + within(state[start + k] + change, (k + 1) * width)
    return total


@compiled
def settle_stops(state: Rows, start: int, width: Value, change: Value) -> Value:
    """Moves the stops by a `change` of their input; sum of r_k |slip_k|, the loss over their slope."""
    lost = change - change
    for k in range(N_STOP):
        moved = state[start + k] + change
        kept = within(moved, (k + 1) * width)
        lost = lost + (k + 1) * width * size(moved - kept)
        state[start + k] = kept
    return lost


@compiled
def stop_energy(state: Rows, start: int) -> Value:
    """Sum of e_k^2 / 2, the stored energy over the stops' slope."""
    total = state[start] * state[start]
    for k in range(1, N_STOP):
        total = total + state[start + k] * state[start + k]
    return 0.5 * total
