"""The actuator: what a TOML file of geometries/ says, as frozen records in SI units."""

import hashlib
import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from msl_fem.constants import COPPER_RESISTIVITY
from msl_fem.errors import ActuatorError
from msl_fem.quantity import format_quantity
from msl_fem.schema import FrozenModel, In, bare_number, first_complaint, reason

Length = Annotated[float, In("m"), Field(gt=0)]
Clearance = Annotated[float, In("m"), Field(ge=0)]
Mass = Annotated[float, In("kg"), Field(gt=0)]
Stiffness = Annotated[float, In("N/m"), Field(ge=0)]
Damping = Annotated[float, In("N s/m"), Field(ge=0)]
Force = Annotated[float, In("N")]
Frequency = Annotated[float, In("Hz"), Field(gt=0)]
Voltage = Annotated[float, In("V"), Field(gt=0)]
Current = Annotated[float, In("A"), Field(gt=0)]
Resistance = Annotated[float, In("ohm"), Field(gt=0)]
PositionNoise = Annotated[float, In("m"), Field(ge=0)]
CurrentNoise = Annotated[float, In("A"), Field(ge=0)]
Turns = Annotated[int, Field(gt=0, le=1_000_000)]
LARGEST_MAGNET, THINNEST = 10.0, 1e-3  # m; of the largest length: beyond, the mesher has nothing to hold on to
Fraction = Annotated[float, Field(gt=0, le=1)]


class Coil(FrozenModel):
    """The coil on the centre leg: `turns` in each half window, a rectangle `width` by `height`."""

    turns: Turns
    width: Length
    height: Length
    leg_clearance: Clearance
    face_clearance: Clearance
    fill_factor: Annotated[float, Field(gt=0, lt=1)]


class Iron(FrozenModel):
    """Names of irons (see `msl_fem.material.load_iron`) and the stacking factors of their laminations."""

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


_SECTION_LENGTHS = (
    "centre_leg_width", "outer_leg_width", "window_width", "window_height", "yoke_thickness", "armature_thickness",
)  # fmt: skip


