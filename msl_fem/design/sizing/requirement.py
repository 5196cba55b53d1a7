"""What a magnet has to do: a requirement file (TOML) as a frozen record in SI units.

Every number of a magnet (force, current, voltage of its coil) is derived from here; [supply] is per side, as [drive]
is in an actuator file.
"""

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_args

from pydantic import AfterValidator, Field, ValidationError, model_validator

from msl_fem.actuator import (
    LARGEST_MAGNET,
    Clearance,
    Controller,
    Current,
    CurrentSensor,
    Damping,
    Force,
    Frequency,
    IronSpec,
    Length,
    PositionSensor,
    Sides,
    Stiffness,
    Voltage,
)
from msl_fem.errors import RequirementError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel, In, bare_number, first_complaint, has_unknown_key, read_toml
from msl_fem.magnetics.kinds import Magnet, MagnetKind
from msl_fem.magnetics.kinds.kind import PlaneMagnet, SizedLengths
from msl_fem.magnetics.kinds.parts import Coil

Newton = Annotated[float, In("N"), Field(gt=0)]
SlewRate = Annotated[float, In("N/s"), Field(gt=0)]
FluxDensity = Annotated[float, In("T"), Field(ge=0.05, le=3.0)]
CurrentDensity = Annotated[float, In("A/m^2"), Field(gt=0)]
TemperatureRise = Annotated[float, In("K"), Field(gt=0, le=1000)]
HeatTransfer = Annotated[float, In("W/(m^2 K)"), Field(ge=0.1, le=1e5)]
Density = Annotated[float, In("kg/m^3"), Field(gt=0)]
Payload = Annotated[float, In("kg"), Field(ge=0)]
Objective = Literal["mass", "loss", "force", "inductance"]
DEFAULT_CURRENT_DENSITY = 5e6
"""A/m2 where neither current density nor temperature rise is limited: usual for windings in still air."""
DEFAULT_RANGE = 0.8
"""Of the nominal gap, where no range is stated."""
_PURE_NUMBERS = {
    "schema", "fill_factor", "stacking_factor", "core_stacking_factor", "armature_stacking_factor", "duty", "count",
    "magnets_per_side", "delay_samples",
}  # fmt: skip


SIZED_KINDS: dict[str, type[MagnetKind]] = {
    get_args(kind.model_fields["kind"].annotation)[0]: kind
    for kind in get_args(Magnet)
    if issubclass(kind, MagnetKind) and kind.SIZED is not None
}
"""By the word that files state: the kinds that state what sizing varies."""


def _sized_kind(kind: str) -> str:
    if kind not in SIZED_KINDS:
        raise ValueError(f"'{kind}' cannot be sized; choose one of {', '.join(SIZED_KINDS)}")
    return kind


class MagnetWanted(FrozenModel):
    """Which kind of magnet is to be sized."""

    kind: Annotated[str, AfterValidator(_sized_kind)] = "e-core"


class ForceWanted(FrozenModel):
    """The force of one magnet at a gap, and how fast it must be able to change there.

    Attributes
    ----------
    minimum : of the force of one magnet
    gap : at which it is wanted
    slew_rate : of the force, which the voltage must allow
    """

    minimum: Newton
    gap: Length
    slew_rate: SlewRate | None = None


class FluxLimit(FrozenModel):
    """The largest flux density in the iron, by the operating map's criterion: the mean of the most loaded section.

    Attributes
    ----------
    limit : in the iron itself
    criterion : of the operating map
    """

    limit: FluxDensity = 1.2
    criterion: Literal["mean"] = "mean"


class Supply(FrozenModel):
    """What the amplifier of a side gives at most.

    Attributes
    ----------
    voltage, current : the largest, of a side
    bandwidth : of its current, first order
    """

    voltage: Voltage = 80.0
    current: Current = 12.0
    bandwidth: Frequency | None = None


