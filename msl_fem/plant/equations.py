"""The equations of motion, plain and with every effect of the catalogue; `docs/coupled_model.md` writes them out.

    v_j = R i_j + d lambda_j(i_j, g_j)/dt,   g_1 = g_0 - x,   g_2 = g_0 + x
    m x'' + c x' + k x = F_1(i_1, g_1) - F_2(i_2, g_2) + F_const + d(t)

(Woodson and Melcher, Electromechanical Dynamics I, 1968, ch. 3: flux linkage and force are derivatives of one
coenergy.) The currents are the electrical states: L_inc di/dt = v - R i - lambda_g dg/dt, with lambda_g = -dF/di.

At the effects' neutral values each term of `rates_with_effects` is the plain one, plus zero or times one, so its output
equals that of `rates` to the last bit. Pieces with many numbers are passed by where no lane has them. Powers and losses
are told of one run alone, not of lanes.

Stops are the elements of rate-independent memory: a stop of width r follows its input until it leaves [-r, r] and then
slides, e <- cut(e + change, r). Six of them, of widths r, 2 r ... 6 r and one slope s, give the force s sum_k e_k, a
Prandtl-Ishlinskii operator; s e_k^2/2 is stored, s r_k |slip_k| is lost (Brokate and Sprekels, Hysteresis and Phase
Transitions, 1996, ch. 2). It depends on the order of the input's extremes alone, never on time. Those of iron
may follow z = asinh(gamma y)/gamma and still take s_k e_k dy: `settle_broadened_stops` says what is lost then.

The coils' circuits with hysteresis, eddy currents and coupled sides.

Magnetising currents u, coil currents i, flux linkages Lambda of the magnetic circuits and lambda of the coils:

    u_1 + h_1 + G dLambda_1/dt = i_1 + kappa i_2,   lambda_1 = Lambda_1 + kappa Lambda_2   (and 1 for 2)
    v_j = R_j i_j + d lambda_j/dt,   d Lambda_j/dt = L_j du_j/dt + M du_o/dt + Lambda_g dg_j/dt = L_j a_j + M a_o + e_j

G is the conductance of a shorted winding (eddy_currents), h the memory of the iron (magnetic_hysteresis), less the
current that would make its remanent flux (remanent_flux), kappa the
share of the other side's current (cross_coupling). The power sum v_j i_j is R i^2 + sum (u + h + G dLambda/dt)
dLambda/dt: copper, field, hysteresis, eddy currents. A user's law takes its voltage from v_j before all that, and its
power is not counted; that of its force is work from outside. Each side is one row of two equations for a_1, a_2, with
q = 1/(1 - kappa^2), the currents i0 of a = 0, and

    voltage given:  rho_j = R_j,    b_j = (v_j - R_j i0_j - e_j - kappa e_o) / L_j
    current loop:   rho_j = L_j w,  b_j = w (target_j - i0_j) - kappa e_o / L_j
    (1 + kappa m + rho_j q G (1 - kappa m)) a_j + (m + kappa L_o/L_j + rho_j q G (m - kappa L_o/L_j)) a_o = b_j

with m = M/L_j,

where the loop applies v_j = R_j i_j + e_j + L_j w (target_j - i_j), as in the plain model: it knows its own coil.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import (
    Flag,
    Rows,
    Value,
    choose,
    every,
    exponential,
    first,
    hyperbolic_cosine,
    hyperbolic_sine,
    hyperbolic_tangent,
    inverse_hyperbolic_sine,
    size,
    some,
    width,
    within,
)
from msl_fem.plant.drive import jump_targets, terminal_voltage
from msl_fem.plant.effects import electrical, magnetic, mechanical, stray_flux, thermal
from msl_fem.plant.effects.expressions import LAW_VOLTAGE_1, LAW_VOLTAGE_2
from msl_fem.plant.effects.magnetic import N_EDDY
from msl_fem.plant.effects.mechanisms import N_IRON_STOP, N_STOP
from msl_fem.plant.layout import (
    ANCHOR_1,
    ANCHOR_X,
    ANCHORED,
    BASE,
    BASE_RATE,
    CIRCUIT_1,
    CIRCUIT_2,
    COIL_CURRENT,
    CORE_1,
    CREEP,
    EDDY_FLUX_1,
    EMF,
    ENERGY_COPPER,
    ENERGY_DAMPING,
    ENERGY_EDDY,
    ENERGY_ELECTRICAL,
    ENERGY_EXTERNAL,
    ENERGY_FRICTION,
    ENERGY_HYSTERESIS,
    ENERGY_INTERNAL,
    HEAT_1,
    I1,
    INDUCTANCE,
    INPUTS_BEGIN,
    KNOWN_1,
    KNOWN_IRON,
    KNOWN_MEAN,
    KNOWN_OF_IRON,
    KNOWN_SLOPE,
    LIMITED_1,
    MMF,
    MODE,
    MODE_FOLLOWS_NOW,
    MODE_LOSS,
    MODE_RATE,
    MUTUAL,
    N_CIRCUIT,
    N_INPUT,
    N_KNOWN,
    OUTPUT_OF_1,
    PULL_POWER,
    PUSH,
    RAMP_1,
    RESISTANCE,
    SHARED_FLUX,
    SHARED_INDUCTANCE,
    SHARED_PULL,
    SHARED_SLOPE,
    SLOPE,
    SLOW_CREEP,
    STOPS_1,
    STOPS_X,
    TARGET_1,
    VOLT_SECONDS_1,
    VOLTAGE,
    V,
    X,
    Y,
)
from msl_fem.plant.mutual_flux import are_coupled, set_mutual_flux, shared
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, PlantParameters
from msl_fem.plant.side import Cells, side_gap, side_slopes, side_with_effects
from msl_fem.plant.user_laws import add_law_voltages, law_force


@compiled
def solve_circuits(p: PlantParameters, e: Rows, work: Rows, inputs: int) -> None:
    """Slopes du/dt, voltages and coil currents of both sides into their circuits' rows, under inputs from that row.

    A circuit's rows hold L, e, u + h + G e and R; those of a side that is not there L = 1, else 0. Of currents that are
    known the voltages are not looked for.
    """
    known = work[KNOWN_1] > 0.0
    if p.sides == 2:
        known = known & (work[KNOWN_1 + N_KNOWN] > 0.0)
    if every(known):
        for j in range(p.sides):
            work[CIRCUIT_1 + j * N_CIRCUIT + SLOPE] = work[KNOWN_1 + j * N_KNOWN + KNOWN_SLOPE]
    elif p.sides == 1 or not (_are_tied(e) or some(size(work[MUTUAL]) > 0.0)):
        for j in range(p.sides):
            _solve_circuit(p, e, work, inputs, j)
    else:
        _solve_both(p, e, work, inputs)
    _put_coil_currents(p, e, work)


@compiled
def _put_coil_currents(p: PlantParameters, e: Rows, work: Rows) -> None:
    """What the coils carry, by the magnetising currents and their slopes."""
    if not _are_tied(e):
        for j in range(p.sides):
            work[CIRCUIT_1 + j * N_CIRCUIT + COIL_CURRENT] = work[CIRCUIT_1 + j * N_CIRCUIT + MMF]
        return
    share, unmix, eddy, mutual = e[magnetic.SHARE], e[magnetic.UNMIX], e[magnetic.EDDY], work[MUTUAL]
    a_1, a_2 = work[CIRCUIT_1 + SLOPE], work[CIRCUIT_2 + SLOPE]
    d_1 = work[CIRCUIT_1 + INDUCTANCE] * a_1 + mutual * a_2
    d_2 = work[CIRCUIT_2 + INDUCTANCE] * a_2 + mutual * a_1
    u_1, u_2 = work[CIRCUIT_1 + MMF], work[CIRCUIT_2 + MMF]
    work[CIRCUIT_1 + COIL_CURRENT] = unmix * (u_1 - share * u_2) + unmix * (eddy * d_1 - share * eddy * d_2)
    work[CIRCUIT_2 + COIL_CURRENT] = unmix * (u_2 - share * u_1) + unmix * (eddy * d_2 - share * eddy * d_1)


@compiled
def _solve_both(p: PlantParameters, e: Rows, work: Rows, inputs: int) -> None:
    """Slopes and voltages of two sides, whose circuits have a part in one another."""
    share, unmix, mutual = e[magnetic.SHARE], e[magnetic.UNMIX], work[MUTUAL]
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    r_1, r_2 = work[CIRCUIT_1 + RESISTANCE], work[CIRCUIT_2 + RESISTANCE]
    e_1, e_2 = work[CIRCUIT_1 + EMF], work[CIRCUIT_2 + EMF]
    i_1 = unmix * (work[CIRCUIT_1 + MMF] - share * work[CIRCUIT_2 + MMF])
    i_2 = unmix * (work[CIRCUIT_2 + MMF] - share * work[CIRCUIT_1 + MMF])
    u_1, u_2 = work[LAW_VOLTAGE_1], work[LAW_VOLTAGE_2]
    drop_1, drop_2 = r_1 * i_1 + e_1 + u_1, r_2 * i_2 + e_2 + u_2
    v_1, v_2 = work[inputs + OUTPUT_OF_1], work[inputs + OUTPUT_OF_1 + 1]
    from_2 = from_1 = e_1 - e_1
    if some(size(share) > 0.0):
        from_2, from_1 = share * e_2 / l_1, share * e_1 / l_2
    if p.drive != CURRENT_DRIVE:
        a_1, a_2 = _current_slopes(
            e,
            work,
            l_1,
            l_2,
            r_1,
            r_2,
            (v_1 - drop_1) / l_1 - from_2,
            (v_2 - drop_2) / l_2 - from_1,
        )
        _put_circuits(work, a_1, a_2, v_1, v_2)
    elif np.isinf(first(e[electrical.BANDWIDTH])):
        a_1, a_2 = work[inputs + RAMP_1], work[inputs + RAMP_1 + 1]
        d_1, d_2 = l_1 * a_1 + mutual * a_2, l_2 * a_2 + mutual * a_1
        v_1, v_2 = drop_1 + d_1 + share * (e_2 + d_2), drop_2 + d_2 + share * (e_1 + d_1)
        _put_circuits(work, a_1, a_2, v_1, v_2)
    else:
        new_1, former_1, counts_1 = jump_targets(p, work, inputs, 0)
        new_2, former_2, counts_2 = jump_targets(p, work, inputs, 1)
        _solve_loops(p, e, work, (i_1, i_2), (drop_1, drop_2), (from_2, from_1), new_1, new_2)
        counts = choose(size(counts_1) > 0.0, counts_1, counts_2)
        if some(size(counts) > 0.0):
            a_1, a_2 = work[CIRCUIT_1 + SLOPE], work[CIRCUIT_2 + SLOPE]
            v_1, v_2 = work[CIRCUIT_1 + VOLTAGE], work[CIRCUIT_2 + VOLTAGE]
            _solve_loops(p, e, work, (i_1, i_2), (drop_1, drop_2), (from_2, from_1), former_1, former_2)
            a_1, a_2 = _between(counts, a_1, work[CIRCUIT_1 + SLOPE]), _between(counts, a_2, work[CIRCUIT_2 + SLOPE])
            v_1, v_2 = (
                _between(counts, v_1, work[CIRCUIT_1 + VOLTAGE]),
                _between(counts, v_2, work[CIRCUIT_2 + VOLTAGE]),
            )
            _put_circuits(work, a_1, a_2, v_1, v_2)


@compiled
def _between(share: Value, value: Value, other: Value) -> Value:
    return value + share * (other - value)


@compiled
def _solve_loops(
    p: PlantParameters, e: Rows, work: Rows, currents: tuple[Value, Value], drops: tuple[Value, Value],
    others: tuple[Value, Value], t_1: Value, t_2: Value,
) -> None:  # fmt: skip
    """Slopes and voltages of two current loops with these targets, by `currents` without eddy currents, the voltages
    that keep them, and what the other side's back-EMF moves them by (A/s)."""
    (i_1, i_2), (drop_1, drop_2), (from_2, from_1) = currents, drops, others
    share, unmix, eddy, mutual = e[magnetic.SHARE], e[magnetic.UNMIX], e[magnetic.EDDY], work[MUTUAL]
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    r_1, r_2 = work[CIRCUIT_1 + RESISTANCE], work[CIRCUIT_2 + RESISTANCE]
    e_1, e_2 = work[CIRCUIT_1 + EMF], work[CIRCUIT_2 + EMF]
    u_1, u_2 = work[LAW_VOLTAGE_1], work[LAW_VOLTAGE_2]
    w = e[electrical.BANDWIDTH]
    b_1, b_2 = w * (t_1 - i_1) - from_2, w * (t_2 - i_2) - from_1
    a_1, a_2 = _current_slopes(e, work, l_1, l_2, w * l_1, w * l_2, b_1, b_2)
    d_1, d_2 = l_1 * a_1 + mutual * a_2, l_2 * a_2 + mutual * a_1
    c_1 = i_1 + unmix * (eddy * d_1 - share * eddy * d_2)
    c_2 = i_2 + unmix * (eddy * d_2 - share * eddy * d_1)
    v_1 = r_1 * c_1 + e_1 + d_1 + share * (e_2 + d_2) + u_1
    v_2 = r_2 * c_2 + e_2 + d_2 + share * (e_1 + d_1) + u_2
    over_1, over_2 = size(v_1) > p.voltage_limit, size(v_2) > p.voltage_limit
    if some(over_1) or some(over_2):
        v_1 = choose(over_1, choose(v_1 < 0.0, 0.0 - p.voltage_limit, p.voltage_limit), v_1)
        v_2 = choose(over_2, choose(v_2 < 0.0, 0.0 - p.voltage_limit, p.voltage_limit), v_2)
        b_1 = choose(over_1, (v_1 - drop_1) / l_1 - from_2, b_1)
        b_2 = choose(over_2, (v_2 - drop_2) / l_2 - from_1, b_2)
        a_1, a_2 = _current_slopes(
            e, work, l_1, l_2, choose(over_1, r_1, w * l_1), choose(over_2, r_2, w * l_2), b_1, b_2
        )
        work[LIMITED_1] = choose(over_1, 1.0, work[LIMITED_1])
        work[LIMITED_1 + 1] = choose(over_2, 1.0, work[LIMITED_1 + 1])
        d_1, d_2 = l_1 * a_1 + mutual * a_2, l_2 * a_2 + mutual * a_1
        c_1 = i_1 + unmix * (eddy * d_1 - share * eddy * d_2)
        c_2 = i_2 + unmix * (eddy * d_2 - share * eddy * d_1)
        v_1 = choose(over_1, v_1, r_1 * c_1 + e_1 + d_1 + share * (e_2 + d_2) + u_1)
        v_2 = choose(over_2, v_2, r_2 * c_2 + e_2 + d_2 + share * (e_1 + d_1) + u_2)
    _put_circuits(work, a_1, a_2, v_1, v_2)


