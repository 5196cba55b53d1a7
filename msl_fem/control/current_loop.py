"""The current loop around a voltage drive as an object: bandwidth from delay and voltage limit, lag as measured."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.actuator.current_loop import CurrentLoop
from msl_fem.computing.arrays import Array
from msl_fem.computing.compiled import compiled
from msl_fem.computing.whole_multiples import whole_multiple
from msl_fem.control.current_step import (
    ACTING,
    N_STATE,
    CurrentLoopParameters,
    current_step,
    side_linkage,
)
from msl_fem.control.inverse import Inverse, believed_gap
from msl_fem.control.power_stage import PowerStage, bridge_voltage, converted
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.instruments import current_reading
from msl_fem.plant.plant import PlantParameters

LEAST_RATE = 2e4
"""Hz: above what is heard; the default rate is the least multiple of the controller's from here on."""
RATE_OVER_BANDWIDTH = 10.0
"""At least (Harnefors, Nee, IEEE Trans. Industry Applications 34, 1998, sec. III: sampling ten times the bandwidth)."""
AMPLIFIER_OVER_BANDWIDTH = 5.0  # of a lag that the amplifier states for its voltage, which the loop does not know
STEP_SHARE = 0.02  # of the current limit: a step that does not meet the voltage limit
BANDWIDTH_OVER_CORNER = 20.0
"""At least, of a flux observer: the pole of the loop stands apart from those of the observer."""
KNOWN_STRAY = frozenset({"leakage_inductance.share_1", "leakage_inductance.share_2", "mutual_inductance.share"})
"""Parameters of effects that the loop's flux linkage takes."""
FORGET = 0.1
_SMALL = 0.5  # of the step, of the sines that measure the lag
_MEASURED_AT = (0.02, 0.05, 0.1)  # Hz over the bandwidth
_PERIODS, _SUBSTEPS = 4, 4


@dataclass(frozen=True, eq=False)
class CurrentLoopDesign:
    """A current loop, and what it promises.

    Attributes
    ----------
    parameters, stage : what the compiled functions take
    bandwidth : Hz, of the pole of the flux linkage
    limited_by : "delay", "voltage limit", "amplifier" or "wish"
    step : A, of a side, that does not meet the voltage limit in the middle
    inductance : H, incremental, of a side in the middle without current
    lag : s, measured: from the wanted to the true current, by sines on the believed coil, dead time and converters in
    """

    parameters: CurrentLoopParameters
    stage: PowerStage
    bandwidth: float
    limited_by: str
    step: float
    inductance: float
    lag: float

    @property
    def rate(self) -> float:
        """Hz."""
        return 1.0 / self.parameters.period

    @property
    def promised_lag(self) -> float:
        """s, in closed form, of a true model: one period to compute, half a pulse, and the pole's."""
        a = self.parameters.pole
        return (1.5 + a / (1.0 - a)) * self.parameters.period

    @property
    def dead_time(self) -> float:
        """s of the lag that are a pure delay, the rest being of first order.

        Mean and variance of the response to a pulse are then those of the loop: a/(1 - a)^2 periods squared by the
        pole, 1/12 by the voltage that is held over a period.
        """
        a = self.parameters.pole
        spread = math.sqrt(a / (1.0 - a) ** 2 + 1.0 / 12.0)
        return max(0.0, self.promised_lag - spread * self.parameters.period)

    @property
    def step_voltage(self) -> float:
        """V, the first of a step in the middle."""
        return _step_voltage(self.parameters.pole, self.inductance * self.step / self.parameters.period)

    def to_json(self) -> dict[str, Any]:
        """The JSON object `current_loop`."""
        return {
            "rate_Hz": self.rate,
            "bandwidth_Hz": self.bandwidth,
            "limited_by": self.limited_by,
            "lag_s": self.lag,
            "lag_in_closed_form_s": self.promised_lag,
            "step_A": self.step,
            "step_voltage_V": self.step_voltage,
            "inductance_H": self.inductance,
            "ripple_A": 2 * self.stage.ripple,
            "dead_time_voltage_V": self.stage.dead_time_voltage,
            "current_step_A": self.stage.current_step,
            "voltage_step_V": self.parameters.voltage_step,
            "flux_observed": self.parameters.trust < 1.0,
        }


def with_current_loop(actuator: Actuator, bandwidth: float) -> Actuator:
    """The actuator whose current loop around its voltage drive has a wished bandwidth (Hz).

    Raises
    ------
    InputError : a drive that is no voltage drive
    """
    drive = actuator.drive
    if drive is None or drive.kind != "voltage":
        kind = "missing" if drive is None else f"'{drive.kind}'"
        raise InputError(
            f"{actuator.name}: drive.kind is {kind}, and a current loop is about a voltage amplifier; "
            "state drive.bandwidth in the actuator file instead"
        )
    wished = (drive.current_loop or CurrentLoop()).model_copy(update={"bandwidth": bandwidth})
    return actuator.model_copy(update={"drive": drive.model_copy(update={"current_loop": wished})})


