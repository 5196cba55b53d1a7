"""Effects of suspension, mover and bench."""

import math

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.lanes import RowLayout
from msl_fem.plant.effects import electrical
from msl_fem.plant.effects.entry import (
    FINE,
    NO_MAGNETS,
    NOT_AT_REST,
    DesignChange,
    Effect,
    KernelSetting,
    MoverMotion,
    Parameter,
    Part,
    Values,
)
from msl_fem.plant.effects.mechanisms import N_STOP, SUM_OF_WIDTHS
from msl_fem.plant.plant import PlantParameters, own_stiffness

LAYOUT = RowLayout(after=electrical.LAYOUT)
QUADRATIC, CUBIC = LAYOUT.rows(2)  # of the spring, N/m^2, N/m^3
FRICTION_SLOPE, FRICTION_WIDTH = LAYOUT.rows(2, N_STOP)  # of the stops, N/m; their widths, m
STRIBECK_RISE, STRIBECK_FALL = LAYOUT.rows(2)  # friction at rest over that in motion less 1; 1/velocity^2 of its fall
SMOOTH_FRICTION, SMOOTH_SLOPE = LAYOUT.rows(2)  # friction that passes zero with the velocity, N; 1/velocity of its tanh
FILM, FILM_GAP = LAYOUT.rows(2)  # N s/m, and the gap at which it is stated, m
MODE_KEPT, MODE_RATIO = LAYOUT.rows(2)  # share of the mass that moves with the armature, second mass over that
MODE_STIFFNESS, MODE_DAMPING = LAYOUT.rows(2)  # of the second mass: w^2, 2 zeta w
MODE_MASS, MODE_READING = LAYOUT.rows(2)  # of the second mass, kg; share of its motion that is read
CREEP_STIFFNESS, CREEP_RATE = LAYOUT.rows(2)  # what relaxes, N/m; its rate, 1/s
SLOW_CREEP_STIFFNESS, SLOW_CREEP_RATE = LAYOUT.rows(2)  # the same of the slower branch
COMPLIANCE, BASE_INERTIA = LAYOUT.rows(2)  # of the base, m/N; compliance over w^2, kg (m/N)^2
BASE_STIFFNESS, BASE_DAMPING = LAYOUT.rows(2)  # of the base: w^2, 2 zeta w
FORCE = LAYOUT.row()  # constant, N


def _spring(e: Array, v: Values, setting: KernelSetting) -> None:
    e[QUADRATIC], e[CUBIC] = v["stiffness_nonlinearity", "quadratic"], v["stiffness_nonlinearity", "cubic"]


def _believed_spring(change: DesignChange, v: Values) -> None:
    change.cubic = v["stiffness_nonlinearity", "cubic"]


def _spring_force(v: Values, plant: PlantParameters, motion: MoverMotion) -> Array:
    x = motion.position
    return (v["stiffness_nonlinearity", "quadratic"] + v["stiffness_nonlinearity", "cubic"] * x) * x * x


def _friction(e: Array, v: Values, setting: KernelSetting) -> None:
    force, transition = v["coulomb_friction", "force"], v["coulomb_friction", "transition_velocity"]
    width = v["coulomb_friction", "presliding"] / N_STOP
    sliding = force
    if transition > 0.0:
        e[SMOOTH_FRICTION], e[SMOOTH_SLOPE] = force, 1.0 / transition
        sliding = 0.0
    for k in range(N_STOP):
        e[FRICTION_WIDTH + k] = (k + 1) * width
        e[FRICTION_SLOPE + k] = sliding / (SUM_OF_WIDTHS * width)
    e[STRIBECK_RISE] = v["coulomb_friction", "stribeck_rise"]
    slow = v["coulomb_friction", "stribeck_velocity"]
    e[STRIBECK_FALL] = 1.0 / (slow * slow)


def _friction_force(v: Values, plant: PlantParameters, motion: MoverMotion) -> Array | float:
    friction = v["coulomb_friction", "force"]
    if not np.any(friction):
        return 0.0
    slowness = 1 + (motion.velocity / v["coulomb_friction", "stribeck_velocity"]) ** 2
    rise = 1 + v["coulomb_friction", "stribeck_rise"] / slowness
    transition = v["coulomb_friction", "transition_velocity"]
    if transition > 0.0:
        return friction * rise * np.tanh(motion.velocity / transition)
    width = v["coulomb_friction", "presliding"] / N_STOP
    return friction * rise * stops_along(motion.position, width) / (width * SUM_OF_WIDTHS)


