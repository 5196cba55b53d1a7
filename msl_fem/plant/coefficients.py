"""The effects' parameters as the compiled kernel takes them: coefficients of its equations, for one plant and step."""

import math

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.plant.effects import POSITION
from msl_fem.plant.effects.lags import pole_and_delay
from msl_fem.plant.plant import CURRENT_DRIVE, PlantParameters

Array = NDArray[np.float64]

N_STOP = 6  # stops of a Prandtl-Ishlinskii operator; their widths are 1, 2 ... 6 times the first
N_QUEUE = 16  # samples by which a command can be late
EDDY_POLES = (9.961828, 46.97476, 177.0982, 678.4545, 2655.095, 12635.84)
EDDY_WEIGHTS = (6.148609, 8.745795, 16.96271, 33.58058, 68.57505, 209.0614)
"""Modes by which the currents in sheets are taken: conductance 3 (q coth q - 1)/q^2 = sum w/(q^2 + p) + rest."""
N_EDDY = len(EDDY_POLES)  # modes of the eddy currents of a side, beside what answers at once

# Rows of the coefficients. Gaps of the sides at x = 0 (m); what multiplies the magnets' current; W' is multiplied by
# depth + growth g; from the middle to the outer points of a face (m); share of the other side's current;
# 1/(1 - share^2)
GAP_1, GAP_2, CURRENT_SCALE, DEPTH, GROWTH, TILT, SHARE, UNMIX = range(8)
# Conductance of the eddy loop (1/ohm); slope of a stop of the hysteresis (A/Wb) and its first width (Wb)
EDDY, HYSTERESIS_SLOPE, HYSTERESIS_WIDTH = 8, 9, 10
# Relative rise of the resistance (1/J), its decay (1/s), the rise in the beginning
HEAT_PER_JOULE, COOLING, HEAT_START = 11, 12, 51
# Spring (N/m2, N/m3); slope of a friction stop (N/m) and its first width (m); film (N s/m) and the gap it is stated at
QUADRATIC, CUBIC, FRICTION_SLOPE, FRICTION_WIDTH, FILM, FILM_GAP = 13, 14, 15, 16, 17, 18
# Second mass: share of the mass that moves with the armature, mass over that, w^2, 2 zeta w, mass (kg), reading
MODE_KEPT, MODE_RATIO, MODE_STIFFNESS, MODE_DAMPING, MODE_MASS, MODE_READING = 19, 20, 21, 22, 23, 24
# Relaxing stiffness (N/m), its rate (1/s); compliance of the base (m/N), w^2, 2 zeta w
CREEP_STIFFNESS, CREEP_RATE, COMPLIANCE, BASE_STIFFNESS, BASE_DAMPING = 25, 26, 27, 28, 29
BASE_INERTIA = 52  # compliance over w^2 (kg (m/N)^2)
# Modes of the eddy currents: current over flux linkage (A/Wb), rates (1/s)
EDDY_MODE, EDDY_RATE = 53, 53 + N_EDDY
# Forces (N): constant, of the periodic disturbance; rotation of its phase in half a step
FORCE, FORCE_COSINE, FORCE_SINE, TURN_COSINE, TURN_SINE = 30, 31, 32, 33, 34
# Bandwidths of drive and position sensor (rad/s)
BANDWIDTH, SENSOR_BANDWIDTH = 35, 36
# Delay of the command: whole samples, then the step of a sample in which it acts, and after what share of that step
DELAY_SAMPLES, JUMP_STEP, JUMP_SHARE = 37, 38, 39
# What is left of the amplifier's lag at begin, middle, end of a step, and of a jump within the step, see `fall_stages`
FALL, JUMP, SLEW_TIME, RAMP_MIDDLE, RAMP_END = 40, 44, 48, 49, 50
# Rate at which the core follows the coil's temperature (1/s); friction at rest over that in motion less 1, one over
# the square of the velocity (m/s) over which it falls
CORE_RATE, STRIBECK_RISE, STRIBECK_FALL = (53 + 2 * N_EDDY + n for n in range(3))
# Iron in series: one over L_0 (1/H), current at low fields (A), its width (A), current over the cube (1/A2)
IRON_SCALE, IRON_LOW, IRON_WIDTH, IRON_KNEE = (56 + 2 * N_EDDY + n for n in range(4))
# Slew limit of the lag: one over what it moves by in a time constant at most (1/A, 1/V, 1/N); a step over the time
# constant; of the step with the jump, time before it until middle and end, over the time constant
SOFT, DECAY, PAST_MIDDLE, PAST_END = (60 + 2 * N_EDDY + n for n in range(4))
N_COEFFICIENT = 64 + 2 * N_EDDY
FASTEST_EDDY = 1.0  # steps: faster modes of the eddy currents are taken to answer at once