def designed_current_loop(
    actuator: Actuator, inverse: Inverse, coupled: PlantParameters, effects: EffectValues | None = None
) -> CurrentLoopDesign | None:
    """The current loop around a voltage drive, by its section or the section's defaults; None around other drives.

    Leakage and mutual inductance are taken from `effects`.

    Raises
    ------
    InputError : no voltage limit; a rate that is no multiple of the controller's; a bandwidth beyond what delay or
        voltage limit allow
    """
    drive = actuator.drive
    if drive is None or drive.kind != "voltage" or actuator.controller is None:
        return None
    asked = drive.current_loop or CurrentLoop()
    if not math.isfinite(coupled.voltage_limit):
        raise InputError(f"{actuator.name}: drive.voltage_limit is missing; the current loop around a voltage needs it")
    periods = _periods(actuator, asked)
    period = 1.0 / (actuator.controller.rate * periods)
    leakage, mutual = _stray(inverse, effects)
    none = CurrentLoopParameters(
        inverse, *leakage, mutual, coupled.resistance, period, 0.0, FORGET, coupled.voltage_limit, 0.0
    )
    inductance = side_linkage(none, 0, 0.0, 0.0, believed_gap(inverse, 0, 0.0))[1]
    largest = inverse.current_limit / inverse.current_share
    step = asked.step or STEP_SHARE * largest
    bandwidth, limited_by = _bandwidth(actuator, asked, none, inductance * step / period)
    pulse = 2 * coupled.voltage_limit / asked.pulse_steps if asked.pulse_steps else 0.0
    parameters = none._replace(pole=math.exp(-2 * math.pi * bandwidth * period), voltage_step=pulse)
    stage = PowerStage(
        dead_time_voltage=2 * asked.dead_time / period * coupled.voltage_limit,
        ripple=_ripple(coupled.voltage_limit, inductance, period),
        current_step=2 * largest / 2**asked.converter_bits if asked.converter_bits else 0.0,
        current_end=largest,
        periods=periods,
    )
    lag = measured_lag(parameters, stage, bandwidth=bandwidth, amplitude=_SMALL * step)
    lag += 0.0 if math.isinf(coupled.bandwidth) else 1.0 / coupled.bandwidth
    parameters = _observing(actuator, asked, parameters, stage, bandwidth)
    return CurrentLoopDesign(parameters, stage, bandwidth, limited_by, step, inductance, lag)


def _observing(
    actuator: Actuator, asked: CurrentLoop, parameters: CurrentLoopParameters, stage: PowerStage, bandwidth: float
) -> CurrentLoopParameters:
    """The loop with its flux observer, both poles at the corner with a damping of 1/sqrt(2); as it is without one."""
    corner = asked.flux_corner
    if corner is None:
        return parameters
    most = bandwidth / BANDWIDTH_OVER_CORNER
    if not 0 < corner <= most:
        raise InputError(
            f"{actuator.name}: drive.current_loop.flux_corner {format_quantity(corner, 'Hz')} must be above 0 and at "
            f"most {format_quantity(float(f'{most:.3g}'), 'Hz')}, a twentieth of the loop's bandwidth; state 10 Hz"
        )
    turn = 2 * math.pi * corner * parameters.period
    return parameters._replace(
        trust=-math.expm1(-math.sqrt(2.0) * turn), forget=turn**2, lost=stage.dead_time_voltage, ripple=stage.ripple
    )


def _periods(actuator: Actuator, asked: CurrentLoop) -> int:
    """Periods of the loop in one of the controller."""
    assert actuator.controller is not None
    outer = actuator.controller.rate
    if asked.rate is None:
        return max(1, math.ceil(LEAST_RATE / outer - 1e-9))
    periods = whole_multiple(asked.rate, outer)
    if periods is None:
        raise InputError(
            f"{actuator.name}: drive.current_loop.rate {format_quantity(asked.rate, 'Hz')} is no whole multiple of "
            f"controller.rate {format_quantity(outer, 'Hz')}; state one, like "
            f"{format_quantity(outer * max(1, math.ceil(LEAST_RATE / outer)), 'Hz')}"
        )
    return periods


def _bandwidth(
    actuator: Actuator, asked: CurrentLoop, loop: CurrentLoopParameters, at_once: float
) -> tuple[float, str]:
    """(Hz, what limits it); `at_once` is the voltage of the step within one period, V."""
    bounds = {"delay": 1.0 / (RATE_OVER_BANDWIDTH * loop.period), "voltage limit": math.inf}
    if at_once > loop.voltage_limit:
        bounds["voltage limit"] = -math.log(1.0 - loop.voltage_limit / at_once) / (2 * math.pi * loop.period)
    drive = actuator.drive
    assert drive is not None
    if drive.bandwidth is not None:
        bounds["amplifier"] = drive.bandwidth / AMPLIFIER_OVER_BANDWIDTH
    limited_by = min(bounds, key=lambda name: bounds[name])
    most, wish = bounds[limited_by], asked.bandwidth
    if wish is None:
        return most, limited_by
    if wish <= most * (1 + 1e-9):
        return wish, "wish"
    reason = {
        "delay": f"at {format_quantity(1.0 / loop.period, 'Hz')} with one period of delay",
        "voltage limit": (
            f"for its step, which takes {_step_voltage(math.exp(-2 * math.pi * wish * loop.period), at_once):.4g} V "
            f"where the drive has {loop.voltage_limit:g} V"
        ),
        "amplifier": f"with an amplifier of {format_quantity(drive.bandwidth or 0.0, 'Hz')}",
    }[limited_by]
    raise InputError(
        f"{actuator.name}: drive.current_loop.bandwidth {format_quantity(wish, 'Hz')} is not to be had {reason}; wish "
        f"for at most {format_quantity(float(f'{most:.3g}'), 'Hz')}, or leave it out"
    )


