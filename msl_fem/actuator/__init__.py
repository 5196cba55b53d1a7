"""The actuator: what a TOML file of geometries/ says, as frozen records in SI units; leaf flexures in closed form."""

from msl_fem.actuator.actuator import (
    PURE_NUMBERS,
    Actuator,
    Controller,
    CurrentSensor,
    Drive,
    PositionSensor,
    example_actuators,
    load_actuator,
    parse_actuator,
)
from msl_fem.actuator.leaf import (
    FLEXURE_MATERIALS,
    GUIDED_MASS_SHARE,
    SAFETY,
    FlexureMaterial,
    Leaf,
    Placement,
    flexure_material,
    placed,
)
from msl_fem.actuator.motion import Flexure, Motion, Sides
from msl_fem.actuator.tolerances import Tolerances
from msl_fem.files.dimensions import (
    Clearance,
    Current,
    CurrentNoise,
    Damping,
    Force,
    Frequency,
    Length,
    PositionNoise,
    Stiffness,
    Voltage,
)
from msl_fem.magnetics.kinds import ECore, Magnet, MagnetKind, MeshMagnet, TableMagnet
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.kinds.proportions import LARGEST_MAGNET, THINNEST

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
    "Frequency",
    "IronSpec",
    "Leaf",
    "Length",
    "Magnet",
    "MagnetKind",
    "MeshMagnet",
    "Motion",
    "Placement",
    "PositionNoise",
    "PositionSensor",
    "Sides",
    "Stiffness",
    "TableMagnet",
    "Tolerances",
    "Voltage",
    "example_actuators",
    "flexure_material",
    "load_actuator",
    "parse_actuator",
    "placed",
]