@compiled
def _solve_circuit(p: PlantParameters, e: Rows, work: Rows, inputs: int, j: int) -> None:
    """The same of the only one, or of side j where no lane has eddy currents or sees anything of another side: the
    equation of the plain model, with v = drop + L (1 + R G) a and a = w/(1 + w L G) (target - i0)."""
    circuit = CIRCUIT_1 + j * N_CIRCUIT
    current, inductance, eddy = work[circuit + MMF], work[circuit + INDUCTANCE], e[magnetic.EDDY]
    drop = work[circuit + RESISTANCE] * current + work[circuit + EMF] + work[LAW_VOLTAGE_1 + j]
    w, stiffness = e[electrical.BANDWIDTH], inductance
    if some(eddy > 0.0) and not (p.drive == CURRENT_DRIVE and np.isinf(first(w))):
        w = w / (1.0 + w * inductance * eddy)
        stiffness = inductance * (1.0 + work[circuit + RESISTANCE] * eddy)
    new, former, counts = jump_targets(p, work, inputs, j)
    output, ramp = work[inputs + OUTPUT_OF_1 + j], work[inputs + RAMP_1 + j]
    voltage, slope, over = terminal_voltage(p, w, current, drop, stiffness, new, output, ramp)
    work[LIMITED_1 + j] = choose(over, 1.0, work[LIMITED_1 + j])
    if some(size(counts) > 0.0):
        before, slope_before, over = terminal_voltage(p, w, current, drop, stiffness, former, output, ramp)
        voltage, slope = _between(counts, voltage, before), _between(counts, slope, slope_before)
        work[LIMITED_1 + j] = choose(over, 1.0, work[LIMITED_1 + j])
    known = KNOWN_1 + j * N_KNOWN
    work[circuit + SLOPE] = choose(work[known] > 0.0, work[known + KNOWN_SLOPE], slope)
    work[circuit + VOLTAGE] = voltage