@compiled
def stops_along(position: Array, width: float) -> Array:
    """The sum of the stops of a friction along a path (n_sample,), m; at rest in the beginning."""
    state, sums = np.zeros(N_STOP), np.zeros(position.size)
    for n in range(1, position.size):
        change, total = position[n] - position[n - 1], 0.0
        for k in range(N_STOP):
            reach = (k + 1) * width
            state[k] = min(max(state[k] + change, -reach), reach)
            total += state[k]
        sums[n] = total
    return sums


def _film(e: Array, v: Values, setting: KernelSetting) -> None:
    e[FILM], e[FILM_GAP] = v["squeeze_film", "damping"], setting.plant.nominal_gap


def _believed_film(change: DesignChange, v: Values) -> None:
    change.damping = change.sides * v["squeeze_film", "damping"]


def _second_mass(e: Array, v: Values, setting: KernelSetting) -> None:
    share, natural = v["structural_mode", "mass_share"], 2 * math.pi * v["structural_mode", "frequency"]
    e[MODE_KEPT], e[MODE_RATIO] = 1.0 - share, share / (1.0 - share)
    if share or v["structural_mode", "load_reading"]:  # what is not there stands still, whatever the step
        e[MODE_STIFFNESS] = natural * natural
        e[MODE_DAMPING] = 2 * v["structural_mode", "damping_ratio"] * natural
    e[MODE_MASS] = share * setting.plant.mass if share else 0.0  # not 0 times the infinite mass of a locked mover
    e[MODE_READING] = v["structural_mode", "load_reading"]


def _second_mass_force(v: Values, plant: PlantParameters, motion: MoverMotion) -> Array:
    return plant.mass * v["structural_mode", "mass_share"] * motion.mode_acceleration


DECADE = 10.0
"""Times slower than the first that the second branch relaxes: a spectrum of times is told in steps of a decade."""


def _relaxation(e: Array, v: Values, setting: KernelSetting) -> None:
    fast, slow = v["flexure_relaxation", "strength"], v["flexure_relaxation", "slow_strength"]
    own, rate = own_stiffness(setting.plant), 1.0 / v["flexure_relaxation", "time_constant"]
    e[CREEP_STIFFNESS], e[CREEP_RATE] = fast * own, rate if fast else 0.0
    e[SLOW_CREEP_STIFFNESS], e[SLOW_CREEP_RATE] = slow * own, rate / DECADE if slow else 0.0


def _constant_force(e: Array, v: Values, setting: KernelSetting) -> None:
    e[FORCE] = v["force_offset", "force"]


def _believed_force(change: DesignChange, v: Values) -> None:
    change.constant_force = v["force_offset", "force"]


def _balancing_force(v: Values, plant: PlantParameters, motion: MoverMotion) -> float:
    return -v["force_offset", "force"]


def _base(e: Array, v: Values, setting: KernelSetting) -> None:
    natural = 2 * math.pi * v["support_compliance", "frequency"]
    e[COMPLIANCE] = v["support_compliance", "compliance"]
    e[BASE_INERTIA] = e[COMPLIANCE] / (natural * natural)
    if e[COMPLIANCE]:
        e[BASE_STIFFNESS] = natural * natural
        e[BASE_DAMPING] = 2 * v["support_compliance", "damping_ratio"] * natural


