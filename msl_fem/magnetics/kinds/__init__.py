"""Kinds of magnets, a file each: dimensions, section, winding, closed equations. `Magnet` is the list of them."""

from msl_fem.magnetics.kinds.e_core import ECore
from msl_fem.magnetics.kinds.foreign_mesh import MeshMagnet
from msl_fem.magnetics.kinds.kind import MagnetKind
from msl_fem.magnetics.kinds.plunger import Plunger
from msl_fem.magnetics.kinds.pot_core import PotCore
from msl_fem.magnetics.kinds.tabulated import TableMagnet
from msl_fem.magnetics.kinds.u_core import UCore

Magnet = ECore | UCore | PotCore | Plunger | TableMagnet | MeshMagnet
"""What [magnet] of an actuator file may be: its `kind` chooses. A new kind is a name here."""

__all__ = ["ECore", "Magnet", "MagnetKind", "MeshMagnet", "Plunger", "PotCore", "TableMagnet", "UCore"]