def _step_voltage(pole: float, at_once: float) -> float:
    return (1.0 - pole) * at_once


def _ripple(supply: float, inductance: float, period: float) -> float:
    """A, half of the largest ripple from peak to peak: a full bridge switched between both polarities, V T/(2 L) at a
    mean of nothing (Mohan, Undeland, Robbins, Power Electronics, 3rd ed., sec. 7-7-1)."""
    return supply * period / (4.0 * inductance)


def _stray(inverse: Inverse, effects: EffectValues | None) -> tuple[tuple[float, float], float]:
    """((leakage of both sides), mutual inductance), H, of a belief."""
    if effects is None:
        return (0.0, 0.0), 0.0
    bare = CurrentLoopParameters(inverse, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0)
    of_side = side_linkage(bare, 0, 0.0, 0.0, believed_gap(inverse, 0, 0.0))[1]
    leakage = effects.stated.get("leakage_inductance", {})
    mutual = effects.stated.get("mutual_inductance", {})
    of_two = mutual.get("share", 0.0) if inverse.sides > 1 else 0.0
    return (of_side * leakage.get("share_1", 0.0), of_side * leakage.get("share_2", 0.0)), of_side * of_two


def measured_lag(
    parameters: CurrentLoopParameters,
    stage: PowerStage,
    *,
    bandwidth: float,
    amplitude: float,
    bias: float | None = None,
) -> float:
    """s from the wanted to the true current of side 1, the mover held in the middle: mean over sines.

    Dead time and converters are in, noise is not. `bias` in A is that of the sines; three times their amplitude
    without it.
    """
    middle = 3 * amplitude if bias is None else bias
    late = []
    for share in _MEASURED_AT:
        n = round(1.0 / (share * bandwidth * parameters.period))
        k = np.arange(_PERIODS * n)
        wanted = middle + amplitude * np.sin(2 * np.pi * k / n)
        found = held_coil(parameters, stage, wanted)
        turn = np.exp(-2j * np.pi * k[-2 * n :] / n)
        answer = np.sum(found[-2 * n :] * turn) / np.sum(wanted[-2 * n :] * turn)
        late.append(-np.angle(answer) / (2 * np.pi) * n - 0.5)  # the wanted current is held over its period
    return float(np.mean(late) * parameters.period)


@compiled
def held_coil(parameters: CurrentLoopParameters, stage: PowerStage, wanted: Array) -> Array:
    """(n,) A of side 1 at the samples of the current loop, the mover held in the middle, from its first wanted current.

    The circuit d lambda/dt = v - R i is integrated by Runge and Kutta's method on the believed flux linkage.
    """
    p = parameters
    gap = believed_gap(p.inverse, 0, 0.0)
    state, read, asked, given = np.zeros(N_STATE), np.zeros(2), np.zeros(2), np.zeros(2)
    found = np.empty(wanted.size)
    current, h = wanted[0], p.period / _SUBSTEPS
    state[ACTING] = p.resistance * current
    for k in range(wanted.size):
        found[k] = current
        voltage = bridge_voltage(stage, state[ACTING], current)
        read[0], asked[0] = converted(stage, current), wanted[k]
        current_step(p, state, asked, read, 0.0, 0.0, given)
        for _ in range(_SUBSTEPS):
            a = (voltage - p.resistance * current) / side_linkage(p, 0, current, 0.0, gap)[1]
            i = current + 0.5 * h * a
            b = (voltage - p.resistance * i) / side_linkage(p, 0, i, 0.0, gap)[1]
            i = current + 0.5 * h * b
            c = (voltage - p.resistance * i) / side_linkage(p, 0, i, 0.0, gap)[1]
            i = current + h * c
            d = (voltage - p.resistance * i) / side_linkage(p, 0, i, 0.0, gap)[1]
            current += h * (a + 2 * b + 2 * c + d) / 6.0
    return found


def current_noise(
    design: CurrentLoopDesign, actuator: Actuator, n: int, *, generator: np.random.Generator | None
) -> Array:
    """(n, periods, 2) A of noise in the current readings of n samples of the controller."""
    return current_reading(actuator, np.zeros((n, design.stage.periods, 2)), generator=generator)
