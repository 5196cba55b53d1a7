"""Effects of the magnets: each leaves force and flux linkage the derivatives of one coenergy, or states its loss."""

import math

from msl_fem.computing.arrays import Array
from msl_fem.computing.lanes import RowLayout
from msl_fem.plant.effects.entry import (
    NO_MAGNETS,
    NOT_AT_REST,
    DesignChange,
    Effect,
    KernelSetting,
    Parameter,
    Part,
    Values,
    bending_current,
)
from msl_fem.plant.effects.mechanisms import N_IRON_STOP, NEVER
from msl_fem.plant.plant import CURRENT_DRIVE
from msl_fem.plant.poles import FAST

EDDY_POLES = (
    9.884933, 41.23557, 114.6043, 308.2497, 831.9319, 2248.805, 6080.012, 16424.88, 44312.97, 119880.7, 338243.2,
    1340791.0,
)  # fmt: skip
EDDY_WEIGHTS = (
    6.026067, 6.770124, 10.11462, 16.62025, 27.37571, 45.04355, 74.04006, 121.5388, 199.4603, 331.4702, 614.261,
    2104.485,
)  # fmt: skip
"""Modes by which the currents in sheets are taken: conductance 3 (q coth q - 1)/q^2 = sum w/(q^2 + p) + rest."""
N_EDDY = len(EDDY_POLES)  # modes of the eddy currents of a side, beside what answers at once

LAYOUT = RowLayout()
GAP_1, GAP_2 = LAYOUT.rows(2)  # gaps of the sides at x = 0, m
CURRENT_SCALE = LAYOUT.row()  # what multiplies the magnets' current
DEPTH, GROWTH = LAYOUT.rows(2)  # W' is multiplied by depth + growth g
TILT = LAYOUT.row()  # from the middle to the outer points of a face, m
SHARE, UNMIX = LAYOUT.rows(2)  # share of the other side's current; 1/(1 - share^2)
EDDY = LAYOUT.row()  # conductance of the eddy loop, 1/ohm
EDDY_MODE, EDDY_RATE = LAYOUT.rows(2, N_EDDY)  # modes of the eddy currents: current over flux, A/Wb; rates, 1/s
EDDY_MISSED = LAYOUT.row(N_EDDY)  # share of the flux linkage at a run's begin that they have not followed yet
EDDY_EXACT = LAYOUT.row()  # whether they are known in closed form over a step (0 or 1): beside a fast current loop
HYSTERESIS_SLOPE, HYSTERESIS_WIDTH = LAYOUT.rows(2, N_IRON_STOP)  # of the stops, A/Wb; their widths, Wb
HYSTERESIS_STRETCH = LAYOUT.row()  # of what the stops follow: y = lambda + stretch lambda^3, Wb^-2
HYSTERESIS_BROADENING = LAYOUT.row()  # and of y: z = asinh(gamma y)/gamma, 1/Wb
STEEPNESS = 7.0  # of the exponential, at the knee's current
RISE = math.exp(STEEPNESS) - 1.0  # of it up to there
IRON_SCALE, IRON_LOW = LAYOUT.rows(2)  # iron in series: one over L_0, 1/H; current at low fields, A
IRON_WIDTH, IRON_KNEE = LAYOUT.rows(2)  # its width, A; current over the cube, 1/A^2
IRON_BENDS = LAYOUT.row()  # in place of the cube an exponential of y^2, 1/A^2


def _gaps(e: Array, v: Values, setting: KernelSetting) -> None:
    offset, centring = v["gap_offset", "offset"], v["gap_offset", "centring"]
    e[GAP_1] = setting.plant.nominal_gap + offset + centring
    e[GAP_2] = setting.plant.nominal_gap + offset - centring


def _believed_gaps(change: DesignChange, v: Values) -> None:
    offset, centring = v["gap_offset", "offset"], v["gap_offset", "centring"]
    change.gap_1, change.gap_2 = offset + centring, offset - centring


def _coenergy_scales(v: Values) -> tuple[float, float, float]:
    """(scale, depth, growth) of W'(i, g) -> (depth + growth g) W'(scale i, g)."""
    sooner, turns = 1.0 + v["early_saturation", "knee_shift"], 1.0 + v["fringing", "turns_error"]
    depth = (1.0 + v["fringing", "depth_error"]) / (sooner * sooner)
    return sooner * turns, depth, v["fringing", "growth"] / (sooner * sooner)