@compiled
def _current_slopes(
    e: Rows, work: Rows, l_1: Value, l_2: Value, rho_1: Value, rho_2: Value, b_1: Value, b_2: Value
) -> tuple[Value, Value]:
    """(a_1, a_2) of the two rows, by Cramer's rule."""
    row_1, row_2 = coupled_rows(e, work, l_1, l_2, rho_1, rho_2)
    return _both_slopes(work, b_1, b_2, row_1, row_2)


@compiled
def _are_tied(e: Rows) -> bool:
    """Whether a circuit has a share of the other one's current or eddy currents, in one lane at least."""
    return some(size(e[magnetic.SHARE]) > 0.0) or some(e[magnetic.EDDY] > 0.0)


@compiled
def coupled_rows(
    e: Rows, work: Rows, l_1: Value, l_2: Value, rho_1: Value, rho_2: Value
) -> tuple[tuple[Value, Value], tuple[Value, Value]]:  # fmt: skip
    """The two rows (own, other) of the equations for a_1, a_2 (see above)."""
    m_1, m_2 = work[MUTUAL] / l_1, work[MUTUAL] / l_2
    if e is None:
        return (1.0 + 0.0 * m_1, m_1), (1.0 + 0.0 * m_2, m_2)
    else:
        if not _are_tied(e):
            return (1.0 + 0.0 * m_1, m_1), (1.0 + 0.0 * m_2, m_2)
        share, loop = e[magnetic.SHARE], e[magnetic.UNMIX] * e[magnetic.EDDY]
        loop_1, loop_2 = rho_1 * loop, rho_2 * loop
        own_1 = 1.0 + share * m_1 + loop_1 * (1.0 - share * m_1)
        own_2 = 1.0 + share * m_2 + loop_2 * (1.0 - share * m_2)
        from_2, from_1 = share * (l_2 / l_1), share * (l_1 / l_2)
        return (own_1, m_1 + from_2 + loop_1 * (m_1 - from_2)), (own_2, m_2 + from_1 + loop_2 * (m_2 - from_1))


