"""The operating map to walk about in: current and gap in the page, region, force and flux computed there.

The page carries the coefficients of the table's own coenergy surface and the guard's lines as doubles, and evaluates
both by the formulas of `msl_fem.table.coenergy_surface` and `msl_fem.maps.guard`: what it shows is what table and
guard say, to rounding.
"""

import base64
import json
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.maps import Guard, OperatingMap
from msl_fem.maps.guard import REASONS, REGIONS
from msl_fem.report.figures import operating_regions
from msl_fem.report.page import Widget, html_from, page_part, script_text
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import PairTable

QUANTITIES = (
    ("coenergy", "coenergy", "mJ", 1e3),
    ("flux_linkage", "flux linkage", "mWb", 1e3),
    ("force", "force of one magnet", "N", 1.0),
    ("incremental_inductance", "incremental inductance", "mH", 1e3),
    ("force_current_slope", "dF/di", "N/A", 1.0),
    ("force_gap_slope", "dF/dg", "N/mm", 1e-3),
)
"""Name, label, unit and values of that unit in an SI unit, in the order of the surface's values."""
_SHOWN = ("force", "flux_linkage", "incremental_inductance", "coenergy", "force_current_slope", "force_gap_slope")


def explorer(
    table: MagneticTable, operating_map: OperatingMap, *, start: tuple[float, float], magnets: int = 1
) -> Widget:
    """The widget that shows a table and its map at any current and gap.

    Parameters
    ----------
    start : (current in A, gap in m) to begin with, inside the table
    magnets : magnets a side, whose forces add
    """
    by_name = {quantity[0]: quantity for quantity in QUANTITIES}
    html = html_from(
        "explorer.html.j2",
        quantities=[by_name[name] for name in _SHOWN],
        levels=operating_map.levels.tolist(),
        magnets=magnets,
        says=_what_it_says(table),
        data=script_text(json.dumps(_data(table, operating_map, start=start, magnets=magnets))),
    )
    return Widget(html, page_part("explorer_parts.js") + page_part("explorer.js"))


def _data(table: MagneticTable, made: OperatingMap, *, start: tuple[float, float], magnets: int) -> dict[str, Any]:
    """All that the script needs; arrays as little-endian doubles in base64."""
    lines = Guard(made).arrays
    figure = operating_regions(made)
    return {
        **surface_data(table),
        "guard": {
            "gap": doubles_text(lines.gap),
            "limit": [doubles_text(row) for row in lines.limit],
            "slope": [doubles_text(row) for row in lines.slope],
            "current_max": lines.current_max,
        },
        "quantities": quantities_data(QUANTITIES, table),
        "reached": (~np.isnan(made.current)).tolist(),
        "levels": made.levels.tolist(),
        "regions": list(REGIONS),
        "reasons": list(REASONS),
        "magnets": magnets,
        "start": {"current": float(f"{start[0]:.3g}"), "gap": float(f"{start[1]:.3g}")},
        "map": json.loads(figure.to_json()),
    }


def quantities_data(
    quantities: Iterable[tuple[str, str, str, float]], table: MagneticTable | PairTable
) -> list[dict[str, str | float]]:
    """What the page has to know of quantities (name, label, unit, values of that unit in an SI unit) of a table."""
    return [
        {"name": n, "label": label, "unit": unit, "scale": s, "largest": float(np.abs(table.nodes[n]).max())}
        for n, label, unit, s in quantities
    ]


def surface_data(table: MagneticTable) -> dict[str, str]:
    """The coenergy surface of one magnet, for the page."""
    surface = table.surface
    return {name: doubles_text(getattr(surface, name)) for name in ("gap", "current", "coefficients")}


def _what_it_says(table: MagneticTable) -> str:
    return (
        "Force, flux linkage and slopes come from the table's coenergy surface, evaluated in this page with the "
        "table's coefficients. Limits are the guard's straight lines, which lie a little below the curves."
        + stated_errors(table)
    )


def stated_errors(table: MagneticTable | PairTable) -> str:
    """A sentence with the errors that a table states, after a space; '' where it states none."""
    errors = [
        f"{name} {100 * value:.2g} %"
        for name, value in (("mesh error", table.mesh_error), ("interpolation error", table.interpolation_error))
        if np.isfinite(value)
    ]
    return f" The table's own errors, of its largest force: {', '.join(errors)}." if errors else ""


def doubles_text(values: ArrayLike) -> str:
    """An array as little-endian doubles in base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f8").tobytes()).decode()
