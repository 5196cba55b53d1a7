"""The pot core: a post in its coil inside a ring, of one piece with the yoke, facing a disc."""

import math
from typing import ClassVar, Literal

from pydantic import model_validator

from msl_fem.files.dimensions import Clearance, Length
from msl_fem.magnetics.kinds.ends import mean_height
from msl_fem.magnetics.kinds.kind import (
    CircuitOfKind,
    CircuitPart,
    DrawnLength,
    FlatFaceMagnet,
    FringeEdge,
    LeakageWindow,
    PoleFace,
    SizedLengths,
    WindingSpace,
)
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.kinds.proportions import check_coil_fits, check_proportions
from msl_fem.magnetics.section import IronPart, Line, Section, rectangle

_SECTION_LENGTHS = (
    "post_diameter", "window_width", "window_height", "ring_width", "yoke_thickness", "armature_thickness",
)  # fmt: skip
BESIDE = 0.02  # of the window's width from the post's edge: where yoke and armature carry most flux


class PotCore(FlatFaceMagnet):
    """A body of revolution about the post's axis: post, winding, ring and yoke, facing a disc that is attracted.

    Attributes
    ----------
    post_diameter : of the pole in the middle
    window_width, window_height : of the room of the winding, radially and along the axis
    ring_width : of the outer wall, radially
    yoke_thickness, armature_thickness : along the axis
    armature_overhang : of the disc beyond the ring, radially
    """

    TOLERANCED: ClassVar = ("post_diameter", "ring_width", "yoke_thickness", "armature_thickness")
    SIZED: ClassVar = SizedLengths(
        pole="post_diameter",
        return_pole="ring_width",
        parts=(("ring", "return_width"), ("yoke", "yoke_thickness"), ("armature", "armature_thickness")),
    )

    kind: Literal["pot-core"]
    post_diameter: Length
    window_width: Length
    window_height: Length
    ring_width: Length
    yoke_thickness: Length
    armature_thickness: Length
    armature_overhang: Clearance = 0.0
    coil: Coil
    iron: IronSpec
    air: Air | None = None

    @model_validator(mode="after")
    def _lengths_belong_to_one_magnet(self) -> "PotCore":
        coil = self.coil
        lengths = {name: float(getattr(self, name)) for name in _SECTION_LENGTHS}
        check_proportions(
            lengths | {"coil.width": coil.width, "coil.height": coil.height},
            clearances={
                "armature_overhang": self.armature_overhang,
                "coil.leg_clearance": coil.leg_clearance,
                "coil.face_clearance": coil.face_clearance,
            },
            margins={f"air.{side}": margin for side, margin in self.air or ()},
        )
        check_coil_fits("width", coil.leg_clearance + coil.width, self.window_width)
        check_coil_fits("height", coil.face_clearance + coil.height, self.window_height)
        return self

    @property
    def half_width(self) -> float:
        """The core's outer radius."""
        return self._ring_radius + self.ring_width

    @property
    def _ring_radius(self) -> float:
        """Of the ring's inside, in m."""
        return self.post_diameter / 2 + self.window_width

    def section(self, gap: float) -> Section:
        """The half plane r >= 0: x is r, y is z."""
        post, inner, half, wide = self.post_diameter / 2, self._ring_radius, self.half_width, self.armature_half_width
        roof, top, low = gap + self.window_height, gap + self.height, -self.armature_thickness
        coil = self.coil
        left, bottom = post + coil.leg_clearance, gap + coil.face_clearance
        box = self.air_box.around(half=half, wide=wide, below=self.armature_thickness, above=self.height)
        faces = [(r, gap, 1.0) for r in (post, inner, half)]
        backs = [(wide, low, 0.1), (half, top, 0.1), (post, roof, 0.1), (inner, roof, 0.1)]
        return Section(
            regions=(
                rectangle("air", 0, -box.below, box.edge, gap + box.above),
                rectangle("strip", 0, 0, box.edge, gap),
                rectangle("armature", 0, low, wide, 0),
                rectangle("core", 0, gap, half, top),
                rectangle("window", post, gap, inner, roof),
                rectangle("coil", left, bottom, left + coil.width, bottom + coil.height),
            ),
            corners=(*faces, (wide, 0.0, 1.0), *backs),
            cuts=self._cuts(gap),
            iron=self.iron.by_region,
            turns_density={"coil": self.turns / self.winding_space.area},
            depth=1.0,
            gap=gap,
            far=box.far,
            parts=self._parts(gap),
            symmetry="axis",
        )

    def _cuts(self, gap: float) -> tuple[Line, ...]:
        """Across post and ring at mid-height; around the post through yoke and armature, where flux is densest."""
        post, roof, middle = self.post_diameter / 2, gap + self.window_height, gap + self.window_height / 2
        beside = post + BESIDE * self.window_width
        return (
            Line("post", (0, middle), (post, middle)),
            Line("yoke", (beside, roof), (beside, gap + self.height)),
            Line("ring", (self._ring_radius, middle), (self.half_width, middle)),
            Line("armature", (beside, -self.armature_thickness), (beside, 0)),
        )

    def _parts(self, gap: float) -> tuple[IronPart, ...]:
        """Post and ring from the pole faces to the yoke, which is the whole disc behind."""
        roof, half = gap + self.window_height, self.half_width
        post = rectangle("post", 0, gap, self.post_diameter / 2, roof)
        yoke = rectangle("yoke", 0, roof, half, gap + self.height)
        ring = rectangle("ring", self._ring_radius, gap, half, roof)
        armature = rectangle("armature", 0, -self.armature_thickness, self.armature_half_width, 0)
        return (
            IronPart("post", "core", post.vertices),
            IronPart("yoke", "core", yoke.vertices),
            IronPart("ring", "core", ring.vertices),
            IronPart("armature", "armature", armature.vertices),
        )

    def measures(self, gap: float) -> tuple[DrawnLength, ...]:
        """Widths along the back, heights along the ring, the coil in its window."""
        post, half = self.post_diameter / 2, self.half_width
        inner, roof = post + self.window_width, gap + self.window_height
        top = roof + self.yoke_thickness
        coil = self.coil
        left, low = post + coil.leg_clearance, gap + coil.face_clearance
        return (
            DrawnLength("post_diameter", (-post, top), (post, top)),
            DrawnLength("window_width", (post, top), (inner, top)),
            DrawnLength("ring_width", (inner, top), (half, top)),
            DrawnLength("yoke_thickness", (half, roof), (half, top)),
            DrawnLength("window_height", (half, gap), (half, roof)),
            DrawnLength("armature_thickness", (half, -self.armature_thickness), (half, 0.0)),
            DrawnLength("coil.width", (left, low), (left + coil.width, low)),
            DrawnLength("coil.height", (left + coil.width, low), (left + coil.width, low + coil.height)),
        )

    @property
    def winding_space(self) -> WindingSpace:
        """Turns are circles, all of them inside the core."""
        coil = self.coil
        return WindingSpace(
            coils=1,
            perimeter=math.pi * self.post_diameter,
            clearance=coil.leg_clearance,
            width=coil.width,
            height=coil.height,
            slot_width=self.window_width,
            exposed=0.0,
        )

    @property
    def core_surface(self) -> float:
        """The yoke's back and the outside of ring and yoke."""
        return math.pi * self.half_width * (self.half_width + 2 * self.height)

    @property
    def outer_size(self) -> tuple[float, float, float]:
        """The coil lies inside the core."""
        width = 2 * max(self.half_width, self.armature_half_width)
        return width, self.armature_thickness + self.height, width

    @property
    def circuit(self) -> CircuitOfKind:
        """Post, yoke, ring and armature in series; across yoke and armature the flux spreads from post to ring.

        A disc of the thickness t between the radii a and b has the reluctance ln(b/a)/(2 pi mu t): the length b - a
        over an area at the logarithmic mean of the radii (e.g. Roters, Electromagnetic Devices, 1941, ch. V).
        """
        post, inner, half = self.post_diameter / 2, self._ring_radius, self.half_width
        post_area, ring_area = math.pi * post**2, math.pi * (half**2 - inner**2)
        share = ring_area / (post_area + ring_area)  # of the magnetomotive force across the post's gap
        across = self.window_width
        around = 2 * math.pi * across / math.log(inner / post)
        beside = 2 * math.pi * (post + BESIDE * across)
        leg = self.window_height + self.yoke_thickness / 2
        coil = self.coil
        flush = FringeEdge(2 * math.pi * half, self.armature_thickness, flush=True)
        breadth = 2 * math.pi * (post + across / 2)
        return CircuitOfKind(
            faces=(
                PoleFace(post_area, (FringeEdge(2 * math.pi * post, self._reach(share)),)),
                PoleFace(ring_area, (FringeEdge(2 * math.pi * inner, self._reach(1 - share)), flush)),
            ),
            window=LeakageWindow(breadth, across, self.window_height, coil.face_clearance, coil.height),
            parts=(
                CircuitPart("post", "core", leg, post_area),
                CircuitPart("yoke", "core", across, around * self.yoke_thickness, beside * self.yoke_thickness),
                CircuitPart("ring", "core", leg, ring_area),
                CircuitPart(
                    "armature", "armature", across, around * self.armature_thickness, beside * self.armature_thickness
                ),
            ),
            crossed=("yoke",),
            halfway=("post", "ring"),
        )

    def _reach(self, share: float) -> float:
        """The height of a leg's side that counts in its fringe, where a share of the coil's force is lost along it."""
        begin = self.coil.face_clearance
        return min(mean_height(begin, begin + share * self.coil.height), 2 * self.window_width / math.pi)
