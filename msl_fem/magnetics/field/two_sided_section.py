"""The section of two magnets on either side of the armature they share, which may be tilted."""

from dataclasses import dataclass

import numpy as np

from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.magnetics.section import Region, Section, rectangle

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


def two_sided_section(magnet: PlaneMagnet, position: TwoSidedPosition) -> TwoSidedSection:
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
    upper = magnet.section(position.gap_1)
    lower = magnet.section(position.gap_2)
    regions = _surroundings(magnet, position)
    corners: list[Corner] = []
    for side, part, gap in ((1, upper, position.gap_1), (2, lower, position.gap_2)):
        mirror = 1.0 if side == 1 else -1.0
        base = middle * (1 - mirror)  # side 2 is mirrored about the armature's middle
        for region in part.regions[1:]:  # without the air box
            if region.name in ("strip", "armature"):
                continue
            vertices = [(x, base + mirror * y) for x, y in region.vertices]
            name = _name(region.name, side)
            coil = region.name in part.turns_density
            regions.append(Region(f"{name}+" if coil else name, tuple(vertices)))
            if not half:
                mirrored = tuple((-x, y) for x, y in vertices)
                regions.append(Region(f"{name}-" if coil else name, mirrored))
        scale = (nearest / gap) ** (2 / 3)  # sizes at corners are in fractions of the section's gap
        above = [(x, base + mirror * y, s * scale) for x, y, s in part.corners if y > 0]
        corners += above if half else above + [(-x, y, s) for x, y, s in above]
    outline = [*armature[1:3], (0.0, 0.0), (0.0, 2 * middle)] if half else armature
    regions.append(Region("armature", tuple(outline)))
    corners += [(x, y, 1.0) for x, y in (armature[1:3] if half else armature)]
    turns = [_turns(upper, side, half=half) for side in (1, 2)]
    core = upper.iron["core"]
    section = Section(
        regions=tuple(regions),
        corners=tuple(corners),
        cuts=(),
        iron={"core_1": core, "core_2": core, "armature": upper.iron["armature"]},
        turns_density=turns[0] | turns[1],
        depth=magnet.stack_depth,
        gap=nearest,
        symmetry=upper.symmetry if half else "flux line",
    )
    return TwoSidedSection(section, half, (turns[0], turns[1]), (0.0, middle))


def _name(region: str, side: int) -> str:
    """The name of a side's region: windows are shared, and what is taken off the poles belongs to the gap."""
    return {"window": "window", "air": "gap"}.get(region, f"{region}_{side}")


def _turns(part: Section, side: int, *, half: bool) -> dict[str, float]:
    """Region to turns per area (1/m2); in a mirrored half currents change their sign where x = 0 is a flux line."""
    sign = -1 if part.symmetry == "flux line" else 1
    turns = {f"{name}_{side}+": density for name, density in part.turns_density.items()}
    if not half:
        turns |= {f"{name}_{side}-": sign * density for name, density in part.turns_density.items()}
    return turns


def _armature(magnet: PlaneMagnet) -> list[tuple[float, float]]:
    wide = magnet.armature_half_width
    low = -magnet.armature_thickness
    return [(-wide, low), (wide, low), (wide, 0.0), (-wide, 0.0)]


def _turned(x: float, y: float, tilt: float, middle: float) -> tuple[float, float]:
    c, s = np.cos(tilt), np.sin(tilt)
    return float(x * c - (y - middle) * s), float(middle + x * s + (y - middle) * c)


def _nearest_gap(magnet: PlaneMagnet, position: TwoSidedPosition) -> float:
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


def _surroundings(magnet: PlaneMagnet, position: TwoSidedPosition) -> list[Region]:
    """The air box and the air between the cores."""
    air, thick = magnet.air_box, magnet.armature_thickness
    wide = max(magnet.half_width, magnet.armature_half_width)
    side = magnet.half_width + air.side
    left = 0.0 if position.tilt == 0.0 else 1.0
    top = position.gap_1 + magnet.height + air.top
    bottom = -thick - position.gap_2 - magnet.height - air.top
    reach = wide + thick  # past the corners of a tilted armature
    return [
        rectangle("air", -left * side, bottom, side, top),
        rectangle("gap", -left * reach, -thick - position.gap_2, reach, position.gap_1),
    ]
