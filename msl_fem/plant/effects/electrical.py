"""Effects of coil, amplifier and current sensor."""

import math

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import RowLayout
from msl_fem.errors import InputError
from msl_fem.plant.effects import stray_flux
from msl_fem.plant.effects.entry import (
    FINE,
    NO_MAGNETS,
    NOT_AT_REST,
    DesignChange,
    Effect,
    KernelSetting,
    Parameter,
    Part,
    Values,
)
from msl_fem.plant.effects.mechanisms import drive_lag, fall_stages

AS_MUCH = 100.0  # J: usual amounts of heating for each joule and of a start are as large as one another
N_QUEUE = 16  # samples by which a command can be late

LAYOUT = RowLayout(after=stray_flux.LAYOUT)
HEAT_PER_JOULE, COOLING = LAYOUT.rows(2)  # relative rise of the resistance, 1/J; its decay, 1/s
HEAT_START = LAYOUT.row()  # the rise in the beginning
CORE_RATE = LAYOUT.row()  # at which the core follows the coil's temperature, 1/s
BANDWIDTH = LAYOUT.row()  # of the drive, rad/s
# Delay of the command: whole samples, then the step of a sample in which it acts, and after what share of that step
DELAY_SAMPLES, JUMP_STEP, JUMP_SHARE = LAYOUT.rows(3)
# What is left of the lag at begin, middle and end of a step, and behind it; the same of a jump within the step
FALL, JUMP = LAYOUT.rows(2, 4)
THROUGH = LAYOUT.row()  # the share of what a command is above where the lag is, that acts at once
SLEW_TIME = LAYOUT.row()
LAG_RAMP = LAYOUT.row(4)  # the lag's answers to a command that rises by 1 in a step
# Slew limit of the lag: one over what it moves by in a time constant at most (1/A, 1/V, 1/N); a step over the time
# constant; of the step with the jump, time before it until middle and end, over the time constant
SOFT, DECAY, PAST_MIDDLE, PAST_END = LAYOUT.rows(4)
# What is lost of a command beyond the drive's own limit; that limit; how far about it it sets in, A, V or N
LOST_SHARE, LIMIT, CORNER = LAYOUT.rows(3)


def _heating(e: Array, v: Values, setting: KernelSetting) -> None:
    """Heating, and how fast coil and core settle: a coil has these rates once, so what states them twice, heating and
    history, counts by its amounts."""
    e[HEAT_PER_JOULE], e[HEAT_START] = v["coil_heating", "rise_per_joule"], v["coil_heating", "initial_rise"]
    heating = AS_MUCH * e[HEAT_PER_JOULE] + abs(e[HEAT_START])
    history = abs(v["thermal_history", "rise_1"]) + abs(v["thermal_history", "rise_2"])
    history += abs(v["thermal_history", "core_rise"])
    share = history / (history + heating) if history > 0.0 else 0.0
    cooling, settling = v["coil_heating", "cooling_rate"], v["thermal_history", "settling_rate"]
    e[COOLING] = cooling + share * (settling - cooling)
    core, core_settling = v["coil_heating", "core_rate"], v["thermal_history", "core_rate"]
    e[CORE_RATE] = core + share * (core_settling - core)


def command_path(e: Array, v: Values, setting: KernelSetting) -> None:
    """The way of a command to the drive: delay, slew limit and lag, the drive's own bandwidth."""
    e[BANDWIDTH] = setting.plant.bandwidth * (1.0 + v["amplifier_bandwidth", "bandwidth_error"])
    step, n_step = setting.step, setting.n_step
    lag, zero, delay = drive_lag(v)
    delay += v["time_delay", "command"]
    late = delay / step
    whole = math.floor(late / n_step)
    rest = max(late - whole * n_step, 0.0)
    e[DELAY_SAMPLES] = whole
    e[JUMP_STEP] = math.floor(rest)
    e[JUMP_SHARE] = rest - e[JUMP_STEP]
    decay = step / lag if lag > 0 else math.inf
    e[FALL : FALL + 4] = fall_stages(0.0, decay)
    e[JUMP : JUMP + 4] = fall_stages(float(e[JUMP_SHARE]), decay)
    if lag > 0:
        e[SOFT], e[DECAY] = v["amplifier_bandwidth", "slew_time"] / lag, decay
        e[PAST_MIDDLE], e[PAST_END] = min(0.5, e[JUMP_SHARE]) * decay, e[JUMP_SHARE] * decay
    else:
        e[SLEW_TIME] = v["amplifier_bandwidth", "slew_time"]
        e[THROUGH] = 1.0 if e[SLEW_TIME] == 0.0 else 0.0
    for k, s in enumerate((0.0, 0.5, 1.0, 1.0)):
        e[LAG_RAMP + k] = s - 0.5 - 1.0 / decay + (0.5 + 1.0 / decay) * e[FALL + k]
    if zero > 0.0:
        e[THROUGH] = zero / lag
        _mix_zero(e, zero / lag)


