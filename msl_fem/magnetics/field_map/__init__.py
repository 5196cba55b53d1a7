"""The operating map by root finding on field solutions, and how far the two sides are decoupled over it."""

from msl_fem.magnetics.field_map.decoupling_map import DecouplingMap, decoupling_map, decoupling_positions
from msl_fem.magnetics.field_map.level_map import FieldMapSettings, default_gaps, field_map

__all__ = ["DecouplingMap", "FieldMapSettings", "decoupling_map", "decoupling_positions", "default_gaps", "field_map"]
