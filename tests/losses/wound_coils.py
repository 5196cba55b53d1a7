"""Coils for the tests of wires."""

from pathlib import Path

from msl_fem.actuator import Actuator, ECore, load_actuator

SERVO = Path(__file__).parents[2] / "geometries" / "fast_tool_servo.toml"


def servo() -> Actuator:
    return load_actuator(SERVO)


def coil_of(width: float, height: float, turns: int) -> ECore:
    """The reference actuator's magnet with another coil in a larger window; m."""
    magnet = servo().magnet
    coil = magnet.coil.model_copy(update={"width": width, "height": height, "turns": turns})
    return magnet.model_copy(update={"coil": coil, "window_width": 2 * width, "window_height": 2 * height})
