"""The power amplifier of a side: what becomes of a command, the voltage it gives, and all that acts during a step.

Targets of current loops, outputs of voltage and force drives and outer forces: Runge-Kutta takes them at begin, middle
and end of the step.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import (
    Flag,
    Rows,
    Value,
    choose,
    exponential,
    first,
    fma,
    lane_of,
    larger,
    logarithm,
    set_lane,
    size,
    smaller,
    some,
    square_root,
    width,
    within,
)
from msl_fem.plant.effects import electrical, magnetic, mechanical, sensing
from msl_fem.plant.effects.electrical import N_QUEUE
from msl_fem.plant.layout import (
    AT_CURRENT_LIMIT_1,
    AT_VOLTAGE_LIMIT_1,
    CIRCUIT_1,
    CIRCUIT_2,
    COIL_1,
    COIL_READING_WEIGHTS,
    COMMAND_1,
    DRIVE_FALL,
    DRIVE_RAMP,
    ENERGY_ELECTRICAL,
    FORMER_1,
    FORMER_ABOVE_1,
    FORMER_SHARE,
    GIVEN_BEGIN_1,
    GIVEN_END_1,
    I1,
    I2,
    INPUTS_BEGIN,
    INPUTS_END,
    INPUTS_MIDDLE,
    LAG_1,
    LAG_END_1,
    N_CIRCUIT,
    OUTPUT_1,
    OUTPUT_END_1,
    OUTPUT_OF_1,
    PHASE_COSINE,
    PHASE_COSINE_END,
    PHASE_SINE,
    PHASE_SINE_END,
    PUSH,
    QUEUE_1,
    QUEUE_2,
    RAMP_1,
    RISE_1,
    SENSOR_WEIGHTS,
    SHARED_ENERGY,
    SHARED_FLUX,
    SLEW_1,
    SLEW_END_1,
    TARGET_1,
    VOLT_SECONDS_1,
    X,
)
from msl_fem.plant.mutual_flux import set_mutual_flux
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, PlantParameters
from msl_fem.plant.poles import FAST, fall_rows, lag_weights, mean_and_rise
from msl_fem.plant.side import Cells, side_flux, side_gap

Three = tuple[Value, Value, Value]
_STEEP = 20.0  # above it asinh(e^w/2) is w
_FEW = 0.01  # below it series of a few terms are exact
_NO_CORNER = 1e-30  # A, V or N: a limit that sets in at once


@compiled
def set_timing(p: PlantParameters, e: Rows, step: float, work: Rows) -> None:
    """Weights of the sensor's and the drive's lag over a step into the workspace, lane by lane."""
    work[DRIVE_FALL] = p.bandwidth if e is None else e[electrical.BANDWIDTH]
    work[SENSOR_WEIGHTS] = p.sensor_bandwidth if e is None else e[sensing.SENSOR_BANDWIDTH]
    for lane in range(width(work)):
        drive, sensor = lane_of(work, DRIVE_FALL, lane), lane_of(work, SENSOR_WEIGHTS, lane)
        lag_weights(sensor, step, work, SENSOR_WEIGHTS, lane)
        fall_rows(drive, step, work, DRIVE_FALL, lane)
        late = 1.0 / (drive * step)
        for k in range(4):
            behind = (0.5 + late) * lane_of(work, DRIVE_FALL + k, lane)
            set_lane(work, DRIVE_RAMP + k, lane, min(0.5 * k, 1.0) - 0.5 - late + behind)
        if e is not None:
            lag_weights(lane_of(e, sensing.COIL_READING_RATE, lane), step, work, COIL_READING_WEIGHTS, lane)


@compiled
def terminal_voltage(
    p: PlantParameters, w: Value, current: Value, drop: Value, inductance: Value, target: Value, output: Value,
    ramp: Value,
) -> tuple[Value, Value, Flag]:  # fmt: skip
    """(voltage V, di/dt A/s, whether the voltage limit acts) of a side.

    `drop` is R i + lambda_g dg/dt, what is left of the voltage where the current stands still. A voltage drive gives
    its `output`. A current drive's inner loop of bandwidth w knows the coil: v = drop + L_inc w (target - i) makes the
    current a first-order lag of its target, -3 dB at w, until v meets the voltage limit (Krishnan, Electric Motor
    Drives, 2001, ch. 3: current control with decoupling of the back-EMF). Without a bandwidth the current is its
    target, which rises by `ramp` A/s.
    """
    never = inductance < 0.0
    if p.drive != CURRENT_DRIVE:
        return output, (output - drop) / inductance, never
    if np.isinf(first(w)):
        return drop + inductance * ramp, ramp, never
    slope = w * (target - current)
    voltage = drop + inductance * slope
    over = size(voltage) > p.voltage_limit
    if not some(over):
        return voltage, slope, over
    most = choose(voltage < 0.0, 0.0 - p.voltage_limit, p.voltage_limit)
    return choose(over, most, voltage), choose(over, (most - drop) / inductance, slope), over


@compiled
def jump_targets(p: PlantParameters, work: Rows, inputs: int, j: int) -> tuple[Value, Value, Value]:
    """(target of side j behind a jump within the step, before it, what the one before counts at this instant); both the
    same, and nothing, where none jumps. A voltage limit holds for either, not for what stands for both."""
    target = work[inputs + TARGET_1 + j]
    if p.drive != CURRENT_DRIVE:
        return target, target, target - target
    above = work[inputs + FORMER_ABOVE_1 + j]
    share = choose(size(above) > 0.0, work[inputs + FORMER_SHARE], 0.0)
    new = target - share * above
    return new, new + above, share


@compiled
def take_command(p: PlantParameters, state: Rows, work: Rows, commands: Rows, now: int, ahead: int) -> Flag:
    """Puts what is wanted, of two commands from row `now`, by the gain and zero of the input, clipped at the drive's
    limit and counted there, into the call's command, and by what it rises until what is wanted `ahead`, a sample later.

    False where it is not a number. A voltage drive does not limit its current; calls that begin beyond the current
    limit are counted.
    """
    good = state[X] == state[X]
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        gain, zero = p.input_gain_1, p.input_zero_1
        if j == 1:
            gain, zero = p.input_gain_2, p.input_zero_2
        command = choose(good, gain * commands[now + j] + zero, commands[now + j])
        later = choose(good, gain * commands[ahead + j] + zero, commands[ahead + j])
        good = good & (command - command == 0.0) & (later - later == 0.0)
        if p.drive == CURRENT_DRIVE:
            count(state, AT_CURRENT_LIMIT_1 + j, size(command) > p.current_limit)
            command, later = within(command, p.current_limit), within(later, p.current_limit)
        elif p.drive == VOLTAGE_DRIVE:
            count(state, AT_VOLTAGE_LIMIT_1 + j, size(command) > p.voltage_limit)
            count(state, AT_CURRENT_LIMIT_1 + j, size(state[COIL_1 + j]) > p.current_limit)
            command, later = within(command, p.voltage_limit), within(later, p.voltage_limit)
        work[COMMAND_1 + j] = command
        work[RISE_1 + j] = later - command
    return good


@compiled
def count(state: Rows, n: int, flag: Flag) -> None:
    state[n] = state[n] + choose(flag, 1.0, 0.0)


@compiled
def jump(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows) -> Flag:
    """Sets the currents of an ideal drive to the call's command; False outside the table.

    They jump at constant gap, that of Y: the jump of flux goes into the volt-seconds, that of field energy into the
    electrical input. An ideal voltage or force drive gives its command at once.
    """
    inside = state[X] == state[X]
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        command = work[COMMAND_1 + j]
        state[OUTPUT_1 + j] = command
        if p.drive == CURRENT_DRIVE:
            current = command
            if e is not None:
                current = command + e[magnetic.SHARE] * work[COMMAND_1 + 1 - j]
            inside = inside & _jump_of_side(cells, p, e, state, work, j, current)
    return inside


@compiled
def _jump_of_both(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, current: Value) -> Flag:
    """What the sides have in common, while the current of side j goes to another value and the other one stays."""
    own, other = CIRCUIT_1 + j * N_CIRCUIT + SHARED_FLUX, CIRCUIT_2 - j * N_CIRCUIT + SHARED_FLUX
    was_inside = set_mutual_flux(cells, p, e, work, state[I1], state[I2])
    own_before, other_before, stored_before = work[own], work[other], work[SHARED_ENERGY]
    first, second = state[I1], state[I2]
    if j == 0:
        first = current
    else:
        second = current
    inside = was_inside & set_mutual_flux(cells, p, e, work, first, second)
    own_change, other_change = work[own] - own_before, work[other] - other_before
    if e is not None:
        share = e[magnetic.SHARE]
        own_change, other_change = own_change + share * other_change, other_change + share * own_change
    state[VOLT_SECONDS_1 + j] = state[VOLT_SECONDS_1 + j] + own_change
    state[VOLT_SECONDS_1 + 1 - j] = state[VOLT_SECONDS_1 + 1 - j] + other_change
    state[ENERGY_ELECTRICAL] = state[ENERGY_ELECTRICAL] + (work[SHARED_ENERGY] - stored_before)
    return inside


@compiled
def _jump_of_side(cells: Cells, p: PlantParameters, e: Rows, state: Rows, work: Rows, j: int, current: Value) -> Flag:
    gap = side_gap(p, e, work, j)
    was_inside, flux_before, stored_before = side_flux(cells, p, e, work, j, state[I1 + j], gap)
    inside, flux, stored = side_flux(cells, p, e, work, j, current, gap)
    inside = inside & was_inside
    if some(inside):
        change = choose(inside, flux - flux_before, np.nan)
        other = VOLT_SECONDS_1 + 1 - j
        state[VOLT_SECONDS_1 + j] = state[VOLT_SECONDS_1 + j] + change
        if e is not None:
            state[other] = state[other] + e[magnetic.SHARE] * change
        state[ENERGY_ELECTRICAL] = state[ENERGY_ELECTRICAL] + (stored - stored_before)
        if p.sides == 2:
            inside = inside & _jump_of_both(cells, p, e, state, work, j, current)
        state[I1 + j] = choose(inside, current, np.nan)
    return inside


@compiled
def queue_command(e: Rows, state: Rows, work: Rows, linear: bool) -> None:
    """Puts the call's command last in the queues, and takes out those that act now; `linear`: with their rise."""
    for j in range(2):
        if some(e[electrical.LOST_SHARE] > 0.0):
            _limit_command(e, work, j)
        queue = QUEUE_1 if j == 0 else QUEUE_2
        if some(e[electrical.DELAY_SAMPLES] > 0.0):
            for k in range(queue + N_QUEUE, queue, -1):
                state[k] = state[k - 1]
            state[queue] = work[COMMAND_1 + j]
            for lane in range(width(state)):
                acts = queue + int(lane_of(e, electrical.DELAY_SAMPLES, lane))
                command, former = lane_of(state, acts, lane), lane_of(state, acts + 1, lane)
                if linear and acts > queue:
                    set_lane(work, RISE_1 + j, lane, lane_of(state, acts - 1, lane) - command)
                set_lane(work, COMMAND_1 + j, lane, command)
                set_lane(work, FORMER_1 + j, lane, former)
        else:  # none waits: of a queue its first two are asked for
            work[FORMER_1 + j] = state[queue]
            state[queue + 1] = state[queue]
            state[queue] = work[COMMAND_1 + j]


