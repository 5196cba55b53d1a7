"""What a diagnosis is worth to a loop: the loop of the belief on the same plants."""

from pathlib import Path

from msl_fem.cli.controller_maps import maps_for
from msl_fem.cli.controllers import DesignOptions
from msl_fem.cli.output import progress_bar, say
from msl_fem.cli.told import Told
from msl_fem.control import ControllerDesign, design_model_as_believed, designed
from msl_fem.control.improvement import Improvement
from msl_fem.control.unseen_plants import DrawPlant, UnseenPlants, on_unseen_plants
from msl_fem.errors import InputError
from msl_fem.plant.excitation import Reference
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import load_table


def design_of_belief(
    options: DesignOptions, told: Told, table: MagneticTable, *, own: bool, files: tuple[Path | None, Path | None]
) -> ControllerDesign | None:
    """The design with the same options of what was believed before the diagnosis; None, said on stderr, where that
    cannot be.

    Parameters
    ----------
    table : of the fitted magnets
    own : whether it is one that the diagnosis corrected, so that the believed one is that of `files`
    files : the table and the map that are given
    """
    table_file, map_file = files
    if own and table_file is None:
        say("note: the loop is not compared with that of the belief: its table is not known; give it with --table")
        return None
    actuator, effects = told.believed.actuator, told.believed.effects
    try:
        believed = load_table(table_file) if own and table_file is not None else table
        maps = maps_for(actuator, believed, map_file=map_file, table_file=table_file)
        stated = effects if effects.stated else None
        model = design_model_as_believed(actuator, believed, maps.one_side, stated, maps.pair)
        return designed(model, options.choice())
    except InputError as err:
        say(f"note: the loop is not compared with that of the belief, which cannot be designed: {err}")
        return None


def improvement_on(
    before: ControllerDesign | None, loop: UnseenPlants, reference: Reference, draw: DrawPlant
) -> Improvement | None:
    """The loop of the belief on the plants of another; None without it, or where it cannot follow the reference."""
    if before is None:
        return None
    try:
        with progress_bar("the belief's loop") as progress:
            others = on_unseen_plants(
                before, reference, draw, n=loop.error.size, suspects=loop.suspects, progress=progress
            )
    except InputError as err:
        say(f"note: the loop is not compared with that of the belief, which is not for this reference: {err}")
        return None
    return Improvement(loop, others)