def kernel_coefficients(
    plant: PlantParameters, effects: Array, *, inductance: float, step: float, n_step: int
) -> Array:
    """The coefficients (N_COEFFICIENT,) of a plant with effects, for n_step steps of `step` seconds a sample.

    Parameters
    ----------
    effects : (N_PARAMETER,) of the catalogue
    inductance : of a side at the nominal gap without current, H; any number without magnets

    Raises
    ------
    InputError : a command delayed by more than `N_QUEUE` samples
    """
    v = {key: float(effects[n]) for key, n in POSITION.items()}
    e = np.zeros(N_COEFFICIENT)
    _magnets(e, plant, v, inductance)
    _eddy_currents(e, v, inductance, step)
    _mechanics(e, plant, v, step)
    _drive(e, plant, v, step, n_step)
    e[SENSOR_BANDWIDTH] = _slower(plant.sensor_bandwidth, pole_and_delay(v, "position_sensor_lag")[0])
    return e


def _magnets(e: Array, plant: PlantParameters, v: dict[tuple[str, str], float], inductance: float) -> None:
    offset, centring = v["gap_offset", "offset"], v["gap_offset", "centring"]
    e[GAP_1], e[GAP_2] = plant.nominal_gap + offset + centring, plant.nominal_gap + offset - centring
    sooner, turns = 1.0 + v["early_saturation", "knee_shift"], 1.0 + v["fringing", "turns_error"]
    e[CURRENT_SCALE] = sooner * turns
    e[DEPTH] = (1.0 + v["fringing", "depth_error"]) / sooner**2
    e[GROWTH] = v["fringing", "growth"] / sooner**2
    e[TILT] = math.sqrt(1.8 * v["armature_tilt", "gap_variance"])  # sqrt(3/5) of half the span, which is sqrt(3 v)
    e[IRON_SCALE] = 1.0 / inductance
    e[IRON_LOW], e[IRON_WIDTH] = v["early_saturation", "low_field_current"], v["early_saturation", "low_field_width"]
    e[IRON_KNEE] = v["early_saturation", "knee_excess"]
    e[SHARE] = v["cross_coupling", "share"] if plant.sides == 2 else 0.0
    e[UNMIX] = 1.0 / (1.0 - e[SHARE] ** 2)
    widest = inductance * v["magnetic_hysteresis", "reversal_current"]
    e[HYSTERESIS_WIDTH] = widest / N_STOP
    e[HYSTERESIS_SLOPE] = v["magnetic_hysteresis", "coercive_current"] / (_widths() * e[HYSTERESIS_WIDTH])
    e[HEAT_PER_JOULE], e[COOLING] = v["coil_heating", "rise_per_joule"], v["coil_heating", "cooling_rate"]
    e[HEAT_START] = v["coil_heating", "initial_rise"]
    e[CORE_RATE] = v["coil_heating", "core_rate"]


def _eddy_currents(e: Array, v: dict[tuple[str, str], float], inductance: float, step: float) -> None:
    """Sheets of diffusion time T and low-frequency conductance G: a magnetising current (3 G/T) (q coth q - 1) Lambda,
    q^2 = s T, is taken as the sum over k of (G w_k/T) s/(s + p_k/T) Lambda, and the rest of G at once: within 0.5 % up
    to s T = 10^4. Modes that are faster than the step answer at once."""
    conductance, diffusion = v["eddy_currents", "time_constant"] / inductance, v["eddy_currents", "diffusion_time"]
    at_once = 1.0
    for k, (pole, weight) in enumerate(zip(EDDY_POLES, EDDY_WEIGHTS, strict=True)):
        if conductance and diffusion > FASTEST_EDDY * step * pole:
            e[EDDY_MODE + k], e[EDDY_RATE + k] = weight * conductance / diffusion, pole / diffusion
            at_once -= weight / pole
    e[EDDY] = conductance * at_once


