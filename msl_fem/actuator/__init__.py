"""The actuator: what a TOML file of geometries/ says, as frozen records in SI units; leaf flexures in closed form."""

from msl_fem.actuator.actuator import Actuator
from msl_fem.actuator.drive import Controller, CurrentSensor, Drive, PositionSensor
from msl_fem.actuator.flexure_section import Flexure
from msl_fem.actuator.leaf import GUIDED_MASS_SHARE, Leaf
from msl_fem.actuator.leaf_materials import FLEXURE_MATERIALS, SAFETY, FlexureMaterial, flexure_material
from msl_fem.actuator.leaf_placement import Placement, placed
from msl_fem.actuator.magnet import Air, Coil, ECore, Iron, MeshMagnet, TableMagnet
from msl_fem.actuator.motion import Motion, Sides
from msl_fem.actuator.proportions import LARGEST_MAGNET, THINNEST
from msl_fem.actuator.quantities import (
    Clearance,
    Current,
    CurrentNoise,
    Damping,
    Force,
    Fraction,
    Frequency,
    Inertia,
    Length,
    Mass,
    PositionNoise,
    Resistance,
    Stiffness,
    Turns,
    Voltage,
)
from msl_fem.actuator.reader import PURE_NUMBERS, load_actuator, parse_actuator
from msl_fem.actuator.tolerances import Tolerances

__all__ = [
    "FLEXURE_MATERIALS",
    "GUIDED_MASS_SHARE",
    "LARGEST_MAGNET",
    "PURE_NUMBERS",
    "SAFETY",
    "THINNEST",
    "Actuator",
    "Air",
    "Clearance",
    "Coil",
    "Controller",
    "Current",
    "CurrentNoise",
    "CurrentSensor",
    "Damping",
    "Drive",
    "ECore",
    "Flexure",
    "FlexureMaterial",
    "Force",
    "Fraction",
    "Frequency",
    "Inertia",
    "Iron",
    "Leaf",
    "Length",
    "Mass",
    "MeshMagnet",
    "Motion",
    "Placement",
    "PositionNoise",
    "PositionSensor",
    "Resistance",
    "Sides",
    "Stiffness",
    "TableMagnet",
    "Tolerances",
    "Turns",
    "Voltage",
    "flexure_material",
    "load_actuator",
    "parse_actuator",
    "placed",
]
