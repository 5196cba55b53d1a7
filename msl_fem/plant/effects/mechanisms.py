"""Mechanisms that several effects share: lags of several poles, stops with a memory, what stands for a fast fall."""

import math
from collections.abc import Mapping
from typing import Any

N_STOP = 6
"""Stops of friction, a Prandtl-Ishlinskii operator; their widths are 1, 2 ... 6 times the first."""
N_IRON_STOP = 32
"""Stops of iron: its branches bend so gently that with six of them a long record shows where each begins to slip."""
NEVER = 1e9
"""Of a current at which a shape has its effect, A: it is never reached."""
OVERSHOOT_POLE = 3.0
OVERSHOOT_ZERO = math.sqrt(10.0)
"""Of a drive that overshoots, in parts of its lag for each part of `delay_share` above 1; squares that differ by 1."""
SUM_OF_WIDTHS = N_STOP * (N_STOP + 1) // 2
"""Of the stops, in units of the first."""


def sensor_lag(values: Mapping[tuple[str, str], Any]) -> tuple[Any, Any]:
    """(time constant, delay) in s of a position sensor's lag by `delay_share`, numbers or arrays.

    One pole and a delay do what several poles do, up to the second order in frequency and, nearly, the third.
    """
    lag, share = values["position_sensor_lag", "lag"], values["position_sensor_lag", "delay_share"]
    return (1.0 - share) * lag, share * lag


def drive_lag(values: Mapping[tuple[str, str], float]) -> tuple[float, float, float]:
    """(time constant of a pole, of a zero, delay) in s of a drive's lag, by `delay_share`.

    Up to 1 a pole and a delay. Beyond, the drive overshoots, as of second order with a damping of
    1/sqrt(2 + 2 (delay_share - 1)^2): a zero as well, so that the lag and, to the second order in frequency, the gain
    are those of that drive.
    """
    lag, share = values["amplifier_bandwidth", "lag"], values["amplifier_bandwidth", "delay_share"]
    over = max(share - 1.0, 0.0)
    pole, zero = (max(1.0 - share, 0.0) + OVERSHOOT_POLE * over) * lag, OVERSHOOT_ZERO * over * lag
    return pole, zero, lag - pole + zero


def position_delay(values: Mapping[tuple[str, str], Any]) -> Any:
    """By how much the position is read late, in s, beside its sensor's pole."""
    return values["time_delay", "position"] + sensor_lag(values)[1]


def fall_stages(share: float, decay: float) -> tuple[float, float, float, float]:
    """Values (begin, middle, end of a step) that stand for a signal, and its value at the end of the step.

    The signal f is 1 until `share` of the step has passed and then falls like exp(-decay s), s in steps. Runge-Kutta
    sees three values b, m, e, and would miss a jump or a fast fall between them. These are chosen so that its answer
    of a first-order equation, whose terms of order 0, 1, 2 in the step are (b + 4 m + e)/6, (b + 2 m)/6, (b + m)/12,
    has the exact ones: the integrals of f, (1 - s) f and (1 - s)^2 f / 2. What is left is of third order.
    """
    rest = 1.0 - share
    z = decay * rest if rest > 0 else 0.0
    fall_0, fall_1, fall_2 = _moments(z)
    part_0, part_1, part_2 = rest * fall_0, rest * rest * fall_1, rest * rest * rest * fall_2
    m0 = share + part_0
    m1 = share * share / 2 + share * part_0 + part_1
    m2 = share * share * share / 3 + share * share * part_0 + 2 * share * part_1 + part_2
    last = math.exp(-z) if rest > 0 else 1.0
    return 6 * (m0 - 3 * m1 + 2 * m2), 6 * (m1 - m2), 6 * (2 * m2 - m1), last


def _moments(z: float) -> tuple[float, float, float]:
    """int_0^1 exp(-z s) s^j ds for j = 0, 1, 2, by its series below z = 2 and by parts above, where that is stable."""
    if z > 2.0:
        m0 = -math.expm1(-z) / z
        m1 = (m0 - math.exp(-z)) / z
        return m0, m1, (2 * m1 - math.exp(-z)) / z
    m0 = m1 = m2 = 0.0
    term = 1.0
    for n in range(24):
        m0, m1, m2 = m0 + term / (n + 1), m1 + term / (n + 2), m2 + term / (n + 3)
        term = -z * term / (n + 1)
    return m0, m1, m2
