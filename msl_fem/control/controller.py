"""One step of the controller, compiled: estimate, decide on a force, turn it into currents, ask the guard.

    u = u_model + B(K (xi_model - xi_hat) - K_i sum(y - x_model))     with the reference feedforward
    u = B(-K xi_hat - K_i sum(y - r)) + K_r (r, r', r'')              without: K_r = 0 is the source paper's LQR

With the feedforward the loop has two degrees of freedom: xi_model is the believed plant under u_model = u_ff +
K_model (xi_ref - xi_model), where u_ff = m r'' + c r' + k r is the force that the reference needs one `lead` ahead
(see `preview`). Regulator and integral act on deviations from this promised response and not on the reference's own
jumps (model following: Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., sec. 4.5). B is a second-order
section on what is fed back. K, K_i and the filter's gains may follow the stiffness of the magnets that hold the mover
(see `gain_schedule`); the integral sums K_i times the error, so that a K_i that moves does not move the force. Positive
u pulls towards +x and is side 1's, negative side 2's. All designs are this step with other numbers; PID is the law
without feedforward whose filter is a difference quotient.
"""

from typing import NamedTuple

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.control.heat import N_NODE, ThermalArrays, bearable_now, warm
from msl_fem.control.inverse import Inverse
from msl_fem.control.output_stage import OutputStage, commanded_currents

# The state: the filter's prediction for the coming sample (m, m/s, N) and its last estimate, the integral (N), the last
# innovation (m) and force (N); then counts of commands by the verdict of the output stage:
# what the guard says of what was wanted, and commands that were cut for the drive or the table; whether a first sample
# was taken; the memory of the second-order section; the magnets' stiffness that the gains follow (N/m); how much warmer
# than the ambient winding and core of a magnet of each side are (K).
X_PREDICTED, V_PREDICTED, D_PREDICTED, V_HAT, D_HAT, INTEGRAL, INNOVATION, FORCE = range(8)
N_PREFERRED, N_DISCOURAGED, N_FORCE_LIMITED, N_HEAT_LIMITED, N_VIOLATION = range(8, 13)
STARTED, SHAPE_1, SHAPE_2, STIFFNESS, RISE_1 = range(13, 18)
RISE_2 = RISE_1 + N_NODE
COMING = RISE_2 + N_NODE
"""Row of the state: the position in m at which the last currents were inverted."""
N_FIXED = COMING + 1
# After these: the known states of the believed plant (n - 2), the followed model (n), the feedforward's queue (delay).

NO_SHAPE = (1.0, 0.0, 0.0, 0.0, 0.0)
"""The second-order section that changes nothing: b0, b1, b2, a1, a2 of (b0 + b1/z + b2/z^2)/(1 + a1/z + a2/z^2)."""
_LEAST_GAP = 0.05  # of the nominal one: nearer, a pull's stiffness is taken from there


class ControllerParameters(NamedTuple):
    """All that `controller_step` knows: belief, gains, guard."""

    inverse: Inverse
    stage: OutputStage
    model_a: Array  # (n, n) of the believed plant
    model_b: Array  # (n,)
    gain: Array  # (n,)
    integral_gain: float
    shape: Array  # (5,) see NO_SHAPE
    model_gain: Array  # (n,) of the model's own state feedback
    reference_gain: Array  # (3,) of position, velocity, acceleration, without feedforward
    filter_prediction: Array  # (3, n + 2)
    filter_gain: Array  # (2,)
    mass: float
    stiffness: float
    damping: float
    constant_force: float  # N, believed to act along +x
    cubic: float  # N/m^3, of the believed suspension; carried at the position to come
    delay: int
    lead: float  # s, of the feedforward
    gap_row: Array  # (n + 2,) the position that the inverse uses, as `gap_to_come.position_after`
    feedforward: bool
    schedule_at: Array  # (n_node,) N/m
    schedule: Array  # (n_node, n + 3) factors of gain, integral_gain and filter_gain
    schedule_share: float  # of a sample's stiffness in that which the gains follow
    nominal_gap: float  # m
    thermal: ThermalArrays  # of a magnet


def controller_state(parameters: ControllerParameters) -> Array:
    """The state before the first sample."""
    n = parameters.model_a.shape[0]
    return np.zeros(N_FIXED + (n - 2) + n + parameters.delay)


