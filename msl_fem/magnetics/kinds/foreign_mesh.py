"""A magnet whose section is a mesh from elsewhere."""

from typing import Literal

from msl_fem.files.dimensions import Length, Turns
from msl_fem.files.schema import FrozenModel
from msl_fem.magnetics.kinds.parts import IronSpec


class MeshMagnet(FrozenModel):
    """A magnet whose whole plane section is a mesh of straight triangles with named regions.

    Regions: core*, armature* (what moves), coil+*, coil-* (turns that carry the current out of the plane, into it) and
    air*, which surrounds all; A = 0 on the mesh's edge.

    Attributes
    ----------
    mesh : a gmsh file with physical names, or another format of meshio with named cell sets; relative to the file
    length_unit : the length of one unit of the mesh's coordinates, like "1 mm"; metres without it
    gap : the air gap that the mesh was made at
    pull : the direction in which the armature is attracted
    turns : of all regions coil+* together, and of coil-*
    """

    kind: Literal["mesh"]
    mesh: str
    length_unit: Length = 1.0
    stack_depth: Length
    gap: Length
    pull: Literal["+x", "-x", "+y", "-y"] = "+y"
    turns: Turns
    iron: IronSpec
