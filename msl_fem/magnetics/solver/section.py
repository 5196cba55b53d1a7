"""The plane section of an E-core magnet as painted polygons: which region lies where, where the field is singular."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import ECore

Array = NDArray[np.float64]
NEAR = 2.0  # half widths of the core around the iron that are painted and meshed freely, if the box is larger


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


def _box(name: str, x0: float, y0: float, x1: float, y1: float) -> Region:
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def e_core_section(magnet: ECore, gap: float) -> Section:
    """The right half of an E-core over its armature: pole faces at y = gap, armature surface at y = 0."""
    centre, window = magnet.centre_leg_width / 2, magnet.window_width
    inner, half = centre + window, magnet.half_width
    top, roof = gap + magnet.height, gap + magnet.window_height
    low, wide = -magnet.armature_thickness, magnet.armature_half_width
    air, coil = magnet.air_box, magnet.coil
    left, bottom = centre + coil.leg_clearance, gap + coil.face_clearance
    # the box beyond the strip's lines: half width, depth below y = 0, height above y = gap
    box = np.array([half + air.side, magnet.armature_thickness + air.bottom, magnet.height + air.top])
    near = np.array([max(half, wide), magnet.armature_thickness, magnet.height]) + NEAR * half
    far = max(1.0, float((box / near).min()))
    edge, below, above = box / far
    regions = [
        _box("air", 0, -below, edge, gap + above),
        _box("strip", 0, 0, edge, gap),
        _box("armature", 0, low, wide, 0),
        _box("core", 0, gap, half, top),
        _box("window", centre, gap, inner, roof),
        _box("coil", left, bottom, left + coil.width, bottom + coil.height),
    ]
    poles = [(centre, -1), (inner, 1), (half, -1)]  # pole corners on y = gap, and where their iron lies
    faces = [(x, gap, 1.0) for x, _ in poles]
    if magnet.pole_chamfer:
        c = magnet.pole_chamfer
        faces = [(x + side * c, gap, 0.7) for x, side in poles] + [(x, gap + c, 0.3) for x, _ in poles]
        regions += [Region("air", ((x, gap), (x + side * c, gap), (x, gap + c))) for x, side in poles]
    corners = [*faces, (wide, 0.0, 1.0), (wide, low, 0.1), (half, top, 0.1), (centre, roof, 0.1), (inner, roof, 0.1)]
    middle = gap + magnet.window_height / 2
    across = centre + window / 2
    cuts = (
        Line("centre_leg", (0, middle), (centre, middle)),
        Line("yoke", (across, roof), (across, top)),
        Line("outer_leg", (inner, middle), (half, middle)),
        Line("armature", (across, low), (across, 0)),
    )
    iron = magnet.iron
    return Section(
        tuple(regions),
        tuple(corners),
        cuts,
        {"core": (iron.core, iron.core_stacking), "armature": (iron.armature, iron.armature_stacking)},
        {"coil": coil.turns / magnet.coil_section},
        magnet.stack_depth,
        gap,
        far,
    )
