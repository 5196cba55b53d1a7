"""What moves: sides that pull, the mass on its suspension, and the section [motion.flexure] with its leaves."""

from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from msl_fem.actuator.leaf import Leaf, Placement, flexure_material, placed
from msl_fem.errors import ActuatorError, MaterialError
from msl_fem.files.dimensions import Clearance, Damping, Force, Inertia, Length, Mass, Stiffness
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
        count = sets or self.sets
        sides = (1, -1) if self.arrangement == "opposed" else (-1,)
        if count == 2 and self.set_spacing is None:
            raise ActuatorError("motion.flexure.set_spacing is missing; two sets need their distance")
        if self.leaves % (count * len(sides)):
            raise ActuatorError(
                f"{self.leaves} {self.arrangement} leaves cannot be parted into {count} sets; "
                "change motion.flexure.count"
            )
        half = (self.set_spacing or 0.0) / 2
        return placed(
            (0.0,) if count == 1 else (-half, half),
            per_side=self.leaves // (count * len(sides)),
            sides=sides,
            reach=self.attachment,
            pitch=self.leaf_spacing or self.width,
        )


class Sides(FrozenModel):
    """How many magnets pull, and how those of a side are connected.

    Attributes
    ----------
    count : of sides: 1 pulls towards +x alone, 2 pull against each other
    magnets_per_side : alike, facing the same armature
    connection : of the coils of a side
    polarity : how the fluxes of both sides meet in the armature
    """

    count: Literal[1, 2]
    magnets_per_side: Annotated[int, Field(gt=0, le=1000)]
    connection: Literal["series", "parallel"] = "series"
    polarity: Literal["opposing", "aiding"] = "opposing"


class Motion(FrozenModel):
    """The moving mass on its suspension; `range` is plus and minus about the nominal gap.

    Where there is an `end_stop` (plus and minus as well), a mover that reaches it is thrown back with
    `end_stop_restitution` (0 if not stated) times its velocity, and a simulation goes on; without, it ends where the
    range does.

    Where `stiffness` is left out and `flexure` is there, it is that of the flexure; where both are stated, the stated
    one counts, and `notes` tells the difference.

    Attributes
    ----------
    moving_mass : all that moves, armature included
    stiffness : of the suspension; that of the flexure where it is left out
    damping : viscous
    nominal_gap : of both sides at x = 0; needed with a magnet
    range : largest |x|; beyond it a run ends
    constant_force : along +x, towards side 1: gravity is "-4.9 N" for 0.5 kg that hangs below the magnet
    end_stop : |x| at which the mover meets a stop; pull-in runs need one
    end_stop_restitution : velocity after over velocity before an impact, 0 (stays) to 1
    """

    moving_mass: Mass
    stiffness: Stiffness = 0.0
    damping: Damping = 0.0
    nominal_gap: Length | None = None
    range: Length | None = None
    constant_force: Force = 0.0
    flexure: Flexure | None = None
    end_stop: Length | None = None
    end_stop_restitution: Annotated[float, Field(ge=0, le=1)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _stiffness_of_the_flexure(cls, content: Any) -> Any:
        """Fill in the stiffness that the file leaves to the flexure; a faulty flexure is left for its own complaint."""
        if not isinstance(content, dict) or content.get("flexure") is None or "stiffness" in content:
            return content
        try:
            flexure = Flexure.model_validate(content["flexure"])
        except ValidationError:
            return content
        return content | {"stiffness": flexure.stiffness}

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = dump(self)
        for name in ("flexure",) if self.flexure is None else self.implied():
            content.pop(name, None)
        for name in ("end_stop", "end_stop_restitution"):
            if getattr(self, name) is None:
                content.pop(name, None)
        return content

    def implied(self) -> frozenset[str]:
        """`stiffness`, where it is the flexure's."""
        follows = self.flexure is not None and self.stiffness == self.flexure.stiffness
        return frozenset({"stiffness"}) if follows else frozenset()

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know: a stated stiffness that is not the flexure's."""
        if self.flexure is None or self.implied():
            return ()
        own = self.flexure.stiffness
        return (
            f"motion.stiffness {format_quantity(self.stiffness, 'N/m')} counts; the flexure's closed form gives "
            f"{format_quantity(own, 'N/m')}, {100 * (own / self.stiffness - 1):+.2g} %"
            if self.stiffness
            else f"motion.stiffness 0 counts, not the flexure's {format_quantity(own, 'N/m')}",
        )

    @model_validator(mode="after")
    def _range_leaves_a_gap(self) -> "Motion":
        if self.nominal_gap is not None and self.range is not None and self.range >= self.nominal_gap:
            raise ValueError(
                f"range {format_quantity(self.range, 'm')} must be below nominal_gap "
                f"{format_quantity(self.nominal_gap, 'm')}, or the faces touch"
            )
        return self

    @model_validator(mode="after")
    def _end_stop_leaves_a_gap(self) -> "Motion":
        if self.end_stop is None and self.end_stop_restitution is not None:
            raise ValueError("end_stop_restitution is stated without end_stop; state both or neither")
        if self.end_stop is not None and self.nominal_gap is not None and self.end_stop >= self.nominal_gap:
            raise ValueError(
                f"end_stop {format_quantity(self.end_stop, 'm')} must be below nominal_gap "
                f"{format_quantity(self.nominal_gap, 'm')}, or the faces touch before"
            )
        return self
