"""The section [drive.current_loop]: the hardware of a sampled current loop around a voltage drive."""

from typing import Annotated

from pydantic import Field

from msl_fem.files.dimensions import Current, Frequency
from msl_fem.files.schema import FrozenModel, In


class CurrentLoop(FrozenModel):
    """A current loop whose full bridge is switched by pulse-width modulation, with the converters around it.

    Attributes
    ----------
    rate : of the modulation; currents are sampled and voltages set once a period. Without it, the least multiple of
        the controller's rate from 20 kHz on
    bandwidth : that is wished; without it, the most that delay and voltage limit allow
    step : of a side's current, which must not meet the voltage limit; a fiftieth of the current limit without it
    dead_time : of a half bridge, in which neither switch is on
    converter_bits : of the current's reading, over plus and minus the current limit; 0: not quantised
    pulse_steps : widths of a pulse that a period has; 0: not quantised
    flux_corner : above it the flux linkage is integrated from the voltage, below it the table's at current and position
        counts; without it the table's alone
    """

    rate: Frequency | None = None
    bandwidth: Frequency | None = None
    step: Current | None = None
    dead_time: Annotated[float, In("s"), Field(ge=0)] = 5e-7
    converter_bits: Annotated[int, Field(ge=0, le=32)] = 12
    pulse_steps: Annotated[int, Field(ge=0, le=1_000_000_000)] = 5000
    flux_corner: Frequency | None = None
