"""What magnets of several kinds have: a coil, irons, the air around; in an actuator file and in SI units."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from msl_fem.files.dimensions import Clearance, Fraction, Length, Turns
from msl_fem.files.schema import FrozenModel

NEAR = 2.0  # half widths of the core around the iron that are painted and meshed freely, if the box is larger


class Coil(FrozenModel):
    """A coil round a leg: in the window a rectangle, `width` away from the leg by `height` along it.

    `turns` counts those of all coils of the magnet in series.

    Attributes
    ----------
    turns : of all coils of a magnet in series
    width, height : of the winding's cross section, away from the leg and along it
    leg_clearance, face_clearance : from leg and pole faces to the winding: bobbin, insulation
    fill_factor : copper over the winding's cross section
    """

    turns: Turns
    width: Length
    height: Length
    leg_clearance: Clearance
    face_clearance: Clearance
    fill_factor: Annotated[float, Field(gt=0, lt=1)]


class IronSpec(FrozenModel):
    """Names of irons (see `msl_fem.materials.material.load_iron`) and the stacking factors of their laminations.

    Attributes
    ----------
    core, armature : a name of the library ("m19"), "linear:1000", "analytic:e1", or a file of points ("steel.csv")
    stacking_factor : iron over the stack's depth
    core_stacking_factor, armature_stacking_factor : in its place for one part
    """

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

    @property
    def by_region(self) -> dict[str, tuple[str, float]]:
        """Region of a section ("core", "armature") to (iron's name, stacking factor)."""
        return {"core": (self.core, self.core_stacking), "armature": (self.armature, self.armature_stacking)}


class Air(FrozenModel):
    """The air box, A = 0 on it: beyond the core's half width, below the armature, above the yoke.

    Attributes
    ----------
    side, bottom, top : beyond the core's half width, below the armature, above the yoke
    """

    side: Length
    bottom: Length
    top: Length

    def around(self, *, half: float, wide: float, below: float, above: float) -> "PaintedBox":
        """The box painted round a core of a half width, an armature of another, reaching so far from the strip's lines.

        Within `NEAR` half widths it is painted; what the box is larger than that, the mesh is stretched by.
        """
        box = np.array([half + self.side, below + self.bottom, above + self.top])
        near = np.array([max(half, wide), below, above]) + NEAR * half
        far = max(1.0, float((box / near).min()))
        edge, under, over = box / far
        return PaintedBox(edge, under, over, far)


@dataclass(frozen=True)
class PaintedBox:
    """Painted air: to x = `edge`, `below` y = 0 and `above` y = gap; the box is `far` times that."""

    edge: float
    below: float
    above: float
    far: float
