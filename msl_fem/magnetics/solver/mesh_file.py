"""A foreign mesh with named regions, read through meshio and checked."""

import contextlib
import io
from pathlib import Path
from typing import Any

import meshio
import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError
from msl_fem.magnetics.solver.mesh import TriangleMesh

Indices = NDArray[np.int64]
IGNORED = {"vertex", "line", "line3"}
FLAT = 1e-9  # of the mesh's size: what z may vary
THINNEST = 1e-12  # of a triangle's longest edge squared: a smaller area is none


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
        area, or some triangles have no region's name or two
    """
    content = _read(path)
    kinds = {block.type for block in content.cells} - IGNORED
    if kinds != {"triangle"}:
        found = ", ".join(sorted(kinds)) or "none"
        raise InputError(f"{path}: cells are {found}; only straight three-node triangles are allowed: save first order")
    points = np.asarray(content.points, dtype=float)
    if points.shape[1] > 2 and np.ptp(points[:, 2]) > FLAT * np.ptp(points[:, :2]):
        raise InputError(f"{path}: the mesh is not plane, z varies; lay it into the x-y plane")
    blocks = [k for k, block in enumerate(content.cells) if block.type == "triangle"]
    triangles = np.concatenate([content.cells[k].data for k in blocks]).T.astype(np.int64)
    region, names = _regions(content, blocks, triangles.shape[1], path)
    used, places = np.unique(triangles, return_inverse=True)
    corners = places.reshape(triangles.shape)
    xy = points[used, :2].T * unit
    return TriangleMesh(np.ascontiguousarray(xy), _anticlockwise(xy, corners, path), region, names, gap)


def _read(path: Path) -> Any:
    chatter = io.StringIO()
    try:
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter):
            return meshio.read(path)
    except (Exception, SystemExit) as err:  # meshio ends the process where no reader fits
        said = str(err) if not isinstance(err, SystemExit) else "no format of meshio fits"
        raise InputError(f"{path}: cannot be read as a mesh ({said or type(err).__name__}); give a gmsh file") from err


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
            members = [
                starts[j] + np.asarray(cells[k], dtype=int) for j, k in enumerate(blocks) if cells[k] is not None
            ]
            chosen = np.concatenate(members) if members else np.empty(0, dtype=int)
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


def _anticlockwise(xy: NDArray[np.float64], corners: Indices, path: Path) -> Indices:
    """The triangles with clockwise ones turned round."""
    (x0, x1, x2), (y0, y1, y2) = xy[:, corners]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    longest = np.maximum((x1 - x0) ** 2 + (y1 - y0) ** 2, (x2 - x0) ** 2 + (y2 - y0) ** 2)
    none = np.abs(area) <= THINNEST * longest
    if none.any():
        k = int(np.flatnonzero(none)[0])
        raise InputError(
            f"{path}: {np.count_nonzero(none)} triangles have no area, the first at x = {x0[k] * 1e3:g} mm, "
            f"y = {y0[k] * 1e3:g} mm; mesh the section again"
        )
    turned = corners.copy()
    turned[1:, area < 0] = corners[2:0:-1, area < 0]
    return turned
