"""The actuator file: its sections in one frozen record with the electronics, and the reader of the TOML."""

import hashlib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, ValidationError, model_serializer, model_validator

from msl_fem.actuator.current_loop import CurrentLoop
from msl_fem.actuator.motion import Motion, Sides
from msl_fem.actuator.tolerances import Tolerances
from msl_fem.errors import ActuatorError
from msl_fem.files.dimensions import Current, CurrentNoise, Frequency, PositionNoise, Resistance, Voltage
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel, bare_number, first_complaint, has_unknown_key, read_toml
from msl_fem.files.shown import Shown
from msl_fem.magnetics.kinds import Magnet, MagnetKind, MeshMagnet

PURE_NUMBERS = frozenset({
    "schema", "turns", "fill_factor", "stacking_factor", "core_stacking_factor", "armature_stacking_factor",
    "count", "magnets_per_side", "delay_samples", "sets", "bh_polarisation", "bh_field_strength",
    "end_stop_restitution", "converter_bits", "pulse_steps",
})  # fmt: skip
"""Keys of an actuator's sections whose numbers have no unit."""


EXAMPLES = Path(__file__).parent / "examples"
"""Actuator files that an installed package has; copies of those in geometries/."""


class Drive(FrozenModel):
    """The power amplifier of a side; limits are per side, the resistance is that of one magnet's coil.

    Attributes
    ----------
    kind : what is commanded: the current of a side (by a current loop), its voltage, or a force without magnets
    bandwidth : first order, -3 dB; ideal without it
    voltage_limit, current_limit : of a side, in size
    coil_resistance : of one magnet's coil at 20 degC; from the winding without it
    current_loop : of a controller around a voltage drive; its defaults where the section is left out
    """

    kind: Literal["current", "voltage", "force"]
    bandwidth: Frequency | None = None
    voltage_limit: Voltage | None = None
    current_limit: Current | None = None
    coil_resistance: Resistance | None = None
    current_loop: CurrentLoop | None = None

    @model_serializer(mode="wrap")
    def _as_stated(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        content: dict[str, Any] = dump(self)
        if self.current_loop is None:
            content.pop("current_loop", None)
        return content

    @model_validator(mode="after")
    def _loop_around_a_voltage(self) -> "Drive":
        if self.current_loop is not None and self.kind != "voltage":
            raise ValueError(
                f"current_loop is stated and kind is '{self.kind}'; a current drive has its loop inside, stated by its "
                'bandwidth: use kind = "voltage", or leave the section out'
            )
        return self


class PositionSensor(FrozenModel):
    """The reading of the position.

    Attributes
    ----------
    noise : one sigma of white noise
    bandwidth : first order, -3 dB; ideal without it
    resolution : readings are whole multiples of it; 0: none
    """

    noise: PositionNoise = 0.0
    bandwidth: Frequency | None = None
    resolution: PositionNoise = 0.0


class CurrentSensor(FrozenModel):
    """The reading of the sides' currents.

    Attributes
    ----------
    noise : one sigma of white noise
    """

    noise: CurrentNoise = 0.0


class Controller(FrozenModel):
    """The controller's clock.

    Attributes
    ----------
    rate : samples a second of the control loop
    delay_samples : from a reading to the command that it makes, in samples beside the hold
    """

    rate: Frequency
    delay_samples: Annotated[int, Field(ge=0, le=20)] = 0


class Actuator(Shown, FrozenModel):
    """An actuator file. Sections that an actuator lacks are None; SI units throughout.

    Attributes
    ----------
    schema_version : of the file's format; always 1
    name : letters, digits, spaces and _ . -
    end_effects : whether fields in two dimensions are corrected for the flux at the stack's ends, if it has any
    sources : free texts: where the numbers come from
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(min_length=1, max_length=80, pattern=r"^[A-Za-z0-9_. -]+$")]
    end_effects: Literal["none", "section"] = "section"
    magnet: Annotated[Magnet, Field(discriminator="kind")] | None = None
    sides: Sides | None = None
    motion: Motion | None = None
    drive: Drive | None = None
    position_sensor: PositionSensor = PositionSensor()
    current_sensor: CurrentSensor = CurrentSensor()
    controller: Controller | None = None
    tolerances: Tolerances | None = None  # type: ignore[valid-type]
    sources: dict[str, str] = Field(default_factory=dict)
    file: Path | None = Field(default=None, exclude=True)

    @model_validator(mode="after")
    def _sections_belong_together(self) -> "Actuator":
        if isinstance(self.magnet, MeshMagnet):
            self.magnet.look_in(self.folder)
        if self.magnet is not None and self.motion is not None and self.motion.nominal_gap is None:
            raise ValueError("motion.nominal_gap is missing; an actuator with a magnet needs it")
        if self.magnet is None and self.drive is not None and self.drive.kind != "force":
            raise ValueError(f"drive.kind is '{self.drive.kind}' but there is no [magnet]; use kind = \"force\"")
        return self

    def __repr__(self) -> str:
        """A line that a person reads; all values are in `model_dump()`."""
        kind = f"{self.magnet.kind}, " if self.magnet else ""
        motion = self.motion
        moved = f"{motion.moving_mass:g} kg" if motion else "no motion"
        gap = f" at {motion.nominal_gap * 1e3:g} mm" if motion and motion.nominal_gap else ""
        drive = f", {self.drive.kind} drive" if self.drive else ""
        sides = f", {self.sides.count} x {self.sides.magnets_per_side} magnets" if self.sides else ""
        return f"Actuator({self.name}: {kind}{moved}{gap}{sides}{drive})"

    def facts(self) -> dict[str, str]:
        """What the file says, in short."""
        facts = {"name": self.name, "magnet": self.magnet.kind if self.magnet else "none"}
        if isinstance(self.magnet, MagnetKind):
            facts["turns"] = f"{self.magnet.turns}"
            facts["winding"] = f"{format_quantity(self.magnet.winding_resistance, 'ohm')} at 20 °C"
        if self.sides is not None:
            facts["sides"] = f"{self.sides.count} with {self.sides.magnets_per_side} magnets each"
        if self.motion is not None:
            facts["moving mass"] = format_quantity(self.motion.moving_mass, "kg")
        if self.motion is not None and self.motion.nominal_gap is not None:
            facts["nominal gap"] = format_quantity(self.motion.nominal_gap, "m")
        if self.drive is not None:
            facts["drive"] = self.drive.kind
        if self.controller is not None:
            facts["controller"] = format_quantity(self.controller.rate, "Hz")
        return facts

    @property
    def folder(self) -> Path:
        """Where relative names in the file are looked up."""
        return self.file.parent if self.file else Path()

    @property
    def digest(self) -> str:
        """SHA-256 of the content: equal for equal actuators, whatever the file's comments, sources and tolerances.

        How its ends are to be solved for is no part of it: a table states that itself.
        """
        return hashlib.sha256(
            self.model_dump_json(exclude={"sources", "tolerances", "end_effects"}).encode()
        ).hexdigest()

    def lacking(self, *sections: str) -> str:
        """Those of the sections that the file does not have, like "[magnet], [controller]"; "" where it has all."""
        return ", ".join(f"[{name}]" for name in sections if getattr(self, name) is None)

    def magnet_kind(self, what: str = "the field solution") -> MagnetKind:
        """The magnet, where its dimensions are known; else ActuatorError, which says what needs them."""
        if isinstance(self.magnet, MagnetKind):
            return self.magnet
        raise self._other_kind(what, 'a kind with dimensions, like "e-core"')

    def mesh_magnet(self) -> MeshMagnet:
        """The magnet, where it is a mesh; ActuatorError otherwise."""
        if isinstance(self.magnet, MeshMagnet):
            return self.magnet
        raise self._other_kind("this", 'kind = "mesh"')

    def _other_kind(self, what: str, kind: str) -> ActuatorError:
        there = self.magnet.kind if self.magnet else "none"
        return ActuatorError(f"{self.name}: {what} needs [magnet] of {kind}; this one is '{there}'")

    def coil_resistance(self) -> float:
        """Resistance of one magnet's coil in ohm: as stated in [drive], else from the winding."""
        if self.drive is not None and self.drive.coil_resistance is not None:
            return self.drive.coil_resistance
        return self.magnet_kind("the coil's resistance, where [drive] does not state it,").winding_resistance


def load_actuator(path: str | Path) -> Actuator:
    """The actuator that a TOML file describes, or an example of the package by its name: "fast_tool_servo".

    Raises
    ------
    ActuatorError : no such file, not TOML, an unknown or a missing key, a wrong unit, a value out of its range;
        the message names the file and the key path
    """
    file = actuator_file(path)
    content = read_toml(file, error=ActuatorError, wanted="an actuator file")
    return parse_actuator(content, file=file)


def actuator_file(path: str | Path) -> Path:
    """The file that is meant: the path itself, or that of the package's example of this name."""
    file = Path(path)
    if str(path) in example_actuators() and not file.exists():
        return EXAMPLES / f"{path}.toml"
    return file


def example_actuators() -> tuple[str, ...]:
    """The names of the actuators that the package brings along."""
    return tuple(sorted(file.stem for file in EXAMPLES.glob("*.toml")))


def parse_actuator(content: dict[str, Any], *, file: Path | None = None) -> Actuator:
    """The actuator that a parsed TOML document describes; raises as `load_actuator`."""
    if "file" in content:
        raise ActuatorError(f"{file or 'actuator'}: file: unknown key; remove it")
    complaint = bare_number(content, PURE_NUMBERS)
    try:
        actuator = Actuator.model_validate({**content, "file": file})
    except ValidationError as err:
        if complaint is None or has_unknown_key(err):  # the number of a misspelt key needs a name first, then a unit
            complaint = first_complaint(err, unions=("magnet",), of=Actuator)
        raise ActuatorError(f"{file or 'actuator'}: {complaint}") from err
    if complaint:
        raise ActuatorError(f"{file or 'actuator'}: {complaint}")
    return actuator