def _mix_zero(e: Array, through: float) -> None:
    """Lets a share of what the lag has not followed yet act at once."""
    at_once = fall_stages(float(e[JUMP_SHARE]), math.inf)
    for k, s in enumerate((0.0, 0.5, 1.0)):  # the fourth is the lag's own
        e[FALL + k] *= 1.0 - through
        e[JUMP + k] += through * (at_once[k] - e[JUMP + k])
        e[LAG_RAMP + k] += through * (s - 0.5 - e[LAG_RAMP + k])


def _limit(e: Array, v: Values, setting: KernelSetting) -> None:
    e[LOST_SHARE], e[LIMIT] = v["drive_limit", "lost_share"], v["drive_limit", "limit"]
    e[CORNER] = v["drive_limit", "corner"]


def check_delay(e: Array, setting: KernelSetting) -> None:
    """Returns where the queues hold the delayed commands of coefficients (N_COEFFICIENT,).

    Raises
    ------
    InputError : a delay of more than `N_QUEUE` samples
    """
    if e[DELAY_SAMPLES] >= N_QUEUE:
        late = e[DELAY_SAMPLES] * setting.n_step + e[JUMP_STEP] + e[JUMP_SHARE]
        raise InputError(
            f"time_delay.command: {late * setting.step:g} s are {late / setting.n_step:.3g} samples, the coupled model "
            f"delays a command by less than {N_QUEUE}; sample more slowly"
        )


def believed_command_path(change: DesignChange, v: Values) -> None:
    """Lag and delay on a command's way, as a design believes them."""
    change.bandwidth = 1.0 + v["amplifier_bandwidth", "bandwidth_error"]
    change.delay = v["time_delay", "command"]


def _believed_lag(change: DesignChange, v: Values) -> None:
    believed_command_path(change, v)
    change.lag += v["amplifier_bandwidth", "lag"]


