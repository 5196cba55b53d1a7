"""What moves: sides that pull, and the mass on its suspension."""

from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer, model_validator

from msl_fem.actuator.flexure_section import Flexure
from msl_fem.actuator.quantities import Damping, Force, Length, Mass, Stiffness
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel


class Sides(FrozenModel):
    """How many magnets pull, and how those of a side are connected."""

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