@compiled
def _limit_command(e: Rows, work: Rows, j: int) -> None:
    """Takes from the call's command of side j, and from the next one, what the drive does not give beyond its limit."""
    limits = e[electrical.LOST_SHARE] > 0.0
    asked, later = work[COMMAND_1 + j], work[COMMAND_1 + j] + work[RISE_1 + j]
    given, later = _given(e, asked), _given(e, later)
    work[COMMAND_1 + j] = choose(limits, given, asked)
    work[RISE_1 + j] = choose(limits, later - given, work[RISE_1 + j])


@compiled
def _given(e: Rows, asked: Value) -> Value:
    """What a drive gives of a command beyond its limit, into which it runs over a corner: see drive_limit."""
    return asked - e[electrical.LOST_SHARE] * (_beyond(e, asked) - _beyond(e, 0.0 - asked))


@compiled
def _beyond(e: Rows, asked: Value) -> Value:
    """What a command has beyond the positive limit, c log(1 + exp(d/c)) of d = asked - limit, c = corner/pi."""
    c = larger(e[electrical.CORNER], _NO_CORNER) / np.pi
    over = asked - e[electrical.LIMIT]
    return larger(over, 0.0) + c * logarithm(1.0 + exponential(0.0 - size(over) / c))


@compiled
def set_inputs(p: PlantParameters, state: Rows, work: Rows, push: Value, begin: float, part: float) -> None:
    """The inputs of one step of the plain model, from a share `begin` of the sample on, `part` of it: commands held or
    rising, outputs on their way to the commands, forces held."""
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        mean, rise = _straight(work, j, begin + 0.0 * push, part)
        target = mean - 0.5 * rise, mean + 0.0 * rise, mean + 0.5 * rise
        _put(work, TARGET_1 + j, target)
        if p.drive != CURRENT_DRIVE:
            _put(work, OUTPUT_OF_1 + j, _output(state, work, j, target, np.isinf(first(p.bandwidth))))
    _put(work, PUSH, (push, push, push))


