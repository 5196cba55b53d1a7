"""Copper loss of a magnet's coil at a temperature, for direct and for periodic current."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.losses.wire import Winding, resistance_factor, slot_rows
from msl_fem.materials.constants import REFERENCE_TEMPERATURE, resistance_ratio


@dataclass(frozen=True)
class CopperLoss:
    """The copper loss of one magnet's coil.

    Attributes
    ----------
    current_rms : A
    temperature : of the winding, K
    resistance : ohm to direct current at this temperature
    loss : W
    alternating_share : part of the loss that skin and proximity effect add; 0 where they were not asked for
    """

    current_rms: float
    temperature: float
    resistance: float
    loss: float
    alternating_share: float = 0.0


def copper_loss(actuator: Actuator, current_rms: float, *, temperature: float = REFERENCE_TEMPERATURE) -> CopperLoss:
    """i^2 R of one magnet's coil at a temperature in K; the actuator's resistance is that at 20 degC.

    Raises
    ------
    InputError : a negative current or one that is no number, a temperature outside copper's range
    ActuatorError : no coil resistance is stated and the magnet's dimensions are not known
    """
    if not (np.isfinite(current_rms) and current_rms >= 0):
        raise InputError(f"an RMS current of {current_rms:g} A is not allowed; it must be 0 or more")
    resistance = actuator.coil_resistance() * resistance_ratio(temperature)
    return CopperLoss(float(current_rms), temperature, resistance, float(current_rms) ** 2 * resistance)


def copper_loss_of_period(
    actuator: Actuator,
    current: ArrayLike,
    *,
    frequency: float,
    winding: Winding,
    temperature: float = REFERENCE_TEMPERATURE,
) -> CopperLoss:
    """The copper loss of a periodic current with skin and proximity effect: each harmonic has its own resistance.

    Parameters
    ----------
    current : (n_sample,) A, one period in equal steps, the end not repeated
    frequency : of the period in Hz
    winding : the wire and its layers; only the ratio R_ac/R_dc is taken from it

    Raises
    ------
    InputError, ActuatorError : as `copper_loss`
    """
    i = np.asarray(current, dtype=float)
    if i.ndim != 1 or i.size < 2 or not np.isfinite(i).all():
        raise InputError(f"the current's period must be one row of finite numbers, this one has the shape {i.shape}")
    direct = copper_loss(actuator, float(np.sqrt(np.mean(i**2))), temperature=temperature)
    power = np.abs(np.fft.rfft(i) / i.size) ** 2 * 2  # squares of RMS values
    power[0] /= 2
    if i.size % 2 == 0:
        power[-1] /= 2
    rows = slot_rows(winding, actuator.magnet_kind("skin and proximity effect"))
    factor = resistance_factor(rows, frequency * np.arange(power.size), temperature=temperature)
    loss = direct.resistance * float(np.sum(power * factor))
    share = 1 - direct.loss / loss if loss > 0 else 0.0
    return CopperLoss(direct.current_rms, temperature, direct.resistance, loss, share)
