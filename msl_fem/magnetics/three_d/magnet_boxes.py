"""A quarter of a magnet as boxes, from the section that its kind draws: a stack with its end turns, or a pot core."""

import math
from pathlib import Path

import numpy as np

from msl_fem.actuator import MagnetKind
from msl_fem.errors import InputError
from msl_fem.magnetics.kinds.kind import PlaneMagnet
from msl_fem.magnetics.kinds.pot_core import PotCore
from msl_fem.magnetics.section import Region, Section
from msl_fem.magnetics.three_d.boxes import Box, BoxModel, Interval, Racetrack
from msl_fem.magnetics.three_d.coenergy_law import coenergy_curves
from msl_fem.magnetics.three_d.tensor_grid import SizeNear
from msl_fem.materials.material import load_iron

FINEST = 1 / 6  # of the gap: the elements beside a pole face's edge
QUARTER = math.pi / 2  # of a turn
LAYERS = 3  # of boxes over it


def magnet_boxes(magnet: MagnetKind, gap: float, folder: Path, *, ends: bool = True) -> BoxModel:
    """A quarter of the magnet at a gap, x >= 0 and z >= 0, from the middle of the stack to the air beyond its end.

    Without `ends` the stack's end is a flux line: the plane section in one layer of boxes. A pot core is a quarter of
    a turn, with the radius and the angle about the axis in the place of x and z.

    Raises
    ------
    InputError : neither a stack of sheets nor a pot core, chamfered poles, a pot core of sheets
    MaterialError : an iron that cannot be read
    """
    if not isinstance(magnet, PlaneMagnet | PotCore):
        raise InputError("three dimensions are solved for e-core, u-core and pot-core; leave --dimension out")
    section = magnet.section(gap)
    if any(not _upright(region) for region in section.regions):
        raise InputError("three dimensions take no chamfered poles; set pole_chamfer to 0 mm or leave --dimension out")
    round_core = isinstance(magnet, PotCore)
    if round_core and any(stacking < 1 for _, stacking in section.iron.values()):
        raise InputError("three dimensions take a pot core of solid iron; set its stacking factors to 1")
    half, ends = (QUARTER, False) if isinstance(magnet, PotCore) else (magnet.stack_depth / 2, ends)
    curves = coenergy_curves([(load_iron(name, folder=folder), stacking) for name, stacking in section.iron.values()])
    x, y = _air(section)
    sizes = [SizeNear(0.0, gap * FINEST / strength) for _, _, strength in section.corners]
    near = [
        tuple(SizeNear(corner[axis], s.size) for corner, s in zip(section.corners, sizes, strict=True))
        for axis in range(2)
    ]
    edge = SizeNear(half, gap * FINEST)
    return BoxModel(
        boxes=_painted(section, half),
        curves=curves,
        coil=_coil(magnet, section, half if ends else math.inf),
        air=(x, y, (0.0, half + x[1] - magnet.half_width if ends else half)),
        breaks=((), (0.0, gap), tuple(np.linspace(0, half, LAYERS + 1)) if round_core else ()),
        near=(near[0], near[1], (edge,) if ends else (SizeNear(0.0, half),)),
        equipotential=section.symmetry == "equipotential",
        polar=round_core,
    )


def _painted(section: Section, half: float) -> tuple[Box, ...]:
    """The section's regions but its air, of iron over 0 < z < half, of turns over all of it."""
    irons = list(section.iron)
    solid = [region for region in section.regions if region.name not in ("air", "strip")]
    return tuple(
        Box(irons.index(r.name) if r.name in irons else -1, *_sides(r), (0.0, half if r.name in irons else math.inf))
        for r in solid
    )


def _upright(region: Region) -> bool:
    """Whether a region is a rectangle along the axes."""
    x, y = np.array(region.vertices).T
    return len(region.vertices) == 4 and np.unique(x).size == 2 and np.unique(y).size == 2


def _sides(region: Region) -> tuple[Interval, Interval]:
    x, y = np.array(region.vertices).T
    return (float(x.min()), float(x.max())), (float(y.min()), float(y.max()))


def _air(section: Section) -> tuple[Interval, Interval]:
    """x and y of the section's box of air."""
    (air,) = (region for region in section.regions if region.name == "air" and len(region.vertices) == 4)
    (_, right), (low, high) = _sides(air)
    return (0.0, section.far * right), (section.far * low, section.far * high)


def _coil(magnet: PlaneMagnet | PotCore, section: Section, half: float) -> Racetrack:
    """The coil round the leg that it encloses, which begins at x = 0 or between the coil's two sides; |z| < half."""
    coil = magnet.coil
    sides = sorted(_sides(region) for region in section.regions if region.name in section.turns_density)
    height = sides[0][1]
    if len(sides) == 1:
        edge = sides[0][0][0] - coil.leg_clearance
        leg = (-edge, edge)
    else:
        leg = sides[0][0][1] + coil.leg_clearance, sides[1][0][0] - coil.leg_clearance
    turns = magnet.turns / magnet.winding_space.coils
    return Racetrack(leg, (-half, half), coil.leg_clearance, coil.width, height, turns)
