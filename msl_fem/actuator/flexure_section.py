"""The section [motion.flexure]: thin parallel leaves between the frame and the mover."""

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from msl_fem.actuator.leaf import Leaf
from msl_fem.actuator.leaf_materials import flexure_material
from msl_fem.actuator.leaf_placement import Placement, placed
from msl_fem.actuator.quantities import Clearance, Inertia, Length
from msl_fem.errors import ActuatorError, MaterialError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel

SLENDER = 5.0  # length over thickness, from which shear and the clamps' give are below about 1 % of the bending


class Flexure(FrozenModel):
    """Sets of parallel leaves, clamped to the frame and guided by the mover; they bend along the motion.

    Attributes
    ----------
    length, width, thickness : of one leaf, free of its clamps
    count : leaves of one set
    sets : places along the motion that carry a set
    material : name in `msl_fem.actuator.FLEXURE_MATERIALS`
    arrangement : "opposed", half of a set's leaves on either side of the mover, whose ends hold each other apart;
        "one-sided", all on one side, free to shorten
    attachment : from the axis of the motion to where the leaves meet the mover
    set_spacing : between two sets, along the motion
    leaf_spacing : between the middles of neighbouring leaves on one side, along their width; side by side without it
    roll_inertia, pitch_inertia, yaw_inertia : the mover's, about the axes of the motion, across leaf and motion, and
        along the leaves, through its centre of mass
    """

    length: Length
    width: Length
    thickness: Length
    count: Annotated[int, Field(gt=0, le=100)]
    sets: Literal[1, 2] = 1
    material: str
    arrangement: Literal["opposed", "one-sided"] = "opposed"
    attachment: Clearance = 0.0
    set_spacing: Length | None = None
    leaf_spacing: Length | None = None
    roll_inertia: Inertia | None = None
    pitch_inertia: Inertia | None = None
    yaw_inertia: Inertia | None = None

    @field_validator("material")
    @classmethod
    def _known(cls, name: str) -> str:
        try:
            return flexure_material(name).name
        except MaterialError as err:
            raise ValueError(str(err)) from err

    @model_validator(mode="after")
    def _leaves_are_leaves(self) -> "Flexure":
        thickest = min(self.length / SLENDER, self.width)
        if self.thickness > thickest:
            raise ValueError(
                f"thickness {format_quantity(self.thickness, 'm')} is above {format_quantity(thickest, 'm')}, a fifth "
                "of the length or the whole width; a leaf is thin: make it thinner"
            )
        if self.arrangement == "opposed" and self.count % 2:
            raise ValueError(
                f"count {self.count} is odd, but opposed leaves come in pairs; make it even, or the arrangement "
                '"one-sided"'
            )
        return self

    @property
    def leaf(self) -> Leaf:
        """One of the leaves."""
        return Leaf(self.length, self.width, self.thickness, flexure_material(self.material))

    @property
    def leaves(self) -> int:
        """The number of leaves of all sets."""
        return self.count * self.sets

    @property
    def stiffness(self) -> float:
        """N/m along the motion at small displacements: that of the leaf times their number."""
        return self.leaves * self.leaf.stiffness

    @property
    def cubic_stiffness(self) -> float:
        """N/m3, of all leaves; 0 where they are free to shorten."""
        return self.leaves * self.leaf.cubic_stiffness if self.arrangement == "opposed" else 0.0

    def placements(self, sets: int | None = None) -> tuple[Placement, ...]:
        """Where the leaves stand, or where the same leaves would in another number of sets, about the middle.

        Raises
        ------
        ActuatorError : two sets without set_spacing, or leaves that cannot be parted into so many sets
        """
        wanted = sets or self.sets
        sides = (1, -1) if self.arrangement == "opposed" else (-1,)
        if wanted == 2 and self.set_spacing is None:
            raise ActuatorError("motion.flexure.set_spacing is missing; two sets need their distance")
        if self.leaves % (wanted * len(sides)):
            raise ActuatorError(
                f"{self.leaves} {self.arrangement} leaves cannot be parted into {wanted} sets; "
                "change motion.flexure.count"
            )
        half = (self.set_spacing or 0.0) / 2
        return placed(
            (0.0,) if wanted == 1 else (-half, half),
            per_side=self.leaves // (wanted * len(sides)),
            sides=sides,
            reach=self.attachment,
            pitch=self.leaf_spacing or self.width,
        )
