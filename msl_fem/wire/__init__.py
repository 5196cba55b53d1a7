"""Enamelled wire: sizes and gauges, layer windings that fit a window, resistance to direct and alternating current."""

from msl_fem.wire.alternating import NEGLIGIBLE, SlotRows, negligible_below, resistance_factor, skin_depth, slot_rows
from msl_fem.wire.round_wire import Grade, RoundWire, Series, gauge_diameter, gauge_wire, metric_wire, wires
from msl_fem.wire.winding import Layers, Packing, Winding, WireChoice, choose_wire, fitting_layers, wind

__all__ = [
    "NEGLIGIBLE",
    "Grade",
    "Layers",
    "Packing",
    "RoundWire",
    "Series",
    "SlotRows",
    "Winding",
    "WireChoice",
    "choose_wire",
    "fitting_layers",
    "gauge_diameter",
    "gauge_wire",
    "metric_wire",
    "negligible_below",
    "resistance_factor",
    "skin_depth",
    "slot_rows",
    "wind",
    "wires",
]
