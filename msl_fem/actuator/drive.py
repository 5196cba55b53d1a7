"""The electronics: power amplifier, sensors, the controller's clock."""

from typing import Annotated, Literal

from pydantic import Field

from msl_fem.actuator.quantities import Current, CurrentNoise, Frequency, PositionNoise, Resistance, Voltage
from msl_fem.files.schema import FrozenModel


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
