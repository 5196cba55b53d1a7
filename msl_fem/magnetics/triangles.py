"""Triangles with named regions, and how they follow a gap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.arrays import Array


@dataclass(frozen=True, eq=False)
class MeshMotion:
    """A body that moves as the gap grows, and how the air around follows it.

    Attributes
    ----------
    share : (n_point,) of the body's displacement: 1 on it, 0 on what stands still, between in the air
    direction : (2,) unit vector of the displacement
    """

    share: Array
    direction: Array


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """Straight-edged triangles.

    Attributes
    ----------
    points : (2, n_point) in m
    triangles : (3, n_triangle) point indices
    region : (n_triangle,) index into `names`
    names : region names
    gap : the gap of these coordinates in m
    motion : how points follow the gap; None where a strip stretches and what lies above it is shifted
    """

    points: Array
    triangles: NDArray[np.int64]
    region: NDArray[np.int64]
    names: tuple[str, ...]
    gap: float
    motion: "MeshMotion | None" = None

    def elements(self, *names: str) -> NDArray[np.int64]:
        """Indices of the triangles in the regions named."""
        indices = [k for k, name in enumerate(self.names) if name in names]
        return np.flatnonzero(np.isin(self.region, indices))

    @property
    def areas(self) -> Array:
        """(n_triangle,) m2."""
        (x0, x1, x2), (y0, y1, y2) = self.points[:, self.triangles]
        return np.asarray(np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / 2)

    @property
    def edges(self) -> NDArray[np.int64]:
        """(2, 3 n_triangle) point indices of the triangles' first edges, then the second, then the third."""
        first, second, third = self.triangles
        return np.stack([np.concatenate([first, second, third]), np.concatenate([second, third, first])])

    def at_gap(self, gap: float, points: Array | None = None) -> Array:
        """Coordinates (2, n) at another gap, of the mesh's points or of `points` at this mesh's gap.

        The strip is stretched, what lies above it shifted; with a motion the mesh's own points alone can be moved.
        """
        if self.motion is not None:
            assert points is None, "the mesh's own points"
            return self.points + self.motion.share * self.motion.direction[:, None] * (gap - self.gap)
        x, y = self.points if points is None else points
        moved = np.where(y <= 0, y, np.where(y >= self.gap, y + gap - self.gap, y * gap / self.gap))
        return np.stack([x, moved])


def hat_gradients(mesh: TriangleMesh) -> Array:
    """(corner, 2, triangle) gradients of the linear functions that are 1 at a corner and 0 at the others."""
    x, y = mesh.points[:, mesh.triangles]  # (corner, triangle)
    twice_area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
    after, before = [1, 2, 0], [2, 0, 1]
    return np.stack([y[after] - y[before], x[before] - x[after]], axis=1) / twice_area


def single_edges(edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of the edges (2, n) that occur once, in either direction, sorted by their points."""
    low, high = np.sort(edges, axis=0)
    _, first, count = np.unique(low * (high.max(initial=0) + 1) + high, return_index=True, return_counts=True)
    return first[count == 1]


def boundary_points(mesh: TriangleMesh) -> NDArray[np.int64]:
    """Indices of the points on edges that belong to one triangle only."""
    return np.unique(mesh.edges[:, single_edges(mesh.edges)])
