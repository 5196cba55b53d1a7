"""The kinds of magnets: an E-core by its dimensions, a table, a mesh; how far a made one may be from its drawing."""

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from msl_fem.actuator.quantities import Clearance, Fraction, Length, Turns, check_coil_fits, check_proportions, metres
from msl_fem.files.schema import FrozenModel, In
from msl_fem.materials.constants import COPPER_RESISTIVITY

_SECTION_LENGTHS = (
    "centre_leg_width", "outer_leg_width", "window_width", "window_height", "yoke_thickness", "armature_thickness",
)  # fmt: skip


class Coil(FrozenModel):
    """The coil on the centre leg: `turns` in each half window, a rectangle `width` by `height`."""

    turns: Turns
    width: Length
    height: Length
    leg_clearance: Clearance
    face_clearance: Clearance
    fill_factor: Annotated[float, Field(gt=0, lt=1)]


class IronSpec(FrozenModel):
    """Names of irons (see `msl_fem.materials.material.load_iron`) and the stacking factors of their laminations."""

    core: str
    armature: str
    stacking_factor: Fraction = 1.0
    core_stacking_factor: Fraction | None = None
    armature_stacking_factor: Fraction | None = None

    @property
    def core_stacking(self) -> float:
        return self.core_stacking_factor or self.stacking_factor

    @property
    def armature_stacking(self) -> float:
        return self.armature_stacking_factor or self.stacking_factor


class Air(FrozenModel):
    """The air box, A = 0 on it: beyond the core's half width, below the armature, above the yoke."""

    side: Length
    bottom: Length
    top: Length


class ECore(FrozenModel):
    """A laminated E-core with its coil on the centre leg, facing a flat armature."""

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

    @model_validator(mode="after")
    def _air_box_holds_the_armature(self) -> "ECore":
        if self.air is not None and self.air.side <= self.armature_overhang:
            raise ValueError(
                f"air.side {metres(self.air.side)} counts from the core and must be above "
                f"armature_overhang {metres(self.armature_overhang)}; make the air box wider"
            )
        return self

    @property
    def half_width(self) -> float:
        return self.centre_leg_width / 2 + self.window_width + self.outer_leg_width

    @property
    def height(self) -> float:
        """From the pole faces to the back of the yoke."""
        return self.window_height + self.yoke_thickness

    @property
    def armature_half_width(self) -> float:
        return self.half_width + self.armature_overhang

    @property
    def air_box(self) -> Air:
        """The stated air box, or eight times the core's width to every side.

        The cut's error falls like the square of the box. That of the default moves the force by less than 1e-4 and the
        flux linkage by less than 2e-4; E1's own box, two half widths away, by 2e-3 (saturated) and 6e-3 (1 mm).
        """
        if self.air is not None:
            return self.air
        margin = 16.0 * self.half_width
        return Air(side=margin, bottom=margin, top=margin)

    @property
    def coil_section(self) -> float:
        """Cross section of one coil side in m2."""
        return self.coil.width * self.coil.height

    @property
    def mean_turn_length(self) -> float:
        """Length of the middle turn: the straight sides and a circular arc at each corner."""
        straight = 2 * (self.stack_depth + self.centre_leg_width)
        return straight + 2 * math.pi * (self.coil.leg_clearance + self.coil.width / 2)

    @property
    def winding_resistance(self) -> float:
        """Resistance of the coil at 20 degC from its copper section: R = rho N^2 l_turn / (k_fill A_coil)."""
        copper = self.coil.fill_factor * self.coil_section
        return COPPER_RESISTIVITY * self.coil.turns**2 * self.mean_turn_length / copper


class TableMagnet(FrozenModel):
    """A magnet known by a measured or foreign table."""

    kind: Literal["table"]
    table: str


class MeshMagnet(FrozenModel):
    """A magnet whose whole plane section is a mesh of straight triangles with named regions.

    Regions: core*, armature* (what moves), coil+*, coil-* (turns that carry the current out of the plane, into it) and
    air*, which surrounds all; A = 0 on the mesh's edge.

    Attributes
    ----------
    mesh : a gmsh file with physical names, or another format of meshio with named cell sets; relative to the file
    length_unit : the length of one unit of the mesh's coordinates, like "1 mm"; metres without it
    gap : the air gap that the mesh was made at
    pull : the direction in which the armature is attracted
    turns : of all regions coil+* together, and of coil-*
    """

    kind: Literal["mesh"]
    mesh: str
    length_unit: Length = 1.0
    stack_depth: Length
    gap: Length
    pull: Literal["+x", "-x", "+y", "-y"] = "+y"
    turns: Turns
    iron: IronSpec


Share = Annotated[float, In(""), Field(ge=0, le=0.5)]


class Tolerances(FrozenModel):
    """Limits, plus and minus; what is left out has the default that `msl_fem.design.tolerances` names with its source.

    Attributes
    ----------
    gap : of every gap of a magnet, from assembly
    centre_leg_width, outer_leg_width, yoke_thickness, armature_thickness, stack_depth : of the dimension
    stacking_factor : of its value, as a number
    bh_polarisation : of the iron's polarisation at a field strength, relative
    bh_field_strength : of the field strength that a polarisation takes, relative
    """

    gap: Clearance | None = None
    centre_leg_width: Clearance | None = None
    outer_leg_width: Clearance | None = None
    yoke_thickness: Clearance | None = None
    armature_thickness: Clearance | None = None
    stack_depth: Clearance | None = None
    stacking_factor: Share | None = None
    bh_polarisation: Share | None = None
    bh_field_strength: Share | None = None
