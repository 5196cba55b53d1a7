"""A plane section as painted polygons: which region lies where, where the field is singular, where it is read."""

from dataclasses import dataclass


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
class Section:
    """A half section x >= 0 (A = 0 on x = 0 and on the box), in metres, at the gap `gap`.

    The strip 0 <= y <= gap crosses the whole box: another gap stretches it and shifts what lies above.

    Attributes
    ----------
    regions : painted in order
    corners : where the field is singular and the mesh is graded, with the grading's strength (1: faces of the gap)
    cuts : lines on which flux density is read, none of them in the strip
    iron : region name to (iron name, stacking factor)
    turns_density : region name to turns per area (1/m2), signed
    depth : stack depth in m
    gap : the gap of these coordinates in m
    far : the air box is this many times as large as painted; between the two the mesh is stretched radially
    """

    regions: tuple[Region, ...]
    corners: tuple[tuple[float, float, float], ...]
    cuts: tuple[Line, ...]
    iron: dict[str, tuple[str, float]]
    turns_density: dict[str, float]
    depth: float
    gap: float
    far: float = 1.0


def rectangle(name: str, x0: float, y0: float, x1: float, y1: float) -> Region:
    """The region between two opposite corners."""
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
