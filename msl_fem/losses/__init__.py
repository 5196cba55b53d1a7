"""Where a magnet heats and how hot it gets: wire and windings, copper and iron losses, the thermal limit."""

from msl_fem.losses.ac_resistance import (
    NEGLIGIBLE,
    SlotRows,
    negligible_below,
    resistance_factor,
    skin_depth,
    slot_rows,
)
from msl_fem.losses.bertotti import EXCESS_OF_SINE, LossDensity, eddy_coefficient, loss_density, sinusoidal_loss
from msl_fem.losses.flux_waveform import FluxWaveform, closed_loops
from msl_fem.losses.operation import (
    IronLoss,
    IronLossModel,
    PeriodicOperation,
    SectionLoss,
    iron_loss,
    mean_period,
    sine_operation,
)
from msl_fem.losses.round_wire import Grade, RoundWire, Series, gauge_diameter, gauge_wire, metric_wire, wires
from msl_fem.losses.section_flux import SectionFlux, iron_names, iron_volumes
from msl_fem.losses.thermal_curve import ThermalCurve, thermal_curve, thermal_curve_with_iron
from msl_fem.losses.thermal_limit import CLASS_130_RISE, ContinuousCurrent, ThermalLimit, continuous_current
from msl_fem.losses.thermal_network import Cooling, ThermalNetwork, core_surface, end_turn_surface, thermal_network
from msl_fem.losses.winding import Layers, Packing, Winding, WireChoice, choose_wire, fitting_layers, wind
from msl_fem.losses.winding_temperature import Cycle, Heating, ThermalRunaway, peak_rise, runaway_current, steady_rise

__all__ = [
    "CLASS_130_RISE",
    "EXCESS_OF_SINE",
    "NEGLIGIBLE",
    "ContinuousCurrent",
    "Cooling",
    "Cycle",
    "FluxWaveform",
    "Grade",
    "Heating",
    "IronLoss",
    "IronLossModel",
    "Layers",
    "LossDensity",
    "Packing",
    "PeriodicOperation",
    "RoundWire",
    "SectionFlux",
    "SectionLoss",
    "Series",
    "SlotRows",
    "ThermalCurve",
    "ThermalLimit",
    "ThermalNetwork",
    "ThermalRunaway",
    "Winding",
    "WireChoice",
    "choose_wire",
    "closed_loops",
    "continuous_current",
    "core_surface",
    "eddy_coefficient",
    "end_turn_surface",
    "fitting_layers",
    "gauge_diameter",
    "gauge_wire",
    "iron_loss",
    "iron_names",
    "iron_volumes",
    "loss_density",
    "mean_period",
    "metric_wire",
    "negligible_below",
    "peak_rise",
    "resistance_factor",
    "runaway_current",
    "sine_operation",
    "sinusoidal_loss",
    "skin_depth",
    "slot_rows",
    "steady_rise",
    "thermal_curve",
    "thermal_curve_with_iron",
    "thermal_network",
    "wind",
    "wires",
]
