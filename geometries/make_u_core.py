"""Writes u_core.msh: a U-core with one coil round its yoke over a flat armature, lengths in mm."""

import sys
from pathlib import Path

import meshio
import numpy as np

from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.triangles import TriangleMesh

LEG, WINDOW, HEIGHT, THICK, GAP = 10e-3, 20e-3, 25e-3, 10e-3, 0.5e-3  # of the core, and the air gap
COIL, CLEARANCE, AIR = 6e-3, 1e-3, 60e-3
NAMES = ("air", "air_gap", "air_window", "core", "armature", "coil+", "coil-")


def u_core_section(gap: float = GAP) -> Section:
    """The whole section: armature's surface at y = 0, pole faces at y = gap."""
    inner, half, roof, top = WINDOW / 2, WINDOW / 2 + LEG, gap + HEIGHT, gap + HEIGHT + THICK
    coil = inner - CLEARANCE

    def box(name: str, x0: float, x1: float, y0: float, y1: float) -> Region:
        return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))

    regions = (
        box("air", -half - AIR, half + AIR, -THICK - AIR, top + AIR),
        box("gap", -half - THICK, half + THICK, 0.0, gap),
        box("armature", -half, half, -THICK, 0.0),
        box("core", -half, half, gap, top),
        box("window", -inner, inner, gap, roof),
        box("coil+", -coil, coil, top + CLEARANCE, top + CLEARANCE + COIL),
        box("coil-", -coil, coil, roof - CLEARANCE - COIL, roof - CLEARANCE),
    )
    right = [
        (inner, gap, 1.0),
        (half, gap, 1.0),
        (half, 0.0, 1.0),
        (half, -THICK, 0.1),
        (half, top, 0.1),
        (inner, roof, 0.2),
    ]
    corners = tuple((side * x, y, strength) for side in (1, -1) for x, y, strength in right)
    iron = {"core": ("m19", 1.0), "armature": ("m19", 1.0)}
    return Section(regions, corners, (), iron, {}, 20e-3, gap)


def named(mesh: TriangleMesh) -> meshio.Mesh:
    """The mesh in mm with a physical name for every region, as gmsh writes it."""
    renamed = {"gap": "air_gap", "window": "air_window"}
    names = [renamed.get(name, name) for name in mesh.names]
    tag = np.array([NAMES.index(name) + 1 for name in names], dtype=np.int32)[mesh.region]
    points = np.column_stack([*(mesh.points * 1e3), np.zeros(mesh.points.shape[1])])
    return meshio.Mesh(
        points,
        [("triangle", mesh.triangles.T.astype(np.int32))],
        cell_data={"gmsh:physical": [tag], "gmsh:geometrical": [tag]},
        field_data={name: np.array([k + 1, 2]) for k, name in enumerate(NAMES)},
    )


def write(path: Path) -> None:
    """The file of the example."""
    mesh = triangulate(u_core_section(), MeshSize(corner=0.05, gap=2.0, iron=0.6, growth=0.6))
    meshio.write(path, named(mesh), file_format="gmsh22", binary=False, float_fmt=".9g")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("u_core.msh"))
