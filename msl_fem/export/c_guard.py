"""The guard as one C99 header, equal to the compiled Python to the last bit."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.export.c_printer import Printer, header_style
from msl_fem.export.c_text import c_header, c_prefix, write_header
from msl_fem.export.c_types import REAL, WHOLE
from msl_fem.maps import Guard, OperatingMap
from msl_fem.maps.guard import REASONS, GuardArrays, limit_at, margin_of, reason_of, region_of

Array = NDArray[np.float64]
_NAMES = ("BELOW_FIRST", "BETWEEN", "ABOVE_LAST", "BEYOND_MAP", "GAP_OUTSIDE", "GAP_NAN", "CURRENT_NAN")
_MOST_NODES_CHECKED = 12


def guard_header(operating_map: OperatingMap, *, name: str | None = None) -> str:
    """The text of the header: tables, functions, provenance, and judgements to check a compiler and a machine by.

    Raises
    ------
    InputError : a `name` that cannot begin C names, or a map that no guard can be made of
    """
    m, guard = operating_map, Guard(operating_map)
    current, gap = guard_check_points(guard)
    check = {
        "current": current,
        "gap": gap,
        "limit": guard.limit(gap),
        "margin": guard.margin(current, gap),
        "reason": guard.reasons(current, gap),
    }
    provenance = {
        "actuator": m.actuator or "not known",
        "digest": m.digest or "not known",
        "levels": m.levels.tolist(),
        "criterion": m.criterion,
        "warnings": m.warnings,
    }
    content = {**provenance, **guard.arrays._asdict(), "reasons": tuple(zip(_NAMES, REASONS, strict=True))}
    prefix = c_prefix(m.actuator, name)
    printed = _functions(guard.arrays, prefix)
    return c_header("guard.h.j2", prefix, content | {"check": check, "printed": printed})


def _functions(arrays: GuardArrays, prefix: str) -> str:
    """What judges, as C."""
    printer = Printer(header_style(f"{prefix}_guard_", exact=prefix, arrays=guard_names(arrays, prefix)))
    at = {"current": REAL, "gap": REAL}
    printer.add(limit_at, {"guard": arrays, "level": WHOLE, "gap": REAL})
    for function in (region_of, margin_of, reason_of):
        printer.add(function, {"guard": arrays} | at)
    return printer.definitions


def guard_names(arrays: GuardArrays, prefix: str) -> tuple[tuple[int, str], ...]:
    """Identity of each of the guard's arrays, and its name in the header."""
    return tuple((id(getattr(arrays, n)), f"{prefix}_guard_{n}_") for n in ("gap", "limit", "slope", "start"))


def write(operating_map: OperatingMap, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The header written. Raises InputError as `guard_header`, or where the folder cannot be written."""
    return write_header(guard_header(operating_map, name=name), target)


def guard_check_points(guard: Guard) -> tuple[Array, Array]:
    """(current, gap) (n,) where an implementation goes wrong first.

    On the nodes, next to them, between them; on the limits and next to them; beyond the map by the last bit and by far;
    zeros of both signs, the smallest numbers, infinities and what is not a number.
    """
    nodes = guard.arrays.gap
    some = nodes[np.unique(np.linspace(0, nodes.size - 1, _MOST_NODES_CHECKED).astype(int))]
    between = some[:-1] + np.array([0.1, 0.5, 0.9])[:, None] * np.diff(some)
    beside = np.r_[np.nextafter(some, 0), some, np.nextafter(some, np.inf)]
    tiny = np.finfo(float).smallest_subnormal
    odd = np.array([0.0, -0.0, tiny, -tiny, -some[0], 1e300, -np.inf, np.inf, np.nan])
    pairs: list[tuple[float, float]] = []
    for gap in np.r_[between.ravel(), beside]:
        limits = guard.limit(gap)
        sizes = np.r_[limits, np.nextafter(limits, np.inf)]
        sizes = sizes[np.isfinite(sizes)] if np.isfinite(sizes).any() else np.array([0.0])
        pairs += [(s if n % 2 else -s, gap) for n, s in enumerate(sizes)]
    middle, end = float(between[1, 0]), guard.arrays.current_max
    pairs += [(current, middle) for current in (*odd, end, -end, np.nextafter(end, np.inf))]
    pairs += [(current, gap) for gap in odd for current in (0.0, np.nan)]
    found = np.array(pairs)
    return found[:, 0].copy(), found[:, 1].copy()
