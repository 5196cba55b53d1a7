"""A short static map without held-out rows: each row is held out once, by leaving every fourth out in turn.

What the rows say is named only where every turn names it: a name that hangs on a few rows is missed in the turn that
lacks them (cross-validation: Stone, J. R. Stat. Soc. B 36, 1974, 111-147).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msl_fem.diagnosis.result import Diagnosis
from msl_fem.record import Record

TURNS = 4
FEWEST_IN_TURN = 8
"""Rows of a map, of which each turn fits three quarters."""
MOST_IN_TURN = 40
"""Rows above which a map is long enough for held-out rows of its own."""


def turns_of(record: Record) -> tuple[Record, ...]:
    """The record once for each turn; none where it has runs, held-out rows, or too few or too many rows."""
    static = record.static
    if record.runs or static is None or static.rows("held-out").size:
        return ()
    if not FEWEST_IN_TURN <= static.gap.size <= MOST_IN_TURN or np.ptp(np.abs(static.current)) == 0:
        return ()
    place = np.arange(static.gap.size) % TURNS
    roles = [np.where(place == turn, "held-out", "fit") for turn in range(TURNS)]
    return tuple(replace(record, static=replace(static, role=role)) for role in roles)


def agreed(turns: Sequence[Diagnosis]) -> Diagnosis:
    """The diagnosis of the turn that is least sure of its first name, where all name alike; else undecidable."""
    names = [turn.names for turn in turns]
    if len(set(names)) > 1:
        told = "; ".join(", ".join(name) or "nothing" for name in names)
        reason = f"held out in turn, the rows of the static map name different causes: {told}; measure more rows"
        return Diagnosis("undecidable", reason)
    doubtful = [turn for turn in turns if turn.verdict not in ("named", "nothing-found")]
    chosen = min(doubtful or turns, key=lambda turn: turn.causes[0].statistic if turn.causes else 0.0)
    note = f"no rows are held out: each was, in one of {TURNS} turns, and all turns name alike"
    return replace(chosen, notes=(*chosen.notes, note))
