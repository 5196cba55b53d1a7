"""Temperatures of a network whose winding's resistance grows with its temperature: steady, and over a duty cycle."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from msl_fem.errors import ComputationError, InputError
from msl_fem.losses.thermal_network import ThermalNetwork
from msl_fem.materials.constants import REFERENCE_TEMPERATURE, TEMPERATURE_COEFFICIENT

Array = NDArray[np.float64]
SMALLEST_DUTY = 1e-4


class ThermalRunaway(ComputationError):  # noqa: N818 - reads as the sentence it stands for
    """No finite temperature balances the loss, which grows with it."""


@dataclass(frozen=True)
class Heating:
    """What heats a network.

    Attributes
    ----------
    resistance : of the winding in ohm at 20 degC
    ambient : K
    core_loss : W in the last node while the current flows
    """

    resistance: float
    ambient: float = REFERENCE_TEMPERATURE
    core_loss: float = 0.0

    @property
    def ambient_resistance(self) -> float:
        """ohm with the winding at ambient temperature."""
        return self.resistance * (1 + TEMPERATURE_COEFFICIENT * (self.ambient - REFERENCE_TEMPERATURE))


@dataclass(frozen=True)
class Cycle:
    """Current for `duty` of each period in s, none for the rest; a period of None is short against everything."""

    duty: float = 1.0
    period: float | None = None

    def __post_init__(self) -> None:
        if not SMALLEST_DUTY <= self.duty <= 1:
            raise InputError(f"a duty of {self.duty:g} is not allowed; it must be {SMALLEST_DUTY:g} ... 1")
        if self.period is not None and not 0 < self.period < math.inf:
            raise InputError(f"a period of {self.period:g} s is not allowed; it must be above 0, or left out")


def runaway_current(network: ThermalNetwork, heating: Heating) -> float:
    """The direct current in A from which on no finite temperature balances the loss.

    The loss grows by i^2 R_20 alpha a kelvin, the heat carried away by 1/R_th: beyond i = 1/sqrt(R_20 alpha R_th).
    """
    return 1 / math.sqrt(heating.resistance * TEMPERATURE_COEFFICIENT * network.resistance)


def steady_rise(network: ThermalNetwork, heating: Heating, current_rms: float) -> Array:
    """(n_node,) K over ambient with a steady RMS current in A, the resistance being that at the winding's temperature.

    Raises
    ------
    ThermalRunaway : there is no finite equilibrium; the message says from which current on
    """
    limit = runaway_current(network, heating)
    if not current_rms < limit:
        raise ThermalRunaway(
            f"{current_rms:.4g} A heats the winding without end: its resistance grows with its temperature, and from "
            f"{limit:.4g} A on no temperature balances the loss; give a smaller current or a better cooling"
        )
    matrix, source = _matrix_and_source(network, heating, current_rms)
    return np.asarray(np.linalg.solve(matrix, source))


def _matrix_and_source(network: ThermalNetwork, heating: Heating, current: float) -> tuple[Array, Array]:
    """G with the resistance's growth taken off the winding, W/K, and the heat at zero rise, W."""
    matrix, source = network.conductance.copy(), np.zeros(network.capacity.size)
    matrix[0, 0] -= current**2 * heating.resistance * TEMPERATURE_COEFFICIENT
    source[0] = current**2 * heating.ambient_resistance
    source[-1] += heating.core_loss
    return matrix, source


def peak_rise(network: ThermalNetwork, heating: Heating, current: float, *, cycle: Cycle) -> float:
    """K over ambient that the winding reaches at the end of each on phase, once the cycle repeats; inf on runaway.

    current : A (RMS) while it flows

    Both phases are linear in the temperatures, dx/dt = C^-1 (s - M x), and solved exactly; the periodic state is the
    fixed point of their composition. A period of None: the mean loss at a steady temperature, current sqrt(duty).

    Raises
    ------
    InputError : a period with heat capacities that are not known
    """
    if cycle.period is None or cycle.duty == 1.0:
        mean = Heating(heating.resistance, heating.ambient, heating.core_loss * cycle.duty)
        try:
            return float(steady_rise(network, mean, current * math.sqrt(cycle.duty))[0])
        except ThermalRunaway:
            return math.inf
    if not np.isfinite(network.capacity).all():
        raise InputError(
            "the winding's heat capacity is not known, so a period cannot be judged; leave --period out, or describe "
            "the magnet as an E-core"
        )
    on = _transition(network, *_matrix_and_source(network, heating, current), cycle.duty * cycle.period)
    if on is None:
        return math.inf
    idle = Heating(heating.resistance, heating.ambient)
    off = _transition(network, *_matrix_and_source(network, idle, 0.0), (1 - cycle.duty) * cycle.period)
    assert off is not None  # without current nothing grows
    around = on @ off  # from the end of an on phase to the next one
    n = network.capacity.size
    if np.abs(np.linalg.eigvals(around[:n, :n])).max() >= 1:
        return math.inf
    return float(np.linalg.solve(np.eye(n) - around[:n, :n], around[:n, n])[0])


def _transition(network: ThermalNetwork, matrix: Array, source: Array, duration: float) -> Array | None:
    """(n_node + 1, n_node + 1): takes (rises, 1) at the beginning of a phase to those at its end; None beyond e^200."""
    n = source.size
    rates = np.zeros((n + 1, n + 1))
    rates[:n, :n] = -matrix / network.capacity[:, None]
    rates[:n, n] = source / network.capacity
    if float(np.linalg.eigvals(rates[:n, :n]).real.max()) * duration > 200:
        return None
    return np.asarray(expm(rates * duration))