@compiled
def controller_step(
    parameters: ControllerParameters, state: Array, reference: Array, measured: float, command: Array
) -> None:
    """Side currents in A into command (2,), to act `delay` samples later; the state is updated.

    A reading that is not finite gives no current and counts as a violation; the filter goes on with its prediction.

    Parameters
    ----------
    reference : (6,) position, velocity, acceleration wanted now, and wanted a `lead` later
    measured : m
    """
    p = parameters
    n = p.model_a.shape[0]
    known = state[N_FIXED : N_FIXED + n - 2]
    model = state[N_FIXED + n - 2 : N_FIXED + 2 * n - 2]
    queue = state[N_FIXED + 2 * n - 2 :]
    seen = np.isfinite(measured)
    if state[STARTED] == 0.0:
        if not seen:  # there is nothing to begin from
            command[0] = command[1] = 0.0
            state[N_VIOLATION] += 1.0
            return
        state[STARTED] = 1.0
        state[X_PREDICTED] = measured
        model[0] = measured
        known[:] = p.constant_force  # the mover has rested, with no current
        model[2:] = p.constant_force
        queue[:] = p.constant_force
    y = measured if seen else state[X_PREDICTED]
    gains = np.empty(n + 3)
    _scheduled(p, state[STIFFNESS], gains)
    _estimate(state, y, gains[n + 1], gains[n + 2])
    force, error = _law(p, state, reference, y, gains, model, known, queue)
    coming = _position_to_come(p, state, y, force, known)
    apart = p.cubic * coming * coming * coming - p.constant_force  # forces that the linear plant has not
    positions = (y, coming)
    state[COMING] = coming
    rises_1, rises_2 = state[RISE_1:RISE_2], state[RISE_2:COMING]
    borne = bearable_now(p.thermal, rises_1), bearable_now(p.thermal, rises_2)
    total = force + apart if seen else np.nan
    of_magnets, verdict = commanded_currents(p.stage, p.inverse, total, positions, borne, command)
    state[N_PREFERRED + verdict] += 1.0
    warm(p.thermal, rises_1, command[0] * p.inverse.current_share)
    warm(p.thermal, rises_2, command[1] * p.inverse.current_share)
    given = of_magnets - apart
    state[FORCE] = given
    # Anti-windup: the integral stands while the force is cut and the error would push it further.
    cut = force - given
    if abs(cut) <= 1e-9 * (1.0 + abs(force)) or cut * gains[n] * error > 0:
        state[INTEGRAL] += gains[n] * error
    if seen:
        state[STIFFNESS] += p.schedule_share * (pull_stiffness(of_magnets, coming, p.nominal_gap) - state[STIFFNESS])
    _predict(p, state, y, given, known)


@compiled
def causal_step(
    parameters: ControllerParameters, state: Array, reference: Array, measured: float, command: Array
) -> None:
    """`controller_step` for a reference that is not known ahead: (3,) wanted now, carried on by its acceleration."""
    lead = parameters.lead
    r, v, a = reference[0], reference[1], reference[2]
    carried = np.empty(6)
    carried[0] = r
    carried[1] = v
    carried[2] = a
    carried[3] = r + lead * (v + 0.5 * lead * a)
    carried[4] = v + lead * a
    carried[5] = a
    controller_step(parameters, state, carried, measured, command)


@compiled
def pull_stiffness(force: float, position: float, nominal_gap: float) -> float:
    """N/m that a held force of the magnets takes from the suspension: 2 |F|/g of F = C i^2/g^2, without saturation."""
    gap = nominal_gap - position if force > 0 else nominal_gap + position
    least = _LEAST_GAP * nominal_gap
    return 2.0 * abs(force) / (gap if gap > least else least)


@compiled
def _scheduled(p: ControllerParameters, stiffness: float, gains: Array) -> None:
    """Gain, integral gain and filter gain (n + 3,): factors straight between nodes, held beyond them."""
    n = p.gain.size
    nodes = p.schedule_at
    j = 0
    while j < nodes.size - 2 and stiffness > nodes[j + 1]:
        j += 1
    share = (stiffness - nodes[j]) / (nodes[j + 1] - nodes[j])
    if share < 0.0:
        share = 0.0
    if share > 1.0:
        share = 1.0
    for k in range(n + 3):
        gains[k] = p.schedule[j, k] + share * (p.schedule[j + 1, k] - p.schedule[j, k])
    for k in range(n):
        gains[k] *= p.gain[k]
    gains[n] *= p.integral_gain
    gains[n + 1] *= p.filter_gain[0]
    gains[n + 2] *= p.filter_gain[1]


