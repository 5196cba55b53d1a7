"""The E-core: a laminated core with its coil on the centre leg, facing a flat armature."""

from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from msl_fem.files.dimensions import Clearance, Length
from msl_fem.magnetics.kinds.ends import EndFactors, KnownEnds, StackEnds, mean_height
from msl_fem.magnetics.kinds.kind import (
    CircuitOfKind,
    CircuitPart,
    DrawnLength,
    FringeEdge,
    LeakageWindow,
    PlaneMagnet,
    PoleFace,
    SizedLengths,
    WindingSpace,
)
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.kinds.proportions import check_coil_fits, check_proportions, metres
from msl_fem.magnetics.section import IronPart, Line, Region, Section, rectangle

_SECTION_LENGTHS = (
    "centre_leg_width", "outer_leg_width", "window_width", "window_height", "yoke_thickness", "armature_thickness",
)  # fmt: skip

E1_LENGTH, E1_TURNS = 20e-3, 200  # centre leg and window together, as the end turns go around them, m
E1_ENDS = EndFactors(gap=1.237, window=1.198, outer=0.393, leakage=0.326e-3)
"""By twelve solutions of E1 in three dimensions: docs/three_dimensions.md."""


class ECore(PlaneMagnet):
    """A laminated E-core with its coil on the centre leg, facing a flat armature.

    Attributes
    ----------
    centre_leg_width, outer_leg_width : of the leg, across the flux
    window_width, window_height : of the room between the legs, height along them
    yoke_thickness, armature_thickness : across the flux
    armature_overhang : of the armature beyond the outer legs, on each side
    stack_depth : of the sheets, across the section
    pole_chamfer : of the edges of the pole faces, under 45 degrees
    """

    TOLERANCED: ClassVar = (
        "centre_leg_width",
        "outer_leg_width",
        "yoke_thickness",
        "armature_thickness",
        "stack_depth",
    )
    SIZED: ClassVar = SizedLengths(
        pole="centre_leg_width",
        return_pole="outer_leg_width",
        parts=(("outer_leg", "return_width"), ("yoke", "yoke_thickness"), ("armature", "armature_thickness")),
    )

    kind: Literal["e-core"]
    centre_leg_width: Length
    outer_leg_width: Length
    window_width: Length
    window_height: Length
    yoke_thickness: Length
    armature_thickness: Length
    armature_overhang: Clearance = 0.0
    stack_depth: Length
    pole_chamfer: Clearance = 0.0
    coil: Coil
    iron: IronSpec
    air: Air | None = None

    @model_validator(mode="after")
    def _lengths_belong_to_one_magnet(self) -> "ECore":
        coil = self.coil
        lengths = {name: float(getattr(self, name)) for name in _SECTION_LENGTHS}
        check_proportions(
            lengths | {"coil.width": coil.width, "coil.height": coil.height},
            clearances={
                "armature_overhang": self.armature_overhang,
                "pole_chamfer": self.pole_chamfer,
                "coil.leg_clearance": coil.leg_clearance,
                "coil.face_clearance": coil.face_clearance,
            },
            margins={f"air.{side}": margin for side, margin in self.air or ()},
            stack_depth=self.stack_depth,
        )
        return self

    @model_validator(mode="after")
    def _coil_fits_its_window(self) -> "ECore":
        coil = self.coil
        check_coil_fits("width", coil.leg_clearance + coil.width, self.window_width)
        check_coil_fits("height", coil.face_clearance + coil.height, self.window_height)
        return self

    @model_validator(mode="after")
    def _chamfer_leaves_a_pole(self) -> "ECore":
        largest = min(self.centre_leg_width, 2 * self.outer_leg_width) / 4
        if self.pole_chamfer > largest:
            raise ValueError(
                f"pole_chamfer {metres(self.pole_chamfer)} is above {metres(largest)}, a quarter of the thinnest pole; "
                "make it smaller"
            )
        return self

    @property
    def half_width(self) -> float:
        return self.centre_leg_width / 2 + self.window_width + self.outer_leg_width

    def section(self, gap: float) -> Section:
        """The right half of the core over its armature; x = 0 is a flux line."""
        centre = self.centre_leg_width / 2
        inner, half, wide = centre + self.window_width, self.half_width, self.armature_half_width
        roof, top, low = gap + self.window_height, gap + self.height, -self.armature_thickness
        coil = self.coil
        left = centre + coil.leg_clearance
        bottom = gap + coil.face_clearance
        box = self.air_box.around(half=half, wide=wide, below=self.armature_thickness, above=self.height)
        regions = [
            rectangle("air", 0, -box.below, box.edge, gap + box.above),
            rectangle("strip", 0, 0, box.edge, gap),
            rectangle("armature", 0, low, wide, 0),
            rectangle("core", 0, gap, half, top),
            rectangle("window", centre, gap, inner, roof),
            rectangle("coil", left, bottom, left + coil.width, bottom + coil.height),
        ]
        poles = [(centre, -1), (inner, 1), (half, -1)]  # pole corners on y = gap, and where their iron lies
        faces = [(x, gap, 1.0) for x, _ in poles]
        if self.pole_chamfer:
            c = self.pole_chamfer
            faces = [(x + side * c, gap, 0.7) for x, side in poles] + [(x, gap + c, 0.3) for x, _ in poles]
            regions += [Region("air", ((x, gap), (x + side * c, gap), (x, gap + c))) for x, side in poles]
        backs = [(wide, low, 0.1), (half, top, 0.1), (centre, roof, 0.1), (inner, roof, 0.1)]
        return Section(
            regions=tuple(regions),
            corners=(*faces, (wide, 0.0, 1.0), *backs),
            cuts=self._cuts(gap),
            iron=self.iron.by_region,
            turns_density={"coil": self.turns / self.winding_space.area},
            depth=self.stack_depth,
            gap=gap,
            far=box.far,
            parts=self._parts(gap),
        )

    def _cuts(self, gap: float) -> tuple[Line, ...]:
        """Across the legs at mid-height, across yoke and armature in the middle of the window."""
        centre = self.centre_leg_width / 2
        inner = centre + self.window_width
        middle = gap + self.window_height / 2
        across = centre + self.window_width / 2
        return (
            Line("centre_leg", (0, middle), (centre, middle)),
            Line("yoke", (across, gap + self.window_height), (across, gap + self.height)),
            Line("outer_leg", (inner, middle), (self.half_width, middle)),
            Line("armature", (across, -self.armature_thickness), (across, 0)),
        )

    def _parts(self, gap: float) -> tuple[IronPart, ...]:
        """Legs from the pole faces to the yoke; the yoke has the corners, the armature its overhang."""
        centre = self.centre_leg_width / 2
        inner, half = centre + self.window_width, self.half_width
        roof, c = gap + self.window_height, self.pole_chamfer
        chamfered = (inner, gap + c), (inner + c, gap), (half - c, gap), (half, gap + c)
        yoke = rectangle("yoke", 0, roof, half, gap + self.height)
        armature = rectangle("armature", 0, -self.armature_thickness, self.armature_half_width, 0)
        return (
            IronPart("centre_leg", "core", ((0, gap), (centre - c, gap), (centre, gap + c), (centre, roof), (0, roof))),
            IronPart("yoke", "core", yoke.vertices),
            IronPart("outer_leg", "core", (*chamfered, (half, roof), (inner, roof))),
            IronPart("armature", "armature", armature.vertices),
        )

    def measures(self, gap: float) -> tuple[DrawnLength, ...]:
        """Widths along the back, heights along the outer leg, the coil in its window."""
        c, half = self.centre_leg_width / 2, self.half_width
        inner, roof, top = c + self.window_width, gap + self.window_height, gap + self.height
        coil = self.coil
        left, low = c + coil.leg_clearance, gap + coil.face_clearance
        return (
            DrawnLength("centre_leg_width", (-c, top), (c, top)),
            DrawnLength("window_width", (c, top), (inner, top)),
            DrawnLength("outer_leg_width", (inner, top), (half, top)),
            DrawnLength("yoke_thickness", (half, roof), (half, top)),
            DrawnLength("window_height", (half, gap), (half, roof)),
            DrawnLength("armature_thickness", (half, -self.armature_thickness), (half, 0.0)),
            DrawnLength("coil.width", (left, low), (left + coil.width, low)),
            DrawnLength("coil.height", (left + coil.width, low), (left + coil.width, low + coil.height)),
        )

    @property
    def winding_space(self) -> WindingSpace:
        coil = self.coil
        perimeter = 2 * (self.stack_depth + self.centre_leg_width)
        mean = perimeter + 2 * np.pi * (coil.leg_clearance + coil.width / 2)
        return WindingSpace(
            coils=1,
            perimeter=perimeter,
            clearance=coil.leg_clearance,
            width=coil.width,
            height=coil.height,
            slot_width=self.window_width,
            exposed=mean - 2 * self.stack_depth,
        )

    @property
    def core_surface(self) -> float:
        """Both ends of the stack, back and sides."""
        section = 2 * self.half_width * self.height - 2 * self.window_width * self.window_height
        return 2 * section + (2 * self.half_width + 2 * self.height) * self.stack_depth

    @property
    def pole_faces(self) -> tuple[tuple[float, float], ...]:
        legs = (self.centre_leg_width, self.outer_leg_width, self.outer_leg_width)
        return tuple((width, self.stack_depth) for width in legs)

    @property
    def outer_size(self) -> tuple[float, float, float]:
        """The coil lies inside the windows; its end turns stand out of the stack."""
        turns = self.coil.leg_clearance + self.coil.width
        width = 2 * max(self.half_width, self.armature_half_width)
        return width, self.armature_thickness + self.height, self.stack_depth + 2 * turns

    @property
    def stack_ends(self) -> StackEnds:
        """The pole's end face keeps the gap's magnetomotive force up to the coil, along which it is lost."""
        coil = self.coil
        centre = self.centre_leg_width / 2
        outer = self.outer_leg_width
        share = outer / (centre + outer)  # of the coil's force in the centre leg's gap: as the reluctances
        reach = mean_height(coil.face_clearance, coil.face_clearance + share * coil.height)
        return StackEnds(
            depth=self.stack_depth,
            reach=min(reach, self.armature_thickness),
            window_width=self.window_width,
            legs=(self.outer_leg_width, centre),
            mirror=True,
        )

    @property
    def known_ends(self) -> KnownEnds:
        """E1's in three dimensions; the leakage goes with the end turns' length and the square of their number."""
        length = (self.centre_leg_width + self.window_width) / E1_LENGTH
        leakage = E1_ENDS.leakage * length * (self.coil.turns / E1_TURNS) ** 2
        return KnownEnds(
            factors=replace(E1_ENDS, leakage=leakage),
            force_error=0.012,
            flux_error=0.014,
            share=0.12,
            source="factors by solutions of E1 in three dimensions",
        )

    @property
    def circuit(self) -> CircuitOfKind:
        """Centre leg, yoke, outer legs and armature; both halves of the section in parallel."""
        c, o, depth = self.centre_leg_width, self.outer_leg_width, self.stack_depth
        share = 2 * o / (c + 2 * o)  # of the magnetomotive force across the centre leg's gap, as the reluctances
        leg = self.window_height + self.yoke_thickness / 2
        across = self.window_width + c / 4 + o / 2
        coil = self.coil
        inner = FringeEdge(2 * depth, self._reach(1 - share))
        flush = FringeEdge(2 * depth, self.armature_thickness, flush=True)
        return CircuitOfKind(
            faces=(
                PoleFace(c * depth, (FringeEdge(2 * depth, self._reach(share)),)),
                PoleFace(2 * o * depth, (inner, flush)),
            ),
            window=LeakageWindow(2 * depth, self.window_width, self.window_height, coil.face_clearance, coil.height),
            parts=(
                CircuitPart("centre_leg", "core", leg, c * depth),
                CircuitPart("yoke", "core", across, 2 * self.yoke_thickness * depth),
                CircuitPart("outer_leg", "core", leg, 2 * o * depth),
                CircuitPart("armature", "armature", across, 2 * self.armature_thickness * depth),
            ),
            crossed=("yoke",),
            halfway=("centre_leg", "outer_leg"),
        )

    def _reach(self, share: float) -> float:
        """The height of a leg's side that counts in its fringe, where a share of the coil's force is lost along it."""
        begin = self.coil.face_clearance
        return min(mean_height(begin, begin + share * self.coil.height), 2 * self.window_width / np.pi)
