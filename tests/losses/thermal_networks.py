"""Networks for the thermal tests."""

from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.losses import Cooling, ThermalNetwork, thermal_network

ROOT = Path(__file__).parents[2]
ALPHA = 3.93e-3


def servo() -> Actuator:
    return load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")


def two_nodes() -> ThermalNetwork:
    return thermal_network(servo(), Cooling())


def one_node(resistance: float = 2.0, capacity: float = 50.0) -> ThermalNetwork:
    return ThermalNetwork(("winding",), np.array([capacity]), np.array([[1 / resistance]]), ())
