"""The table of a pair as C99: what both sides have in common by its nodes, expanded and evaluated to the same bits."""

from pathlib import Path
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.computing.quintic_cell import AT_NODE, N_CELL, expand_all
from msl_fem.export.c_printer import Printer, header_style
from msl_fem.export.c_table import table_header
from msl_fem.export.c_text import c_header, c_prefix, write_header
from msl_fem.export.c_types import REAL, Pointer
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_surface import DERIVATIVES, PairSurface, evaluate_pair
from msl_fem.table.pair_table import PairTable

_CHECKED = 4  # places along each axis
_NODES = ("position", "current_1", "current_2", "hermite")


def pair_table_header(table: PairTable, *, name: str | None = None) -> str:
    """The text of the header: one magnet's table, what both have in common, and values to check a machine by.

    Raises
    ------
    InputError : a `name` that cannot begin C names
    """
    provenance = dict(table.provenance)
    prefix = c_prefix(str(provenance.get("actuator", "")), name)
    surface = table.shared.surface
    printer = Printer(header_style(f"{prefix}_shared_", exact=prefix))
    scratch = {"cell": (N_CELL,), "across": (3, 36), "along": (6, 6), "out": (len(DERIVATIVES),)}
    rows = {key: Pointer(shape) for key, shape in scratch.items()}
    printer.add(evaluate_pair, _arrays(surface) | dict.fromkeys("xij", REAL) | rows)
    points = pair_table_check_points(table)
    content = _nodes(surface, printer) | {
        "actuator": provenance.get("actuator") or "not known",
        "digest": provenance.get("actuator_sha256") or "not known",
        "gap_sum": table.gap_sum,
        "errors": {
            "mesh error": table.mesh_error,
            "interpolation error": table.interpolation_error,
            "reciprocity error": table.reciprocity_error,
        },
        "one_sided": table_header(table.one_sided, name=prefix),
        "n_cell": N_CELL,
        "check": {"points": points, "values": _values(table, points)},
    }
    return c_header("pair_table.h.j2", prefix, content)


def shared_header(table: MagneticTable, *, name: str) -> str:
    """The text of a header with what two sides have in common, and a function that expands all its cells."""
    assert table.shared is not None
    surface = table.shared.surface
    printer = Printer(header_style(f"{name}_shared_", exact=name))
    cells = tuple(nodes.size - 1 for nodes in (surface.position, surface.current_1, surface.current_2))
    arrays = dict(zip(("first", "second", "third", "nodes"), _arrays(surface).values(), strict=True))
    printer.add(expand_all, arrays | {"cells": Pointer((int(np.prod(cells)), N_CELL))})
    return c_header("shared_table.h.j2", name, _nodes(surface, printer))


def _arrays(surface: PairSurface) -> dict[str, Pointer]:
    return {key: Pointer(np.shape(getattr(surface, key)), fixed=True) for key in _NODES}


def _nodes(surface: PairSurface, printer: Printer) -> dict[str, Any]:
    """What `shared_table.h.j2` takes."""
    return {
        "position": surface.position,
        "current_1": surface.current_1,
        "current_2": surface.current_2,
        "nodes": surface.hermite,
        "at_node": AT_NODE,
        "printed": f"{printer.declarations}\n{printer.definitions}",
    }


def write(table: PairTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The header written. Raises InputError as `pair_table_header`, or where the folder cannot be written."""
    return write_header(pair_table_header(table, name=name), target)


def pair_table_check_points(table: PairTable) -> Array:
    """(n, 3) positions and currents: on nodes, between them, at the edges of the block, just outside, no numbers."""
    found = []
    for nodes in table.axes:
        some = nodes[np.unique(np.linspace(0, nodes.size - 1, _CHECKED).astype(int))]
        found.append(np.r_[some, 0.5 * (some[:-1] + some[1:]), np.nextafter(some[-1], np.inf), np.nan])
    return np.stack(np.meshgrid(*found, indexing="ij"), axis=-1).reshape(-1, 3)


def _values(table: PairTable, points: Array) -> Array:
    """(n, 10) the table's quantities in their order; nan outside."""
    values = np.full((len(points), len(DERIVATIVES)), np.nan)
    within = [(column >= axis[0]) & (column <= axis[-1]) for column, axis in zip(points.T, table.axes, strict=True)]
    inside = np.all(within, axis=0)
    values[inside] = np.stack(list(table.evaluate(*points[inside].T).values()), axis=-1)
    return values
