"""A mover on leaf flexures: its modes, and whether the flexure does what the actuator needs."""

from msl_fem.mechanics.flexure_assessment import FullRange, SetModes, SuspensionReport, assess_flexure
from msl_fem.mechanics.flexure_beam import Mode, Mover, mover_modes

__all__ = ["FullRange", "Mode", "Mover", "SetModes", "SuspensionReport", "assess_flexure", "mover_modes"]