@compiled
def _both_slopes(
    work: Rows, b_1: Value, b_2: Value, row_1: tuple[Value, Value], row_2: tuple[Value, Value]
) -> tuple[Value, Value]:
    """(a_1, a_2) of two rows (own, other); where one is known, the other one follows from its own row."""
    (own_1, other_1), (own_2, other_2) = row_1, row_2
    second = KNOWN_1 + N_KNOWN
    determinant = own_1 * own_2 - other_1 * other_2
    from_2, from_1 = b_1 - other_1 * work[second + KNOWN_SLOPE], b_2 - other_2 * work[KNOWN_1 + KNOWN_SLOPE]
    a_1 = choose(work[second] > 0.0, from_2 / own_1, (b_1 * own_2 - other_1 * b_2) / determinant)
    a_2 = choose(work[KNOWN_1] > 0.0, from_1 / own_2, (own_1 * b_2 - b_1 * other_2) / determinant)
    return a_1, a_2


@compiled
def _put_circuits(work: Rows, a_1: Value, a_2: Value, v_1: Value, v_2: Value) -> None:
    """Slopes and voltages into their rows; the slope of a current that is known is that of the stage."""
    work[CIRCUIT_1 + SLOPE] = choose(work[KNOWN_1] > 0.0, work[KNOWN_1 + KNOWN_SLOPE], a_1)
    second = KNOWN_1 + N_KNOWN
    work[CIRCUIT_2 + SLOPE] = choose(work[second] > 0.0, work[second + KNOWN_SLOPE], a_2)
    work[CIRCUIT_1 + VOLTAGE] = v_1
    work[CIRCUIT_2 + VOLTAGE] = v_2


