"""The guard of a pair as one C99 header, printed from the compiled Python, equal to it to the last bit."""

import re
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.export.c_printer import Printer
from msl_fem.export.c_text import c_header, c_prefix, write_header
from msl_fem.export.c_types import REAL, WHOLE, Pointer, RecordType
from msl_fem.maps.pair_guard import PairGuard, pair_limit_at, pair_region_of
from msl_fem.maps.pair_limits import PairMap

N_CHECK = 60
_PRIVATE = re.compile(
    r"\b(?=(?:printed|coenergy_surface|pair_guard)_\w|PairGuardArrays\b|(?:PREFERRED|DISCOURAGED|UNACCEPTABLE)\b)"
)
"""Names that get the header's prefix, so that two headers go into one program."""


def pair_guard_header(record: PairMap, *, name: str | None = None) -> str:
    """The text of the header: tables, functions, provenance, and judgements to check a compiler and a machine by.

    Raises
    ------
    InputError : a `name` that cannot begin C names
    """
    guard = PairGuard(record)
    arrays = guard.arrays
    numbers = [(name, REAL) for name in arrays._fields[:-1]]
    fields = (*numbers, ("limit", Pointer(arrays.limit.shape, fixed=True)))
    kind, printer = RecordType("PairGuardArrays", fields), Printer()
    printer.record(kind)
    where = {"current_1": REAL, "current_2": REAL, "position": REAL}
    printer.add(pair_region_of, {"guard": kind} | where)
    at = {"relation": WHOLE, "level": WHOLE, "position": REAL, "other": REAL}
    printer.add(pair_limit_at, {"guard": kind} | at)
    prefix = c_prefix(record.actuator, name)
    source = _PRIVATE.sub(f"{prefix}_", f"{printer.declarations}\n{printer.definitions}")
    one, two, position = pair_check_points(guard)
    content = {
        "actuator": record.actuator or "not known",
        "digest": record.digest or "not known",
        "levels": record.levels.tolist(),
        "polarity": record.polarity,
        "numbers": arrays[:-1],
        "limit": arrays.limit,
        "ends": (arrays.position_end, arrays.other_end),
        "source": source,
        "check": {"one": one, "two": two, "position": position, "region": guard.regions(one, two, position)},
    }
    return c_header("pair_guard.h.j2", prefix, content)


def write(record: PairMap, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The header written. Raises InputError as `pair_guard_header`, or where the folder cannot be written."""
    return write_header(pair_guard_header(record, name=name), target)


def pair_check_points(guard: PairGuard) -> tuple[Array, Array, Array]:
    """(current_1, current_2, position), (n,) each, where an implementation goes wrong first.

    On nodes, at limits and next to them, of both relations; beyond the map; infinite, and not a number.
    """
    rng = np.random.default_rng(17)
    nodes, other = guard.pair_map.position, guard.pair_map.other
    points: list[tuple[float, float, float]] = []
    for n in range(N_CHECK):
        x = float(rng.choice(nodes) if n % 3 else rng.uniform(nodes[0], nodes[-1]))
        j = float(rng.choice(other) if n % 2 else rng.uniform(0, other[-1]) ** 2 / other[-1])
        relation = int(rng.integers(2))
        limit = float(pair_limit_at(guard.arrays, relation, int(rng.integers(guard.pair_map.levels.size)), x, j))
        sign = 1.0 if relation else -1.0
        points += [(i, sign * j, x) for i in (limit, float(np.nextafter(limit, np.inf)), -limit)]
    end, reach = guard.pair_map.current_max, float(nodes[-1])
    odd = [0.0, -0.0, end, -end, float(np.nextafter(end, np.inf)), np.inf, -np.inf, np.nan, 5e-324]
    points += [(i, 0.0, 0.0) for i in odd] + [(0.0, i, reach) for i in odd]
    points += [(0.0, 0.0, x) for x in (reach, -reach, float(np.nextafter(reach, 1)), np.inf, np.nan)]
    found = np.array(points)
    return found[:, 0].copy(), found[:, 1].copy(), found[:, 2].copy()
