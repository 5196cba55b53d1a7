"""The thermal limit over the gap: a further curve of the operating map."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError, MaterialError
from msl_fem.losses.operation import IronLossModel, sine_operation
from msl_fem.losses.thermal_limit import ContinuousCurrent, ThermalLimit, continuous_current
from msl_fem.losses.thermal_network import ThermalNetwork
from msl_fem.losses.winding_temperature import Cycle, Heating, peak_rise
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]
TOLERANCE = 1e-5  # of a current


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
    gaps, found = np.array(gap, dtype=float), continuous_current(actuator, limit)
    same = np.ones_like(gaps)
    return ThermalCurve(gaps, found.continuous * same, found.on_phase * same, found, None, found.notes)


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
    gaps, copper_only = np.array(gap, dtype=float), continuous_current(actuator, limit)
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
        low, known = 0.0, verdict is not None
        while high - low > TOLERANCE * high:
            middle = (low + high) / 2
            verdict = self._bears(gap, cycle, middle)
            if verdict:
                low = middle
            else:
                high, known = middle, verdict is not None
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
