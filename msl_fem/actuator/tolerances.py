"""The section [tolerances]: how far a manufactured magnet may be from its drawing."""

from typing import Annotated, get_args

from pydantic import Field, create_model

from msl_fem.files.dimensions import Clearance
from msl_fem.files.schema import FrozenModel, In
from msl_fem.magnetics.kinds import Magnet, MagnetKind

Share = Annotated[float, In(""), Field(ge=0, le=0.5)]
KINDS: tuple[type[MagnetKind], ...] = tuple(kind for kind in get_args(Magnet) if issubclass(kind, MagnetKind))
LENGTHS = tuple(dict.fromkeys(name for kind in KINDS for name in kind.TOLERANCED))
"""Of all kinds; each has its own of them."""


class GeneralTolerances(FrozenModel):
    """Limits, plus and minus; what is left out has the default that `msl_fem.design.tolerances` names with its source.

    Attributes
    ----------
    gap : of every gap of a magnet, from assembly
    stacking_factor : of its value, as a number
    bh_polarisation : of the iron's polarisation at a field strength, relative
    bh_field_strength : of the field strength that a polarisation takes, relative
    centre_leg_width, outer_leg_width, leg_width, post_diameter, ring_width : of that length
    yoke_thickness, armature_thickness, stack_depth : of that length
    """

    gap: Clearance | None = None
    stacking_factor: Share | None = None
    bh_polarisation: Share | None = None
    bh_field_strength: Share | None = None


def _with_lengths() -> type[GeneralTolerances]:
    lengths = {name: (Clearance | None, None) for name in LENGTHS}
    return create_model("Tolerances", __base__=GeneralTolerances, **lengths)  # type: ignore[call-overload]


Tolerances = _with_lengths()
"""`GeneralTolerances` and those of the lengths that kinds of magnets name as toleranced."""
