"""The current that a magnet's winding bears: an allowed rise, a duty cycle, and the limit over the gap as a curve."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError, MaterialError
from msl_fem.losses.section_loss import IronLossModel, sine_operation
from msl_fem.losses.thermal_network import (
    Cooling,
    Cycle,
    Heating,
    ThermalNetwork,
    peak_rise,
    runaway_current,
    thermal_network,
)
from msl_fem.materials.constants import COLDEST, HOTTEST, REFERENCE_TEMPERATURE, resistance_ratio
from msl_fem.table.magnetic_table import MagneticTable

CLASS_130_RISE = 80.0
"""K: rise of a winding's mean temperature, by resistance, of insulation class 130 (B), IEC 60034-1, table 8."""
TOLERANCE = 1e-5  # of a current


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
            f"{limit.temperature_rise:g} K; lower the frequency, cool better or allow more"
        )
    loss = left / network.resistance
    resistance = heating.resistance * resistance_ratio(limit.hottest)
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

    from scipy.optimize import brentq

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


@dataclass(frozen=True, eq=False)
class ThermalCurve:
    """The RMS current that the winding bears at each gap.

    Attributes
    ----------
    gap : (n_gap,) m
    continuous, on_phase : (n_gap,) A, without pause and for the duty of each period; nan where the iron loss is not
        known at the current that the copper alone would bear
    copper_only : the limit without iron loss
    frequency : Hz of the sinusoidal current whose iron loss is in it, None without
    notes : what the figures rest on
    """

    gap: Array
    continuous: Array
    on_phase: Array
    copper_only: ContinuousCurrent
    frequency: float | None
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The map's fields: continuous_current_A, duty_current_A (null where not known) and thermal."""

        def or_null(values: Array) -> list[float | None]:
            return [None if math.isnan(v) else v for v in values.tolist()]

        thermal = self.copper_only.to_json() | {"frequency_Hz": self.frequency, "notes": list(self.notes)}
        return {
            "continuous_current_A": or_null(self.continuous),
            "duty_current_A": or_null(self.on_phase),
            "thermal": thermal,
        }


def thermal_curve(actuator: Actuator, gap: ArrayLike, limit: ThermalLimit) -> ThermalCurve:
    """The limit of the copper loss alone in A, the same at every gap (n_gap,) in m; raises as `continuous_current`."""
    gaps = np.array(gap, dtype=float)
    bearable = continuous_current(actuator, limit)
    same = np.ones_like(gaps)
    return ThermalCurve(
        gaps, bearable.continuous * same, bearable.on_phase * same, bearable, frequency=None, notes=bearable.notes
    )


def thermal_curve_with_iron(
    actuator: Actuator, gap: ArrayLike, limit: ThermalLimit, *, table: MagneticTable, frequency: float
) -> ThermalCurve:
    """The limit for a sinusoidal current of a frequency in Hz about zero, with its own iron loss in the core.

    At each gap the RMS current i for which copper and iron, the latter at the peak sqrt(2) i, reach the allowed
    temperature, by bisection: more current, more of either loss.

    Raises
    ------
    MaterialError : the losses of an iron of the core are not known
    ActuatorError, InputError, OutOfTable, TableError : as `continuous_current` and `iron_loss`
    """
    gaps = np.array(gap, dtype=float)
    copper_only = continuous_current(actuator, limit)
    model = IronLossModel(table, actuator)
    reasons = {sheet.reason for name, sheet in model.sheets.items() if name != "armature" and sheet.reason}
    if reasons:
        raise MaterialError("; ".join(sorted(reasons)))
    notes = [note for note in copper_only.notes if note != "iron loss is left out"]
    notes.append(f"iron loss of a sine of {frequency:g} Hz about zero in the core, the armature's left out")
    heating = Heating(actuator.coil_resistance(), limit.ambient)
    heat = _Heat(model, heating, limit, copper_only.network, frequency)
    for g in gaps:
        model.loss(sine_operation(0.0, g, frequency=frequency, amplitude=0.0))  # what is wrong with the request, if so
    continuous = np.array([heat.bearable(g, Cycle(), copper_only.continuous) for g in gaps])
    on_phase = continuous
    if limit.cycle.duty < 1:
        on_phase = np.array([heat.bearable(g, limit.cycle, copper_only.on_phase) for g in gaps])
    if np.isnan(continuous).any() or np.isnan(on_phase).any():
        notes.append("null: there the iron loss is not known up to the limit (the table or the measured losses end)")
    return ThermalCurve(gaps, continuous, on_phase, copper_only, frequency, tuple(notes))


@dataclass(frozen=True, eq=False)
class _Heat:
    """Copper and iron of a magnet with a sinusoidal current."""

    model: IronLossModel
    heating: Heating
    limit: ThermalLimit
    network: ThermalNetwork
    frequency: float

    def bearable(self, gap: float, cycle: Cycle, high: float) -> float:
        """The largest RMS current up to `high`, A; nan where it lies beyond where the iron loss is known."""
        verdict = self._bears(gap, cycle, high)
        if verdict:
            return high
        low = 0.0
        known = verdict is not None
        while high - low > TOLERANCE * high:
            middle = (low + high) / 2
            verdict = self._bears(gap, cycle, middle)
            if verdict:
                low = middle
            else:
                high = middle
                known = verdict is not None
        return low if known else math.nan

    def _bears(self, gap: float, cycle: Cycle, current: float) -> bool | None:
        """Whether the winding stays below its limit; None where the iron loss is not known."""
        try:
            wave = sine_operation(0.0, gap, frequency=self.frequency, amplitude=math.sqrt(2) * current)
            loss = self.model.loss(wave).core_loss
        except InputError:  # outside the table or the measured losses
            return None
        heating = replace(self.heating, core_loss=loss or 0.0)
        return peak_rise(self.network, heating, current, cycle=cycle) <= self.limit.temperature_rise
