"""The section [tolerances]: how far a made magnet may be from its drawing, plus and minus."""

from typing import Annotated

from pydantic import Field

from msl_fem.actuator.quantities import Clearance
from msl_fem.files.schema import FrozenModel, In

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
