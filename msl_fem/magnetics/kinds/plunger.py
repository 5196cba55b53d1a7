"""The plunger magnet: a plunger that is drawn into a frame with a ring coil, a body of revolution by its outlines."""

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from msl_fem.errors import InputError
from msl_fem.files.dimensions import Clearance, Coordinate
from msl_fem.magnetics.kinds.kind import MagnetKind, WindingSpace
from msl_fem.magnetics.kinds.outlines import convex_corners, outline_distance, outlines_meet, rectangle_points
from msl_fem.magnetics.kinds.parts import Air, Coil, IronSpec
from msl_fem.magnetics.kinds.proportions import metres
from msl_fem.magnetics.section import IronPart, Line, MovingRegions, Region, Section, rectangle

Point = tuple[Coordinate, Coordinate]
AIR = 4.0  # outer radii of air around the magnet, where none is stated


class RingCoil(Coil):
    """A coil of revolution about the axis: a rectangle from `inner_radius` outwards and from `bottom` upwards.

    Attributes
    ----------
    inner_radius : of the winding
    bottom : z of its lower end
    """

    inner_radius: Clearance
    bottom: Coordinate
    leg_clearance: Clearance = 0.0
    face_clearance: Clearance = 0.0


class Plunger(MagnetKind):
    """A magnet of revolution about r = 0 whose plunger is drawn in along z; outlines are points (r, z).

    Attributes
    ----------
    frame, plunger : outlines of the iron that stands and the iron that moves, as drawn: at gap 0
    withdrawal : the direction in which the plunger moves as the gap grows
    frame_cut, plunger_cut : lines (from, to) across them as drawn, on which flux density is read
    """

    TOLERANCED: ClassVar = ()
    OWN_MESHES: ClassVar = True

    kind: Literal["plunger"]
    frame: tuple[Point, ...] = Field(min_length=3)
    plunger: tuple[Point, ...] = Field(min_length=3)
    withdrawal: Literal["+z", "-z"] = "+z"
    frame_cut: tuple[Point, Point]
    plunger_cut: tuple[Point, Point]
    coil: RingCoil
    iron: IronSpec
    air: Air | None = None

    @model_validator(mode="after")
    def _outlines_are_of_one_magnet(self) -> "Plunger":
        coil = self._coil_outline
        for name, points in (("frame", self.frame), ("plunger", self.plunger)):
            if min(r for r, _ in points) < 0:
                raise ValueError(f"{name} has a point left of the axis; radii must be 0 or more")
        parts = {"frame": self.frame, "plunger": self.plunger, "coil": coil}
        for one, other in (("plunger", "frame"), ("plunger", "coil"), ("coil", "frame")):
            if outlines_meet(parts[one], parts[other]):
                raise ValueError(f"the {one} reaches into the {other}; draw them apart")
        if self.clearance <= 1e-4 * self.half_width:
            raise ValueError(
                f"plunger and frame are {metres(self.clearance)} apart as drawn; at least "
                f"{metres(1e-4 * self.half_width)} is needed between them"
            )
        return self

    @property
    def turns(self) -> int:
        return self.coil.turns

    @property
    def half_width(self) -> float:
        """The frame's outer radius."""
        return max(r for r, _ in self.frame)

    @property
    def clearance(self) -> float:
        """The smallest distance in m of plunger and frame as drawn."""
        near = outline_distance(self.plunger, self.frame), outline_distance(self.frame, self.plunger)
        return float(min(values.min() for values in near))

    @property
    def _coil_outline(self) -> tuple[tuple[float, float], ...]:
        coil = self.coil
        top = coil.bottom + coil.height
        return rectangle_points(coil.inner_radius, coil.bottom, coil.inner_radius + coil.width, top)

    def section(self, gap: float) -> Section:
        """The half plane r >= 0 with the plunger withdrawn by the gap.

        Raises
        ------
        InputError : the plunger would touch another part or leave the air box
        """
        shift = gap if self.withdrawal == "+z" else -gap
        moved = tuple((r, z + shift) for r, z in self.plunger)
        edge, low, high = self._box()
        for name, points in (("frame", self.frame), ("coil", self._coil_outline)):
            if outlines_meet(moved, points):
                raise InputError(f"at gap {metres(gap)} the plunger reaches into the {name}; choose another gap")
        heights = [z for _, z in moved]
        if min(heights) <= low or max(heights) >= high:
            raise InputError(
                f"at gap {metres(gap)} the plunger leaves the air box, z = {metres(low)} ... {metres(high)}; widen the "
                "box or choose a smaller gap"
            )
        frame, plunger = Region("core", self.frame), Region("armature", moved)
        corners = convex_corners(frame.vertices, moved, self.clearance)
        (a, b), cut = self.plunger_cut, self.frame_cut
        return Section(
            regions=(rectangle("air", 0.0, low, edge, high), frame, Region("coil", self._coil_outline), plunger),
            corners=(*corners, *convex_corners(moved, frame.vertices, self.clearance)),
            cuts=(Line("frame", *cut), Line("plunger", (a[0], a[1] + shift), (b[0], b[1] + shift))),
            iron=self.iron.by_region,
            turns_density={"coil": self.turns / self.winding_space.area},
            depth=1.0,
            gap=gap,
            parts=(IronPart("frame", "core", self.frame), IronPart("plunger", "armature", moved)),
            symmetry="axis",
            moving=MovingRegions(("armature",), ("air",), (0.0, math.copysign(1.0, shift)), self.clearance),
        )

    def _box(self) -> tuple[float, float, float]:
        """Outer radius, lowest and highest z of the air in m, around the magnet as drawn."""
        margin = AIR * self.half_width
        air = self.air or Air(side=margin, bottom=margin, top=margin)
        z = np.array([z for _, z in (*self.frame, *self.plunger)])
        return self.half_width + air.side, float(z.min()) - air.bottom, float(z.max()) + air.top

    @property
    def winding_space(self) -> WindingSpace:
        """Turns are circles, all of them inside the frame."""
        coil = self.coil
        return WindingSpace(
            coils=1,
            perimeter=2 * math.pi * coil.inner_radius,
            clearance=0.0,
            width=coil.width,
            height=coil.height,
            slot_width=coil.width,
            exposed=0.0,
        )
