"""Outlines of bodies of revolution, polygons of points (r, z): their corners, how far apart they are."""

from collections.abc import Sequence

import numpy as np

from msl_fem.computing.arrays import Array

Points = Sequence[tuple[float, float]]
TOUCHING = 1e-6  # of a polygon's largest coordinate: outlines that share an edge do not meet
N_ALONG = 400  # points of an edge that are looked at


def rectangle_points(r0: float, z0: float, r1: float, z1: float) -> tuple[tuple[float, float], ...]:
    """The four corners, anticlockwise."""
    return (r0, z0), (r1, z0), (r1, z1), (r0, z1)


def outline_distance(points: Points, outline: Points) -> Array:
    """(n,) m from each of the points to a closed outline."""
    ring, at = np.array(outline), np.array(points)
    along = np.roll(ring, -1, axis=0) - ring
    t = ((at[:, None] - ring) * along).sum(axis=2) / (along**2).sum(axis=1)
    nearest = ring + np.clip(t, 0, 1)[:, :, None] * along
    return np.asarray(np.hypot(*(at[:, None] - nearest).transpose(2, 0, 1)).min(axis=1))


def convex_corners(
    outline: Points, other: Points, clearance: float, *more: Points
) -> tuple[tuple[float, float, float], ...]:
    """The corners off the axis where iron ends, with the grading's strength (see `Section`).

    Elements there are of the size of the distance to the other bodies, not of the smallest distance of the two.
    """
    ring = np.array(outline)
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    following = np.roll(ring, -1, axis=0)
    orientation = np.sign(np.sum(ring[:, 0] * following[:, 1] - following[:, 0] * ring[:, 1]))
    turn = orientation * (before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0])
    distance = np.min([outline_distance(outline, polygon) for polygon in (other, *more)], axis=0)
    strength = (clearance / np.maximum(distance, clearance)) ** (2 / 3)
    sharp = (turn > 0) & (ring[:, 0] > 0)
    return tuple((float(r), float(z), float(s)) for (r, z), s in zip(ring[sharp], strength[sharp], strict=True))


def outlines_meet(one: Points, other: Points) -> bool:
    """Whether an outline enters another polygon."""
    return _enters(one, other) or _enters(other, one)


def _enters(outline: Points, polygon: Points) -> bool:
    """Whether points along an outline lie in a polygon (even-odd rule)."""
    start, ring = np.array(outline), np.array(polygon)
    along = np.roll(start, -1, axis=0) - start
    x, y = (start[:, None] + along[:, None] * ((np.arange(N_ALONG) + 0.5) / N_ALONG)[:, None]).reshape(-1, 2).T
    inside = np.zeros(x.size, dtype=bool)
    for (x0, y0), (x1, y1) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        if y0 != y1:
            inside ^= ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    deep = np.flatnonzero(inside)
    if not deep.size:
        return False
    distance = outline_distance(list(zip(x[deep], y[deep], strict=True)), polygon)
    return bool(distance.max() > TOUCHING * np.abs(ring).max())