MECHANICAL = (
    Effect(
        name="stiffness_nonlinearity",
        group="mechanical",
        sentence="the flexure hardens or softens (cubic term)",
        equation="m x'' + c x' + k x + quadratic x^2 + cubic x^3 = ...",
        source="Smith, Flexures, 2000, ch. 4; Duffing's equation",
        parameters=(
            Parameter(
                "cubic",
                "N/m^3",
                0.0,
                (-1e14, 1e14),
                5e9,
                "of the flexure's force",
                of=(
                    ("force", 1),
                    ("travel", -3),
                ),
            ),
            Parameter(
                "quadratic",
                "N/m^2",
                0.0,
                (-1e10, 1e10),
                3e6,
                "of the flexure's force",
                of=(
                    ("force", 1),
                    ("travel", -2),
                ),
            ),
        ),
        coefficients=_spring,
        believe=_believed_spring,
        needed_force=_spring_force,
        design=Part(("cubic",), "the magnets carry the cubic force alone; the feedback takes the quadratic one"),
        inverse=Part(("cubic", "quadratic")),
        static=NOT_AT_REST,
        advice="measure force over travel with weights; longer leaves, or leaves that may draw in",
        sets=(("cubic",), ("quadratic",), ("cubic", "quadratic")),
        one_form=True,
    ),
    Effect(
        name="coulomb_friction",
        group="mechanical",
        sentence="dry friction, a force against the motion that is nearly as large at any speed",
        equation=(
            "force -s sum_k e_k (1 + stribeck_rise/(1 + (v/stribeck_velocity)^2)), e_k a stop of width r_k of "
            "the position: elastic below, sliding at that force; with a transition_velocity w in their place "
            "-force tanh(v/w)"
        ),
        source=(
            "Iwan, J. Appl. Mech. 33, 1966, 893-900; Al-Bender, Lampaert, Swevers, IEEE TAC 50(11), 2005, 1883-1887; "
            "Hess, Soom, J. Tribology 112, 1990, 147-152 (the fall over velocity); "
            "Andersson, Soderberg, Bjorklund, Tribology Int. 40, 2007, 580-587 (tanh over velocity)"
        ),
        parameters=(
            Parameter("force", "N", 0.0, (0.0, 1e3), 0.1, "in full sliding", of=(("force", 1),)),
            Parameter(
                "presliding",
                "m",
                1e-6,
                (1e-8, 1e-3),
                1e-6,
                "travel until everything slides",
                shape=True,
                tried=(0.03, 0.2),
                over="position",
            ),
            Parameter(
                "stribeck_rise",
                "",
                0.0,
                (0.0, 3.0),
                0.2,
                "friction at rest over the force in full sliding, less 1",
                shape=True,
                tried=(0.2,),
            ),
            Parameter(
                "stribeck_velocity",
                "m/s",
                1e-3,
                (1e-7, 10.0),
                1e-3,
                "at which half of the rise is left",
                shape=True,
                tried=(0.15,),
                over="velocity",
            ),
            Parameter(
                "transition_velocity",
                "m/s",
                0.0,
                (0.0, 10.0),
                1e-3,
                "over which friction passes zero; 0: elastic over the presliding length",
                shape=True,
                tried=(0.2,),
                over="velocity",
                instead=("presliding", "stribeck_rise", "stribeck_velocity"),
            ),
        ),
        coefficients=_friction,
        needed_force=_friction_force,
        design=Part(declined="the linear plant has no memory; the feedback takes friction as a disturbance"),
        inverse=Part(("force",)),
        static=NOT_AT_REST,
        advice="look for rubbing cables, seals and guides",
    ),
    Effect(
        name="squeeze_film",
        group="mechanical",
        sentence="air damping that grows as the gap closes",
        equation="force -damping ((g_0/g_1)^3 + (g_0/g_2)^3) dx/dt",
        source="Blech, J. Lubrication Tech. 105, 1983, 615-620; Bao, Yang, Sensors and Actuators A 136, 2007, 3-27",
        parameters=(
            Parameter(
                "damping",
                "N s/m",
                0.0,
                (0.0, 1e4),
                1.0,
                "of one side's film at the nominal gap",
                of=(("mass", 0.5), ("force", 0.5), ("travel", -0.5)),
            ),
        ),
        needs=("magnets",),
        coefficients=_film,
        believe=_believed_film,
        design=Part(("damping",)),
        inverse=NO_MAGNETS,
        static=NOT_AT_REST,
        advice="open the gap at the nearest point, drill the faces, or keep it in the model",
        one_form=True,
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
            Parameter(
                "frequency",
                "Hz",
                400.0,
                (1.0, 1e4),
                100.0,
                "w / 2 pi, of the share alone",
                shape=True,
                tried=tuple(1.6 * 1.18**n for n in range(17)),
                over="own_frequency",
                resonant=True,
                width=0.15,
            ),
            Parameter("damping_ratio", "", 0.01, (0.0, 1.0), 0.01, "zeta", shape=True, tried=(0.015,)),
        ),
        coefficients=_second_mass,
        needed_force=_second_mass_force,
        design=Part(declined="the linear plant is one mass; keep the loop's bandwidth below the resonance"),
        inverse=Part(("mass_share", "load_reading")),
        static=NOT_AT_REST,
        advice="tap the mover with the coils open; stiffen what resonates, keep the loop's bandwidth below it",
        sets=(("mass_share",), ("mass_share", "load_reading")),
        deviation_of={"position_sensor_crosstalk": 0.02},
        steps=FINE,
        turns="frequency",
        one_form=True,
    ),
    Effect(
        name="flexure_relaxation",
        group="mechanical",
        sentence="creep or viscoelastic stiffness",
        equation="force -k (strength (x - y) + slow_strength (x - z)), time_constant y' = x - y, "
        "10 time_constant z' = x - z: the standard linear solid, or two branches of a generalised Maxwell model",
        source="Zener, Elasticity and Anelasticity of Metals, 1948, ch. 5; Tschoegl, The Phenomenological Theory of "
        "Linear Viscoelastic Behavior, 1989, ch. 3",
        parameters=(
            Parameter(
                "strength",
                "",
                0.0,
                (0.0, 5.0),
                0.01,
                "stiffness that relaxes, over that which stays; without a spring over one of 20 Hz with the mover",
            ),
            Parameter(
                "slow_strength",
                "",
                0.0,
                (0.0, 5.0),
                0.01,
                "the same of what relaxes ten times more slowly: creep has a spectrum of times",
            ),
            Parameter(
                "time_constant",
                "s",
                0.1,
                (1e-4, 1e4),
                0.1,
                "of the relaxation",
                shape=True,
                tried=(0.004, 0.03, 0.2),
                width=0.8,
            ),
        ),
        coefficients=_relaxation,
        design=Part(declined="it is slower than the loop, whose integrator takes it"),
        inverse=Part(declined="a share of the spring relaxes, and a carriage has none"),
        sets=(("strength",), ("strength", "slow_strength")),
        static=NOT_AT_REST,
        advice="look for adhesive, plastics and loose clamps in the suspension, for cables and hoses",
    ),
    Effect(
        name="force_offset",
        group="mechanical",
        sentence="a constant force that is not believed (drive offset, gravity, cable)",
        equation="m x'' + ... = ... + force",
        source="Newton's second law",
        parameters=(Parameter("force", "N", 0.0, (-1e4, 1e4), 0.1, "along +x", of=(("force", 1),)),),
        coefficients=_constant_force,
        believe=_believed_force,
        needed_force=_balancing_force,
        design=Part(("force",)),
        inverse=Part(("force",)),
        static=Part(("force",)),
        advice="check gravity along the axis, cables, the rest position",
        deviation_of={"early_saturation": 0.05},
        one_form=True,
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
            Parameter(
                "compliance",
                "m/N",
                0.0,
                (0.0, 1e-5),
                1e-8,
                "of the base, static",
                of=(
                    ("travel", 1),
                    ("force", -1),
                ),
            ),
            Parameter(
                "frequency",
                "Hz",
                500.0,
                (5.0, 1e4),
                200.0,
                "w / 2 pi of the base",
                shape=True,
                tried=(4.0, 10.0, 25.0),
                over="own_frequency",
                width=0.15,
            ),
            Parameter("damping_ratio", "", 0.1, (1e-3, 2.0), 0.1, "zeta of the base", shape=True, tried=(0.1,)),
        ),
        needs=("magnets",),
        coefficients=_base,
        design=Part(declined="the linear plant is one mass; keep the loop's bandwidth below the bench's resonance"),
        inverse=NO_MAGNETS,
        static=NOT_AT_REST,
        advice="stiffen the bench or read the gap against the magnet",
        deviation_of={"magnetic_hysteresis": 0.01},
    ),
)
