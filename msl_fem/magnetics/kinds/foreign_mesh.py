"""A magnet whose section is a mesh from elsewhere; what moves in it moves with the gap."""

from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import PrivateAttr

from msl_fem.errors import InputError
from msl_fem.files.dimensions import Length, Turns
from msl_fem.magnetics.kinds.kind import MagnetKind, WindingSpace
from msl_fem.magnetics.kinds.mesh_file import read_mesh, sorted_regions, turns_densities
from msl_fem.magnetics.kinds.mesh_gap import doubt_about_gap
from msl_fem.magnetics.kinds.parts import Coil, IronSpec
from msl_fem.magnetics.section import IronPart, MovingRegions, Section
from msl_fem.magnetics.triangles import TriangleMesh

REACH = 0.3, 2.5  # times the mesh's own gap: between these a mesh follows the gap


class MeshMagnet(MagnetKind):
    """A magnet whose whole plane section is a mesh of straight triangles with named regions.

    Regions: core*, armature* (what moves), coil+*, coil-* (turns that carry the current out of the plane, into it) and
    air*, which surrounds all; A = 0 on the mesh's edge. At other gaps than its own the mesh's armature moves and the
    air follows.

    Attributes
    ----------
    mesh : a gmsh file with physical names, or another format of meshio with named cell sets; relative to the file
    length_unit : the length of one unit of the mesh's coordinates, like "1 mm"; metres without it
    stack_depth : across the section
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
    _folder: Path = PrivateAttr(Path())

    def look_in(self, folder: Path) -> None:
        """A relative name of the mesh's file starts at this folder."""
        self._folder = folder

    def own_mesh(self) -> TriangleMesh:
        return self._read()[0]

    @property
    def doubts(self) -> tuple[str, ...]:
        """That the stated gap is hardly the mesh's."""
        return self._read()[1]

    def _read(self) -> tuple[TriangleMesh, tuple[str, ...]]:
        path = self._folder / self.mesh
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        return _mesh(path, self.length_unit, self.gap, self.pull, changed)

    @property
    def gaps(self) -> tuple[float, float]:
        return REACH[0] * self.gap, REACH[1] * self.gap

    @property
    def half_width(self) -> float:
        """Half of the iron's larger extent."""
        mesh, regions = self.own_mesh(), self._regions
        iron = mesh.triangles[:, mesh.elements(*regions["core"], *regions["armature"])]
        return float(np.ptp(mesh.points[:, np.unique(iron)], axis=1).max()) / 2

    @property
    def _regions(self) -> dict[str, tuple[str, ...]]:
        return sorted_regions(self.own_mesh(), str(self._folder / self.mesh))

    def section(self, gap: float) -> Section:
        """The whole section: no polygons, but what its mesh says of regions, volumes and turns."""
        del gap  # the mesh has its own
        mesh, regions = self.own_mesh(), self._regions
        core, armature = (self.iron.by_region[kind] for kind in ("core", "armature"))
        iron = dict.fromkeys(regions["core"], core) | dict.fromkeys(regions["armature"], armature)
        sign, axis = self.pull
        away = -1.0 if sign == "+" else 1.0
        area = {name: float(mesh.areas[mesh.elements(name)].sum()) for name in iron}
        return Section(
            regions=(),
            corners=(),
            cuts=(),
            iron=iron,
            turns_density=turns_densities(mesh, regions, self.turns),
            depth=self.stack_depth,
            gap=self.gap,
            parts=tuple(IronPart(name, name, (), area[name]) for name in iron),
            symmetry="none",
            moving=MovingRegions(
                regions["armature"], regions["air"], (away, 0.0) if axis == "x" else (0.0, away), self.gap
            ),
        )

    @property  # type: ignore[misc]
    def coil(self) -> Coil:
        raise InputError("a mesh does not tell how its coil is wound; describe the magnet by its dimensions")

    @property
    def winding_space(self) -> WindingSpace:
        raise InputError('a mesh does not tell how its coil is wound; state [drive] coil_resistance, like "2 ohm"')

    @property
    def copper_area(self) -> float:
        """m2 of the coil's side, as if all of it were copper."""
        mesh = self.own_mesh()
        return float(mesh.areas[mesh.elements(*self._regions["coil+"])].sum())


@lru_cache(maxsize=8)
def _mesh(path: Path, unit: float, gap: float, pull: str, changed: int) -> tuple[TriangleMesh, tuple[str, ...]]:
    """The file read once for each time that it was written, and what is doubtful about its gap."""
    del changed
    mesh = read_mesh(path, unit=unit, gap=gap)
    regions = sorted_regions(mesh, str(path))
    try:
        doubt = doubt_about_gap(mesh, regions["armature"], regions["core"], pull)
    except InputError as err:
        raise InputError(f"{path}: {err}") from err
    return mesh, () if doubt is None else (f"{path.name}: {doubt}",)
