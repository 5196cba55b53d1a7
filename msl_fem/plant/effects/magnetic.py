"""Effects of the magnets: each leaves force and flux linkage the derivatives of one coenergy, or states its loss."""

from msl_fem.plant.effects.entry import Effect, Parameter

MAGNETIC = (
    Effect(
        name="gap_offset",
        group="magnetic",
        sentence="the true gap differs from the believed one by a constant (glue line, parting joint, wrong zero)",
        equation="g_1 = g_0 + offset + centring - x,  g_2 = g_0 + offset - centring + x",
        source="Roters, Electromagnetic Devices, 1941, ch. 5 (joints in series with the working gap)",
        parameters=(
            Parameter("offset", "m", 0.0, (-3e-4, 3e-4), 5e-6, "both gaps are wider by this"),
            Parameter("centring", "m", 0.0, (-3e-4, 3e-4), 5e-6, "side 1's gap is wider, side 2's narrower by this"),
        ),
        needs=("magnets",),
    ),
    Effect(
        name="early_saturation",
        group="magnetic",
        sentence="the iron saturates sooner than its B-H curve says (stacking factor, cutting stress)",
        equation=(
            "W'(i, g) -> W'((1 + s) i, g) / (1 + s)^2: B and H of the iron scaled by 1/(1 + s), the gap unchanged; "
            "i = u + low_field_current y/(low_field_width + |y|) + knee_excess y^3, y = lambda/L_0: iron in series"
        ),
        source="Schoppa, Schneider, Wuppermann, J. Magn. Magn. Mater. 215-216, 2000, 74-78 (cutting)",
        parameters=(
            Parameter("knee_shift", "", 0.0, (-0.3, 5.0), 0.02, "s: the flux at the knee is 1/(1 + s)"),
            Parameter(
                "low_field_current", "A", 0.0, (0.0, 2.0), 0.01, "that the iron takes in excess where its curve begins"
            ),
            Parameter("knee_excess", "A^-2", 0.0, (0.0, 100.0), 0.01, "current in excess over the cube of lambda/L_0"),
            Parameter(
                "low_field_width", "A", 0.1, (1e-3, 10.0), 0.1, "lambda/L_0 at half the low-field current", shape=True
            ),
        ),
        needs=("magnets",),
    ),
    Effect(
        name="fringing",
        group="magnetic",
        sentence="flux beyond the 2D section: effective depth grows with the gap; turns and depth errors show here",
        equation="W'(i, g) -> (1 + depth_error + growth g) W'((1 + turns_error) i, g)",
        source="Balakrishnan, Joines, Wilson, IEEE Trans. Power Electronics 12(4), 1997, 654-663",
        parameters=(
            Parameter("growth", "m^-1", 0.0, (-500.0, 1000.0), 20.0, "relative growth of the depth over the gap"),
            Parameter("depth_error", "", 0.0, (-0.2, 0.2), 0.002, "relative error of the stack depth"),
            Parameter("turns_error", "", 0.0, (-0.2, 0.2), 0.002, "relative error of the number of turns"),
        ),
        needs=("magnets",),
    ),
    Effect(
        name="magnetic_hysteresis",
        group="magnetic",
        sentence="force and flux depend on the current's history, rate independent; remanence",
        equation=(
            "i = u + h, h = sum_k s e_k, e_k a stop of width r_k of the flux linkage: a Prandtl-Ishlinskii operator; "
            "flux and force are those of the table at u; loss s r_k |slip_k|, stored s e_k^2 / 2"
        ),
        source="Bergqvist, Physica B 233, 1997, 342-347; Brokate, Sprekels, Hysteresis and Phase Transitions, 1996",
        parameters=(
            Parameter(
                "coercive_current", "A", 0.0, (0.0, 2.0), 0.02, "half the width of the major loop over the current"
            ),
            Parameter(
                "reversal_current",
                "A",
                0.5,
                (0.01, 20.0),
                0.5,
                "half the change of current, at the nominal gap, over which a branch reverses",
                shape=True,
            ),
        ),
        needs=("magnets", "drive lag"),
    ),
    Effect(
        name="eddy_currents",
        group="magnetic",
        sentence="induced currents in laminations, armature or housing delay the flux behind the current",
        equation=(
            "i = u + (3 tau/(T L_0)) (q coth q - 1) lambda, q^2 = s T: sheets of diffusion time T; at T = 0 a shorted "
            "winding beside the coil, i = u + (tau/L_0) d lambda/dt. tau: time_constant, T: diffusion_time"
        ),
        source="Zhu, Knospe, Maslen, IEEE Trans. Magnetics 41(4), 2005, 1248-1258; Woodson, Melcher, 1968, ch. 2",
        parameters=(
            Parameter("time_constant", "s", 0.0, (0.0, 0.05), 1e-4, "of the flux at constant current, nominal gap"),
            Parameter("diffusion_time", "s", 0.0, (0.0, 5.0), 1e-2, "of the field across a sheet's half", shape=True),
        ),
        needs=("magnets", "drive lag"),
    ),
    Effect(
        name="cross_coupling",
        group="magnetic",
        sentence="one side's flux passes through the other side",
        equation="u_1 = i_1 + share i_2, u_2 = i_2 + share i_1; lambda_1 = Lambda_1(u_1) + share Lambda_2(u_2)",
        source="Meeker, Maslen, Noh, IEEE Trans. Magnetics 32(4), 1996, 3219-3227",
        parameters=(
            Parameter("share", "", 0.0, (-0.3, 0.3), 0.01, "of a side's ampere turns that magnetise the other side"),
        ),
        needs=("magnets", "two sides"),
    ),
    Effect(
        name="armature_tilt",
        group="magnetic",
        sentence="the faces are not parallel",
        equation=(
            "W'(i, g) -> 4/9 W'(i, g) + 5/18 (W'(i, g - d) + W'(i, g + d)), d^2 = 9/5 gap_variance: the mean over gaps "
            "spread evenly, by Gauss' three points"
        ),
        source="mean of parallel flux tubes, Roters, 1941, ch. 5; gap_variance = angle^2 <y^2>, width^2/12 of a face",
        parameters=(
            Parameter("gap_variance", "m^2", 0.0, (0.0, 1e-8), 4e-10, "mean square deviation of the gap over the face"),
        ),
        needs=("magnets",),
    ),
)