def _metres(value: float) -> str:
    return format_quantity(value, "m")


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
    iron: Iron
    air: Air | None = None

    @model_validator(mode="after")
    def _lengths_belong_to_one_magnet(self) -> "ECore":
        coil = self.coil
        lengths = {name: float(getattr(self, name)) for name in _SECTION_LENGTHS}
        lengths |= {"coil.width": coil.width, "coil.height": coil.height}
        largest = max(lengths.values())
        if largest > LARGEST_MAGNET:
            name = max(lengths, key=lengths.__getitem__)
            raise ValueError(f"{name} {_metres(largest)} is above {_metres(LARGEST_MAGNET)}; look at its unit")
        smallest = THINNEST * largest
        clearances = {
            "armature_overhang": self.armature_overhang,
            "pole_chamfer": self.pole_chamfer,
            "coil.leg_clearance": coil.leg_clearance,
            "coil.face_clearance": coil.face_clearance,
        }
        for name, value in (lengths | {n: v for n, v in clearances.items() if v > 0}).items():
            if value < smallest:
                or_zero = ", or 0" if name in clearances else ""
                raise ValueError(
                    f"{name} {_metres(value)} is below {_metres(smallest)}, a thousandth of the magnet's largest "
                    f"length; make it larger{or_zero}"
                )
        margins = {f"air.{n}": float(getattr(self.air, n)) for n in ("side", "bottom", "top")} if self.air else {}
        for name, value in (margins | {"armature_overhang": self.armature_overhang}).items():
            lowest = smallest if name in margins else 0.0
            if not lowest <= value <= 100 * largest:
                raise ValueError(
                    f"{name} {_metres(value)} is not allowed; with this magnet it must be "
                    f"{_metres(lowest)} ... {_metres(100 * largest)}"
                )
        if not smallest <= self.stack_depth <= LARGEST_MAGNET:
            raise ValueError(
                f"stack_depth {_metres(self.stack_depth)} is not allowed; with this magnet it must be "
                f"{_metres(smallest)} ... {_metres(LARGEST_MAGNET)}"
            )
        return self

    @model_validator(mode="after")
    def _coil_fits_its_window(self) -> "ECore":
        for name, used, window in (
            ("width", self.coil.leg_clearance + self.coil.width, self.window_width),
            ("height", self.coil.face_clearance + self.coil.height, self.window_height),
        ):
            if used > window * (1 + 1e-9):
                raise ValueError(
                    f"coil.{name} with its clearance is {format_quantity(used, 'm')}, more than the "
                    f"window's {format_quantity(window, 'm')}; make the coil smaller or the window larger"
                )
        largest = min(self.centre_leg_width / 2, self.outer_leg_width) / 2
        if self.pole_chamfer > largest:
            raise ValueError(
                f"pole_chamfer {format_quantity(self.pole_chamfer, 'm')} is above "
                f"{format_quantity(largest, 'm')}, a quarter of the thinnest pole; make it smaller"
            )
        if self.air is not None and self.air.side <= self.armature_overhang:
            raise ValueError(
                f"air.side {format_quantity(self.air.side, 'm')} counts from the core and must be above "
                f"armature_overhang {format_quantity(self.armature_overhang, 'm')}; make the air box wider"
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
        return (
            COPPER_RESISTIVITY
            * self.coil.turns**2
            * self.mean_turn_length
            / (self.coil.fill_factor * self.coil_section)
        )


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
    iron: Iron


class Sides(FrozenModel):
    """How many magnets pull, and how those of a side are connected."""

    count: Literal[1, 2]
    magnets_per_side: Annotated[int, Field(gt=0, le=1000)]
    connection: Literal["series", "parallel"] = "series"
    polarity: Literal["opposing", "aiding"] = "opposing"


class Motion(FrozenModel):
    """The moving mass on its suspension; `range` is plus and minus about the nominal gap."""

    moving_mass: Mass
    stiffness: Stiffness = 0.0
    damping: Damping = 0.0
    nominal_gap: Length | None = None
    range: Length | None = None
    constant_force: Force = 0.0

    @model_validator(mode="after")
    def _range_leaves_a_gap(self) -> "Motion":
        if self.nominal_gap is not None and self.range is not None and self.range >= self.nominal_gap:
            raise ValueError(
                f"range {format_quantity(self.range, 'm')} must be below nominal_gap "
                f"{format_quantity(self.nominal_gap, 'm')}, or the faces touch"
            )
        return self


class Drive(FrozenModel):
    """The power amplifier of a side; limits are per side, the resistance is that of one magnet's coil."""

    kind: Literal["current", "voltage", "force"]
    bandwidth: Frequency | None = None
    voltage_limit: Voltage | None = None
    current_limit: Current | None = None
    coil_resistance: Resistance | None = None


class PositionSensor(FrozenModel):
    noise: PositionNoise = 0.0
    bandwidth: Frequency | None = None
    resolution: PositionNoise = 0.0


class CurrentSensor(FrozenModel):
    noise: CurrentNoise = 0.0


class Controller(FrozenModel):
    rate: Frequency
    delay_samples: Annotated[int, Field(ge=0, le=20)] = 0


class Actuator(FrozenModel):
    """An actuator file. Sections that an actuator lacks are None; SI units throughout."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_. -]+$")]
    magnet: Annotated[ECore | TableMagnet | MeshMagnet, Field(discriminator="kind")] | None = None
    sides: Sides | None = None
    motion: Motion | None = None
    drive: Drive | None = None
    position_sensor: PositionSensor = PositionSensor()
    current_sensor: CurrentSensor = CurrentSensor()
    controller: Controller | None = None
    sources: dict[str, str] = Field(default_factory=dict)
    file: Path | None = Field(default=None, exclude=True)

    @model_validator(mode="after")
    def _sections_belong_together(self) -> "Actuator":
        if self.magnet is not None and self.motion is not None and self.motion.nominal_gap is None:
            raise ValueError("motion.nominal_gap is missing; an actuator with a magnet needs it")
        if self.magnet is None and self.drive is not None and self.drive.kind != "force":
            raise ValueError(f"drive.kind is '{self.drive.kind}' but there is no [magnet]; use kind = \"force\"")
        return self

    @property
    def folder(self) -> Path:
        """Where relative names in the file are looked up."""
        return self.file.parent if self.file else Path()

    @property
    def digest(self) -> str:
        """SHA-256 of the content: equal for equal actuators, whatever the file's comments."""
        return hashlib.sha256(self.model_dump_json(exclude={"sources"}).encode()).hexdigest()

    def e_core(self) -> ECore:
        """The magnet, where it is an E-core; ActuatorError otherwise."""
        if not isinstance(self.magnet, ECore):
            kind = self.magnet.kind if self.magnet else "none"
            raise ActuatorError(
                f"{self.name}: the field solution needs [magnet] kind = \"e-core\", this one is '{kind}'"
            )
        return self.magnet

    def mesh_magnet(self) -> MeshMagnet:
        """The magnet, where it is a mesh; ActuatorError otherwise."""
        if not isinstance(self.magnet, MeshMagnet):
            kind = self.magnet.kind if self.magnet else "none"
            raise ActuatorError(f"{self.name}: this needs [magnet] kind = \"mesh\", this one is '{kind}'")
        return self.magnet

    def coil_resistance(self) -> float:
        """Resistance of one magnet's coil in ohm: as stated in [drive], else from the winding."""
        if self.drive is not None and self.drive.coil_resistance is not None:
            return self.drive.coil_resistance
        return self.e_core().winding_resistance


def load_actuator(path: str | Path) -> Actuator:
    """The actuator that a TOML file describes.

    Raises
    ------
    ActuatorError : no such file, not TOML, an unknown or a missing key, a wrong unit, a value out of its range;
        the message names the file and the key path
    """
    file = Path(path)
    try:
        text = file.read_bytes().decode("utf-8")
    except (OSError, ValueError) as err:
        raise ActuatorError(f"{path}: cannot be read ({reason(err)}); give an actuator file (TOML)") from err
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as err:
        raise ActuatorError(f"{path}: not valid TOML: {err}") from err
    return parse_actuator(content, file=file)


def parse_actuator(content: dict[str, Any], *, file: Path | None = None) -> Actuator:
    """The actuator that a parsed TOML document describes; raises as `load_actuator`."""
    if "file" in content:
        raise ActuatorError(f"{file or 'actuator'}: file: unknown key; remove it")
    complaint = bare_number(content, _PURE_NUMBERS)
    if complaint:
        raise ActuatorError(f"{file or 'actuator'}: {complaint}")
    try:
        return Actuator.model_validate({**content, "file": file})
    except ValidationError as err:
        raise ActuatorError(f"{file or 'actuator'}: {first_complaint(err, unions=('magnet',))}") from err


_PURE_NUMBERS = {
    "schema", "turns", "fill_factor", "stacking_factor", "core_stacking_factor", "armature_stacking_factor",
    "count", "magnets_per_side", "delay_samples",
}  # fmt: skip
