"""Effects of suspension, mover and bench."""

from msl_fem.plant.effects.entry import Effect, Parameter

MECHANICAL = (
    Effect(
        name="stiffness_nonlinearity",
        group="mechanical",
        sentence="the flexure hardens or softens (cubic term)",
        equation="m x'' + c x' + k x + quadratic x^2 + cubic x^3 = ...",
        source="Smith, Flexures, 2000, ch. 4; Duffing's equation",
        parameters=(
            Parameter("cubic", "N/m^3", 0.0, (-1e14, 1e14), 5e9, "of the flexure's force"),
            Parameter("quadratic", "N/m^2", 0.0, (-1e10, 1e10), 3e6, "of the flexure's force"),
        ),
    ),
    Effect(
        name="coulomb_friction",
        group="mechanical",
        sentence="a rate-independent friction force",
        equation=(
            "force -s sum_k e_k (1 + stribeck_rise/(1 + (v/stribeck_velocity)^2)), e_k a stop of width r_k of "
            "the position: elastic below, sliding at `force`"
        ),
        source=(
            "Iwan, J. Appl. Mech. 33, 1966, 893-900; Al-Bender, Lampaert, Swevers, IEEE TAC 50(11), 2005, 1883-1887; "
            "Hess, Soom, J. Tribology 112, 1990, 147-152 (the fall over velocity)"
        ),
        parameters=(
            Parameter("force", "N", 0.0, (0.0, 1e3), 0.1, "in full sliding"),
            Parameter("presliding", "m", 1e-6, (1e-8, 1e-3), 1e-6, "travel until everything slides", shape=True),
            Parameter("stribeck_rise", "", 0.0, (0.0, 3.0), 0.2, "friction at rest over `force`, less 1", shape=True),
            Parameter(
                "stribeck_velocity", "m/s", 1e-3, (1e-7, 10.0), 1e-3, "at which half of the rise is left", shape=True
            ),
        ),
    ),
    Effect(
        name="squeeze_film",
        group="mechanical",
        sentence="air damping that grows as the gap closes",
        equation="force -damping ((g_0/g_1)^3 + (g_0/g_2)^3) dx/dt",
        source="Blech, J. Lubrication Tech. 105, 1983, 615-620; Bao, Yang, Sensors and Actuators A 136, 2007, 3-27",
        parameters=(Parameter("damping", "N s/m", 0.0, (0.0, 1e4), 1.0, "of one side's film at the nominal gap"),),
        needs=("magnets",),
    ),
    Effect(
        name="structural_mode",
        group="mechanical",
        sentence="a second resonance in the load path",
        equation=(
            "a share mu of the mass hangs on a spring: q'' + 2 zeta w q' + w^2 q = -x'', "
            "(1 - mu) m x'' = ... + mu m (w^2 q + 2 zeta w q'); the sensor reads x + load_reading q"
        ),
        source="Den Hartog, Mechanical Vibrations, 4th ed., 1956, ch. 3 (two masses)",
        parameters=(
            Parameter("mass_share", "", 0.0, (0.0, 0.6), 0.01, "mu"),
            Parameter("load_reading", "", 0.0, (-1.0, 1.0), 0.1, "0: the sensor sees the armature, 1: the load"),
            Parameter("frequency", "Hz", 400.0, (1.0, 1e4), 100.0, "w / 2 pi, of the share alone", shape=True),
            Parameter("damping_ratio", "", 0.01, (0.0, 1.0), 0.01, "zeta", shape=True),
        ),
    ),
    Effect(
        name="flexure_relaxation",
        group="mechanical",
        sentence="creep or viscoelastic stiffness",
        equation="force -strength k (x - y), time_constant y' = x - y: the standard linear solid",
        source="Zener, Elasticity and Anelasticity of Metals, 1948, ch. 5",
        parameters=(
            Parameter("strength", "", 0.0, (0.0, 5.0), 0.01, "stiffness that relaxes, over that which stays"),
            Parameter("time_constant", "s", 0.1, (1e-4, 1e4), 0.1, "of the relaxation", shape=True),
        ),
    ),
    Effect(
        name="force_offset",
        group="mechanical",
        sentence="a constant force that is not believed (drive offset, gravity, cable)",
        equation="m x'' + ... = ... + force",
        source="Newton's second law",
        parameters=(Parameter("force", "N", 0.0, (-1e4, 1e4), 0.1, "along +x"),),
    ),
    Effect(
        name="support_compliance",
        group="mechanical",
        sentence="the bench gives way under force, so the gap is not the one that is read",
        equation=(
            "the magnets stand on a base that gives way by b: g_1 = g_0 - (x - b), "
            "b''/w^2 + 2 zeta b'/w + b = -compliance (F_1 - F_2); flexure and sensor stand on the ground"
        ),
        source="Rivin, Stiffness and Damping in Mechanical Design, 1999, ch. 5",
        parameters=(
            Parameter("compliance", "m/N", 0.0, (0.0, 1e-5), 1e-8, "of the base, static"),
            Parameter("frequency", "Hz", 500.0, (5.0, 1e4), 200.0, "w / 2 pi of the base", shape=True),
            Parameter("damping_ratio", "", 0.1, (1e-3, 2.0), 0.1, "zeta of the base", shape=True),
        ),
        needs=("magnets",),
    ),
)
