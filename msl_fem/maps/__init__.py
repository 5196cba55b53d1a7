"""The operating map of a magnet, its file, and the guard that judges commands by it."""

from msl_fem.maps.guard import REGIONS, Guard, Judgement
from msl_fem.maps.level_currents import LEVELS, MEAN, Criterion, OperatingMap, operating_map, parse_criterion
from msl_fem.maps.map_file import map_from_json, map_to_json, read_map, write_map

__all__ = [
    "LEVELS",
    "MEAN",
    "REGIONS",
    "Criterion",
    "Guard",
    "Judgement",
    "OperatingMap",
    "map_from_json",
    "map_to_json",
    "operating_map",
    "parse_criterion",
    "read_map",
    "write_map",
]