@compiled
def rates(cells: Cells, p: PlantParameters, work: Rows, inputs: int, dy: int) -> Flag:
    """The slopes of the first N_PLAIN states Y into the rows from `dy`, under inputs from that row; False outside."""
    position, velocity = work[Y + X], work[Y + V]
    external = work[inputs + PUSH]
    if p.drive == FORCE_DRIVE:
        external = external + work[inputs + OUTPUT_OF_1]
        work[dy + VOLT_SECONDS_1] = work[inputs + OUTPUT_OF_1]
    force = external
    power = copper = velocity - velocity
    inside = velocity == velocity
    if p.sides == 2:
        inside = set_mutual_flux(cells, p, None, work, work[Y + I1], work[Y + I1 + 1])
        force = shared(cells, work, SHARED_PULL, force)
    for j in range(p.sides):
        toward = 1.0 - 2.0 * j  # side 1 pulls towards +x, side 2 towards -x
        current = work[Y + I1 + j]
        found, pull, inductance, flux_slope = side_slopes(cells, p, work, j, current, side_gap(p, None, work, j))
        inside = inside & found
        motion = 0.0 - flux_slope * toward
        if p.sides == 2:
            inductance = shared(cells, work, CIRCUIT_1 + j * N_CIRCUIT + SHARED_INDUCTANCE, inductance)
            motion = shared(cells, work, CIRCUIT_1 + j * N_CIRCUIT + SHARED_SLOPE, motion)
        drop = p.resistance * current + motion * velocity
        voltage, slope, over = terminal_voltage(
            p, p.bandwidth, current, drop, inductance, work[inputs + TARGET_1 + j], work[inputs + OUTPUT_OF_1 + j],
            work[inputs + RAMP_1 + j],
        )  # fmt: skip
        work[LIMITED_1 + j] = choose(over, 1.0, work[LIMITED_1 + j])
        force = force + toward * pull
        known = work[KNOWN_1 + j * N_KNOWN] > 0.0
        voltage = choose(known, p.resistance * current, voltage)
        power = power + (voltage * current + choose(known, toward * pull * velocity, 0.0))
        copper = copper + p.resistance * current * current
        work[dy + I1 + j] = slope
        work[dy + VOLT_SECONDS_1 + j] = voltage
        work[CIRCUIT_1 + j * N_CIRCUIT + INDUCTANCE] = inductance
    if p.sides == 2:
        if are_coupled(cells) or some(size(p.mutual) > 0.0):
            power = power + _mutual_rates(p, work, inputs, dy)
        power = power + _shared_power(cells, work, velocity)
    work[dy + X] = velocity
    work[dy + V] = (force - p.damping * velocity - p.stiffness * position) / p.mass
    if width(work) == 1:
        work[dy + ENERGY_ELECTRICAL] = power
        work[dy + ENERGY_COPPER] = copper
        work[dy + ENERGY_DAMPING] = p.damping * velocity * velocity
        work[dy + ENERGY_EXTERNAL] = external * velocity
    return inside


@compiled
def _mutual_rates(p: PlantParameters, work: Rows, inputs: int, dy: int) -> Value:
    """Puts what mutual flux changes into the currents' slopes, L_j a_j + M a_o = what the drive leaves for it; of an
    ideal current drive into the voltages, whose power it returns."""
    l_1, l_2 = work[CIRCUIT_1 + INDUCTANCE], work[CIRCUIT_2 + INDUCTANCE]
    a_1, a_2 = work[dy + I1], work[dy + I1 + 1]
    if p.drive == CURRENT_DRIVE and np.isinf(first(p.bandwidth)):
        work[dy + VOLT_SECONDS_1] = work[dy + VOLT_SECONDS_1] + work[MUTUAL] * a_2
        work[dy + VOLT_SECONDS_1 + 1] = work[dy + VOLT_SECONDS_1 + 1] + work[MUTUAL] * a_1
        return work[MUTUAL] * (a_2 * work[Y + I1] + a_1 * work[Y + I1 + 1])
    row_1, row_2 = coupled_rows(None, work, l_1, l_2, l_1, l_2)
    a_1, a_2 = _both_slopes(work, a_1, a_2, row_1, row_2)
    work[dy + I1], work[dy + I1 + 1] = a_1, a_2
    return a_1 - a_1


@compiled
def _shared_power(cells: Cells, work: Rows, gap_speed: Value) -> Value:
    """Power of the force that both sides have in common, where both currents are known over the step; else it is part
    of v i."""
    both = (work[KNOWN_1] > 0.0) & (work[KNOWN_1 + N_KNOWN] > 0.0)
    nothing = gap_speed - gap_speed
    return choose(both, shared(cells, work, SHARED_PULL, nothing) * gap_speed, nothing)