@compiled
def _output(state: Rows, work: Rows, j: int, target: Three, ideal: bool) -> Three:
    """What the drive of side j gives in a step, and behind it: its lag's answer to a target that is nearly straight."""
    begin, middle, end = target
    if ideal:
        work[OUTPUT_END_1 + j] = end
        return begin, middle, end
    mean, slope = mean_and_rise(begin, middle, end)
    away = state[OUTPUT_1 + j] - mean
    work[OUTPUT_END_1 + j] = fma(work[DRIVE_FALL + 3], away, mean) + slope * work[DRIVE_RAMP + 3]
    return (
        fma(work[DRIVE_FALL], away, mean) + slope * work[DRIVE_RAMP],
        fma(work[DRIVE_FALL + 1], away, mean) + slope * work[DRIVE_RAMP + 1],
        fma(work[DRIVE_FALL + 2], away, mean) + slope * work[DRIVE_RAMP + 2],
    )


@compiled
def set_ramps(p: PlantParameters, e: Rows, work: Rows, duration: float) -> None:
    """What the currents of an ideal drive rise by, A/s, over a sample of `duration` s; nought of other drives."""
    ideal = p.drive == CURRENT_DRIVE and np.isinf(first(p.bandwidth))
    for j in range(2):
        ramp = work[RISE_1 + j] - work[RISE_1 + j]
        if ideal:
            ramp = work[RISE_1 + j] / duration
            if e is not None:
                ramp = ramp + e[magnetic.SHARE] * (work[RISE_1 + 1 - j] / duration)
        _put(work, RAMP_1 + j, (ramp, ramp, ramp))


