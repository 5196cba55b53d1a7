"""The map of a pair to walk about in: position and both currents in the page, region, force and flux computed there.

The page carries the derivatives of the table's surface at its nodes and the guard's limits as doubles: what it shows is
what `table.pair_table` and `maps.pair_guard` say, to rounding.
"""

import json
from typing import Any

from msl_fem.maps.guard import REGIONS
from msl_fem.maps.pair_guard import PairGuard
from msl_fem.maps.pair_limits import RELATIONS, PairMap
from msl_fem.report.explorer import doubles_text, quantities_data, stated_errors, surface_data
from msl_fem.report.figures import REGION_FILL, figure
from msl_fem.report.page import Widget, html_from, page_part, script_text
from msl_fem.table.pair_table import PairTable

QUANTITIES = (
    ("coenergy", "coenergy", "mJ", 1e3),
    ("flux_linkage_1", "flux linkage of side 1", "mWb", 1e3),
    ("flux_linkage_2", "flux linkage of side 2", "mWb", 1e3),
    ("force", "force towards side 1", "N", 1.0),
    ("incremental_inductance_1", "incremental inductance of side 1", "mH", 1e3),
    ("incremental_inductance_2", "incremental inductance of side 2", "mH", 1e3),
    ("mutual_inductance", "mutual inductance", "mH", 1e3),
    ("force_current_slope_1", "dF/di of side 1", "N/A", 1.0),
    ("force_current_slope_2", "dF/di of side 2", "N/A", 1.0),
    ("force_position_slope", "dF/dx", "N/mm", 1e-3),
)
"""Name, label, unit and values of that unit in an SI unit, in the order of `pair_table.PAIR_NODES`."""
_FIRST_SHOWN = "force"


def pair_explorer(table: PairTable, pair_map: PairMap) -> Widget:
    """The widget that shows the table and the map of a pair at any position and currents."""
    shown = sorted(QUANTITIES, key=lambda quantity: quantity[0] != _FIRST_SHOWN)
    html = html_from(
        "pair_explorer.html.j2",
        quantities=shown,
        levels=pair_map.levels.tolist(),
        says=_what_it_says(table),
        data=script_text(json.dumps(_data(table, pair_map))),
    )
    return Widget(html, page_part("explorer_parts.js") + page_part("pair_explorer.js"))


def _data(table: PairTable, pair_map: PairMap) -> dict[str, Any]:
    """All that the script needs; arrays as little-endian doubles in base64."""
    lines, surface = PairGuard(pair_map).arrays, table.difference
    guard = {name: getattr(lines, name) for name in lines._fields if name != "limit"}
    guard["limit"] = [[[doubles_text(row) for row in rows] for rows in levels] for levels in lines.limit]
    relation = 1.0 if pair_map.polarity == RELATIONS[1] else -1.0
    start = float(f"{0.9 * pair_map.equal_currents()[RELATIONS.index(pair_map.polarity), 0]:.3g}")
    return {
        "one_sided": surface_data(table.one_sided),
        "gap_sum": table.gap_sum,
        "position": doubles_text(surface.position),
        "current_1": doubles_text(surface.current_1),
        "current_2": doubles_text(surface.current_2),
        "hermite": doubles_text(surface.hermite),
        "guard": guard,
        "quantities": quantities_data(QUANTITIES, table),
        "levels": pair_map.levels.tolist(),
        "regions": list(REGIONS),
        "fills": [REGION_FILL[name] for name in REGIONS],
        "relations": list(RELATIONS),
        "start": {"position": 0.0, "first": start, "second": relation * start},
        "look": json.loads(figure(x="", y="").to_json())["layout"],
    }


def _what_it_says(table: PairTable) -> str:
    return (
        "Currents and force are those of one magnet a side; equal signs of the currents aid, different signs oppose. "
        "Numbers come from the table's coenergy, evaluated in this page; limits are the guard's, which lie a little "
        "below the curves." + stated_errors(table)
    )
