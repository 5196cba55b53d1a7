"""A foreign mesh with named regions: the file read through meshio and checked, what its regions are."""

import contextlib
import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.files.schema import refuse_what_never_ends
from msl_fem.magnetics.kinds.mesh_checks import anticlockwise, check_finite
from msl_fem.magnetics.triangles import TriangleMesh, boundary_points

Indices = NDArray[np.int64]
IGNORED = {"vertex", "line", "line3"}
FLAT = 1e-9  # of the mesh's size: what z may vary
KINDS = ("core", "armature", "coil+", "coil-", "air")
AREAS_AGREE = 1e-3  # relative: of the coil's two sides


def read_mesh(path: Path, *, unit: float = 1.0, gap: float) -> TriangleMesh:
    """The triangles of a file, anticlockwise, with the names of their regions; points without a triangle are left out.

    Parameters
    ----------
    path : a gmsh file with physical names, or any format of meshio with named cell sets
    unit : the length of one unit of the file's coordinates in m
    gap : the gap that the mesh was made at, in m

    Raises
    ------
    InputError : the file cannot be read, has other cells than straight triangles, is not plane, a triangle has no
        area, triangles overlap, or some have no region's name or two
    """
    content = _read(path)
    kinds = {block.type for block in content.cells} - IGNORED
    if kinds != {"triangle"}:
        listed = ", ".join(sorted(kinds)) or "none"
        raise InputError(
            f"{path}: cells are {listed}; only straight three-node triangles are allowed: save first order"
        )
    points = np.asarray(content.points, dtype=float)
    check_finite(points, path)
    if points.shape[1] > 2 and np.ptp(points[:, 2]) > FLAT * np.ptp(points[:, :2]):
        raise InputError(f"{path}: the mesh is not plane, z varies; lay it into the x-y plane")
    blocks = [k for k, block in enumerate(content.cells) if block.type == "triangle"]
    triangles = np.concatenate([content.cells[k].data for k in blocks]).T.astype(np.int64)
    region, names = _regions(content, blocks, triangles.shape[1], path)
    used, places = np.unique(triangles, return_inverse=True)
    corners = places.reshape(triangles.shape)
    xy = points[used, :2].T * unit
    return TriangleMesh(np.ascontiguousarray(xy), anticlockwise(xy, corners, path), region, names, gap)


def _read(path: Path) -> Any:
    import meshio  # here, for its import takes longer than all the rest of an actuator

    chatter = io.StringIO()
    try:
        refuse_what_never_ends(path)
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter), warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # a whole number that is none
            return meshio.read(path)
    except (Exception, SystemExit) as err:  # meshio ends the process where no reader fits
        reason = "no format of meshio fits" if isinstance(err, SystemExit) else str(err) or type(err).__name__
        raise InputError(f"{path}: cannot be read as a mesh ({reason}); give a gmsh file") from err


def _regions(content: Any, blocks: list[int], n: int, path: Path) -> tuple[Indices, tuple[str, ...]]:
    """Each triangle's index into the names, and the names."""
    region = np.full(n, -1)
    sizes = [len(content.cells[k].data) for k in blocks]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    physical = content.cell_data.get("gmsh:physical")
    names: list[str] = []
    if physical is not None and content.field_data:
        tags = np.concatenate([physical[k] for k in blocks])
        for name, (tag, dimension) in content.field_data.items():
            if dimension == 2 and (tags == tag).any():
                region[tags == tag] = len(names)
                names.append(name)
    else:
        for name, cells in content.cell_sets.items():
            members = [np.empty(0, dtype=int)]
            for start, k in zip(starts, blocks, strict=False):
                if cells[k] is not None:
                    members.append(start + np.asarray(cells[k], dtype=int))
            chosen = np.concatenate(members)
            if chosen.size == 0 or name.startswith("gmsh:"):
                continue
            if (region[chosen] >= 0).any():
                raise InputError(f"{path}: region '{name}' shares triangles with another one; regions may not overlap")
            region[chosen] = len(names)
            names.append(name)
    if (region < 0).any():
        raise InputError(
            f"{path}: {np.count_nonzero(region < 0)} of {n} triangles belong to no named region; "
            "give every surface a physical name (or cell set)"
        )
    return region.astype(np.int64), tuple(names)


def sorted_regions(mesh: TriangleMesh, path: str) -> dict[str, tuple[str, ...]]:
    """The mesh's regions by kind; InputError where a name says nothing, a kind is missing, or air does not surround."""
    regions = {kind: tuple(n for n in mesh.names if n.startswith(kind)) for kind in KINDS}
    unknown = set(mesh.names).difference(*regions.values())
    if unknown:
        raise InputError(
            f"{path}: region '{min(unknown)}' is unknown; names begin with core, armature, coil+, coil- or air"
        )
    missing = [kind for kind, names in regions.items() if not names]
    if missing:
        raise InputError(f"{path}: no region's name begins with '{missing[0]}'; regions are {', '.join(mesh.names)}")
    solid_names = set(mesh.names) - set(regions["air"])
    solid = np.unique(mesh.triangles[:, mesh.elements(*solid_names)])
    outside = np.intersect1d(solid, boundary_points(mesh))
    if outside.size:
        x, y = mesh.points[:, outside[0]] * 1e3
        raise InputError(
            f"{path}: iron or coil lies on the mesh's edge at x = {x:g} mm, y = {y:g} mm; surround the section with "
            "air, and let regions that touch share their points"
        )
    return regions


def turns_densities(mesh: TriangleMesh, regions: dict[str, tuple[str, ...]], turns: int) -> dict[str, float]:
    """Region to turns per area (1/m2), signed; InputError where the coil's sides differ in area."""
    area = mesh.areas
    out: dict[str, float] = {}
    areas: list[float] = []
    for kind, sign in (("coil+", 1), ("coil-", -1)):
        areas.append(float(area[mesh.elements(*regions[kind])].sum()))
        out |= dict.fromkeys(regions[kind], sign * turns / areas[-1])
    if abs(areas[0] / areas[1] - 1) > AREAS_AGREE:
        raise InputError(
            f"the coil's sides coil+ and coil- have areas of {areas[0] * 1e6:g} and {areas[1] * 1e6:g} mm2; "
            "they must be equal"
        )
    return out