def _mechanics(e: Array, plant: PlantParameters, v: dict[tuple[str, str], float], step: float) -> None:
    e[QUADRATIC], e[CUBIC] = v["stiffness_nonlinearity", "quadratic"], v["stiffness_nonlinearity", "cubic"]
    e[FRICTION_WIDTH] = v["coulomb_friction", "presliding"] / N_STOP
    e[FRICTION_SLOPE] = v["coulomb_friction", "force"] / (_widths() * e[FRICTION_WIDTH])
    e[STRIBECK_RISE] = v["coulomb_friction", "stribeck_rise"]
    e[STRIBECK_FALL] = 1.0 / v["coulomb_friction", "stribeck_velocity"] ** 2
    e[FILM], e[FILM_GAP] = v["squeeze_film", "damping"], plant.nominal_gap
    share, natural = v["structural_mode", "mass_share"], 2 * math.pi * v["structural_mode", "frequency"]
    e[MODE_KEPT], e[MODE_RATIO] = 1.0 - share, share / (1.0 - share)
    if share or v["structural_mode", "load_reading"]:  # what is not there stands still, whatever the step
        e[MODE_STIFFNESS], e[MODE_DAMPING] = natural**2, 2 * v["structural_mode", "damping_ratio"] * natural
    e[MODE_MASS] = share * plant.mass if share else 0.0  # not 0 times the infinite mass of a locked mover
    e[MODE_READING] = v["structural_mode", "load_reading"]
    e[CREEP_STIFFNESS] = v["flexure_relaxation", "strength"] * plant.stiffness
    e[CREEP_RATE] = 1.0 / v["flexure_relaxation", "time_constant"] if v["flexure_relaxation", "strength"] else 0.0
    base = 2 * math.pi * v["support_compliance", "frequency"]
    e[COMPLIANCE] = v["support_compliance", "compliance"]
    e[BASE_INERTIA] = e[COMPLIANCE] / base**2
    if e[COMPLIANCE]:
        e[BASE_STIFFNESS], e[BASE_DAMPING] = base**2, 2 * v["support_compliance", "damping_ratio"] * base
    e[FORCE] = v["force_offset", "force"]
    e[FORCE_COSINE] = v["periodic_disturbance", "force_cosine"]
    e[FORCE_SINE] = v["periodic_disturbance", "force_sine"]
    half_turn = math.pi * v["periodic_disturbance", "frequency"] * step
    e[TURN_COSINE], e[TURN_SINE] = math.cos(half_turn), math.sin(half_turn)


def _drive(e: Array, plant: PlantParameters, v: dict[tuple[str, str], float], step: float, n_step: int) -> None:
    e[BANDWIDTH] = plant.bandwidth * (1.0 + v["amplifier_bandwidth", "bandwidth_error"])
    lag, delay = pole_and_delay(v, "amplifier_bandwidth")
    delay += v["time_delay", "command"]
    late = delay / step
    whole = math.floor(late / n_step)
    if whole >= N_QUEUE:
        raise InputError(
            f"time_delay.command: {delay:g} s are {late / n_step:.3g} samples, the coupled model "
            f"delays a command by less than {N_QUEUE}; sample more slowly"
        )
    e[DELAY_SAMPLES], rest = whole, max(late - whole * n_step, 0.0)
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
    z = e[BANDWIDTH] * step
    if math.isfinite(z):
        half, whole_step = math.exp(-0.5 * z), math.exp(-z)
        e[RAMP_MIDDLE] = -1.0 / z + (0.5 + 1.0 / z) * half
        e[RAMP_END] = 0.5 - 1.0 / z + (0.5 + 1.0 / z) * whole_step


def drive_lags(plant: PlantParameters) -> bool:
    """Whether the currents cannot jump: not so in an ideal current drive."""
    return plant.drive != CURRENT_DRIVE or math.isfinite(plant.bandwidth)


def fall_stages(share: float, decay: float) -> tuple[float, float, float, float]:
    """Values (begin, middle, end of a step) that stand for a signal, and its value at the end of the step.

    The signal f is 1 until `share` of the step has passed and then falls like exp(-decay s), s in steps. Runge-Kutta
    sees three values b, m, e, and would miss a jump or a fast fall between them. These are chosen so that its answer
    of a first-order equation, whose terms of order 0, 1, 2 in the step are (b + 4 m + e)/6, (b + 2 m)/6, (b + m)/12,
    has the exact ones: the integrals of f, (1 - s) f and (1 - s)^2 f / 2. What is left is of third order.
    """
    rest = 1.0 - share
    z = decay * rest if rest > 0 else 0.0
    parts = [rest ** (j + 1) * m for j, m in enumerate(_moments(z))]
    m0, m1, m2 = (
        share ** (k + 1) / (k + 1) + sum(math.comb(k, j) * share ** (k - j) * parts[j] for j in range(k + 1))
        for k in range(3)
    )
    last = math.exp(-z) if rest > 0 else 1.0
    return 6 * (m0 - 3 * m1 + 2 * m2), 6 * (m1 - m2), 6 * (2 * m2 - m1), last


def _moments(z: float) -> list[float]:
    """int_0^1 exp(-z s) s^j ds for j = 0, 1, 2, by its series below z = 2 and by parts above, where that is stable."""
    if z > 2.0:
        found = [-math.expm1(-z) / z]
        for j in (1, 2):
            found.append((j * found[-1] - math.exp(-z)) / z)
        return found
    return [sum((-z) ** n / (math.factorial(n) * (n + j + 1)) for n in range(24)) for j in range(3)]


def _slower(bandwidth: float, lag: float) -> float:
    """The bandwidth of a first-order part whose time constant grows by `lag`."""
    if math.isinf(bandwidth):
        return 1.0 / lag if lag > 0 else math.inf
    return bandwidth / (1.0 + bandwidth * lag)


def _widths() -> int:
    """Sum of the stops' widths in units of the first."""
    return N_STOP * (N_STOP + 1) // 2