ELECTRICAL = (
    Effect(
        name="coil_heating",
        group="electrical",
        sentence="resistance drifts with dissipated energy",
        equation=(
            "R_j = R (1 + rho_j), "
            "rho_j' = rise_per_joule R_j i_j^2 - cooling_rate (rho_j - kappa_j), rho_j(0) = initial_rise, "
            "kappa_j' = core_rate (rho_j - kappa_j), kappa_j(0) = 0: coil, then core"
        ),
        source="Boglietti et al., IEEE Trans. Ind. Electron. 56(3), 2009, 871-882 (lumped capacities)",
        parameters=(
            Parameter(
                "rise_per_joule",
                "J^-1",
                0.0,
                (0.0, 1.0),
                1e-4,
                "0.39 %/K over the heat capacity of a side's coils",
                of=(("mass", -1),),
            ),
            Parameter(
                "initial_rise",
                "",
                0.0,
                (-0.3, 1.0),
                0.01,
                "of the resistance when the run begins, relative",
                alone=True,
            ),
            Parameter(
                "cooling_rate",
                "s^-1",
                0.0,
                (0.0, 10.0),
                0.01,
                "one over the coil's time constant",
                shape=True,
                tried=(0.2, 1.5),
                width=1.5,
            ),
            Parameter(
                "core_rate",
                "s^-1",
                0.0,
                (0.0, 10.0),
                0.01,
                "at which the core follows the coil",
                shape=True,
                tried=(0.03,),
                width=1.5,
            ),
        ),
        needs=("magnets",),
        coefficients=_heating,
        design=Part(declined="the drive's current loop makes up for a resistance that changes"),
        inverse=NO_MAGNETS,
        static=NOT_AT_REST,
        advice="let the coils reach their temperature before a run, or measure their temperature",
        sets=(("rise_per_joule",), ("rise_per_joule", "initial_rise")),
        one_form=True,
    ),
    Effect(
        name="amplifier_bandwidth",
        group="electrical",
        sentence="the drive follows its command with a lag or a slew limit",
        equation=(
            "y' = S tanh((s(t - d lag) - y)/((1 - d) lag S)) before the drive, S = 1/slew_time, drive's bandwidth "
            "w (1 + bandwidth_error); d: delay_share, above 1 with a zero: the drive overshoots"
        ),
        source="Schweitzer, Maslen (ed.), Magnetic Bearings, 2009, ch. 3 (power amplifiers)",
        parameters=(
            Parameter(
                "lag", "s", 0.0, (0.0, 0.05), 1e-5, "time constant of a pole more", alone=True, of=(("period", 1),)
            ),
            Parameter(
                "slew_time",
                "s",
                0.0,
                (0.0, 1.0),
                1e-5,
                "that the drive takes for 1 A (1 V, 1 N) at least",
                of=(("period", 1),),
            ),
            Parameter("bandwidth_error", "", 0.0, (-0.9, 2.0), 0.05, "relative, of the drive's stated bandwidth"),
            Parameter(
                "delay_share",
                "",
                0.0,
                (0.0, 2.0),
                0.1,
                "of the lag: what more than one pole do; above 1 the drive overshoots",
                shape=True,
                tried=(0.3,),
                width=0.8,
                belongs_to="lag",
                ends=(0.95, 2.0),
            ),
        ),
        needs=("drive lag",),
        coefficients=command_path,
        believe=_believed_lag,
        design=Part(("lag", "bandwidth_error"), "a slew limit is not linear; keep the reference below it"),
        inverse=Part(
            ("lag",),
            "a slew limit is not linear, and the equation takes no bandwidth of the drive",
        ),
        static=NOT_AT_REST,
        advice="measure the step response of the drive with the mover locked; check its voltage limit",
        sets=(("lag",), ("slew_time",), ("bandwidth_error",), ("lag", "slew_time")),
        deviation_of={"time_delay": 0.1, "eddy_currents": 0.1, "magnetic_hysteresis": 0.01, "early_saturation": 0.05},
        steps=FINE,
        coarse=("bandwidth_error",),
    ),
    Effect(
        name="drive_limit",
        group="electrical",
        sentence="the drive gives less than it is asked for beyond a limit that is not stated",
        equation=(
            "s -> s - lost_share (beyond(s - limit) - beyond(-s - limit)) of a command s, before lag and delay; 1: "
            "nothing is given beyond it. beyond(d) = c log(1 + exp(d/c)) with c = corner/pi; max(d, 0) of a corner of 0"
        ),
        source="Schweitzer, Maslen (ed.), Magnetic Bearings, 2009, ch. 3 (saturation of power amplifiers)",
        parameters=(
            Parameter("lost_share", "", 0.0, (0.0, 1.0), 0.03, "of what a command has beyond the limit"),
            Parameter(
                "limit",
                "",
                0.5,
                (1e-6, 1e6),
                0.1,
                "A, V or N, as the drive takes",
                shape=True,
                tried=(0.7, 1.1, 1.6, 2.2),
                over="command",
                width=0.3,
            ),
            Parameter(
                "corner",
                "",
                0.0,
                (0.0, 1e6),
                0.1,
                "A, V or N to both sides of the limit, of an equal spread, over which it sets in; 0: at once",
                shape=True,
                tried=(0.2,),
                over="command",
                optional=True,
            ),
        ),
        coefficients=_limit,
        design=Part(declined="a limit is not linear; keep the reference below it"),
        inverse=Part(declined="the equation takes the force as it was commanded"),
        static=NOT_AT_REST,
        advice="hold the drive's supply and limits against the largest command; look at the commands' peaks on a scope",
    ),
    Effect(
        name="current_sensor_error",
        group="electrical",
        sentence="gain or offset of the current reading",
        equation="reading_j = (1 + gain_j) i_j + offset_j; the amplifier's own sensor is not touched",
        source="Ramsden, Hall-Effect Sensors, 2nd ed., 2006, ch. 2",
        parameters=(
            Parameter("gain_1", "", 0.0, (-0.3, 0.3), 0.005, "relative error of side 1's reading"),
            Parameter("gain_2", "", 0.0, (-0.3, 0.3), 0.005, "relative error of side 2's reading"),
            Parameter("offset_1", "A", 0.0, (-2.0, 2.0), 0.005, "of side 1's reading", of=(("current", 1),)),
            Parameter("offset_2", "A", 0.0, (-2.0, 2.0), 0.005, "of side 2's reading", of=(("current", 1),)),
        ),
        needs=("magnets",),
        design=Part(
            declined="the amplifier's own sensor closes the current loop; the controller does not read this one"
        ),
        inverse=NO_MAGNETS,
        static=Part(("gain_1", "offset_1"), "the instrument of a static map stands as side 1's"),
        advice="calibrate the current readings against a shunt; zero them without current",
        sets=(
            ("gain_1", "gain_2"),
            ("offset_1", "offset_2"),
            ("gain_1", "gain_2", "offset_1", "offset_2"),
            ("gain_1",),
            ("gain_2",),
            ("offset_1",),
            ("offset_2",),
            ("gain_1", "offset_1"),
            ("gain_2", "offset_2"),
        ),
        separating="the current beside a second instrument, and one row with the current reversed",
    ),
)
