"""The maps that a controller's guard judges by: given in a file, or made of the table."""

from dataclasses import dataclass
from pathlib import Path

from msl_fem.actuator import Actuator, TableMagnet
from msl_fem.cli.given_map import given_map
from msl_fem.cli.output import say
from msl_fem.errors import InputError
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.maps.doubts import doubt_about_origin
from msl_fem.maps.pair_limits import PairMap, pair_map
from msl_fem.maps.pair_map_file import is_pair_map, read_pair_map
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import read_pair_table


@dataclass(frozen=True, eq=False)
class Maps:
    """What a controller's guard judges by.

    Attributes
    ----------
    one_side : of a magnet alone
    pair : of both sides together; None where each is judged by itself
    """

    one_side: OperatingMap
    pair: PairMap | None = None


def maps_for(actuator: Actuator, table: MagneticTable, *, map_file: Path | None, table_file: Path | None) -> Maps:
    """The maps of an actuator and its table: those of `map_file`, which may be a pair's; else of the table.

    Raises
    ------
    InputError : a map that cannot be read, or a table without flux densities of its sections
    """
    if map_file is not None and not is_pair_map(map_file):
        if table.shared is not None:
            say(f"note: {map_file} is the map of one side; both are judged together by that of the pair")
        return Maps(given_map(map_file, actuator))
    if map_file is not None:
        pair = read_pair_map(map_file)
        doubt = doubt_about_origin(actuator, pair)
        if doubt is not None:
            say(f"note: {map_file}: {doubt}")
        return Maps(operating_map(table, levels=pair.levels.tolist()), pair)
    file = table_file
    if file is None and isinstance(actuator.magnet, TableMagnet):
        file = actuator.folder / actuator.magnet.table
    one_side = operating_map(table)
    if table.shared is None or file is None or actuator.sides is None:
        return Maps(one_side)
    try:
        return Maps(
            one_side, pair_map(read_pair_table(file), levels=one_side.levels.tolist(), polarity=actuator.sides.polarity)
        )
    except InputError as err:
        say(f"note: each side is judged by its own map, as there is none of the pair: {err}")
        return Maps(one_side)
