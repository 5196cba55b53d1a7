"""What acts on the plant during one step: targets of current loops, outputs of voltage and force drives, outer forces.

Runge-Kutta takes them at begin, middle and end of the step.
"""

import numpy as np

from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import (
    Rows,
    Value,
    choose,
    exponential,
    first,
    fma,
    larger,
    logarithm,
    size,
    smaller,
    some,
    square_root,
)
from msl_fem.plant import coefficients as c
from msl_fem.plant.plant import CURRENT_DRIVE, FORCE_DRIVE, PlantParameters
from msl_fem.plant.state import LAG_1, OUTPUT_1, PHASE_COSINE, PHASE_SINE, SLEW_1
from msl_fem.plant.work import (
    COMMAND_1,
    DRIVE_HALF,
    DRIVE_WHOLE,
    FORMER_1,
    INPUTS,
    LAG_END_1,
    N_INPUT,
    OUTPUT_OF_1,
    PHASE_COSINE_END,
    PHASE_SINE_END,
    PUSH,
    SLEW_END_1,
    TARGET_1,
)

Three = tuple[Value, Value, Value]
_STEEP = 20.0  # above it asinh(e^w/2) is w
_FEW = 0.01  # below it series of a few terms are exact


@compiled
def act(p: PlantParameters, state: Rows, work: Rows, push: Value) -> None:
    """The inputs of one step of the plain model: commands and forces held, outputs on their way to the commands."""
    half, whole = work[DRIVE_HALF], work[DRIVE_WHOLE]
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        target, output = work[COMMAND_1 + j], state[OUTPUT_1 + j]
        _put(work, TARGET_1 + j, (target, target, target))
        if p.drive != CURRENT_DRIVE:
            away = output - target
            _put(work, OUTPUT_OF_1 + j, (output, fma(half, away, target), fma(whole, away, target)))
    _put(work, PUSH, (push, push, push))


@compiled
def act_with_effects(
    p: PlantParameters, e: Rows, state: Rows, work: Rows, push: Value, n: int, step: float
) -> None:  # fmt: skip
    """The inputs of step n of a sample with time_delay, amplifier_bandwidth, force_offset and periodic_disturbance.

    The command that acts changes from the former to the present one in step JUMP_STEP, after its share JUMP_SHARE;
    then it passes the lag with its slew limit, and the drive's own bandwidth.
    """
    for j in range(1 if p.drive == FORCE_DRIVE else p.sides):
        begin, middle, end = _amplifier(e, state, work, j, n, step)
        _put(work, TARGET_1 + j, (begin, middle, end))
        if p.drive != CURRENT_DRIVE:
            if np.isinf(first(e[c.BANDWIDTH])):
                _put(work, OUTPUT_OF_1 + j, (begin, middle, end))
            else:
                output, slope = state[OUTPUT_1 + j], end - begin
                mean = middle + (begin - 2.0 * middle + end) / 6.0
                away = output - mean
                later = fma(work[DRIVE_HALF], away, mean) + slope * e[c.RAMP_MIDDLE]
                last = fma(work[DRIVE_WHOLE], away, mean) + slope * e[c.RAMP_END]
                _put(work, OUTPUT_OF_1 + j, (output, later, last))
    _put(work, PUSH, _outer_forces(e, state, work, push))


@compiled
def _amplifier(e: Rows, state: Rows, work: Rows, j: int, n: int, step: float) -> Three:
    """The command of side j behind delay, slew limit and lag, at begin, middle and end of step n.

    The slew limit is that of the lag, y' = S tanh((s - y)/(S lag)); where there is no lag, of the command. What stands
    for a fast fall between begin, middle and end (`fall_stages`) is `kept` as far as the limit leaves the fall fast.
    """
    before, after = work[FORMER_1 + j], work[COMMAND_1 + j]
    jumps, late = e[c.JUMP_STEP] == n, e[c.JUMP_STEP] > n
    old, new = choose(late, before, choose(jumps, before, after)), choose(late, before, after)
    share = choose(jumps, e[c.JUMP_SHARE], 0.0)
    early = share * step
    held, missing = _slew(state[SLEW_1 + j], old, early, e[c.SLEW_TIME])
    held, more = _slew(held, new, step - early, e[c.SLEW_TIME])
    work[SLEW_END_1 + j] = held
    offset = 0.0 - (missing + more) / step
    away, jump = state[LAG_1 + j] - old, old - new
    begin, middle, end, last = (
        _lagged(e, 0, new, away, jump, offset, jumps), _lagged(e, 1, new, away, jump, offset, jumps),
        _lagged(e, 2, new, away, jump, offset, jumps), _lagged(e, 3, new, away, jump, offset, jumps),
    )  # fmt: skip
    if some(e[c.SOFT] > 0.0):
        far = larger(size(away), size(away + jump)) * e[c.SOFT]
        kept = 1.0 / (1.0 + far * far * (far * far))
        limited = e[c.SOFT] > 0.0
        value = old + away
        begin = choose(limited, fma(kept, begin - value, value), begin)
        value, linear = _limited(e, new, away, jump, 0.5 * e[c.DECAY], choose(jumps, e[c.PAST_MIDDLE], 0.0))
        middle = choose(limited, fma(kept, middle - linear, value), middle)
        value, linear = _limited(e, new, away, jump, e[c.DECAY], choose(jumps, e[c.PAST_END], 0.0))
        end, last = choose(limited, fma(kept, end - linear, value), end), choose(limited, value, last)
    work[LAG_END_1 + j] = last
    return begin, middle, end


@compiled
def _lagged(e: Rows, k: int, new: Value, away: Value, jump: Value, offset: Value, jumps: Value) -> Value:
    """Entry k of `fall_stages` for the lag's answer to a command that jumps, or stands, and to a constant offset."""
    fall = e[c.FALL + k]
    return new + away * fall + jump * choose(jumps, e[c.JUMP + k], fall) + offset * (1.0 - fall)


@compiled
def _limited(e: Rows, new: Value, away: Value, jump: Value, time: Value, past: Value) -> tuple[Value, Value]:
    """The lag's answer with its slew limit, and without, to a command that jumps at `past`; times over its time
    constant."""
    before, after = exponential(0.0 - past), exponential(past - time)
    soft = e[c.SOFT]
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
    constant = push + e[c.FORCE]
    cosine, sine = state[PHASE_COSINE], state[PHASE_SINE]
    a, b = e[c.FORCE_COSINE], e[c.FORCE_SINE]
    begin = constant + (a * cosine + b * sine)
    cosine, sine = _turned(e, cosine, sine)
    middle = constant + (a * cosine + b * sine)
    cosine, sine = _turned(e, cosine, sine)
    work[PHASE_COSINE_END] = cosine
    work[PHASE_SINE_END] = sine
    return begin, middle, constant + (a * cosine + b * sine)


@compiled
def _turned(e: Rows, cosine: Value, sine: Value) -> tuple[Value, Value]:
    turn_cosine, turn_sine = e[c.TURN_COSINE], e[c.TURN_SINE]
    return cosine * turn_cosine - sine * turn_sine, sine * turn_cosine + cosine * turn_sine


@compiled
def _put(work: Rows, n: int, three: Three) -> None:
    begin, middle, end = three
    work[INPUTS + n] = begin
    work[INPUTS + N_INPUT + n] = middle
    work[INPUTS + 2 * N_INPUT + n] = end
