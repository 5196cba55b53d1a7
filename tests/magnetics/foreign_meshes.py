"""A magnet of the house as a mesh of its whole section, as if it came from elsewhere."""

from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate

NAMES = {"strip": "air_gap", "window": "air_window"}


def whole(section: Section) -> Section:
    """Both halves of a section whose currents keep their sign, the coil's sides named by it."""
    regions = []
    for region in section.regions:
        density = section.turns_density.get(region.name, 0.0)
        name = f"coil{'+' if density > 0 else '-'}" if density else NAMES.get(region.name, region.name)
        mirrored = tuple((-x, y) for x, y in reversed(region.vertices))
        if any(x == 0 for x, _ in region.vertices):
            right = max(x for x, _ in region.vertices)
            low, high = (pick(y for _, y in region.vertices) for pick in (min, max))
            regions.append(Region(name, ((-right, low), (right, low), (right, high), (-right, high))))
        else:
            regions += [Region(name, region.vertices), Region(name, mirrored)]
    corners = tuple((side * x, y, s) for x, y, s in section.corners for side in (1, -1))
    return replace(section, regions=tuple(regions), corners=corners, turns_density={}, cuts=(), far=1.0)


def boxed(actuator: Actuator, margin: float = 0.055) -> Actuator:
    """The actuator with a box of air so near that it is painted whole, without layers beyond."""
    near = {"air": dict.fromkeys(("side", "bottom", "top"), margin)}
    assert actuator.magnet is not None
    magnet = type(actuator.magnet).model_validate(actuator.magnet.model_dump() | near)
    assert magnet.section(1e-3).far == 1.0
    return actuator.model_copy(update={"magnet": magnet})


def foreign(actuator: Actuator, gap: float, folder: Path) -> Actuator:
    """The magnet as a gmsh file of its whole section at a gap, read back as kind = "mesh"."""
    magnet = actuator.magnet
    section = whole(magnet.section(gap))
    mesh = triangulate(section, MeshSize(corner=0.02, gap=2.0, iron=0.6, growth=0.4))
    tag = {name: k + 1 for k, name in enumerate(mesh.names)}
    tags = np.array([tag[name] for name in mesh.names], dtype=np.int32)[mesh.region]
    content = meshio.Mesh(
        np.column_stack([*mesh.points, np.zeros(mesh.points.shape[1])]),
        [("triangle", mesh.triangles.T.astype(np.int32))],
        cell_data={"gmsh:physical": [tags], "gmsh:geometrical": [tags]},
        field_data={name: np.array([k, 2]) for name, k in tag.items()},
    )
    file = folder / f"{gap:g}.msh"
    meshio.write(file, content, file_format="gmsh22", binary=False)
    magnetic = {
        "kind": "mesh", "mesh": str(file), "stack_depth": magnet.stack_depth, "gap": gap, "turns": magnet.turns,
        "iron": magnet.iron.model_dump(exclude_none=True),
    }  # fmt: skip
    return Actuator.model_validate({"schema": 1, "name": "foreign", "magnet": magnetic, "file": actuator.file})
