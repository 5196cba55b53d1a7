"""The plane section of two E-core magnets on either side of one armature, which may be tilted."""

from dataclasses import dataclass

import numpy as np

from msl_fem.actuator import ECore
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.solver.section import Region, Section, e_core_section

SMALLEST_GAP = 0.02  # of the mean gap: what a tilt must leave at the armature's edge
Corner = tuple[float, float, float]


@dataclass(frozen=True)
class TwoSidedPosition:
    """Where the armature stands: the gaps of side 1 (above) and side 2 in m, its tilt anticlockwise in rad."""

    gap_1: float
    gap_2: float
    tilt: float = 0.0


@dataclass(frozen=True)
class TwoSidedSection:
    """The section, the symmetry it uses, and where things are.

    Attributes
    ----------
    section : coils are the regions coil_1+, coil_2+ (x > 0) and, in a full section, coil_1-, coil_2-
    half : x >= 0 only, with A = 0 on x = 0; without tilt
    turns_density : by side, region to turns per area (1/m2): positive currents drive flux along the same direction
    centre : the armature's centre (x, y) in m
    """

    section: Section
    half: bool
    turns_density: tuple[dict[str, float], dict[str, float]]
    centre: tuple[float, float]


def two_sided_section(magnet: ECore, position: TwoSidedPosition) -> TwoSidedSection:
    """Side 1 above and side 2, its mirror image, below an armature whose centre lies half its thickness below y = 0.

    Without tilt x = 0 is a flux line and half the section serves; a tilt turns the armature about its centre.

    Raises
    ------
    InputError : the tilted armature comes nearer to a core than a fiftieth of the gap
    """
    middle = -magnet.armature_thickness / 2
    half = position.tilt == 0.0
    armature = [_turned(x, y, position.tilt, middle) for x, y in _armature(magnet)]
    nearest = _nearest_gap(magnet, position)
    one = e_core_section(magnet, position.gap_1)
    two = e_core_section(magnet, position.gap_2)
    regions, corners = _surroundings(magnet, position), list[Corner]()
    for side, part, gap in ((1, one, position.gap_1), (2, two, position.gap_2)):
        mirror = 1.0 if side == 1 else -1.0
        base = middle * (1 - mirror)  # side 2 is mirrored about the armature's middle
        painted = [r for r in part.regions if r.name in ("core", "window", "coil")]
        painted += [Region("gap", r.vertices) for r in part.regions[6:]]  # chamfers
        for region in painted:
            vertices = [(x, base + mirror * y) for x, y in region.vertices]
            name = region.name if region.name in ("window", "gap") else f"{region.name}_{side}"
            regions.append(Region(f"{name}+" if region.name == "coil" else name, tuple(vertices)))
            if not half:
                mirrored = tuple((-x, y) for x, y in vertices)
                regions.append(Region(f"{name}-" if region.name == "coil" else name, mirrored))
        scale = (nearest / gap) ** (2 / 3)  # sizes at corners are in fractions of the section's gap
        above = [(x, base + mirror * y, s * scale) for x, y, s in part.corners if y > 0]
        corners += above if half else above + [(-x, y, s) for x, y, s in above]
    regions.append(Region("armature", (*armature[1:3], (0.0, 0.0), (0.0, 2 * middle)) if half else tuple(armature)))
    corners += [(x, y, 1.0) for x, y in (armature[1:3] if half else armature)]
    density = magnet.coil.turns / magnet.coil_section
    turns = [{f"coil_{k}+": density} | ({} if half else {f"coil_{k}-": -density}) for k in (1, 2)]
    core, plate = one.iron["core"], one.iron["armature"]
    section = Section(
        tuple(regions),
        tuple(corners),
        (),
        {"core_1": core, "core_2": core, "armature": plate},
        turns[0] | turns[1],
        magnet.stack_depth,
        nearest,
    )
    return TwoSidedSection(section, half, (turns[0], turns[1]), (0.0, middle))


def _armature(magnet: ECore) -> list[tuple[float, float]]:
    wide, low = magnet.armature_half_width, -magnet.armature_thickness
    return [(-wide, low), (wide, low), (wide, 0.0), (-wide, 0.0)]


def _turned(x: float, y: float, tilt: float, middle: float) -> tuple[float, float]:
    c, s = np.cos(tilt), np.sin(tilt)
    return float(x * c - (y - middle) * s), float(middle + x * s + (y - middle) * c)


def _nearest_gap(magnet: ECore, position: TwoSidedPosition) -> float:
    """The smallest distance between armature and pole faces; InputError where nothing is left."""
    smaller = min(position.gap_1, position.gap_2)
    corner = magnet.half_width if magnet.armature_overhang == 0 else magnet.armature_half_width
    left = smaller - corner * abs(np.sin(position.tilt))
    if left < SMALLEST_GAP * smaller:
        largest = np.arcsin(min(1.0, (1 - SMALLEST_GAP) * smaller / corner))
        raise InputError(
            f"tilt {format_quantity(position.tilt, 'rad')} brings the armature against a core; at a gap of "
            f"{format_quantity(smaller, 'm')} it may be at most {format_quantity(float(largest), 'rad')}"
        )
    return float(left)


def _surroundings(magnet: ECore, position: TwoSidedPosition) -> list[Region]:
    """The air box and the air between the cores."""
    air, thick = magnet.air_box, magnet.armature_thickness
    wide = max(magnet.half_width, magnet.armature_half_width)
    side, left = magnet.half_width + air.side, 0.0 if position.tilt == 0.0 else 1.0
    top = position.gap_1 + magnet.height + air.top
    bottom = -thick - position.gap_2 - magnet.height - air.top
    reach = wide + thick  # past the corners of a tilted armature
    return [
        _rectangle("air", (-left * side, bottom), (side, top)),
        _rectangle("gap", (-left * reach, -thick - position.gap_2), (reach, position.gap_1)),
    ]


def _rectangle(name: str, low: tuple[float, float], high: tuple[float, float]) -> Region:
    (x0, y0), (x1, y1) = low, high
    return Region(name, ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