def _believed_coenergy(change: DesignChange, v: Values) -> None:
    change.current_scale, change.depth, change.growth = _coenergy_scales(v)


def _coenergy(e: Array, v: Values, setting: KernelSetting) -> None:
    """The magnets' coenergy, and iron in series with it."""
    e[CURRENT_SCALE], e[DEPTH], e[GROWTH] = _coenergy_scales(v)
    e[IRON_SCALE] = 1.0 / setting.inductance
    e[IRON_LOW] = v["early_saturation", "low_field_current"]
    e[IRON_WIDTH] = v["early_saturation", "low_field_width"]
    e[IRON_KNEE] = v["early_saturation", "knee_excess"]
    bends = v["early_saturation", "knee_current"]
    e[IRON_BENDS] = 1.0 / (bends * bends) if bends < NEVER else 0.0


def _hysteresis(e: Array, v: Values, setting: KernelSetting) -> None:
    """Stops k = 1 ... N of widths R_k = p(lambda_r (k/N)^a) and slopes s_k that go with R_k^-b exp(-c R_k/lambda_r),
    sum s_k R_k = i_c.

    They follow p(l) = l + w l (l/lambda_r)^2, lambda_r = L_0 i_r; with a broadening g, b(p(l)) instead, as their widths
    do, b(y) = (lambda_r/g) asinh(g y/lambda_r).
    """
    widest = setting.inductance * v["magnetic_hysteresis", "reversal_current"]
    widening, gamma = v["magnetic_hysteresis", "widening"], v["magnetic_hysteresis", "broadening"] / widest
    e[HYSTERESIS_STRETCH] = widening / (widest * widest)
    e[HYSTERESIS_BROADENING] = gamma
    reach = 0.0
    for k in range(N_IRON_STOP):
        place = math.exp(v["magnetic_hysteresis", "spacing"] * math.log((k + 1.0) / N_IRON_STOP))
        e[HYSTERESIS_WIDTH + k] = widest * place * (1.0 + widening * place * place)
        if gamma > 0.0:
            e[HYSTERESIS_WIDTH + k] = math.asinh(gamma * e[HYSTERESIS_WIDTH + k]) / gamma
        wider = e[HYSTERESIS_WIDTH + k] / widest
        fall = v["magnetic_hysteresis", "fall"] * math.log(wider) + v["magnetic_hysteresis", "decay"] * wider
        e[HYSTERESIS_SLOPE + k] = math.exp(0.0 - fall)
        reach = reach + e[HYSTERESIS_SLOPE + k] * e[HYSTERESIS_WIDTH + k]
    for k in range(N_IRON_STOP):
        e[HYSTERESIS_SLOPE + k] = e[HYSTERESIS_SLOPE + k] * (v["magnetic_hysteresis", "coercive_current"] / reach)


def _eddy_currents(e: Array, v: Values, setting: KernelSetting) -> None:
    """Sheets of diffusion time T and low-frequency conductance G: a magnetising current (3 G/T) (q coth q - 1) Lambda,
    q^2 = s T, is taken as the sum over k of (G w_k/T) s/(s + p_k/T) Lambda, and the rest of G at once: within 0.02 %
    up to s T = 5 10^5. Of a mode that is faster than a step a share has the step's rate and the rest answers at once,
    together as late as the mode: over T nothing jumps. A flux linkage that was built up at once so many seconds before
    a run a mode has followed but for exp(-p_k/T) of it a second."""
    conductance = v["eddy_currents", "time_constant"] / setting.inductance
    diffusion = v["eddy_currents", "diffusion_time"]
    bandwidth = setting.plant.bandwidth * (1.0 + v["amplifier_bandwidth", "bandwidth_error"])
    fast = setting.plant.drive == CURRENT_DRIVE and FAST < bandwidth * setting.step < math.inf
    exact = fast and conductance > 0.0 and diffusion > 0.0
    e[EDDY_EXACT] = 1.0 if exact else 0.0
    at_once, since = 1.0, v["eddy_currents", "switched_on"]
    for k, (pole, weight) in enumerate(zip(EDDY_POLES, EDDY_WEIGHTS, strict=True)):
        steps = diffusion / (pole * setting.step)
        if conductance and diffusion:
            share, rate = (1.0, pole / diffusion) if exact or steps > 1.0 else (steps, 1.0 / setting.step)
            e[EDDY_MODE + k] = share * weight / pole * conductance * rate
            e[EDDY_RATE + k] = rate
            e[EDDY_MISSED + k] = math.exp(-rate * since) if since > 0.0 else 0.0
            at_once -= share * weight / pole
    e[EDDY] = conductance * at_once


