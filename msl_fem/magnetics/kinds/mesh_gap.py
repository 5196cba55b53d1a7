"""The gap that a foreign mesh has between its irons, against the one that its actuator file states."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.triangles import TriangleMesh, single_edges

SAME = 0.03
"""Relative difference of gaps that are the same: straight edges for the arcs of a bearing leave about 1 %."""
FACING = 0.5  # of an outward normal along the pull: a side that is steeper is no face
LEAST = 0.05  # of the length of the faces that meet the other iron: less is a corner
AT_ONCE = 256  # points whose distances to all edges are computed together


def doubt_about_gap(mesh: TriangleMesh, armature: tuple[str, ...], core: tuple[str, ...], pull: str) -> str | None:
    """Why the stated gap `mesh.gap` is hardly the mesh's, in a sentence; None where the mesh has such a distance.

    The distances that may be the gap are the smallest one between core and armature, and those in the direction of pull
    between their faces.

    Parameters
    ----------
    armature, core : names of regions
    pull : "+x", "-x", "+y" or "-y", the direction in which the armature is attracted

    Raises
    ------
    InputError : the irons are farther apart everywhere than the stated gap, or smaller than it
    """
    bodies = (_outline(mesh, armature), _outline(mesh, core))
    nearest = min(float(_distances(_points(a), b).min()) for a, b in (bodies, bodies[::-1]))
    size = max(float(np.ptp(body, axis=(1, 2)).max()) for body in bodies)
    stated, measured = format_quantity(mesh.gap, "m"), format_quantity(nearest, "m")
    if nearest > mesh.gap * (1 + SAME) or size < mesh.gap:
        raise InputError(
            f"gap {stated} is not that of the mesh, whose core and armature are {measured} apart at the nearest and up "
            f"to {format_quantity(size, 'm')} long; state the gap that the mesh was made at, and look at length_unit"
        )
    if abs(nearest / mesh.gap - 1) <= SAME or _share_of_faces(*bodies, pull, mesh.gap) >= LEAST:
        return None
    return (
        f"no distance between core and armature in the mesh is the stated gap, {stated}; they are {measured} apart at "
        "the nearest, which is the gap that the mesh was made at, if no other is meant"
    )


def _outline(mesh: TriangleMesh, names: tuple[str, ...]) -> Array:
    """(2, 2, n) x and y of the starts and ends of the edges around the regions, which lie on their left."""
    edges = np.concatenate([mesh.triangles[[k, (k + 1) % 3]][:, mesh.elements(*names)] for k in range(3)], axis=1)
    return mesh.points[:, edges[:, single_edges(edges)]]


def _points(outline: Array) -> Array:
    """(2, n) the points of an outline."""
    return np.unique(outline.reshape(2, -1), axis=1)


def _blocks(points: Array) -> list[Array]:
    return np.array_split(points, max(points.shape[1] // AT_ONCE, 1), axis=1)


def _distances(points: Array, outline: Array) -> Array:
    """(n_point,) the distance of each point to the nearest edge."""
    start, along = outline[:, 0], outline[:, 1] - outline[:, 0]
    nearest = []
    for block in _blocks(points):
        towards = block[:, :, None] - start[:, None, :]
        share = np.clip((towards * along[:, None, :]).sum(axis=0) / (along**2).sum(axis=0), 0.0, 1.0)
        nearest.append(np.hypot(*(towards - share * along[:, None, :])).min(axis=1))
    return np.concatenate(nearest)


def _share_of_faces(armature: Array, core: Array, pull: str, gap: float) -> float:
    """The share of the faces that meet the other iron in the direction of pull at about the gap, by length."""
    turn = {"+y": ((1, 0), (0, 1)), "-y": ((-1, 0), (0, -1)), "+x": ((0, -1), (1, 0)), "-x": ((0, 1), (-1, 0))}[pull]
    below, above = (np.einsum("ij,jkn->ikn", np.array(turn, dtype=float), body) for body in (armature, core))
    below, above = _faces(below, upwards=True), _faces(above, upwards=False)
    lengths = np.concatenate([np.ptp(face[0], axis=0) for face in (below, above)])
    heights = np.concatenate([_heights(below, above), _heights(above, below)])
    met = np.isfinite(heights)
    same = np.abs(heights / gap - 1) <= SAME
    return float(lengths[same].sum() / lengths[met].sum()) if met.any() else 0.0


def _faces(outline: Array, *, upwards: bool) -> Array:
    """The edges whose outward normal points up, or down."""
    x, y = outline[:, 1] - outline[:, 0]
    normal = -x / np.hypot(x, y)  # the body lies on the left of an edge
    return outline[:, :, normal > FACING if upwards else normal < -FACING]


def _heights(from_edges: Array, to_edges: Array) -> Array:
    """How far above or below the middle of each edge the others are met first; infinite where they are not met."""
    (x0, x1), (y0, y1) = to_edges
    left, right = np.minimum(x0, x1), np.maximum(x0, x1)
    slope = (y1 - y0) / (x1 - x0)
    side = 1.0 if (x1 > x0).all() else -1.0  # faces that look down are met above
    heights = []
    for x, y in (block[:, :, None] for block in _blocks(from_edges.mean(axis=1))):
        met: NDArray[np.bool_] = (left <= x) & (x <= right)
        height = side * (y0 + slope * (x - x0) - y)
        heights.append(np.where(met & (height > 0), height, np.inf).min(axis=1, initial=np.inf))
    return np.concatenate(heights)