class Heat(FrozenModel):
    """How warm the coil may get at the wanted force; `duty` is the share of time that it is held.

    Attributes
    ----------
    current_density : RMS in the copper, at most
    temperature_rise : of the winding over its surroundings, at most
    heat_transfer : from the magnet's surface
    duty : share of time that the force is held
    """

    current_density: CurrentDensity | None = None
    temperature_rise: TemperatureRise | None = None
    heat_transfer: HeatTransfer = 10.0
    duty: Annotated[float, Field(ge=1e-4, le=1)] = 1.0

    @property
    def largest_current_density(self) -> float | None:
        """As stated; a default where nothing limits the heat."""
        if self.current_density is None and self.temperature_rise is None:
            return DEFAULT_CURRENT_DENSITY
        return self.current_density


class Envelope(FrozenModel):
    """The box around one magnet with its armature at the wanted gap, end turns included; what is not stated is free.

    Attributes
    ----------
    width, height, depth : at most; height along the pull, depth along the stack
    """

    width: Length | None = None
    height: Length | None = None
    depth: Length | None = None


class WindingSpec(FrozenModel):
    """The coil's copper and its clearances in the window; with `wire_diameter` the turns follow from the area.

    Attributes
    ----------
    fill_factor : copper over the winding's section
    wire_diameter : of the copper
    leg_clearance, face_clearance, back_clearance : from the winding to the leg, the pole face, the yoke
    """

    fill_factor: Annotated[float, Field(gt=0, lt=1)] = 0.5
    wire_diameter: Length | None = None
    leg_clearance: Clearance = 1e-3
    face_clearance: Clearance = 2e-3
    back_clearance: Clearance = 1e-3


class Densities(FrozenModel):
    """Mass densities in place of those that belong to the materials' names.

    Attributes
    ----------
    core, armature, copper : of that part
    """

    core: Density | None = None
    armature: Density | None = None
    copper: Density | None = None


class MotionWanted(FrozenModel):
    """What the actuator file says of the motion; the armatures' mass is added to `payload`.

    Attributes
    ----------
    payload : of all that moves beside the armatures
    stiffness, damping : of the suspension
    nominal_gap : of both sides at rest
    range : plus and minus
    constant_force : along the pull of side 1
    """

    payload: Payload = 0.0
    stiffness: Stiffness | None = None
    damping: Damping | None = None
    nominal_gap: Length | None = None
    range: Length | None = None
    constant_force: Force = 0.0