def _believed_eddy_currents(change: DesignChange, v: Values) -> None:
    change.lag += v["eddy_currents", "time_constant"]


def _coupling(e: Array, v: Values, setting: KernelSetting) -> None:
    e[SHARE] = v["cross_coupling", "share"] if setting.plant.sides == 2 else 0.0
    e[UNMIX] = 1.0 / (1.0 - e[SHARE] * e[SHARE])


def _tilt(e: Array, v: Values, setting: KernelSetting) -> None:
    e[TILT] = math.sqrt(1.8 * v["armature_tilt", "gap_variance"])  # sqrt(3/5) of half the span, which is sqrt(3 v)


MAGNETIC = (
    Effect(
        name="gap_offset",
        group="magnetic",
        sentence="the true gap differs from the believed one by a constant (glue line, parting joint, wrong zero)",
        equation="g_1 = g_0 + offset + centring - x,  g_2 = g_0 + offset - centring + x",
        source="Roters, Electromagnetic Devices, 1941, ch. 5 (joints in series with the working gap)",
        parameters=(
            Parameter("offset", "m", 0.0, (-5.4e-4, 5.4e-4), 5e-6, "both gaps are wider by this", of=(("gap", 1),)),
            Parameter(
                "centring",
                "m",
                0.0,
                (-5.4e-4, 5.4e-4),
                5e-6,
                "side 1's gap is wider, side 2's narrower by this",
                of=(("gap", 1),),
            ),
        ),
        needs=("magnets",),
        coefficients=_gaps,
        believe=_believed_gaps,
        design=Part(("offset", "centring")),
        inverse=NO_MAGNETS,
        static=Part(("offset",), "one magnet has no middle that it could be off"),
        advice="measure the gap at rest with feeler gauges; look for a glue line, a parting joint, a wrong zero",
        sets=(("offset",), ("centring",)),
        separating="a map down to half the smallest gap: an offset grows there as 1/gap, a scale does not",
        one_form=True,
    ),
    Effect(
        name="early_saturation",
        group="magnetic",
        sentence="the iron saturates sooner than its B-H curve says (stacking factor, cutting stress)",
        equation=(
            "W'(i, g) -> W'((1 + s) i, g) / (1 + s)^2: B and H of the iron scaled by 1/(1 + s), the gap unchanged; "
            "i = u + low_field_current y/(low_field_width + |y|) + knee_excess y^3, y = lambda/L_0: iron in series; "
            "with a knee_current y_k, y_k^2 (exp(7 y^2/y_k^2) - 1)/(exp(7) - 1) in place of y^2 in the cube"
        ),
        source=(
            "Schoppa, Schneider, Wuppermann, J. Magn. Magn. Mater. 215-216, 2000, 74-78 (cutting); Brauer, IEEE Trans. "
            "Magn. 11(1), 1975, 81 (the knee)"
        ),
        parameters=(
            Parameter("knee_shift", "", 0.0, (-0.3, 5.0), 0.02, "s: the flux at the knee is 1/(1 + s)"),
            Parameter(
                "low_field_current",
                "A",
                0.0,
                (0.0, 2.0),
                0.01,
                "that the iron takes in excess where its curve begins",
                lagging=True,
                of=(("current", 1),),
            ),
            Parameter(
                "knee_excess",
                "A^-2",
                0.0,
                (0.0, 100.0),
                0.01,
                "current in excess over the cube of lambda/L_0",
                lagging=True,
                of=(("current", -2),),
            ),
            Parameter(
                "low_field_width",
                "A",
                0.1,
                (1e-3, 10.0),
                0.1,
                "lambda/L_0 at half the low-field current",
                shape=True,
                tried=(0.1,),
                belongs_to="low_field_current",
            ),
            bending_current(
                "knee_current",
                "y_k: the lambda/L_0 at which the excess is that cube; below it is less, and beyond more",
                1.0,
                over="peak",
                optional=True,
                belongs_to="knee_excess",
            ),
        ),
        needs=("magnets",),
        coefficients=_coenergy,
        believe=_believed_coenergy,
        design=Part(("knee_shift",), "the current of iron in series depends on the flux and is left to the feedback"),
        inverse=NO_MAGNETS,
        static=Part(("knee_shift", "low_field_current", "knee_excess")),
        advice="check the stacking factor and the sheets' cut edges; measure the B-H curve of a stacked ring",
        sets=(("knee_shift",), ("low_field_current", "knee_excess"), ("knee_excess",)),
        separating="a map up to twice the largest current, where the iron saturates",
        deviation_of={"magnetic_hysteresis": 0.01},
    ),
    Effect(
        name="fringing",
        group="magnetic",
        sentence="flux beyond the 2D section: effective depth grows with the gap; turns and depth errors show here",
        equation="W'(i, g) -> (1 + depth_error + growth g) W'((1 + turns_error) i, g)",
        source="Balakrishnan, Joines, Wilson, IEEE Trans. Power Electronics 12(4), 1997, 654-663",
        parameters=(
            Parameter(
                "growth",
                "m^-1",
                0.0,
                (-500.0, 1000.0),
                20.0,
                "relative growth of the depth over the gap",
                of=(("gap", -1),),
            ),
            Parameter("depth_error", "", 0.0, (-0.2, 0.2), 0.002, "relative error of the stack depth"),
            Parameter("turns_error", "", 0.0, (-0.2, 0.2), 0.002, "relative error of the number of turns"),
        ),
        needs=("magnets",),
        coefficients=_coenergy,
        believe=_believed_coenergy,
        design=Part(("growth", "depth_error", "turns_error")),
        inverse=NO_MAGNETS,
        static=Part(("growth", "depth_error", "turns_error")),
        advice="check turns and stack depth; where the depth grows with the gap, make the table with end effects",
        sets=(("growth",), ("depth_error",), ("turns_error",), ("growth", "depth_error")),
        separating="a map out to twice the largest gap, where the depth's growth is largest and an offset fades",
        one_form=True,
    ),
    Effect(
        name="magnetic_hysteresis",
        group="magnetic",
        sentence="force and flux depend on the current's history, rate independent; remanence",
        equation=(
            "i = u + h, h = p'(lambda) sum_k s_k e_k, e_k a stop of width R_k of z = (lambda_r/g) asinh(g y/lambda_r), "
            "y = p(lambda) = lambda (1 + widening (lambda/lambda_r)^2), lambda_r = L_0 reversal_current, "
            "g = broadening: a stretched Prandtl-Ishlinskii operator; flux and force are those of the table at u; a "
            "stop that slips loses s_k |y(z) - y(z - e_k)| |dz|; at g = 0: z = y, loss s_k R_k |slip_k|, stored "
            "s_k e_k^2 / 2"
        ),
        source=(
            "Bergqvist, Physica B 233, 1997, 342-347; Brokate, Sprekels, Hysteresis and Phase Transitions, 1996; Al "
            "Janaideh, Rakheja, Su, Mechatronics 19(5), 2009, 656-670 (densities that decay exponentially)"
        ),
        parameters=(
            Parameter(
                "coercive_current",
                "A",
                0.0,
                (0.0, 2.0),
                0.02,
                "half the width of the major loop over the current",
                of=(("current", 1),),
            ),
            Parameter(
                "reversal_current",
                "A",
                0.5,
                (0.01, 20.0),
                0.5,
                "half the change of current, at the nominal gap, over which a branch reverses",
                shape=True,
                tried=(0.3, 1.0, 3.0),
                over="current",
            ),
            Parameter(
                "spacing",
                "",
                1.0,
                (0.3, 6.0),
                0.5,
                "a: the stops' widths are those of the fluxes (k/32)^a lambda_r",
                shape=True,
                tried=(1.5,),
                width=0.7,
            ),
            Parameter(
                "fall",
                "",
                0.0,
                (0.0, 3.0),
                0.5,
                "b: slopes of the stops go with their widths to the power -b: how early minor loops lose energy",
                shape=True,
                tried=(0.3,),
                over="loops",
                width=1.5,
            ),
            Parameter(
                "decay",
                "",
                0.0,
                (0.0, 20.0),
                0.5,
                "c: slopes of the stops go with exp(-c width/lambda_r): how late the largest loops still widen",
                shape=True,
                tried=(1.5,),
                width=1.5,
            ),
            Parameter(
                "widening",
                "",
                0.0,
                (0.0, 2.0),
                0.1,
                "growth of a loop's width with the square of the flux, at lambda_r",
                shape=True,
                tried=(0.09,),
                over="loops",
                width=1.0,
            ),
            Parameter(
                "broadening",
                "",
                0.0,
                (0.0, 10.0),
                0.1,
                "g: the change of flux over which a branch reverses grows as sqrt(1 + (g lambda/lambda_r)^2)",
                shape=True,
                tried=(0.2,),
                width=1.0,
            ),
        ),
        needs=("magnets", "drive lag"),
        coefficients=_hysteresis,
        design=Part(declined="the inverse has no memory; the feedback takes what the iron remembers"),
        inverse=NO_MAGNETS,
        static=Part(("coercive_current",)),
        advice="anneal the sheets or take a better grade; demagnetise before each run",
        separating="loops of the current up and down at one gap, in an ascending series of amplitudes",
    ),
    Effect(
        name="eddy_currents",
        group="magnetic",
        sentence="induced currents in laminations, armature or housing delay the flux behind the current",
        equation=(
            "i = u + (3 tau/(T L_0)) (q coth q - 1) lambda, q^2 = s T: sheets of diffusion time T; at T = 0 a shorted "
            "winding beside the coil, i = u + (tau/L_0) d lambda/dt. tau: time_constant, T: diffusion_time. The lambda "
            "with which a run begins is there since switched_on"
        ),
        source="Zhu, Knospe, Maslen, IEEE Trans. Magnetics 41(4), 2005, 1248-1258; Woodson, Melcher, 1968, ch. 2",
        parameters=(
            Parameter(
                "time_constant",
                "s",
                0.0,
                (0.0, 0.05),
                1e-4,
                "of the flux at constant current, nominal gap",
                alone=True,
                root_of="diffusion_time",
                of=(("period", 1),),
            ),
            Parameter(
                "diffusion_time",
                "s",
                0.0,
                (0.0, 50.0),
                1e-2,
                "of the field across a sheet's half",
                shape=True,
                tried=(1e-3, 1e-2, 1e-1, 1.0, 10.0),
            ),
            Parameter(
                "switched_on",
                "s",
                0.0,
                (0.0, 1e3),
                1e-2,
                "before a run its first currents were; 0: so long ago that nothing of it is left",
                shape=True,
                tried=(0.03,),
                width=1.5,
                optional=True,
            ),
        ),
        needs=("magnets", "drive lag"),
        coefficients=_eddy_currents,
        believe=_believed_eddy_currents,
        design=Part(("time_constant",)),
        inverse=NO_MAGNETS,
        static=NOT_AT_REST,
        advice="look for solid iron and shorted sheets in the flux path, a closed metal ring around it",
        deviation_of={"time_delay": 0.1, "amplifier_bandwidth": 0.1, "magnetic_hysteresis": 0.01},
        steps=2,
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
        coefficients=_coupling,
        design=Part(declined="the inverse finds the current of each side by itself; the feedback takes the rest"),
        inverse=NO_MAGNETS,
        static=Part(declined="it takes two sides, a static map is of one magnet"),
        advice="separate the sides' flux: a thicker armature, other polarity; or keep it in the model",
        deviation_of={"mutual_inductance": 0.1},
        one_form=True,
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
            Parameter(
                "gap_variance",
                "m^2",
                0.0,
                (0.0, 1e-8),
                4e-10,
                "mean square deviation of the gap over the face",
                of=(("gap", 2),),
            ),
        ),
        needs=("magnets",),
        coefficients=_tilt,
        design=Part(declined="it changes the force in the second order of the tilt; the feedback takes that"),
        inverse=NO_MAGNETS,
        static=Part(("gap_variance",)),
        advice="measure the gap at the corners; shim the armature or the magnets until the faces are parallel",
        separating="a map down to half the smallest gap, where a tilt grows as the square of 1/gap",
        one_form=True,
    ),
)
