"""A magnet from the outlines of its section: painted, meshed and written as an actuator file with its mesh."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import meshio
import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.export.dxf_section import COIL_LAYERS
from msl_fem.files.quantity import format_quantity
from msl_fem.files.toml_text import quantity_text, toml_text
from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.section import MovingRegions, Region, Section
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate
from msl_fem.magnetics.triangles import TriangleMesh

Pull = Literal["+x", "-x", "+y", "-y"]
COILS = dict(zip(COIL_LAYERS, ("coil+", "coil-"), strict=True))
SOLID = ("core", "armature", *COILS)
AIR_AROUND = 2.0  # times the drawing's larger side, on each side of it
NEAR = 4.0  # gaps from the other iron: corners where the field is singular and the mesh is graded
FLAT = 1e-6  # of the larger side


@dataclass(frozen=True)
class DrawnMagnet:
    """What a drawing of a section does not say of its magnet.

    Attributes
    ----------
    turns : of all outlines on coil_plus together, and of those on coil_minus
    stack_depth : m
    core, armature : names of the irons
    stacking_factor : of both
    armature_stacking_factor : in its place for the armature
    pull : the direction in which the armature is attracted
    unit : the length of one unit of the drawing in m; None: as the file says, millimetres where it says nothing
    """

    turns: int
    stack_depth: float
    core: str
    armature: str
    stacking_factor: float = 1.0
    armature_stacking_factor: float | None = None
    pull: Pull = "+y"
    unit: float | None = None


def magnet_of_outlines(
    outlines: list[Region],
    target: str | Path,
    magnet: DrawnMagnet,
    *,
    gap: float,
    source: str,
    box: Region | None = None,
    beside: Mapping[str, str] | None = None,
) -> Path:
    """Writes an actuator file of the kind "mesh" to `target` (.toml) and its mesh beside it (.msh); gives `target`.

    Parameters
    ----------
    outlines : in m and in the order of painting, by names that begin as in `SOLID`; all others are air
    gap : m, the clearance between armature and core along the pull
    source : what the magnet was made from, for the file
    box : the outline on which A = 0; without, air of `AIR_AROUND` times the drawing's larger side is put around
    beside : texts of files in the target's folder that the irons are named after
    """
    mesh = triangulate(_section(outlines, gap, magnet, box), MeshSize(corner=0.1, gap=1.0, iron=0.4, growth=0.5))
    target = Path(target)
    for name, text in (beside or {}).items():
        with whole_file(target.with_name(name)) as partial:
            partial.write_text(text, encoding="ascii", newline="\n")
    with whole_file(target.with_suffix(".msh")) as partial:
        meshio.write(partial, _named(mesh), file_format="gmsh22", binary=False, float_fmt=".12g")
    content = {
        "schema": 1,
        "name": target.stem,
        "magnet": {
            "kind": "mesh",
            "mesh": target.with_suffix(".msh").name,
            "stack_depth": quantity_text(magnet.stack_depth, "m"),
            "gap": quantity_text(gap, "m"),
            "pull": magnet.pull,
            "turns": magnet.turns,
            "iron": _irons(magnet),
        },
        "sources": {"magnet": source},
    }  # fmt: skip
    with whole_file(target) as partial:
        partial.write_text(toml_text(content), encoding="utf-8")
    return target


def _irons(magnet: DrawnMagnet) -> dict[str, str | float]:
    stated: dict[str, str | float] = {"core": magnet.core, "armature": magnet.armature}
    stated["stacking_factor"] = magnet.stacking_factor
    if magnet.armature_stacking_factor not in (None, magnet.stacking_factor):
        stated["armature_stacking_factor"] = magnet.armature_stacking_factor
    return stated


def _iron_points(outlines: list[Region], kind: str) -> Array:
    return np.array([v for region in outlines if region.name.startswith(kind) for v in region.vertices])


def gap_along(outlines: list[Region], pull: Pull, path: str | Path) -> float:
    """The clearance between armature and core along the pull, m."""
    axis = 0 if pull[1] == "x" else 1
    sign = 1.0 if pull[0] == "+" else -1.0
    armature, core = (sign * _iron_points(outlines, kind)[:, axis] for kind in ("armature", "core"))
    gap = float(core.min() - armature.max())
    if not gap > FLAT * np.ptp(core):
        raise InputError(
            f"{path}: towards {pull} the core begins {format_quantity(gap, 'm')} beyond the armature; draw them apart, "
            "or state the direction in which the armature is pulled"
        )
    return gap


def _section(outlines: list[Region], gap: float, magnet: DrawnMagnet, box: Region | None) -> Section:
    """The outlines in air, with the gap between the irons as a region of its own and graded corners."""
    every = np.array([v for region in outlines for v in region.vertices])
    low, high = every.min(axis=0), every.max(axis=0)
    reach = AIR_AROUND * float((high - low).max())
    painted = [box or _box("air", low - reach, high + reach), _gap_region(outlines, gap, magnet.pull)]
    painted += [Region(_name(region.name), region.vertices) for region in outlines]
    away = -1.0 if magnet.pull[0] == "+" else 1.0
    direction = (away, 0.0) if magnet.pull[1] == "x" else (0.0, away)
    iron = {name: (magnet.core, 1.0) for name in {r.name for r in painted if r.name.startswith(("core", "armature"))}}
    moving = tuple(sorted(name for name in iron if name.startswith("armature")))
    return Section(
        regions=tuple(painted), corners=tuple(_corners(outlines, gap)), cuts=(), iron=iron, turns_density={},
        depth=magnet.stack_depth, gap=gap, symmetry="none",
        moving=MovingRegions(moving, ("air", "gap"), direction, gap),
    )  # fmt: skip


def _name(layer: str) -> str:
    """The region of a layer; what is neither iron nor coil is air."""
    for begin, region in COILS.items():
        if layer.startswith(begin):
            return region
    return layer if layer.startswith(("core", "armature")) else "air"


def _box(name: str, low: Array, high: Array) -> Region:
    (x0, y0), (x1, y1) = low.tolist(), high.tolist()
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def _gap_region(outlines: list[Region], gap: float, pull: Pull) -> Region:
    """The rectangle between the irons where both are."""
    axis = 0 if pull[1] == "x" else 1
    armature, core = (_iron_points(outlines, kind) for kind in ("armature", "core"))
    low, high = np.maximum(armature.min(axis=0), core.min(axis=0)), np.minimum(armature.max(axis=0), core.max(axis=0))
    face = float(armature[:, axis].max()) if pull[0] == "+" else float(armature[:, axis].min()) - gap
    low[axis], high[axis] = face, face + gap
    return _box("gap", low, high)


def _corners(outlines: list[Region], gap: float) -> list[tuple[float, float, float]]:
    """The irons' corners, those near the other iron graded in full."""
    corners = []
    points = {kind: _iron_points(outlines, kind) for kind in ("core", "armature")}
    for kind, other in (("core", "armature"), ("armature", "core")):
        low, high = points[other].min(axis=0) - NEAR * gap, points[other].max(axis=0) + NEAR * gap
        for x, y in np.unique(points[kind], axis=0):
            faces = bool(((low <= (x, y)) & ((x, y) <= high)).all())
            corners.append((float(x), float(y), 1.0 if faces else 0.1))
    return corners


def _named(mesh: TriangleMesh) -> meshio.Mesh:
    """The mesh in m with a physical name for every region, as gmsh writes it."""
    names: Mapping[str, str] = {"gap": "air_gap"}
    regions = [names.get(name, name) for name in mesh.names]
    tag = (mesh.region + 1).astype(np.int32)
    points = np.column_stack([*mesh.points, np.zeros(mesh.points.shape[1])])
    return meshio.Mesh(
        points,
        [("triangle", mesh.triangles.T.astype(np.int32))],
        cell_data={"gmsh:physical": [tag], "gmsh:geometrical": [tag]},
        field_data={name: np.array([k + 1, 2]) for k, name in enumerate(regions)},
    )