@compiled
def set_inputs_with_effects(
    p: PlantParameters, e: Rows, state: Rows, work: Rows, push: Value, n: int, part: float, step: float, linear: bool
) -> None:  # fmt: skip
    """The inputs of step n of a sample, `part` of it, with time_delay, amplifier_bandwidth, force_offset and
    periodic_disturbance.

    The command that acts changes from the former to the present one in step JUMP_STEP, after its share JUMP_SHARE;
    then it passes the lag with its slew limit, and the drive's own bandwidth.
    """
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        target = _amplifier(e, state, work, j, n, part, step, linear)
        _put(work, TARGET_1 + j, target)
        if p.drive == CURRENT_DRIVE:
            _put_jump(e, work, j, n, step, linear)
        else:
            _put(work, OUTPUT_OF_1 + j, _output(state, work, j, target, np.isinf(first(e[electrical.BANDWIDTH]))))
    _put(work, PUSH, _outer_forces(e, state, work, push))


@compiled
def _put_jump(e: Rows, work: Rows, j: int, n: int, step: float, linear: bool) -> None:
    """What the target of side j stands for in step n, where a command jumps that no lag and no slew limit follows, and
    the loop behind it is integrated."""
    above = work[FORMER_1 + j] - work[COMMAND_1 + j]
    if linear:
        above = above - above
    jumps = (e[electrical.JUMP_STEP] == n) & (e[electrical.JUMP_SHARE] > 0.0) & (e[electrical.THROUGH] == 1.0)
    integrated = (e[electrical.BANDWIDTH] * step <= FAST) & (e[magnetic.EDDY_EXACT] == 0.0)
    above = choose(jumps & integrated, above, 0.0)
    _put(work, FORMER_ABOVE_1 + j, (above, above, above))
    _put(work, FORMER_SHARE, (e[electrical.JUMP], e[electrical.JUMP + 1], e[electrical.JUMP + 2]))


