"""Effects of the position sensor, of time, and of what comes from outside."""

from msl_fem.plant.effects.entry import Effect, Parameter

SENSING = (
    Effect(
        name="position_sensor_nonlinearity",
        group="sensing and timing",
        sentence="gain error or curvature of the position reading",
        equation="reading = (1 + gain_error) x + quadratic x^2 + cubic x^3",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126",
        parameters=(
            Parameter("gain_error", "", 0.0, (-0.3, 0.3), 0.002, "relative"),
            Parameter("quadratic", "m^-1", 0.0, (-1e3, 1e3), 5.0, "of the reading over the position"),
            Parameter("cubic", "m^-2", 0.0, (-1e6, 1e6), 1e4, "of the reading over the position"),
        ),
    ),
    Effect(
        name="position_sensor_lag",
        group="sensing and timing",
        sentence="the position reading lags",
        equation="(1/w + (1 - s) lag) y' = x - y, read s lag later; w: the sensor's stated bandwidth, s: delay_share",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126",
        parameters=(
            Parameter("lag", "s", 0.0, (0.0, 0.05), 1e-5, "added to the sensor's time constant"),
            Parameter("delay_share", "", 0.0, (0.0, 0.95), 0.1, "of the lag: what more than one pole do", shape=True),
        ),
    ),
    Effect(
        name="time_delay",
        group="sensing and timing",
        sentence="a pure delay between command and action or in the record's channels",
        equation="the drive obeys u(t - command); readings are x(t - position), i(t - current)",
        source="Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, ch. 2",
        parameters=(
            Parameter("command", "s", 0.0, (0.0, 0.1), 1e-5, "from the command to its action"),
            Parameter("position", "s", 0.0, (0.0, 0.1), 1e-5, "of the position reading"),
            Parameter("current", "s", 0.0, (0.0, 0.1), 1e-5, "of the current readings"),
        ),
    ),
    Effect(
        name="periodic_disturbance",
        group="sensing and timing",
        sentence="a force or reading at a fixed frequency, mains hum among them",
        equation="a cos(w t) + b sin(w t) on the force, on the position reading, on the current readings",
        source="Bodson, Sacks, Khosla, IEEE Trans. Automatic Control 39(9), 1994, 1939-1944",
        parameters=(
            Parameter("force_cosine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force on the mover"),
            Parameter("force_sine", "N", 0.0, (-1e4, 1e4), 0.1, "of the force on the mover"),
            Parameter("position_cosine", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the position reading"),
            Parameter("position_sine", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the position reading"),
            Parameter("current_cosine", "A", 0.0, (-10.0, 10.0), 5e-3, "of all current readings"),
            Parameter("current_sine", "A", 0.0, (-10.0, 10.0), 5e-3, "of all current readings"),
            Parameter("frequency", "Hz", 50.0, (0.01, 1e5), 10.0, "w / 2 pi", shape=True),
        ),
    ),
    Effect(
        name="sensor_drift",
        group="sensing and timing",
        sentence="a slow wander of the position zero",
        equation="reading = ... + offset + rate t + acceleration t^2/2 + jerk t^3/6",
        source="Fleming, Sensors and Actuators A 190, 2013, 106-126; the first terms of any slow drift",
        parameters=(
            Parameter("rate", "m/s", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero"),
            Parameter("acceleration", "m/s^2", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero"),
            Parameter("jerk", "m/s^3", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero"),
            Parameter("offset", "m", 0.0, (-1e-3, 1e-3), 1e-7, "of the zero when a run begins"),
        ),
    ),
)
