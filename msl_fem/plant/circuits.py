"""The coils' circuits with hysteresis, eddy currents and coupled sides.

Magnetising currents u, coil currents i, flux linkages Lambda of the magnetic circuits and lambda of the coils:

    u_1 + h_1 + G dLambda_1/dt = i_1 + kappa i_2,   lambda_1 = Lambda_1 + kappa Lambda_2   (and 1 for 2)
    v_j = R_j i_j + d lambda_j/dt,   d Lambda_j/dt = L_j du_j/dt + Lambda_g dg_j/dt = L_j a_j + e_j

G is the conductance of a shorted winding (eddy_currents), h the memory of the iron (magnetic_hysteresis), kappa the
share of the other side's current (cross_coupling). The power sum v_j i_j is R i^2 + sum (u + h + G dLambda/dt)
dLambda/dt: copper, field, hysteresis, eddy currents. Each side is one row of two equations for a_1, a_2, with
q = 1/(1 - kappa^2), the currents i0 of a = 0, and

    voltage given:  rho_j = R_j,    b_j = (v_j - R_j i0_j - e_j - kappa e_o) / L_j
    current loop:   rho_j = L_j w,  b_j = w (target_j - i0_j) - kappa e_o / L_j
    (1 + rho_j q G) a_j + kappa L_o/L_j (1 - rho_j q G) a_o = b_j

where the loop applies v_j = R_j i_j + e_j + L_j w (target_j - i_j), as in the plain model: it knows its own coil.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import Rows, Value, choose, first, size, some
from msl_fem.plant.effects import electrical, magnetic
from msl_fem.plant.layout import (
    CIRCUIT_1,
    CIRCUIT_2,
    COIL_CURRENT,
    EMF,
    INDUCTANCE,
    LIMITED_1,
    MMF,
    OUTPUT_OF_1,
    RESISTANCE,
    SLOPE,
    TARGET_1,
    VOLTAGE,
)
from msl_fem.plant.plant import CURRENT_DRIVE, PlantParameters


@compiled
def solve_circuits(p: PlantParameters, e: Rows, work: Rows, inputs: int) -> None:
    """Slopes du/dt, voltages and coil currents of both sides into their circuits' rows, under inputs from that row.

    A circuit's rows hold L, e, u + h + G e and R; those of a side that is not there L = 1, else 0.
    """
    share, unmix, eddy = e[magnetic.SHARE], e[magnetic.UNMIX], e[magnetic.EDDY]
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    r_1, r_2 = work[CIRCUIT_1 + RESISTANCE], work[CIRCUIT_2 + RESISTANCE]
    e_1, e_2 = work[CIRCUIT_1 + EMF], work[CIRCUIT_2 + EMF]
    i_1 = unmix * (work[CIRCUIT_1 + MMF] - share * work[CIRCUIT_2 + MMF])
    i_2 = unmix * (work[CIRCUIT_2 + MMF] - share * work[CIRCUIT_1 + MMF])
    drop_1, drop_2 = r_1 * i_1 + e_1, r_2 * i_2 + e_2
    t_1, t_2 = work[inputs + TARGET_1], work[inputs + TARGET_1 + 1]
    v_1, v_2 = work[inputs + OUTPUT_OF_1], work[inputs + OUTPUT_OF_1 + 1]
    if p.drive != CURRENT_DRIVE:
        a_1, a_2 = _slopes(
            e, l_1, l_2, r_1, r_2, (v_1 - drop_1) / l_1 - share * e_2 / l_1, (v_2 - drop_2) / l_2 - share * e_1 / l_2
        )
        _put(work, a_1, a_2, v_1, v_2)
    elif np.isinf(first(e[electrical.BANDWIDTH])):
        _put(work, i_1 - i_1, i_2 - i_2, drop_1 + share * e_2, drop_2 + share * e_1)
    else:
        w = e[electrical.BANDWIDTH]
        b_1, b_2 = w * (t_1 - i_1) - share * e_2 / l_1, w * (t_2 - i_2) - share * e_1 / l_2
        a_1, a_2 = _slopes(e, l_1, l_2, w * l_1, w * l_2, b_1, b_2)
        c_1 = i_1 + unmix * (eddy * l_1 * a_1 - share * eddy * l_2 * a_2)
        c_2 = i_2 + unmix * (eddy * l_2 * a_2 - share * eddy * l_1 * a_1)
        v_1 = r_1 * c_1 + e_1 + l_1 * a_1 + share * (e_2 + l_2 * a_2)
        v_2 = r_2 * c_2 + e_2 + l_2 * a_2 + share * (e_1 + l_1 * a_1)
        over_1, over_2 = size(v_1) > p.voltage_limit, size(v_2) > p.voltage_limit
        if some(over_1) or some(over_2):
            v_1 = choose(over_1, choose(v_1 < 0.0, 0.0 - p.voltage_limit, p.voltage_limit), v_1)
            v_2 = choose(over_2, choose(v_2 < 0.0, 0.0 - p.voltage_limit, p.voltage_limit), v_2)
            b_1 = choose(over_1, (v_1 - drop_1) / l_1 - share * e_2 / l_1, b_1)
            b_2 = choose(over_2, (v_2 - drop_2) / l_2 - share * e_1 / l_2, b_2)
            a_1, a_2 = _slopes(e, l_1, l_2, choose(over_1, r_1, w * l_1), choose(over_2, r_2, w * l_2), b_1, b_2)
            work[LIMITED_1] = choose(over_1, 1.0, work[LIMITED_1])
            work[LIMITED_1 + 1] = choose(over_2, 1.0, work[LIMITED_1 + 1])
            c_1 = i_1 + unmix * (eddy * l_1 * a_1 - share * eddy * l_2 * a_2)
            c_2 = i_2 + unmix * (eddy * l_2 * a_2 - share * eddy * l_1 * a_1)
            v_1 = choose(over_1, v_1, r_1 * c_1 + e_1 + l_1 * a_1 + share * (e_2 + l_2 * a_2))
            v_2 = choose(over_2, v_2, r_2 * c_2 + e_2 + l_2 * a_2 + share * (e_1 + l_1 * a_1))
        _put(work, a_1, a_2, v_1, v_2)
    a_1, a_2 = work[CIRCUIT_1 + SLOPE], work[CIRCUIT_2 + SLOPE]
    work[CIRCUIT_1 + COIL_CURRENT] = i_1 + unmix * (eddy * l_1 * a_1 - share * eddy * l_2 * a_2)
    work[CIRCUIT_2 + COIL_CURRENT] = i_2 + unmix * (eddy * l_2 * a_2 - share * eddy * l_1 * a_1)


@compiled
def _slopes(e: Rows, l_1: Value, l_2: Value, rho_1: Value, rho_2: Value, b_1: Value, b_2: Value) -> tuple[Value, Value]:
    """(a_1, a_2) of the two rows, by Cramer's rule."""
    share, loop = e[magnetic.SHARE], e[magnetic.UNMIX] * e[magnetic.EDDY]
    own_1, own_2 = 1.0 + rho_1 * loop, 1.0 + rho_2 * loop
    other_1 = share * (l_2 / l_1) * (1.0 - rho_1 * loop)
    other_2 = share * (l_1 / l_2) * (1.0 - rho_2 * loop)
    determinant = own_1 * own_2 - other_1 * other_2
    return (b_1 * own_2 - other_1 * b_2) / determinant, (own_1 * b_2 - b_1 * other_2) / determinant


@compiled
def _put(work: Rows, a_1: Value, a_2: Value, v_1: Value, v_2: Value) -> None:
    work[CIRCUIT_1 + SLOPE] = a_1
    work[CIRCUIT_2 + SLOPE] = a_2
    work[CIRCUIT_1 + VOLTAGE] = v_1
    work[CIRCUIT_2 + VOLTAGE] = v_2
