"""Faces of a drawing of points and straight edges: their outlines, and which of them a point lies in."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array

Indices = NDArray[np.int64]
INSETS = np.geomspace(1e-3, 0.4, 12)
"""Of a face's size: how far from its edges points inside are looked for."""


def outlines_of_faces(points: Array, edges: Indices) -> list[Array]:
    """The outer outline (n, 2) of every bounded face, anticlockwise, the largest first.

    A face may have others inside, which then follow it. Edges that end nowhere bound nothing and are left out.

    Parameters
    ----------
    points : (n_point, 2)
    edges : (n_edge, 2) indices of points; edges meet at points alone
    """
    kept = _without_loose_ends(np.unique(np.sort(edges[edges[:, 0] != edges[:, 1]], axis=1), axis=0))
    following = _next_on_the_left(points, kept)
    outlines = []
    while following:
        first, at = next(iter(following.items()))
        walk = [first]
        del following[first]
        while at != first:
            walk.append(at)
            at = following.pop(at)
        ring = points[[start for start, _ in walk]]
        if signed_area(ring) > 0:
            outlines.append(ring)
    return sorted(outlines, key=lambda ring: -signed_area(ring))


def _without_loose_ends(edges: Indices) -> Indices:
    """The edges without those that lead to a point where no other edge begins, again and again."""
    while True:
        nodes, count = np.unique(edges, return_counts=True)
        loose = np.isin(edges, nodes[count == 1]).any(axis=1)
        if not loose.any():
            return edges
        edges = edges[~loose]


def _next_on_the_left(points: Array, edges: Indices) -> dict[tuple[int, int], tuple[int, int]]:
    """Directed edge to the one that follows it around the face on its left."""
    both = np.concatenate([edges, edges[:, ::-1]])
    along = points[both[:, 1]] - points[both[:, 0]]
    angle = np.arctan2(along[:, 1], along[:, 0])
    around: dict[int, list[int]] = {}
    for k in np.lexsort((angle, both[:, 0])):
        around.setdefault(int(both[k, 0]), []).append(int(both[k, 1]))
    follow = {}
    for node, ends in around.items():
        for place, end in enumerate(ends):
            follow[(end, node)] = (node, ends[place - 1])
    return follow


def signed_area(ring: Array) -> float:
    """m2 of a polygon (n, 2), positive where it runs anticlockwise."""
    (x, y), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    return float((x * y1 - x1 * y).sum()) / 2


def encloses(ring: Array, point: Array) -> bool:
    """Whether a point (2,) lies inside a polygon (n, 2), by the even-odd rule."""
    (x0, y0), (x1, y1) = ring.T, np.roll(ring, -1, axis=0).T
    crosses = (y0 > point[1]) != (y1 > point[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        at = x0 + (point[1] - y0) * (x1 - x0) / (y1 - y0)
    return bool(np.count_nonzero(crosses & (point[0] < at)) % 2)


def face_at(outlines: list[Array], point: Array) -> int | None:
    """The index of the face that a point lies in, of outlines as `outlines_of_faces` gives them; None outside all."""
    inside = [k for k, ring in enumerate(outlines) if encloses(ring, point)]
    return inside[-1] if inside else None


def distance_to(outlines: list[Array], point: Array) -> float:
    """The distance of a point (2,) to the nearest outline."""
    return min(_distance(ring, point) for ring in outlines)


def _distance(ring: Array, point: Array) -> float:
    along = np.roll(ring, -1, axis=0) - ring
    share = np.clip(((point - ring) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(np.hypot(*(ring + share[:, None] * along - point).T).min())


def point_inside(outlines: list[Array], face: int) -> Array:
    """A point (2,) of a face, well away from its edges where it is wide."""
    ring = outlines[face]
    along = np.roll(ring, -1, axis=0) - ring
    inwards = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    size = float(np.ptp(ring, axis=0).min())
    tried = (ring + along / 2 + inset * size * inwards for inset in INSETS)
    candidates = [point for points in tried for point in points if face_at(outlines, point) == face]
    return np.asarray(max(candidates, key=lambda point: distance_to(outlines, point)))
