"""The U-core: a laminated core with a coil on each leg, both in series, facing a flat armature."""

from typing import ClassVar, Literal

import numpy as np
from pydantic import model_validator

from msl_fem.files.dimensions import Clearance, Length
from msl_fem.magnetics.kinds.ends import KnownEnds, StackEnds, mean_height
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
from msl_fem.magnetics.kinds.proportions import check_coil_fits, check_proportions
from msl_fem.magnetics.section import IronPart, Line, Section, rectangle

_SECTION_LENGTHS = ("leg_width", "window_width", "window_height", "yoke_thickness", "armature_thickness")


class UCore(PlaneMagnet):
    """A laminated U-core over a flat armature; each leg carries half the turns, so that flux goes round through both.

    The right half is solved: x = 0 cuts yoke and armature where the field goes straight across.

    Attributes
    ----------
    leg_width : of each leg, across the flux
    window_width, window_height : of the room between the legs, height along them
    yoke_thickness, armature_thickness : across the flux
    armature_overhang : of the armature beyond the legs, on each side
    stack_depth : of the sheets, across the section
    """

    TOLERANCED: ClassVar = ("leg_width", "yoke_thickness", "armature_thickness", "stack_depth")
    SIZED: ClassVar = SizedLengths(
        pole="leg_width",
        return_pole=None,
        parts=(("yoke", "yoke_thickness"), ("armature", "armature_thickness")),
        coils=2,
    )

    kind: Literal["u-core"]
    leg_width: Length
    window_width: Length
    window_height: Length
    yoke_thickness: Length
    armature_thickness: Length
    armature_overhang: Clearance = 0.0
    stack_depth: Length
    coil: Coil
    iron: IronSpec
    air: Air | None = None

    @model_validator(mode="after")
    def _lengths_belong_to_one_magnet(self) -> "UCore":
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
            stack_depth=self.stack_depth,
        )
        return self

    @model_validator(mode="after")
    def _coils_fit_the_window(self) -> "UCore":
        coil = self.coil
        check_coil_fits("width", coil.leg_clearance + coil.width, self.window_width / 2)
        check_coil_fits("height", coil.face_clearance + coil.height, self.window_height)
        outside = coil.leg_clearance + coil.width
        if self.air is not None and self.air.side <= outside:
            raise ValueError(f"air.side {self.air.side:g} m must be above that of the outer coil sides, {outside:g} m")
        if coil.turns % 2:
            raise ValueError(f"coil.turns {coil.turns} is odd; both legs carry the same number: give an even one")
        return self

    @property
    def half_width(self) -> float:
        return self.window_width / 2 + self.leg_width

    def section(self, gap: float) -> Section:
        """The right leg over half the armature, with both sides of its coil; x = 0 is an equipotential."""
        inner, half, wide = self.window_width / 2, self.half_width, self.armature_half_width
        roof, top, low = gap + self.window_height, gap + self.height, -self.armature_thickness
        coil = self.coil
        bottom = gap + coil.face_clearance
        left, right = inner - coil.leg_clearance - coil.width, half + coil.leg_clearance
        beyond = max(half, right + coil.width)
        box = self.air_box.around(half=half, wide=max(wide, beyond), below=self.armature_thickness, above=self.height)
        density = self.turns / self.winding_space.area
        backs = [(wide, low, 0.1), (half, top, 0.1), (inner, roof, 0.1)]
        return Section(
            regions=(
                rectangle("air", 0, -box.below, box.edge, gap + box.above),
                rectangle("strip", 0, 0, box.edge, gap),
                rectangle("armature", 0, low, wide, 0),
                rectangle("core", 0, gap, half, top),
                rectangle("window", 0, gap, inner, roof),
                rectangle("coil_in", left, bottom, left + coil.width, bottom + coil.height),
                rectangle("coil_out", right, bottom, right + coil.width, bottom + coil.height),
            ),
            corners=((inner, gap, 1.0), (half, gap, 1.0), (wide, 0.0, 1.0), *backs),
            cuts=self._cuts(gap),
            iron=self.iron.by_region,
            turns_density={"coil_in": -density, "coil_out": density},
            depth=self.stack_depth,
            gap=gap,
            far=box.far,
            parts=self._parts(gap),
            symmetry="equipotential",
        )

    def _cuts(self, gap: float) -> tuple[Line, ...]:
        """Across the leg at mid-height, across yoke and armature in the middle of the magnet."""
        middle = gap + self.window_height / 2
        return (
            Line("leg", (self.window_width / 2, middle), (self.half_width, middle)),
            Line("yoke", (0, gap + self.window_height), (0, gap + self.height)),
            Line("armature", (0, -self.armature_thickness), (0, 0)),
        )

    def _parts(self, gap: float) -> tuple[IronPart, ...]:
        """Legs from the pole faces to the yoke; the yoke has the corners, the armature its overhang."""
        roof, half = gap + self.window_height, self.half_width
        leg = rectangle("leg", self.window_width / 2, gap, half, roof)
        yoke = rectangle("yoke", 0, roof, half, gap + self.height)
        armature = rectangle("armature", 0, -self.armature_thickness, self.armature_half_width, 0)
        return (
            IronPart("leg", "core", leg.vertices),
            IronPart("yoke", "core", yoke.vertices),
            IronPart("armature", "armature", armature.vertices),
        )

    def measures(self, gap: float) -> tuple[DrawnLength, ...]:
        """Widths along the back, heights along the leg, the coil's outer side."""
        inner, half = self.window_width / 2, self.half_width
        roof, top = gap + self.window_height, gap + self.height
        coil = self.coil
        left, low = half + coil.leg_clearance, gap + coil.face_clearance
        return (
            DrawnLength("window_width", (-inner, top), (inner, top)),
            DrawnLength("leg_width", (inner, top), (half, top)),
            DrawnLength("yoke_thickness", (half, roof), (half, top)),
            DrawnLength("window_height", (half, gap), (half, roof)),
            DrawnLength("armature_thickness", (half, -self.armature_thickness), (half, 0.0)),
            DrawnLength("coil.width", (left, low), (left + coil.width, low)),
            DrawnLength("coil.height", (left + coil.width, low), (left + coil.width, low + coil.height)),
        )

    @property
    def winding_space(self) -> WindingSpace:
        """Of the turns' two long sides one lies in the window, so that one stack depth of each turn is covered."""
        coil = self.coil
        perimeter = 2 * (self.stack_depth + self.leg_width)
        mean = perimeter + 2 * np.pi * (coil.leg_clearance + coil.width / 2)
        return WindingSpace(
            coils=2,
            perimeter=perimeter,
            clearance=coil.leg_clearance,
            width=coil.width,
            height=coil.height,
            slot_width=self.window_width,
            exposed=mean - self.stack_depth,
        )

    @property
    def core_surface(self) -> float:
        """Both ends of the stack and the back; the legs' sides lie under the coils, the yoke's are free."""
        section = 2 * self.half_width * self.height - self.window_width * self.window_height
        return 2 * section + 2 * (self.half_width + self.yoke_thickness) * self.stack_depth

    @property
    def pole_faces(self) -> tuple[tuple[float, float], ...]:
        return ((self.leg_width, self.stack_depth),) * 2

    @property
    def outer_size(self) -> tuple[float, float, float]:
        """The coils' turns stand out on all four sides."""
        turns = self.coil.leg_clearance + self.coil.width
        width = 2 * max(self.half_width + turns, self.armature_half_width)
        return width, self.armature_thickness + self.height, self.stack_depth + 2 * turns

    @property
    def stack_ends(self) -> StackEnds:
        """The pole's end face keeps the gap's magnetomotive force up to the coil, along which all of it is lost."""
        begin = self.coil.face_clearance
        return StackEnds(
            depth=self.stack_depth,
            reach=min(mean_height(begin, begin + self.coil.height), self.armature_thickness),
            window_width=self.window_width,
            legs=(self.leg_width, self.leg_width),
            mirror=False,
            regions=("window", "coil_in"),
        )

    @property
    def known_ends(self) -> KnownEnds:
        """The formulas' factors, which solutions in three dimensions bear out."""
        return KnownEnds(
            force_error=0.011,
            flux_error=0.008,
            share=0.12,
            source="as derived, which solutions in three dimensions bear out",
        )

    @property
    def circuit(self) -> CircuitOfKind:
        """Leg, yoke, leg and armature in series, each with its whole section."""
        depth, coil = self.stack_depth, self.coil
        begin = coil.face_clearance
        reach = min(mean_height(begin, begin + coil.height), 2 * self.window_width / np.pi)
        edges = (FringeEdge(depth, reach), FringeEdge(depth, self.armature_thickness, flush=True))
        face = PoleFace(self.leg_width * depth, edges)
        leg = 2 * (self.window_height + self.yoke_thickness / 2)
        across = self.window_width + self.leg_width
        return CircuitOfKind(
            faces=(face, face),
            window=LeakageWindow(depth, self.window_width, self.window_height, begin, coil.height),
            parts=(
                CircuitPart("leg", "core", leg, self.leg_width * depth),
                CircuitPart("yoke", "core", across, self.yoke_thickness * depth),
                CircuitPart("armature", "armature", across, self.armature_thickness * depth),
            ),
            crossed=("yoke",),
            halfway=("leg",),
        )
