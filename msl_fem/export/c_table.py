"""A table as one C99 header: the coenergy surface and its derivatives, equal to the compiled Python to the last bit."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.export.c_printer import Printer, header_style
from msl_fem.export.c_text import c_header, c_prefix, write_header
from msl_fem.export.c_types import REAL, Pointer
from msl_fem.table.coenergy_surface import STATES, CoenergySurface, evaluate, evaluate_slopes
from msl_fem.table.magnetic_table import INTERPOLANT, MagneticTable

Array = NDArray[np.float64]
_MOST_NODES_CHECKED = 4


def table_header(table: MagneticTable, *, name: str | None = None) -> str:
    """The text of the header: nodes, coefficients, functions, provenance, and values to check a machine by.

    Raises
    ------
    InputError : a `name` that cannot begin C names
    """
    surface, provenance = table.surface, dict(table.provenance)
    current, gap = table_check_points(table)
    content = {
        "actuator": provenance.get("actuator") or "not known",
        "digest": provenance.get("actuator_sha256") or "not known",
        "interpolant": INTERPOLANT,
        "errors": {
            "mesh error": table.mesh_error,
            "interpolation error": table.interpolation_error,
            "reciprocity error": table.reciprocity_error,
        },
        "gap": surface.gap,
        "current": surface.current,
        "coefficients": surface.coefficients,
        "printed": table_functions(surface, c_prefix(str(provenance.get("actuator", "")), name)),
        "check": {"current": current, "gap": gap, "values": surface(current, gap).T},
    }
    return c_header("table.h.j2", c_prefix(str(provenance.get("actuator", "")), name), content)


def table_functions(surface: CoenergySurface, prefix: str) -> str:
    """The surface's evaluation as C, for arrays of its shape."""
    printer = Printer(header_style(f"{prefix}_table_", exact=prefix))
    nodes = {"gap": surface.gap, "current": surface.current, "coefficients": surface.coefficients}
    arrays = {key: Pointer(np.shape(values), fixed=True) for key, values in nodes.items()}
    printer.add(evaluate_slopes, arrays | {"i": REAL, "g": REAL})
    printer.add(evaluate, arrays | {"i": REAL, "g": REAL, "out": Pointer((STATES,))})
    return f"{printer.declarations}\n{printer.definitions}"


def write(table: MagneticTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The header written. Raises InputError as `table_header`, or where the folder cannot be written."""
    return write_header(table_header(table, name=name), target)


def table_check_points(table: MagneticTable) -> tuple[Array, Array]:
    """(current, gap) (n,) on nodes, between them, at the edges of the rectangle, just outside, and no numbers."""
    found = []
    for nodes in (table.current, table.gap):
        some = nodes[np.unique(np.linspace(0, nodes.size - 1, _MOST_NODES_CHECKED).astype(int))]
        found.append(np.r_[some, 0.5 * (some[:-1] + some[1:]), np.nextafter(some[-1], np.inf), np.nan])
    current, gap = np.meshgrid(found[0] * (-1.0) ** np.arange(found[0].size), found[1])
    return current.ravel(), gap.ravel()
