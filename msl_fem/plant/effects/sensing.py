"""Effects of the position sensor, of time, and of what comes from outside."""

import math

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import RowLayout
from msl_fem.plant.effects import mechanical
from msl_fem.plant.effects.electrical import believed_command_path, command_path
from msl_fem.plant.effects.entry import (
    FINE,
    NO_MAGNETS,
    NOT_AT_REST,
    Effect,
    KernelSetting,
    MoverMotion,
    Parameter,
    Part,
    Values,
)
from msl_fem.plant.effects.mechanisms import sensor_lag
from msl_fem.plant.plant import PlantParameters

LAYOUT = RowLayout(after=mechanical.LAYOUT)
SENSOR_BANDWIDTH = LAYOUT.row()  # of the position sensor, rad/s
FORCE_COSINE, FORCE_SINE = LAYOUT.rows(2)  # of the periodic disturbance, N
THIRD_COSINE, THIRD_SINE = LAYOUT.rows(2)  # of its third harmonic, N
TURN_COSINE, TURN_SINE = LAYOUT.rows(2)  # rotation of its phase in half a step
COIL_READING_1, COIL_READING_2 = LAYOUT.rows(2)  # what the position sensor sees of the coils' field, m/A
COIL_READING_RATE = LAYOUT.row()  # of that field's own lag, rad/s


def _sensor_pole(e: Array, v: Values, setting: KernelSetting) -> None:
    bandwidth, lag = setting.plant.sensor_bandwidth, sensor_lag(v)[0]
    if math.isinf(bandwidth):
        e[SENSOR_BANDWIDTH] = 1.0 / lag if lag > 0 else math.inf
    else:
        e[SENSOR_BANDWIDTH] = bandwidth / (1.0 + bandwidth * lag)


def _coil_field(e: Array, v: Values, setting: KernelSetting) -> None:
    sides, lag = setting.plant.sides, v["position_sensor_crosstalk", "lag"]
    e[COIL_READING_1] = v["position_sensor_crosstalk", "per_current_1"] if sides > 0 else 0.0
    e[COIL_READING_2] = v["position_sensor_crosstalk", "per_current_2"] if sides > 1 else 0.0
    e[COIL_READING_RATE] = 1.0 / lag if lag > 0 else math.inf


def _periodic_force(e: Array, v: Values, setting: KernelSetting) -> None:
    e[FORCE_COSINE] = v["periodic_disturbance", "force_cosine"]
    e[FORCE_SINE] = v["periodic_disturbance", "force_sine"]
    e[THIRD_COSINE] = v["periodic_disturbance", "third_cosine"]
    e[THIRD_SINE] = v["periodic_disturbance", "third_sine"]
    half_turn = math.pi * v["periodic_disturbance", "frequency"] * setting.step
    e[TURN_COSINE], e[TURN_SINE] = math.cos(half_turn), math.sin(half_turn)


def _periodic_balance(v: Values, plant: PlantParameters, motion: MoverMotion) -> Array:
    phase = 2 * np.pi * v["periodic_disturbance", "frequency"] * motion.time
    cosine, sine = v["periodic_disturbance", "force_cosine"], v["periodic_disturbance", "force_sine"]
    third = v["periodic_disturbance", "third_cosine"] * np.cos(3 * phase)
    third = third + v["periodic_disturbance", "third_sine"] * np.sin(3 * phase)
    return -(cosine * np.cos(phase) + sine * np.sin(phase) + third)


