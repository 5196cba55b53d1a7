"""The actuator: its sections in one frozen record."""

import hashlib
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from msl_fem.actuator.drive import Controller, CurrentSensor, Drive, PositionSensor
from msl_fem.actuator.magnet import ECore, MeshMagnet, TableMagnet
from msl_fem.actuator.motion import Motion, Sides
from msl_fem.actuator.tolerances import Tolerances
from msl_fem.errors import ActuatorError
from msl_fem.files.schema import FrozenModel


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
    tolerances: Tolerances | None = None
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
        """SHA-256 of the content: equal for equal actuators, whatever the file's comments, sources and tolerances."""
        return hashlib.sha256(self.model_dump_json(exclude={"sources", "tolerances"}).encode()).hexdigest()

    def lacking(self, *sections: str) -> str:
        """Those of the sections that the file does not have, like "[magnet], [controller]"; "" where it has all."""
        return ", ".join(f"[{name}]" for name in sections if getattr(self, name) is None)

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