@compiled
def _estimate(state: Array, measured: float, of_velocity: float, of_disturbance: float) -> None:
    innovation = measured - state[X_PREDICTED]
    state[INNOVATION] = innovation
    state[V_HAT] = state[V_PREDICTED] + of_velocity * innovation
    state[D_HAT] = state[D_PREDICTED] + of_disturbance * innovation


@compiled
def _law(
    p: ControllerParameters, state: Array, reference: Array, measured: float, gains: Array, model: Array, known: Array,
    queue: Array,
) -> tuple[float, float]:  # fmt: skip
    """(force wanted, error that the integral takes); moves the model and the feedforward's queue on."""
    n = p.model_a.shape[0]
    force = -state[INTEGRAL] - gains[0] * measured - gains[1] * state[V_HAT]
    for j in range(2, n):
        force -= gains[j] * known[j - 2]
    if not p.feedforward:
        force = _shaped(p.shape, state, force)
        for j in range(3):
            force += p.reference_gain[j] * reference[j]
        return force, measured - reference[0]
    promised = _model_force(p, reference, model, queue)
    error = measured - model[0]
    following = np.empty(n)
    for row in range(n):
        force += gains[row] * model[row]
        following[row] = p.model_b[row] * promised
        for j in range(n):
            following[row] += p.model_a[row, j] * model[j]
    for row in range(n):
        model[row] = following[row]
    return promised + _shaped(p.shape, state, force), error


@compiled
def _shaped(shape: Array, state: Array, value: float) -> float:
    """A value through the second-order section (transposed direct form II)."""
    out = shape[0] * value + state[SHAPE_1]
    state[SHAPE_1] = shape[1] * value - shape[3] * out + state[SHAPE_2]
    state[SHAPE_2] = shape[2] * value - shape[4] * out
    return float(out)


@compiled
def _model_force(p: ControllerParameters, reference: Array, model: Array, queue: Array) -> float:
    """u_ff + K_model (xi_ref - xi_model); moves the feedforward's queue on.

    xi_ref is the state of a plant that follows: position, velocity, the force needed now, the feedforward under way.
    """
    n = p.model_a.shape[0]
    r, v, a = reference[0], reference[1], reference[2]
    ahead = p.stiffness * reference[3] + p.damping * reference[4] + p.mass * reference[5]
    force = ahead + p.model_gain[0] * r + p.model_gain[1] * v
    n_lag = n - 2 - p.delay
    if n_lag == 1:
        force += p.model_gain[2] * (p.stiffness * r + p.damping * v + p.mass * a)
    for j in range(p.delay):
        force += p.model_gain[2 + n_lag + j] * queue[j]
        queue[j] = queue[j + 1] if j + 1 < p.delay else ahead
    for j in range(n):
        force -= p.model_gain[j] * model[j]
    return float(force)


@compiled
def _position_to_come(p: ControllerParameters, state: Array, measured: float, force: float, known: Array) -> float:
    row = p.gap_row
    n = p.model_a.shape[0]
    position = row[0] * measured + row[1] * state[V_HAT] + row[2] * state[D_HAT] + row[n + 1] * force
    for j in range(n - 2):
        position += row[3 + j] * known[j]
    return float(position)


@compiled
def _predict(p: ControllerParameters, state: Array, measured: float, given: float, known: Array) -> None:
    """The filter's prediction of the next sample, and the known states there."""
    n = p.model_a.shape[0]
    for row in range(3):
        f = p.filter_prediction[row]
        value = f[0] * measured + f[1] * state[V_HAT] + f[2] * state[D_HAT] + f[n + 1] * given
        for j in range(n - 2):
            value += f[3 + j] * known[j]
        state[X_PREDICTED + row] = value
    following = np.empty(n - 2)
    for row in range(n - 2):
        following[row] = p.model_b[2 + row] * given
        for j in range(n - 2):
            following[row] += p.model_a[2 + row, 2 + j] * known[j]
    for row in range(n - 2):
        known[row] = following[row]