@compiled
def _amplifier(e: Rows, state: Rows, work: Rows, j: int, n: int, part: float, step: float, linear: bool) -> Three:
    """The command of side j behind delay, slew limit and lag, at begin, middle and end of step n.

    The slew limit is that of the lag, y' = S tanh((s - y)/(S lag)); where there is no lag, of the command. What stands
    for a fast fall between begin, middle and end (`fall_stages`) is `kept` as far as the limit leaves the fall fast.
    """
    before, after = work[FORMER_1 + j], work[COMMAND_1 + j]
    rise = after - after
    if linear:
        after, rise = _rising(e, work, j, n, part)
        before = after
    jumps, late = e[electrical.JUMP_STEP] == n, e[electrical.JUMP_STEP] > n
    old, new = choose(late, before, choose(jumps, before, after)), choose(late, before, after)
    share = choose(jumps, e[electrical.JUMP_SHARE], 0.0)
    early = share * step
    held, offset = new, new - new
    if some(e[electrical.SLEW_TIME] > 0.0):
        held, missing = _slew(state[SLEW_1 + j], old, early, e[electrical.SLEW_TIME])
        held, more = _slew(held, new, step - early, e[electrical.SLEW_TIME])
        offset = 0.0 - (missing + more) / step
    work[SLEW_END_1 + j] = held
    away, jump = state[LAG_1 + j] - old, old - new
    begin, middle, end, last = (
        _lagged(e, 0, new, away, jump, offset, jumps), _lagged(e, 1, new, away, jump, offset, jumps),
        _lagged(e, 2, new, away, jump, offset, jumps), _lagged(e, 3, new, away, jump, offset, jumps),
    )  # fmt: skip
    if linear:
        ramp = electrical.LAG_RAMP
        begin, middle = begin + rise * e[ramp], middle + rise * e[ramp + 1]
        end, last = end + rise * e[ramp + 2], last + rise * e[ramp + 3]
    if some(e[electrical.SOFT] > 0.0):
        far = larger(size(away), size(away + jump)) * e[electrical.SOFT]
        kept = 1.0 / (1.0 + far * far * (far * far))
        limited = e[electrical.SOFT] > 0.0
        value = old + away
        begin = choose(limited, fma(kept, begin - value, value), begin)
        value, straight = _limited(
            e, new, away, jump, 0.5 * e[electrical.DECAY], choose(jumps, e[electrical.PAST_MIDDLE], 0.0)
        )
        middle = choose(limited, fma(kept, middle - straight, value), middle)
        past = choose(jumps, e[electrical.PAST_END], 0.0)
        value, straight = _limited(e, new, away, jump, e[electrical.DECAY], past)
        end, last = choose(limited, fma(kept, end - straight, value), end), choose(limited, value, last)
    work[LAG_END_1 + j] = last
    own, first_asked, last_asked = state[LAG_1 + j], choose(jumps & (share == 0.0), new, old), new
    if linear:
        first_asked, last_asked = _asked_at_ends(e, work, j, n, part)
    work[GIVEN_BEGIN_1 + j] = own + e[electrical.THROUGH] * (first_asked - own)
    work[GIVEN_END_1 + j] = last + e[electrical.THROUGH] * (last_asked - last)
    return begin, middle, end


@compiled
def _rising(e: Rows, work: Rows, j: int, n: int, part: float) -> tuple[Value, Value]:
    """(mean, rise) over step n, `part` of a sample, of a command that runs straight between its samples."""
    return _straight(work, j, _behind(e, n, part), part)


@compiled
def _asked_at_ends(e: Rows, work: Rows, j: int, n: int, part: float) -> tuple[Value, Value]:
    """That command at begin and end of step n."""
    behind = _behind(e, n, part)
    return _between_samples(work, j, behind), _between_samples(work, j, behind + part)


@compiled
def _behind(e: Rows, n: int, part: float) -> Value:
    """How many samples behind the command that acts step n begins, `part` of a sample."""
    return part * (n - e[electrical.JUMP_STEP] - e[electrical.JUMP_SHARE])


@compiled
def _straight(work: Rows, j: int, behind: Value, part: float) -> tuple[Value, Value]:
    """(mean, rise) of the command of side j from `behind` samples after the one that acts on, `part` of a sample."""
    begin, end = _between_samples(work, j, behind), _between_samples(work, j, behind + part)
    middle = _between_samples(work, j, behind + 0.5 * part)
    return mean_and_rise(begin, middle, end)


@compiled
def _between_samples(work: Rows, j: int, behind: Value) -> Value:
    """The command of side j some samples `behind` the one that acts; before it, from the former one."""
    command, before = work[COMMAND_1 + j], work[COMMAND_1 + j] - work[FORMER_1 + j]
    return command + behind * choose(behind < 0.0, before, work[RISE_1 + j])


