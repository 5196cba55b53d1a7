"""How commands run a sweep: accuracy, processes, progress, the default table of an actuator."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, cast

from msl_fem.actuator import Actuator, TableMagnet
from msl_fem.cli.output import progress_bar, say
from msl_fem.errors import InputError
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.origin import doubt_about_table
from msl_fem.table.pair_table import load_table

if TYPE_CHECKING:  # who is given a table does not wait for a mesher
    from msl_fem.magnetics.field.accuracy import Accuracy


def checked_accuracy(text: str) -> "Accuracy":
    """The accuracy level of that name; InputError otherwise."""
    from msl_fem.magnetics.field.accuracy import LEVELS

    if text not in LEVELS:
        raise InputError(f"accuracy '{text}' is unknown; choose one of {', '.join(LEVELS)}")
    return cast("Accuracy", text)


def checked_end_effects(text: str | None, known: tuple[str, ...] = ("none", "section")) -> bool | None:
    """Whether end effects of that name are wanted; None where none is given, so that the actuator's file decides.

    Raises
    ------
    InputError : a command does not know them
    """
    if text is None:
        return None
    if text not in known:
        raise InputError(f"--end-effects {text} is not known here; choose one of {', '.join(known)}")
    return text != "none"


def default_workers() -> int:
    """One process a core that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def table_of_model(actuator: Actuator, otherwise: MagneticTable | None) -> MagneticTable | None:
    """The table that an extended model names; of one that names none, the table of the plain actuator."""
    if isinstance(actuator.magnet, TableMagnet):
        return load_table(actuator.folder / actuator.magnet.table)
    return otherwise


def _say_doubt(actuator: Actuator, table: MagneticTable, file: Path) -> None:
    doubt = doubt_about_table(actuator, table)
    if doubt is not None:
        say(f"note: {file}: {doubt}; make one with 'msl-fem table'")


def table_for(actuator: Actuator, given: Path | None) -> MagneticTable | None:
    """The table given, that the actuator names, or a computed one; None for a rig without magnets."""
    if actuator.magnet is None:
        return None
    if given is not None:
        table = load_table(given)
        made_for = table.provenance.get("actuator")
        if isinstance(made_for, str) and made_for not in ("", actuator.name):
            say(f"note: {given} was made for {made_for[:80]!r}, and is taken here for {actuator.name!r}")
        _say_doubt(actuator, table, given)
        return table
    if isinstance(actuator.magnet, TableMagnet):
        return load_table(actuator.folder / actuator.magnet.table)
    from msl_fem.magnetics.sweep.table_sweep import SweepSettings, default_grid, sweep

    say("no --table given: computing the default one ('msl-fem table' keeps it)")
    with progress_bar("field solutions, rows") as progress:
        settings = SweepSettings(workers=default_workers())
        return sweep(actuator, *default_grid(actuator), settings=settings, progress=progress)[0]