class Requirement(FrozenModel):
    """A requirement file. What is left out has the default given here; `docs/sizing.md` lists them.

    Attributes
    ----------
    schema_version : of this form of the file
    name : of the actuator that comes out
    objectives : what the search makes small
    sources : where the numbers come from, by key
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_. -]+$")]
    objectives: Annotated[tuple[Objective, ...], Field(min_length=1)] = ("mass", "loss")
    magnet: MagnetWanted = MagnetWanted()
    force: ForceWanted
    flux: FluxLimit = FluxLimit()
    supply: Supply = Supply()
    heat: Heat = Heat()
    envelope: Envelope = Envelope()
    iron: IronSpec = IronSpec(core="m19", armature="m19", stacking_factor=0.96)
    winding: WindingSpec = WindingSpec()
    densities: Densities = Densities()
    sides: Sides = Sides(count=2, magnets_per_side=1)
    motion: MotionWanted = MotionWanted()
    position_sensor: PositionSensor = PositionSensor(noise=50e-9)
    current_sensor: CurrentSensor = CurrentSensor(noise=2e-3)
    controller: Controller = Controller(rate=2.5e3, delay_samples=1)
    sources: dict[str, str] = Field(default_factory=dict)
    file: Path | None = Field(default=None, exclude=True)

    @model_validator(mode="after")
    def _parts_belong_together(self) -> "Requirement":
        if len(set(self.objectives)) < len(self.objectives):
            raise ValueError(f"objectives names one twice: {', '.join(self.objectives)}; name each once")
        if self.force.gap > LARGEST_MAGNET:
            raise ValueError(
                f"force.gap {format_quantity(self.force.gap, 'm')} is above {format_quantity(LARGEST_MAGNET, 'm')}, "
                "larger than any magnet; look at its unit"
            )
        low = self.nominal_gap - self.range
        high = self.nominal_gap + self.range
        if low <= 0:
            raise ValueError(
                f"motion.range {format_quantity(self.range, 'm')} must be below the nominal gap "
                f"{format_quantity(self.nominal_gap, 'm')}, or the faces touch"
            )
        if not low <= self.force.gap <= high * (1 + 1e-9):
            raise ValueError(
                f"force.gap {format_quantity(self.force.gap, 'm')} lies outside the motion's gaps "
                f"{format_quantity(low, 'm')} ... {format_quantity(high, 'm')}; change motion.nominal_gap or "
                "motion.range"
            )
        return self

    @cached_property
    def magnet_class(self) -> type[MagnetKind]:
        return SIZED_KINDS[self.magnet.kind]

    @cached_property
    def sized(self) -> SizedLengths:
        """What the kind states for sizing."""
        sized = self.magnet_class.SIZED
        assert sized is not None
        return sized

    @cached_property
    def revolved(self) -> bool:
        """The magnet is a body of revolution: there is no depth of a stack."""
        return not issubclass(self.magnet_class, PlaneMagnet)

    @cached_property
    def blank_magnet(self) -> MagnetKind:
        """A magnet of the kind with the wanted iron, fill factor and one turn a coil, unchecked and without lengths."""
        coil = cast(Any, Coil).model_construct(turns=self.sized.coils, fill_factor=self.winding.fill_factor)
        return cast(Any, self.magnet_class).model_construct(kind=self.magnet.kind, iron=self.iron, coil=coil)

    @property
    def nominal_gap(self) -> float:
        return self.force.gap if self.motion.nominal_gap is None else self.motion.nominal_gap

    @property
    def range(self) -> float:
        """Travel, plus and minus about the nominal gap."""
        return DEFAULT_RANGE * self.nominal_gap if self.motion.range is None else self.motion.range

    @property
    def coil_current(self) -> float:
        """The largest current of one magnet's coil in A."""
        return self.supply.current / (self.sides.magnets_per_side if self.sides.connection == "parallel" else 1)

    @property
    def coil_voltage(self) -> float:
        """The largest voltage across one magnet's coil in V."""
        return self.supply.voltage / (self.sides.magnets_per_side if self.sides.connection == "series" else 1)

    @property
    def folder(self) -> Path:
        """Where relative names in the file are looked up."""
        return self.file.parent if self.file else Path()

    @property
    def digest(self) -> str:
        """SHA-256 of the content: equal for equal requirements, whatever the file's comments."""
        return hashlib.sha256(self.model_dump_json(exclude={"sources"}).encode()).hexdigest()


def load_requirement(path: str | Path) -> Requirement:
    """The requirement that a TOML file states.

    Raises
    ------
    RequirementError : no such file, not TOML, an unknown or a missing key, a wrong unit, a value out of its range;
        the message names the file and the key path
    """
    content = read_toml(path, error=RequirementError, wanted="a requirement file")
    return parse_requirement(content, file=Path(path))


def parse_requirement(content: dict[str, Any], *, file: Path | None = None) -> Requirement:
    """The requirement that a parsed TOML document states; raises as `load_requirement`."""
    where = file or "requirement"
    if "file" in content:
        raise RequirementError(f"{where}: file: unknown key; remove it")
    complaint = bare_number(content, _PURE_NUMBERS)
    try:
        requirement = Requirement.model_validate({**content, "file": file})
    except ValidationError as err:
        if complaint is None or has_unknown_key(err):
            complaint = first_complaint(err)
        raise RequirementError(f"{where}: {complaint}") from err
    if complaint:
        raise RequirementError(f"{where}: {complaint}")
    return requirement
