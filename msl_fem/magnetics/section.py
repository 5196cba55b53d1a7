"""A section as painted polygons: which region lies where, where the field is singular, where it is read."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError

Symmetry = Literal["flux line", "equipotential", "axis", "none"]


@dataclass(frozen=True)
class Region:
    """A polygon of one material; a later region covers an earlier one."""

    name: str
    vertices: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Line:
    """A straight cut through iron on which flux density is read."""

    name: str
    start: tuple[float, float]
    end: tuple[float, float]


@dataclass(frozen=True)
class IronPart:
    """A part of the iron for which the cut of the same name stands: the polygon that it fills in one of the regions.

    Without a polygon it is all of the region, whose area in m2 is stated.
    """

    name: str
    region: str
    vertices: tuple[tuple[float, float], ...]
    area: float = 0.0


@dataclass(frozen=True)
class MovingRegions:
    """Where no strip crosses the section: regions that move in a direction as the gap grows, in air that follows them.

    `clearance`, the smallest distance in m of what moves and what stands, takes the gap's place in the mesh's sizes.
    """

    names: tuple[str, ...]
    air: tuple[str, ...]
    direction: tuple[float, float]
    clearance: float


@dataclass(frozen=True)
class Section:
    """A half section x >= 0 (A = 0 on the box), in metres, at the gap `gap`.

    The strip 0 <= y <= gap crosses the whole box: another gap stretches it and shifts what lies above.

    Attributes
    ----------
    regions : painted in order
    corners : where the field is singular and the mesh is graded, with the grading's strength (1: faces of the gap)
    cuts : lines on which flux density is read, none of them in the strip
    iron : region name to (iron name, stacking factor)
    turns_density : region name to turns per area (1/m2), signed
    depth : stack depth in m; 1 with an axis
    gap : the gap of these coordinates in m
    far : the air box is this many times as large as painted; between the two the mesh is stretched radially
    parts : of the iron, by the names of the cuts
    symmetry : x = 0 is a flux line (A = 0, currents change their sign), an equipotential of the field (currents keep
        their sign) or the axis of a body of revolution, x being r and y being z; "none" where all of a plane
        section is described
    moving : what moves with the gap where there is no strip
    """

    regions: tuple[Region, ...]
    corners: tuple[tuple[float, float, float], ...]
    cuts: tuple[Line, ...]
    iron: dict[str, tuple[str, float]]
    turns_density: dict[str, float]
    depth: float
    gap: float
    far: float = 1.0
    parts: tuple[IronPart, ...] = ()
    symmetry: Symmetry = "flux line"
    moving: MovingRegions | None = None

    @property
    def size_gap(self) -> float:
        """The distance in m to which the sizes of the mesh's elements relate."""
        return self.gap if self.moving is None else self.moving.clearance

    @property
    def axisymmetric(self) -> bool:
        return self.symmetry == "axis"

    @property
    def scale(self) -> float:
        """What the solved half's energy per unit depth, or that of a body of revolution, is multiplied by."""
        if self.axisymmetric:
            return 1.0
        return self.depth if self.symmetry == "none" else 2 * self.depth

    @property
    def thinnest_iron(self) -> float:
        """m: the shortest cut, one that begins on the axis or plane of symmetry counted twice."""
        if not self.cuts:
            raise InputError("this section states no cuts across its iron, so that its thickness is not known")
        lengths = []
        for cut in self.cuts:
            mirrored = cut.start[0] == 0.0 != cut.end[0]
            lengths.append(float(np.hypot(*np.subtract(cut.end, cut.start))) * (2 if mirrored else 1))
        return min(lengths)

    def thinnest_in(self, region: str) -> float | None:
        """m: the shortest cut through a region's iron, as `thinnest_iron`; None where no cut is known to lie there."""
        names = {part.name for part in self.parts if part.region == region}
        cuts = tuple(cut for cut in self.cuts if cut.name in names)
        return replace(self, cuts=cuts).thinnest_iron if cuts else None

    def part_volume(self, part: IronPart) -> float:
        """m3 of a part of the whole magnet, sheets only: its area times depth, or turned about the axis (Pappus)."""
        if not part.vertices:
            return self.iron[part.region][1] * self.scale * part.area
        area = moment = 0.0
        for (x, y), (x_next, y_next) in zip(part.vertices, (*part.vertices[1:], part.vertices[0]), strict=True):
            cross = x * y_next - x_next * y
            area += cross / 2
            moment += (x + x_next) * cross / 6  # of area, about the axis
        stacking = self.iron[part.region][1]
        if self.axisymmetric:
            return stacking * 2 * np.pi * abs(moment)
        return stacking * self.scale * abs(area)

    @property
    def iron_volumes(self) -> dict[str, float]:
        """Part to its volume in m3, as `part_volume`."""
        return {part.name: self.part_volume(part) for part in self.parts}

    @property
    def body(self) -> tuple[float, float, float, float]:
        """(smallest x, largest x, smallest y, largest y) in m of the solved half's iron and coils."""
        solid = [r.vertices for r in self.regions if r.name in self.iron or r.name in self.turns_density]
        x, y = np.concatenate([np.array(vertices) for vertices in solid]).T
        return float(x.min()), float(x.max()), float(y.min()), float(y.max())


def rectangle(name: str, x0: float, y0: float, x1: float, y1: float) -> Region:
    """The region between two opposite corners."""
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def both_halves(ring: Array) -> list[Array]:
    """The polygon (n, 2) and its mirror image about x = 0; one polygon where it touches the middle."""
    image = ring[::-1] * (-1.0, 1.0)
    on_middle = ring[:, 0] == 0.0
    if not on_middle.any():
        return [ring, image]
    last = int(np.flatnonzero(on_middle & ~np.roll(on_middle, -1))[0])
    right = np.roll(ring, -last, axis=0)  # begins on the middle, goes round, ends on it
    right = right[right[:, 0] > 0]
    return [np.concatenate([right, right[::-1] * (-1.0, 1.0)])]


def is_taken_off(region: Region) -> bool:
    """Whether a region of air is cut out of the iron: a window, or a chamfer's triangle."""
    return region.name == "window" or (region.name == "air" and len(region.vertices) == 3)