SENSING = (
    Effect(
        name="position_sensor_nonlinearity",
        group="sensing and timing",
        sentence="gain error or curvature of the position reading",
        equation="reading = (1 + gain_error) x + quadratic x^2 + cubic x^3",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126",
        parameters=(
            Parameter("gain_error", "", 0.0, (-0.3, 0.3), 0.002, "relative"),
            Parameter(
                "quadratic", "m^-1", 0.0, (-5e3, 5e3), 5.0, "of the reading over the position", of=(("travel", -1),)
            ),
            Parameter("cubic", "m^-2", 0.0, (-1e7, 1e7), 1e4, "of the reading over the position", of=(("travel", -2),)),
        ),
        design=Part(declined="the loop follows the reading and has nothing to compare it with"),
        inverse=Part(("gain_error", "quadratic", "cubic")),
        static=NOT_AT_REST,
        advice="calibrate the position reading over its range, on gauge blocks",
        sets=(
            ("quadratic",),
            ("cubic",),
            ("gain_error",),
            ("quadratic", "cubic"),
            ("gain_error", "quadratic", "cubic"),
        ),
        one_form=True,
    ),
    Effect(
        name="position_sensor_lag",
        group="sensing and timing",
        sentence="the position reading lags",
        equation="(1/w + (1 - s) lag) y' = x - y, read s lag later; w: the sensor's stated bandwidth, s: delay_share",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126",
        parameters=(
            Parameter(
                "lag",
                "s",
                0.0,
                (0.0, 0.05),
                1e-5,
                "added to the sensor's time constant",
                alone=True,
                of=(("period", 1),),
            ),
            Parameter(
                "delay_share",
                "",
                0.0,
                (0.0, 0.95),
                0.1,
                "of the lag: what more than one pole do",
                shape=True,
                tried=(0.3,),
                width=0.8,
                belongs_to="lag",
            ),
        ),
        coefficients=_sensor_pole,
        design=Part(declined="the linear plant has no sensor; the margins of the design have to bear its lag"),
        inverse=Part(("lag",)),
        static=NOT_AT_REST,
        advice="check filters and averaging of the position channel",
        one_form=True,
    ),
    Effect(
        name="position_sensor_crosstalk",
        group="sensing and timing",
        sentence="the coils' field reaches the position sensor",
        equation="the sensor sees x + z, lag z' = per_current_1 u_1 + per_current_2 u_2 - z",
        source="Schweitzer, Maslen (ed.), Magnetic Bearings, 2009, ch. 3 (displacement sensors in stray fields)",
        parameters=(
            Parameter(
                "per_current_1",
                "m/A",
                0.0,
                (-1e-4, 1e-4),
                1e-7,
                "read for side 1's current",
                of=(("travel", 1), ("current", -1)),
            ),
            Parameter(
                "per_current_2",
                "m/A",
                0.0,
                (-1e-4, 1e-4),
                1e-7,
                "read for side 2's current",
                of=(("travel", 1), ("current", -1)),
            ),
            Parameter(
                "lag",
                "s",
                0.0,
                (0.0, 0.05),
                1e-4,
                "of the field on its way, in housing and target",
                shape=True,
                tried=(3e-4,),
                width=1.5,
            ),
        ),
        needs=("magnets",),
        coefficients=_coil_field,
        design=Part(declined="the loop follows the reading and has nothing to compare it with"),
        inverse=NO_MAGNETS,
        static=Part(declined="a static map has its own gap, by gauges or at rest"),
        advice="lock the mover and drive the coils: what the position then reads is this; screen or move the sensor",
        sets=(("per_current_1", "per_current_2"), ("per_current_1",), ("per_current_2",)),
        deviation_of={"eddy_currents": 0.02},
        one_form=True,
    ),
    Effect(
        name="time_delay",
        group="sensing and timing",
        sentence="a pure delay between command and action or in the record's channels",
        equation="the drive obeys u(t - command); readings are x(t - position), i(t - current)",
        source="Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, ch. 2",
        parameters=(
            Parameter(
                "command",
                "s",
                0.0,
                (0.0, 0.1),
                1e-5,
                "from the command to its action",
                lagging=True,
                of=(("period", 1),),
            ),
            Parameter("position", "s", 0.0, (0.0, 0.1), 1e-5, "of the position reading", of=(("period", 1),)),
            Parameter("current", "s", 0.0, (0.0, 0.1), 1e-5, "of the current readings", of=(("period", 1),)),
        ),
        coefficients=command_path,
        believe=believed_command_path,
        design=Part(
            ("command",), "the linear plant has no sensors; the margins of the design have to bear their delays"
        ),
        inverse=Part(("command", "position"), "a rig that a force drives has no current readings"),
        static=NOT_AT_REST,
        advice="check the time stamps of the channels and the cycles between computing and acting",
        sets=(("command",), ("position",), ("current",), ("position", "current")),
        deviation_of={"amplifier_bandwidth": 0.1, "eddy_currents": 0.1, "position_sensor_lag": 0.1},
        steps=FINE,
        coarse=("position",),
    ),
    Effect(
        name="periodic_disturbance",
        group="sensing and timing",
        sentence="a force or reading at a fixed frequency, mains hum among them",
        equation="a cos(w t) + b sin(w t) on the force, with its third harmonic, on the position or current readings",
        source="Bodson, Sacks, Khosla, IEEE Trans. Automatic Control 39(9), 1994, 1939-1944",
        parameters=(
            Parameter("force_cosine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force on the mover", of=(("force", 1),)),
            Parameter("force_sine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force on the mover", of=(("force", 1),)),
            Parameter("third_cosine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force, at 3 w", of=(("force", 1),)),
            Parameter("third_sine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force, at 3 w", of=(("force", 1),)),
            Parameter("position_cosine", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the position reading", of=(("travel", 1),)),
            Parameter("position_sine", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the position reading", of=(("travel", 1),)),
            Parameter("current_cosine", "A", 0.0, (-10.0, 10.0), 5e-3, "of all current readings", of=(("current", 1),)),
            Parameter("current_sine", "A", 0.0, (-10.0, 10.0), 5e-3, "of all current readings", of=(("current", 1),)),
            Parameter("frequency", "Hz", 50.0, (0.01, 1e5), 10.0, "w / 2 pi", shape=True, over="lines", width=0.15),
        ),
        coefficients=_periodic_force,
        needed_force=_periodic_balance,
        design=Part(declined="the feedback takes it as a disturbance"),
        inverse=Part(
            ("force_cosine", "force_sine", "third_cosine", "third_sine", "position_cosine", "position_sine"),
            "a rig that a force drives has no current readings",
        ),
        static=NOT_AT_REST,
        advice="follow its frequency: mains, fans, pumps; earth and screen the channel it is in",
        sets=(
            ("force_cosine", "force_sine"),
            ("force_cosine", "force_sine", "third_cosine", "third_sine"),
            ("position_cosine", "position_sine"),
            ("current_cosine", "current_sine"),
        ),
        one_form=True,
    ),
    Effect(
        name="sensor_drift",
        group="sensing and timing",
        sentence="a slow wander of the position zero",
        equation="reading = ... + offset + rate t + acceleration t^2/2 + jerk t^3/6",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126; the first terms of any slow drift",
        parameters=(
            Parameter("rate", "m/s", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero", of=(("travel", 1),)),
            Parameter("acceleration", "m/s^2", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero", of=(("travel", 1),)),
            Parameter("jerk", "m/s^3", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero", of=(("travel", 1),)),
            Parameter("offset", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero when a run begins", of=(("travel", 1),)),
        ),
        design=Part(declined="the loop follows the reading and has nothing to compare it with"),
        inverse=Part(("rate", "acceleration", "jerk", "offset")),
        static=NOT_AT_REST,
        advice="let the sensor warm up; keep draughts and daylight off; zero it before each run",
        sets=(
            ("rate",),
            ("offset", "rate"),
            ("offset", "rate", "acceleration"),
            ("offset", "rate", "acceleration", "jerk"),
        ),
        wanders="position_m",
        deviation_of={"magnetic_hysteresis": 0.01},
    ),
)