@compiled
def rates_with_effects(
    cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, inputs: int, dy: int, settle: bool
) -> Flag:  # fmt: skip
    """The slopes of the N_INTEGRATED states Y into the rows from `dy`, under inputs from that row; False outside.

    `state` holds the memory of iron and friction. With `settle` it is moved to Y: there a step begins, or ends.
    """
    gap_speed = work[Y + V] - e[mechanical.COMPLIANCE] * work[Y + BASE_RATE]
    external = work[inputs + PUSH]
    if p.drive == FORCE_DRIVE:
        external = external + work[inputs + OUTPUT_OF_1]
        work[dy + VOLT_SECONDS_1] = work[inputs + OUTPUT_OF_1]
    force, magnets = external, external - external
    film, inside = magnets, magnets == magnets
    if p.sides == 2:
        inside = set_mutual_flux(cells, p, e, work, work[Y + I1], work[Y + I1 + 1])
        force = shared(cells, work, SHARED_PULL, force)
        magnets = shared(cells, work, SHARED_PULL, magnets)
    for j in range(p.sides):
        toward = 1.0 - 2.0 * j
        gap = side_gap(p, e, work, j)
        found, pull, inductance, flux_slope, flux, _ = side_with_effects(cells, p, e, work, j, work[Y + I1 + j], gap)
        inside = inside & found
        force = force + toward * pull
        magnets = magnets + toward * pull
        if some(size(e[mechanical.FILM]) > 0.0):
            closeness = e[mechanical.FILM_GAP] / gap
            film = film + closeness * closeness * closeness
        circuit = CIRCUIT_1 + j * N_CIRCUIT
        motion = 0.0 - flux_slope * toward
        if p.sides == 2:
            flux = flux + work[circuit + SHARED_FLUX]
            inductance = shared(cells, work, circuit + SHARED_INDUCTANCE, inductance)
            motion = shared(cells, work, circuit + SHARED_SLOPE, motion)
        emf = motion * gap_speed
        memory = _taken_within(e, state, work, j, flux, (inputs - INPUTS_BEGIN) // N_INPUT, settle)
        work[circuit + INDUCTANCE] = inductance
        work[circuit + EMF] = emf
        work[circuit + PULL_POWER] = toward * pull * gap_speed
        eddies = _eddy_modes(e, state, work, j, flux, dy)
        work[circuit + MMF] = work[Y + I1 + j] + memory + eddies + e[magnetic.EDDY] * emf
        work[circuit + RESISTANCE] = p.resistance * (1.0 + work[Y + HEAT_1 + j])
    if settle:
        state[ANCHORED] = 1.0
    if p.sides > 0:
        add_law_voltages(p, e, work)
        solve_circuits(p, e, work, inputs)
        _electrical_rates(p, e, work, dy)
    if p.sides == 2 and width(work) == 1:
        work[dy + ENERGY_ELECTRICAL] = work[dy + ENERGY_ELECTRICAL] + _shared_power(cells, work, gap_speed)
    of_laws = law_force(p, e, work)
    film_force = e[mechanical.FILM] * film * gap_speed
    spring, stribeck = _suspension(e, state, work, settle)
    _motion(p, e, work, dy, force + of_laws, film_force + spring + stribeck, magnets - film_force)
    if width(work) == 1:
        work[dy + ENERGY_INTERNAL] = work[dy + ENERGY_INTERNAL] + stribeck * work[Y + V]
        work[dy + ENERGY_DAMPING] = p.damping * work[Y + V] * work[Y + V] + film_force * gap_speed
        work[dy + ENERGY_EXTERNAL] = (external + of_laws) * work[Y + V]
    return inside


@compiled
def _taken_within(e: Rows, state: Rows, work: Rows, j: int, flux: Value, instant: int, settle: bool) -> Value:
    """`taken_by_iron` at begin, middle or end (0, 1, 2) of a step where that is known, else by the flux linkage."""
    row = KNOWN_1 + j * N_KNOWN
    known, taken = work[row + KNOWN_IRON] > 0.0, work[row + KNOWN_OF_IRON + instant]
    if settle or not every(known):
        taken = choose(known, taken, taken_by_iron(e, state, j, flux, settle))
    return taken


@compiled
def taken_by_iron(e: Rows, state: Rows, j: int, flux: Value, settle: bool) -> Value:
    """The part of a side's current (A) that its iron's memory and iron in series take, less what remanence gives."""
    return hysteresis(e, state, j, flux, settle) + series_iron(e, flux) - remanence(e, j, flux)


@compiled
def hysteresis(e: Rows, state: Rows, j: int, flux: Value, settle: bool) -> Value:
    """The part of a side's current (A) that its iron's memory takes, p'(lambda) sum_k s_k e_k: magnetic_hysteresis."""
    if not some(e[magnetic.HYSTERESIS_SLOPE] > 0.0):
        return flux - flux
    stretch = e[magnetic.HYSTERESIS_STRETCH] * flux * flux
    followed = flux * (1.0 + stretch)
    gamma = e[magnetic.HYSTERESIS_BROADENING]
    if some(gamma > 0.0):
        followed = choose(gamma > 0.0, inverse_hyperbolic_sine(gamma * followed) / gamma, followed)
    slopes, widths, first = magnetic.HYSTERESIS_SLOPE, magnetic.HYSTERESIS_WIDTH, STOPS_1 + j * N_IRON_STOP
    change = followed - state[ANCHOR_1 + j]
    if settle:
        if some(gamma > 0.0):
            lost = settle_broadened_stops(e, state, gamma, first, change, followed)
        else:
            lost = settle_stops(e, state, slopes, widths, first, N_IRON_STOP, change)
        if width(state) == 1:
            state[ENERGY_HYSTERESIS] = state[ENERGY_HYSTERESIS] + lost
        state[ANCHOR_1 + j] = followed
        change = flux - flux
    return (1.0 + 3.0 * stretch) * stop_sum(e, state, slopes, widths, first, N_IRON_STOP, change)


@compiled
def series_iron(e: Rows, flux: Value) -> Value:
    """The part of a side's current (A) that its iron takes in excess of the table's, see early_saturation."""
    if not (some(e[magnetic.IRON_LOW] > 0.0) or some(e[magnetic.IRON_KNEE] > 0.0)):
        return flux - flux
    y = e[magnetic.IRON_SCALE] * flux
    return y * (e[magnetic.IRON_LOW] / (e[magnetic.IRON_WIDTH] + size(y)) + e[magnetic.IRON_KNEE] * knee(e, y * y))


@compiled
def knee(e: Rows, square: Value) -> Value:
    """(exp(7 b y^2) - 1)/(b (exp(7) - 1)) of y^2, or y^2 where there is no b, see early_saturation."""
    if not some(e[magnetic.IRON_BENDS] > 0.0):
        return square
    bends = e[magnetic.IRON_BENDS]
    steep = magnetic.STEEPNESS * bends * square
    near = magnetic.STEEPNESS * square * (1.0 + steep * (0.5 + steep * (1.0 / 6.0 + steep / 24.0)))
    above = choose(steep < 1e-3, near, (exponential(steep) - 1.0) / bends)
    return choose(bends > 0.0, above / magnetic.RISE, square)


@compiled
def remanence(e: Rows, j: int, flux: Value) -> Value:
    """The current (A) that a side's remanence stands for at its flux, see remanent_flux."""
    if not some(size(e[stray_flux.REMANENT_1 + j]) > 0.0):
        return flux - flux
    return e[stray_flux.REMANENT_1 + j] / (1.0 + e[stray_flux.REMANENCE_FADES] * flux * flux)


@compiled
def _eddy_modes(e: Rows, state: Rows, work: Rows, j: int, flux: Value, dy: int) -> Value:
    """The part of a side's current (A) that the modes of its eddy currents take; before the first evaluation they have
    settled, or followed a share of the flux linkage. Their losses go into the side's loss row."""
    taken = flux - flux
    lost = taken
    if not some(e[magnetic.EDDY_MODE] > 0.0):
        return taken
    for k in range(N_EDDY):
        row = EDDY_FLUX_1 + j * N_EDDY + k
        begun, at_begin = state[ANCHORED] > 0.0, (1.0 - e[magnetic.EDDY_MISSED + k]) * flux
        state[row] = choose(begun, state[row], at_begin)
        work[Y + row] = choose(begun, work[Y + row], at_begin)
        behind = flux - (work[Y + row] + work[MODE_FOLLOWS_NOW + k] * flux)
        taken = taken + e[magnetic.EDDY_MODE + k] * behind
        lost = lost + e[magnetic.EDDY_MODE + k] * e[magnetic.EDDY_RATE + k] * behind * behind
        work[dy + row] = e[magnetic.EDDY_RATE + k] * behind
    work[CIRCUIT_1 + j * N_CIRCUIT + MODE_LOSS] = lost
    return taken


@compiled
def warms(e: Rows) -> bool:
    """Whether a coil's resistance is or becomes another one, in one lane at least."""
    begins = size(e[electrical.HEAT_START]) + size(e[thermal.CORE_RISE])
    begins = begins + size(e[thermal.RISE_1]) + size(e[thermal.RISE_2])
    return some(e[electrical.HEAT_PER_JOULE] + begins > 0.0)


@compiled
def gives_way(e: Rows) -> bool:
    """Whether a flexure relaxes, or there is a second mass or a base that gives way, in one lane at least."""
    bodies = size(e[mechanical.CREEP_STIFFNESS]) + size(e[mechanical.COMPLIANCE])
    bodies = bodies + size(e[mechanical.SLOW_CREEP_STIFFNESS])
    return some(bodies + e[mechanical.MODE_STIFFNESS] > 0.0)


@compiled
def _electrical_rates(p: PlantParameters, e: Rows, work: Rows, dy: int) -> None:
    """Slopes of the circuits' states: coil_heating warms R by what it dissipates; it cools towards its core."""
    power = copper = eddy = work[Y + V] - work[Y + V]
    for j in range(p.sides):
        circuit = CIRCUIT_1 + j * N_CIRCUIT
        current, voltage = work[circuit + COIL_CURRENT], work[circuit + VOLTAGE]
        current = choose(work[KNOWN_1 + j * N_KNOWN] > 1.0, work[KNOWN_1 + j * N_KNOWN + KNOWN_MEAN], current)
        loss = work[circuit + RESISTANCE] * current * current
        mutual = work[MUTUAL] * work[CIRCUIT_2 - j * N_CIRCUIT + SLOPE]
        change = work[circuit + INDUCTANCE] * work[circuit + SLOPE] + mutual + work[circuit + EMF]
        lost = e[magnetic.EDDY] * change * change + work[circuit + MODE_LOSS]
        known = work[KNOWN_1 + j * N_KNOWN] > 0.0
        taken = work[LAW_VOLTAGE_1 + j]
        voltage = choose(known, work[circuit + RESISTANCE] * current + taken, voltage)
        power = power + ((voltage - taken) * current + choose(known, work[circuit + PULL_POWER] + lost, 0.0))
        copper = copper + loss
        eddy = eddy + lost
        work[dy + I1 + j] = work[circuit + SLOPE]
        work[dy + VOLT_SECONDS_1 + j] = voltage
        if warms(e):
            above = work[Y + HEAT_1 + j] - work[Y + CORE_1 + j]
            work[dy + HEAT_1 + j] = e[electrical.HEAT_PER_JOULE] * loss - e[electrical.COOLING] * above
            work[dy + CORE_1 + j] = e[electrical.CORE_RATE] * above
    if width(work) == 1:
        work[dy + ENERGY_ELECTRICAL] = power
        work[dy + ENERGY_COPPER] = copper
        work[dy + ENERGY_EDDY] = eddy


@compiled
def _suspension(e: Rows, state: Rows, work: Rows, settle: bool) -> tuple[Value, Value]:
    """The force (N) against +x of stiffness_nonlinearity, flexure_relaxation and the stops of coulomb_friction, and
    what of friction depends on the velocity (Hess and Soom, J. Tribology 112, 1990, 147-152)."""
    x, slopes, widths = work[Y + X], mechanical.FRICTION_SLOPE, mechanical.FRICTION_WIDTH
    spring = (e[mechanical.QUADRATIC] + e[mechanical.CUBIC] * x) * x * x
    creep = e[mechanical.CREEP_STIFFNESS] * (x - work[Y + CREEP])
    creep = creep + e[mechanical.SLOW_CREEP_STIFFNESS] * (x - work[Y + SLOW_CREEP])
    if not (some(e[slopes] > 0.0) or some(e[mechanical.SMOOTH_FRICTION] > 0.0)):
        return spring + creep, x - x
    change = x - state[ANCHOR_X]
    if settle:
        lost = settle_stops(e, state, slopes, widths, STOPS_X, N_STOP, change)
        if width(state) == 1:
            state[ENERGY_FRICTION] = state[ENERGY_FRICTION] + lost
        state[ANCHOR_X] = x
        change = x - x
    v = work[Y + V]
    more = e[mechanical.STRIBECK_RISE] / (1.0 + e[mechanical.STRIBECK_FALL] * v * v)
    stops = stop_sum(e, state, slopes, widths, STOPS_X, N_STOP, change)
    return spring + creep + stops, more * stops + _smooth_friction(e, v) * (1.0 + more)


@compiled
def _smooth_friction(e: Rows, v: Value) -> Value:
    """Friction (N) that passes zero with the velocity, F tanh(v/w): see coulomb_friction."""
    if not some(e[mechanical.SMOOTH_FRICTION] > 0.0):
        return v - v
    return e[mechanical.SMOOTH_FRICTION] * hyperbolic_tangent(e[mechanical.SMOOTH_SLOPE] * v)


@compiled
def _motion(p: PlantParameters, e: Rows, work: Rows, dy: int, force: Value, own: Value, on_base: Value) -> None:
    """Slopes of mover, second mass (structural_mode), relaxed length (flexure_relaxation), base (support_compliance).

    `force` is that of the plain model, `own` what effects hold against it, `on_base` what the base is pulled with.
    """
    x, v = work[Y + X], work[Y + V]
    acceleration = (force - p.damping * v - p.stiffness * x - own) / (e[mechanical.MODE_KEPT] * p.mass)
    work[dy + X] = v
    work[dy + V] = acceleration
    if width(work) == 1:
        work[dy + ENERGY_INTERNAL] = v - v
    if not gives_way(e):
        return
    mode, mode_rate = work[Y + MODE], work[Y + MODE_RATE]
    base, base_rate = work[Y + BASE], work[Y + BASE_RATE]
    stretch, slow_stretch = x - work[Y + CREEP], x - work[Y + SLOW_CREEP]
    link = e[mechanical.MODE_STIFFNESS] * mode + e[mechanical.MODE_DAMPING] * mode_rate
    acceleration = acceleration + e[mechanical.MODE_RATIO] * link
    work[dy + V] = acceleration
    work[dy + MODE] = mode_rate
    work[dy + MODE_RATE] = 0.0 - acceleration - link
    work[dy + CREEP] = e[mechanical.CREEP_RATE] * stretch
    work[dy + SLOW_CREEP] = e[mechanical.SLOW_CREEP_RATE] * slow_stretch
    work[dy + BASE] = base_rate
    work[dy + BASE_RATE] = (
        e[mechanical.BASE_STIFFNESS] * (0.0 - on_base - base) - e[mechanical.BASE_DAMPING] * base_rate
    )
    if width(work) == 1:
        base_loss = e[mechanical.BASE_INERTIA] * e[mechanical.BASE_DAMPING] * base_rate * base_rate
        mode_loss = e[mechanical.MODE_MASS] * e[mechanical.MODE_DAMPING] * mode_rate * mode_rate
        creep_loss = e[mechanical.CREEP_STIFFNESS] * e[mechanical.CREEP_RATE] * stretch * stretch
        slow_loss = e[mechanical.SLOW_CREEP_STIFFNESS] * e[mechanical.SLOW_CREEP_RATE] * slow_stretch * slow_stretch
        work[dy + ENERGY_INTERNAL] = base_loss + mode_loss + creep_loss + slow_loss


@compiled
def stop_sum(e: Rows, state: Rows, slopes: int, widths: int, start: int, count: int, change: Value) -> Value:
    """Sum of slope times stop, `count` of them, after a `change` of what they follow that is not kept.

    Slopes and widths stand in the coefficients from those rows on, the stops in the state from row `start` on.
    """
    total = change - change
    for k in range(count):
        total = total + e[slopes + k] * within(state[start + k] + change, e[widths + k])
    return total


@compiled
def settle_stops(e: Rows, state: Rows, slopes: int, widths: int, start: int, count: int, change: Value) -> Value:
    """Moves the stops, given as in `stop_sum`, by a `change` of what they follow; the loss in J, s_k r_k |slip_k|."""
    lost = change - change
    for k in range(count):
        moved = state[start + k] + change
        kept = within(moved, e[widths + k])
        lost = lost + e[slopes + k] * e[widths + k] * size(moved - kept)
        state[start + k] = kept
    return lost


@compiled
def settle_broadened_stops(e: Rows, state: Rows, gamma: Value, start: int, change: Value, followed: Value) -> Value:
    """Moves a side's stops, that have `followed` z = asinh(gamma y)/gamma, by the last `change` of it; of one run the
    loss in J.

    They take s_k e_k dy. Of that s_k |y(z) - y(z - e_k)| |dz| is lost where a stop slips, the rest is stored.
    """
    slopes, widths = magnetic.HYSTERESIS_SLOPE, magnetic.HYSTERESIS_WIDTH
    lost = change - change
    for k in range(N_IRON_STOP):
        moved = state[start + k] + change
        kept = within(moved, e[widths + k])
        slip = moved - kept
        plain = e[slopes + k] * e[widths + k] * size(slip)
        if width(state) == 1 and some(size(slip) > 0.0):
            half = 0.5 * gamma
            middle = followed - 0.5 * (slip + kept)
            broad = hyperbolic_sine(half * size(slip)) * hyperbolic_sine(half * e[widths + k])
            broad = e[slopes + k] * broad * hyperbolic_cosine(gamma * middle) / (half * half)
            plain = choose(gamma > 0.0, broad, plain)
        lost = lost + plain
        state[start + k] = kept
    return lost
