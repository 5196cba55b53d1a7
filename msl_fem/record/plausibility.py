"""Whether a run's numbers are a machine's: beyond any sensor is refused, a sensor against its command is doubted."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import CHANNELS, UNITS, Channel, Quantity, place
from msl_fem.record.record import Run

LARGEST: dict[Quantity, float] = {
    "position": 100.0, "reference": 100.0, "force": 1e9, "temperature": 1e4, "voltage": 1e7, "current": 1e6,
    "command": 1e6, "flux_linkage": 1e6,
}  # fmt: skip
"""In SI units: more than any machine of this kind has, whatever it is."""
STATIC: dict[str, Quantity] = {
    "gap_m": "position", "current_A": "current", "force_N": "force", "flux_linkage_Wb": "flux_linkage",
}  # fmt: skip
"""Columns of a static map and what they are."""
ASKED = 0.2
"""Share of the command that a dead sensor misses at least, in the mean."""
APART = 20.0
"""Factor by which a current that follows its command is never larger or smaller; a wrong unit is 1000."""


def refuse_impossible(columns: Mapping[str, Array], *, file: Path | str) -> None:
    """RecordError naming the first sample, of a run or a static map, beyond what any machine shows."""
    for name, values in columns.items():
        quantity = CHANNELS[name].quantity if name in CHANNELS else STATIC.get(name)
        if quantity not in LARGEST:
            continue
        most, unit = LARGEST[quantity], UNITS[quantity]
        beyond = np.flatnonzero(np.abs(values) > most)
        if beyond.size:
            at = int(beyond[0])
            raise RecordError(
                f"{place(file, at)}, column {name}: {values[at]:g} {unit} is more than any machine shows, {most:g} "
                f"{unit}; look at the unit of this column"
            )


def doubtful_against_command(run: Run, *, file: Path | str) -> list[str]:
    """One warning for each current that stands still where another one is asked, or is of another size than asked."""
    warnings = []
    for side in (1, 2):
        current = run.columns.get(Channel("current", side).column)
        command = run.columns.get(Channel("command", side).column)
        if current is None or command is None or current.size == 0:
            continue
        asked, there = (float(np.sqrt(np.mean(v**2))) for v in (command, current))
        missed = float(np.mean(np.abs(command - current)))
        name = Channel("current", side).column
        if np.ptp(current) == 0 and missed > ASKED * asked > 0:
            warnings.append(
                f"{file}: {name} stands at {current[0]:g} A throughout while {asked:.3g} A are commanded; is the "
                "sensor connected?"
            )
        elif asked > 0 and there > 0 and not 1 / APART < there / asked < APART:
            warnings.append(
                f"{file}: {name} is {there:.3g} A (RMS) while {asked:.3g} A are commanded; is one of them in another "
                "unit?"
            )
    return warnings
