"""The thermal limit of a magnet: where its heat goes, its temperature over a duty cycle, the current it bears."""

from msl_fem.thermal.curve import ThermalCurve, thermal_curve, thermal_curve_with_iron
from msl_fem.thermal.limit import CLASS_130_RISE, ContinuousCurrent, ThermalLimit, continuous_current
from msl_fem.thermal.network import Cooling, ThermalNetwork, core_surface, end_turn_surface, thermal_network
from msl_fem.thermal.temperature import Cycle, Heating, ThermalRunaway, peak_rise, runaway_current, steady_rise

__all__ = [
    "CLASS_130_RISE",
    "ContinuousCurrent",
    "Cooling",
    "Cycle",
    "Heating",
    "ThermalCurve",
    "ThermalLimit",
    "ThermalNetwork",
    "ThermalRunaway",
    "continuous_current",
    "core_surface",
    "end_turn_surface",
    "peak_rise",
    "runaway_current",
    "steady_rise",
    "thermal_curve",
    "thermal_curve_with_iron",
    "thermal_network",
]
