"""Tables, sheets and waveforms for the tests of iron losses."""

from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.losses import FluxWaveform
from msl_fem.materials.core_loss_data import Sheet, sheet_of
from msl_fem.table.magnetic_table import MagneticTable, read_table

ROOT = Path(__file__).parents[2]


def servo() -> Actuator:
    return load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")


def servo_table() -> MagneticTable:
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


def m19() -> Sheet:
    return sheet_of("m19", thickness=0.36e-3)


def sine(peak: float, frequency: float, *, samples: int = 256, bias: float = 0.0) -> FluxWaveform:
    return FluxWaveform(bias + peak * np.sin(2 * np.pi * np.arange(samples) / samples), frequency)


def triangle(peak: float, frequency: float, *, samples: int = 512) -> FluxWaveform:
    t = np.arange(samples) / samples
    return FluxWaveform(peak * (4 * np.abs((t - 0.25) % 1 - 0.5) - 1), frequency)