@compiled
def _lagged(e: Rows, k: int, new: Value, away: Value, jump: Value, offset: Value, jumps: Value) -> Value:
    """Entry k of `fall_stages` for the lag's answer to a command that jumps, or stands, and to a constant offset."""
    fall = e[electrical.FALL + k]
    return new + away * fall + jump * choose(jumps, e[electrical.JUMP + k], fall) + offset * (1.0 - fall)


@compiled
def _limited(e: Rows, new: Value, away: Value, jump: Value, time: Value, past: Value) -> tuple[Value, Value]:
    """The lag's answer with its slew limit, and without, to a command that jumps at `past`; times over its time
    constant."""
    before, after = exponential(0.0 - past), exponential(past - time)
    soft = e[electrical.SOFT]
    return new + _left(_left(away, past, soft) + jump, time - past, soft), new + (away * before + jump) * after


@compiled
def _left(away: Value, time: Value, soft: Value) -> Value:
    """What is left of a distance `away` after a time over the lag's time constant.

    With u the distance times `soft`, u' = -tanh u: sinh u falls exponentially. It is (e^w - e^(w - 2 u))/2 with w = u
    less the time, so nothing overflows; of a small u the series are taken.
    """
    u = size(away) * soft
    w = u - time
    low = smaller(w, _STEEP)
    sine = 0.5 * (exponential(low) - exponential(low - 2.0 * u))
    large = choose(w > _STEEP, w, logarithm(sine + square_root(fma(sine, sine, 1.0))))
    square = u * u
    sine = u * fma(square / 6.0, fma(square, 0.05, 1.0), 1.0) * exponential(0.0 - time)
    square = sine * sine
    small = sine * fma(square, fma(square, 0.075, -1.0 / 6.0), 1.0)
    found = choose(u < _FEW, small, large) / choose(soft > 0.0, soft, 1.0)
    return choose(soft > 0.0, choose(away < 0.0, 0.0 - found, found), away * exponential(0.0 - time))


@compiled
def _slew(held: Value, target: Value, duration: Value, slew_time: Value) -> tuple[Value, Value]:
    """(value after `duration` s on the way to the target at 1/slew_time a second, integral of what is missing)."""
    way = target - held
    needed = size(way) * slew_time
    arrives = needed <= duration
    moved = choose(way < 0.0, 0.0 - duration, duration) / slew_time
    missing = choose(arrives, 0.5 * way * needed, (way - 0.5 * moved) * duration)
    return choose(arrives, target, held + moved), missing


@compiled
def _outer_forces(e: Rows, state: Rows, work: Rows, push: Value) -> Three:
    """`push`, the constant offset and the periodic force, whose phase goes on by half a step twice."""
    constant = push + e[mechanical.FORCE]
    cosine, sine = state[PHASE_COSINE], state[PHASE_SINE]
    begin = constant + _periodic(e, cosine, sine)
    cosine, sine = _turned(e, cosine, sine)
    middle = constant + _periodic(e, cosine, sine)
    cosine, sine = _turned(e, cosine, sine)
    work[PHASE_COSINE_END] = cosine
    work[PHASE_SINE_END] = sine
    return begin, middle, constant + _periodic(e, cosine, sine)


@compiled
def _periodic(e: Rows, cosine: Value, sine: Value) -> Value:
    """The periodic force at a phase: cos 3 p = cos p (1 - 4 sin^2 p), sin 3 p = sin p (4 cos^2 p - 1)."""
    third_cosine, third_sine = cosine * (1.0 - 4.0 * sine * sine), sine * (4.0 * cosine * cosine - 1.0)
    first = e[sensing.FORCE_COSINE] * cosine + e[sensing.FORCE_SINE] * sine
    return first + (e[sensing.THIRD_COSINE] * third_cosine + e[sensing.THIRD_SINE] * third_sine)


@compiled
def _turned(e: Rows, cosine: Value, sine: Value) -> tuple[Value, Value]:
    turn_cosine, turn_sine = e[sensing.TURN_COSINE], e[sensing.TURN_SINE]
    return cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine


@compiled
def _put(work: Rows, n: int, three: Three) -> None:
    begin, middle, end = three
    work[INPUTS_BEGIN + n] = begin
    work[INPUTS_MIDDLE + n] = middle
    work[INPUTS_END + n] = end
