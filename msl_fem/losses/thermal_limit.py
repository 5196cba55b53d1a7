"""The current that a magnet's winding bears: an allowed temperature rise, a duty cycle, the resistance growing."""

import math
from dataclasses import dataclass, field
from typing import Any

from scipy.optimize import brentq

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError
from msl_fem.losses.thermal_network import Cooling, ThermalNetwork, thermal_network
from msl_fem.losses.winding_temperature import Cycle, Heating, peak_rise, runaway_current
from msl_fem.materials.constants import COLDEST, HOTTEST, REFERENCE_TEMPERATURE, resistance_ratio

CLASS_130_RISE = 80.0
"""K: rise of a winding's mean temperature, by resistance, of insulation class 130 (B), IEC 60034-1, table 8."""


@dataclass(frozen=True)
class ThermalLimit:
    """What the winding is allowed, and how it is cooled and used.

    Attributes
    ----------
    temperature_rise : K of the winding's mean temperature over ambient
    ambient : K
    """

    temperature_rise: float = CLASS_130_RISE
    ambient: float = REFERENCE_TEMPERATURE
    cycle: Cycle = field(default_factory=Cycle)
    cooling: Cooling = field(default_factory=Cooling)

    def __post_init__(self) -> None:
        if not self.temperature_rise > 0 or not COLDEST <= self.ambient <= self.hottest <= HOTTEST:
            raise InputError(
                f"a rise of {self.temperature_rise:g} K from {self.ambient - 273.15:g} degC is not allowed; the rise "
                f"must be above 0 K, the ambient at least {COLDEST - 273.15:g} degC, both together at most "
                f"{HOTTEST - 273.15:g} degC"
            )

    @property
    def hottest(self) -> float:
        """K: the winding's allowed temperature."""
        return self.ambient + self.temperature_rise


@dataclass(frozen=True, eq=False)
class ContinuousCurrent:
    """The RMS currents of one magnet's coil at which its winding just reaches the allowed temperature.

    Attributes
    ----------
    continuous : A, flowing without pause
    on_phase : A, flowing for the duty of each period
    runaway : A from which on no temperature balances the loss, whatever is allowed
    resistance : ohm of the hot winding
    copper_loss : W at `continuous`
    network : where the heat goes
    notes : what the figures rest on
    """

    limit: ThermalLimit
    continuous: float
    on_phase: float
    runaway: float
    resistance: float
    copper_loss: float
    network: ThermalNetwork
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The JSON object; nan becomes null where it is printed."""
        taus = self.network.time_constants.tolist()
        return {
            "continuous_current_A": self.continuous,
            "duty_current_A": self.on_phase,
            "runaway_current_A": self.runaway,
            "temperature_rise_K": self.limit.temperature_rise,
            "ambient_K": self.limit.ambient,
            "duty": self.limit.cycle.duty,
            "period_s": self.limit.cycle.period,
            "hot_resistance_ohm": self.resistance,
            "copper_loss_W": self.copper_loss,
            "thermal_resistance_K_per_W": self.network.resistance,
            "time_constants_s": [None if math.isnan(tau) else tau for tau in taus],
            "notes": list(self.notes),
        }


def continuous_current(actuator: Actuator, limit: ThermalLimit, *, core_loss: float = 0.0) -> ContinuousCurrent:
    """The currents that a magnet's winding bears for ever and for the duty of each period.

    Parameters
    ----------
    core_loss : W of iron loss in the core while the current flows (`IronLoss.core_loss`)

    At the limit the winding's temperature, hence its resistance, is known, and with it the direct current: no
    iteration. That of a cycle is the root of `peak_rise`.

    Raises
    ------
    InputError : no E-core and no thermal resistance stated, a period without known heat capacities, or an iron loss
        that alone heats the winding beyond the limit
    ActuatorError : no coil resistance
    """
    if not (math.isfinite(core_loss) and core_loss >= 0):
        raise InputError(f"an iron loss of {core_loss:g} W is not allowed; it must be 0 or more")
    network = thermal_network(actuator, limit.cooling)
    heating = Heating(actuator.coil_resistance(), limit.ambient, core_loss)
    left = limit.temperature_rise - network.core_resistance * core_loss
    if left <= 0:
        rise = network.core_resistance * core_loss
        raise InputError(
            f"the iron loss of {core_loss:.3g} W alone heats the winding by {rise:.3g} K, allowed are "
            f"{limit.temperature_rise:g} K; "
            "lower the frequency, cool better or allow more"
        )
    loss, resistance = left / network.resistance, heating.resistance * resistance_ratio(limit.hottest)
    continuous = math.sqrt(loss / resistance)
    return ContinuousCurrent(
        limit=limit,
        continuous=continuous,
        on_phase=_on_phase_current(network, heating, limit, continuous),
        runaway=runaway_current(network, heating),
        resistance=resistance,
        copper_loss=loss,
        network=network,
        notes=(*network.notes, *_notes(actuator, limit, network, core_loss)),
    )


def _on_phase_current(network: ThermalNetwork, heating: Heating, limit: ThermalLimit, continuous: float) -> float:
    """A: between the continuous current and the one whose mean loss over the cycle is as large."""
    cycle = limit.cycle
    if cycle.duty == 1.0:
        return continuous

    def excess(current: float) -> float:
        rise = peak_rise(network, heating, current, cycle=cycle)
        return min(rise, 1e3 * limit.temperature_rise) - limit.temperature_rise

    high = continuous
    while excess(high) < 0:
        high *= 1.2
    return continuous if high == continuous else float(brentq(excess, continuous, high, xtol=1e-12, rtol=1e-12))


def _notes(actuator: Actuator, limit: ThermalLimit, network: ThermalNetwork, core_loss: float) -> tuple[str, ...]:
    notes = [
        f"winding's mean temperature at most {limit.hottest - 273.15:.4g} degC, its hot spot is warmer; copper with "
        f"{actuator.coil_resistance():.4g} ohm at 20 degC; RMS currents of one magnet's coil",
        f"iron loss in the core: {core_loss:.3g} W" if core_loss else "iron loss is left out",
    ]
    cycle = limit.cycle
    if cycle.duty < 1 and cycle.period is None:
        notes.append("duty: a period short against all time constants, so the RMS over the period counts")
    elif cycle.duty < 1:
        taus = ", ".join(f"{tau:.3g} s" for tau in network.time_constants)
        notes.append(f"duty: temperature at the end of each on phase; period {cycle.period:g} s, time constants {taus}")
    return tuple(notes)
