"""Whether the triangles of a foreign mesh can be a section: finite, of some area, without folds and overlaps."""

from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import InputError

Indices = NDArray[np.int64]
Points = NDArray[np.float64]
THINNEST = 1e-12  # of a triangle's longest edge squared: a smaller area is none
FULL_TURN = 2 * np.pi * (1 + 1e-6)
INSIDE = 1e-6  # of a triangle's area: a point nearer to an edge lies on it


def check_finite(points: Points, path: Path) -> None:
    """InputError where a coordinate of the points (n_point, n_dimension) is no number."""
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InputError(f"{path}: node {bad[0] + 1} has a coordinate that is no number; mesh the section again")


def anticlockwise(xy: Points, corners: Indices, path: Path) -> Indices:
    """The triangles (3, n_triangle) of points (2, n_point) with clockwise ones turned round, where they tile a plane.

    Raises
    ------
    InputError : triangles without area, an edge that three share or two from the same side, more than a full turn of
        triangles round a point, a point inside a triangle
    """
    area = _double_area(xy, corners)
    _check_area(xy, corners, area, path)
    turned = corners.copy()
    turned[1:, area < 0] = corners[2:0:-1, area < 0]
    _check_edges(xy, turned, path)
    _check_angles(xy, turned, path)
    _check_points(xy, turned, np.abs(area), path)
    return turned


def _double_area(xy: Points, corners: Indices) -> Points:
    (x0, x1, x2), (y0, y1, y2) = xy[:, corners]
    return np.asarray((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))


def _at(xy: Points, point: int) -> str:
    return f"x = {xy[0, point] * 1e3:g} mm, y = {xy[1, point] * 1e3:g} mm"


def _check_area(xy: Points, corners: Indices, area: Points, path: Path) -> None:
    edges = xy[:, corners] - xy[:, np.roll(corners, 1, axis=0)]
    none = np.abs(area) <= THINNEST * (edges**2).sum(axis=0).max(axis=0)
    if none.any():
        k = int(np.flatnonzero(none)[0])
        raise InputError(
            f"{path}: {np.count_nonzero(none)} triangles have no area, the first at {_at(xy, corners[0, k])}; "
            "mesh the section again"
        )


def _check_edges(xy: Points, corners: Indices, path: Path) -> None:
    """An edge belongs to two triangles at most, which run along it in opposite directions."""
    starts, ends = corners.ravel(), np.roll(corners, -1, axis=0).ravel()
    edges, counts = np.unique(np.stack([starts, ends]), axis=1, return_counts=True)
    if counts.max() > 1:
        place = int(edges[0, np.argmax(counts)])
        raise InputError(
            f"{path}: the mesh is folded at {_at(xy, place)}: two triangles lie on the same side of an edge; a node "
            "or a corner is in the wrong place, mesh the section again"
        )


def _check_angles(xy: Points, corners: Indices, path: Path) -> None:
    """Round a point the triangles make a full turn at most."""
    sums = np.zeros(xy.shape[1])
    for k in range(3):
        first, second = (xy[:, corners[(k + step) % 3]] - xy[:, corners[k]] for step in (1, 2))
        cross = first[0] * second[1] - first[1] * second[0]
        np.add.at(sums, corners[k], np.arctan2(cross, (first * second).sum(axis=0)))
    if sums.max() > FULL_TURN:
        _refuse_overlap(xy, int(np.argmax(sums)), path)


def _refuse_overlap(xy: Points, point: int, path: Path) -> NoReturn:
    raise InputError(
        f"{path}: triangles overlap at {_at(xy, point)}; a node or a corner is in the wrong place, mesh the "
        "section again"
    )


def _check_points(xy: Points, corners: Indices, area: Points, path: Path) -> None:
    """No point lies inside a triangle."""
    used = np.unique(corners)
    centre = xy[:, corners].mean(axis=1)
    radius = np.sqrt(((xy[:, corners] - centre[:, None]) ** 2).sum(axis=0).max(axis=0))
    from scipy.spatial import cKDTree  # who controls a magnet needs none of scipy

    near = cKDTree(xy[:, used].T).query_ball_point(centre.T, radius)
    triangle = np.repeat(np.arange(corners.shape[1]), [len(found) for found in near])
    point = used[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
    inside = np.ones(point.size, dtype=bool)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        part = _double_area(xy, np.stack([corners[start, triangle], corners[end, triangle], point]))
        inside &= part > INSIDE * area[triangle]
    if inside.any():
        _refuse_overlap(xy, int(point[np.argmax(inside)]), path)
