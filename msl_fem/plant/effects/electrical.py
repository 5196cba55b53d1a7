"""Effects of coil, amplifier and current sensor."""

from msl_fem.plant.effects.entry import Effect, Parameter

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
                "rise_per_joule", "J^-1", 0.0, (0.0, 1.0), 1e-4, "0.39 %/K over the heat capacity of a side's coils"
            ),
            Parameter("initial_rise", "", 0.0, (-0.3, 1.0), 0.01, "of the resistance when the run begins, relative"),
            Parameter("cooling_rate", "s^-1", 0.0, (0.0, 10.0), 0.01, "one over the coil's time constant", shape=True),
            Parameter("core_rate", "s^-1", 0.0, (0.0, 10.0), 0.01, "at which the core follows the coil", shape=True),
        ),
        needs=("magnets",),
    ),
    Effect(
        name="amplifier_bandwidth",
        group="electrical",
        sentence="the drive follows its command with a lag or a slew limit",
        equation=(
            "y' = S tanh((s(t - d lag) - y)/((1 - d) lag S)) before the drive, S = 1/slew_time, drive's bandwidth "
            "w (1 + bandwidth_error); d: delay_share"
        ),
        source="Schweitzer, Maslen (ed.), Magnetic Bearings, 2009, ch. 3 (power amplifiers)",
        parameters=(
            Parameter("lag", "s", 0.0, (0.0, 0.05), 1e-5, "time constant of a pole more"),
            Parameter("slew_time", "s", 0.0, (0.0, 1.0), 1e-5, "that the drive takes for 1 A (1 V, 1 N) at least"),
            Parameter("bandwidth_error", "", 0.0, (-0.9, 2.0), 0.05, "relative, of the drive's stated bandwidth"),
            Parameter("delay_share", "", 0.0, (0.0, 0.95), 0.1, "of the lag: what more than one pole do", shape=True),
        ),
        needs=("drive lag",),
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
            Parameter("offset_1", "A", 0.0, (-2.0, 2.0), 0.005, "of side 1's reading"),
            Parameter("offset_2", "A", 0.0, (-2.0, 2.0), 0.005, "of side 2's reading"),
        ),
        needs=("magnets",),
    ),
)
