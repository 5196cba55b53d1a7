"""One period of the current loop, compiled: from wanted and read currents to the voltages of the coils.

A side's flux linkage lambda obeys d lambda/dt = v - R i - d, whatever iron and gap do; d is what is not known: motion,
dead time, a resistance that is off. So the loop controls the flux linkage that belongs to the wanted current at the
measured position, and is linear where the inductance is not. A voltage acts one period after the reading that it
answers; what is under way moves the flux linkage on by then:

    d[k] = d[k-1] - forget (lambda[k] - predicted[k])/T          lambda[k] by the table, from current and position
    predicted[k+1] = lambda[k] + T (v[k] - R i[k] - d[k])        v[k] acts now
    v[k+1] = R i[k+1] + d[k] + (1 - pole)(wanted - predicted[k+1])/T

With a true model lambda[k+2] = predicted[k+1] + (1 - pole)(wanted - predicted[k+1]): a pole and one period of delay;
pole = 0 is the deadbeat law. The estimate d is the integral part (Kukrer, IEEE Trans. Power Electronics 11, 1996:
discrete current control of voltage-fed PWM inverters by prediction; Harnefors, Nee, IEEE Trans. Industry Applications
34, 1998: gains from the model). It takes the voltage that was given, cut and rounded, so it does not wind up.

With `trust` below 1 the flux linkage is observed: integrated from v - R i - d, and drawn to the table's by `trust` of
what that misses (the voltage model of a flux, with its drift taken off by the current model below a corner:
Jansen, Lorenz, IEEE Trans. Industry Applications 30, 1994). The pull goes with its square, so above the
corner neither eddy currents nor an error of the gap are in it; the target is taken at the position at which the
currents were inverted, so that flux linkage and force belong together.
"""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.inverse import Inverse, believed_gap, side_surface
from msl_fem.table.coenergy_surface import evaluate

# Of a side: flux linkage predicted for the coming reading (Wb), unknown drop (V), voltage that acts now (V), whether it
# has begun
FLUX, UNKNOWN, ACTING, BEGUN = range(4)
N_OF_SIDE = 4
N_LIMITED = 2 * N_OF_SIDE
"""Row of the state that counts the voltages that were cut at the limit."""
N_STATE = N_LIMITED + 1
_VALUES = 6


class CurrentLoopParameters(NamedTuple):
    """All that `current_step` knows."""

    inverse: Inverse  # of which surfaces, gaps and the magnets' connection
    leakage_1: float  # H, of side 1, beside the table's flux linkage
    leakage_2: float
    mutual: float  # H, of both sides
    resistance: float  # ohm, of a side
    period: float  # s
    pole: float  # of the flux linkage, a period
    forget: float  # share of a period's surprise that goes into the unknown drop
    voltage_limit: float  # V
    voltage_step: float  # V, of a pulse; 0: any voltage
    trust: float = 1.0  # share of a period's surprise that goes into the flux linkage; 1: the table's is taken
    lost: float = 0.0  # V, that the bridge's dead time takes, where the flux linkage is observed
    ripple: float = 0.0  # A, half of the current's ripple


@compiled
def current_step(
    parameters: CurrentLoopParameters, state: Array, wanted: Array, read: Array, position: float, aim: float,
    voltage: Array,
) -> None:  # fmt: skip
    """Voltages of the sides in V into voltage (2,), to act one period later; the state is updated.

    A reading that is not finite gives no voltage, and the loop begins anew.

    Parameters
    ----------
    wanted, read : (2,) A of the sides
    position : m, as last measured
    aim : m, at which the wanted currents were inverted: where a flux observer's target is taken
    """
    voltage[0] = voltage[1] = 0.0
    for side in range(2):
        if side < parameters.inverse.sides:
            _of_side(parameters, state, side, wanted, read, position, aim, voltage)


@compiled
def _of_side(
    p: CurrentLoopParameters, state: Array, side: int, wanted: Array, read: Array, position: float, aim: float,
    voltage: Array,
) -> None:  # fmt: skip
    first = side * N_OF_SIDE
    gap = believed_gap(p.inverse, side, position)
    now, asked = read[side] + read[1 - side], wanted[side] + wanted[1 - side]
    if not (np.isfinite(now) and np.isfinite(asked) and np.isfinite(gap)):
        state[first + BEGUN] = state[first + ACTING] = state[first + UNKNOWN] = 0.0
        return
    flux, inductance = side_linkage(p, side, read[side], read[1 - side], gap)
    aimed = believed_gap(p.inverse, side, aim) if p.trust < 1.0 and np.isfinite(aim) else gap
    target, _ = side_linkage(p, side, wanted[side], wanted[1 - side], aimed)
    if state[first + BEGUN] > 0.0:
        missed = flux - state[first + FLUX]
        state[first + UNKNOWN] -= p.forget * missed / p.period
        if p.trust < 1.0:
            flux = state[first + FLUX] + p.trust * missed
    state[first + BEGUN] = 1.0
    unknown = state[first + UNKNOWN]
    lost = _lost(p, read[side]) if p.trust < 1.0 else 0.0
    coming = flux + p.period * (state[first + ACTING] - p.resistance * read[side] - unknown - lost)
    current = read[side] + (coming - flux) / inductance
    wished = p.resistance * current + unknown + (1.0 - p.pole) * (target - coming) / p.period
    if p.trust < 1.0:
        wished += _lost(p, current)
    given = _given(p, wished)
    if abs(wished) > p.voltage_limit:
        state[N_LIMITED] += 1.0
    state[first + FLUX] = coming
    state[first + ACTING] = given
    voltage[side] = given


@compiled
def _lost(p: CurrentLoopParameters, current: float) -> float:
    """V that dead time takes of the bridge's mean at a current, see `power_stage.bridge_voltage`."""
    share = 1.0 if p.ripple == 0.0 else min(abs(current) / p.ripple, 1.0)
    return p.lost * share if current > 0.0 else -p.lost * share


@compiled
def _given(p: CurrentLoopParameters, wished: float) -> float:
    """The voltage that the modulator makes of one: cut, and a whole number of pulse steps."""
    most = p.voltage_limit
    wished = most if wished > most else -most if wished < -most else wished
    if p.voltage_step == 0.0:
        return wished
    steps = int(abs(wished) / p.voltage_step + 0.5)
    return steps * p.voltage_step if wished >= 0.0 else -(steps * p.voltage_step)


@compiled
def side_linkage(p: CurrentLoopParameters, side: int, current: float, other: float, gap: float) -> tuple[float, float]:
    """(flux linkage Wb, incremental inductance H) of a side at its current, the other side's current, and its gap.

    Straight on beyond the table's currents; beyond its gaps, those of its edge.
    """
    surface = side_surface(p.inverse, side)
    share = p.inverse.current_share
    end = surface.current[-1]
    i = share * current
    inside = end if i > end else -end if i < -end else i
    low, high = surface.gap[0], surface.gap[-1]
    at = low if gap < low else high if gap > high else gap
    values = np.empty(_VALUES)
    evaluate(surface.gap, surface.current, surface.coefficients, inside, at, values)
    linkages = p.inverse.magnets * share
    leak = p.leakage_1 if side == 0 else p.leakage_2
    flux = linkages * (values[1] + values[3] * (i - inside)) + leak * current + p.mutual * other
    return float(flux), float(linkages * share * values[3] + leak)
