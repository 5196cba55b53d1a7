"""The reference actuator's controllers on the closed-form magnet, made once, and references for them."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
from conftest import ROOT, closed_form_table

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.control import (
    ControllerChoice,
    ControllerDesign,
    DesignModel,
    PlantUnderTest,
    design_controller,
    design_model_of,
    designed,
)
from msl_fem.maps import OperatingMap, operating_map

RATE = 2500.0
TABLE = closed_form_table()


def servo(**changes: dict[str, object]) -> Actuator:
    """The reference actuator with sections changed: servo(drive={"current_limit": 1.0})."""
    made = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    return made.model_copy(update={k: getattr(made, k).model_copy(update=v) for k, v in changes.items()})


@cache
def servo_map(levels: tuple[float, ...] = (1.2, 1.6)) -> OperatingMap:
    return operating_map(TABLE, levels=levels)


@cache
def servo_design(*, feedforward: bool = True) -> ControllerDesign:
    return design_controller(servo(), TABLE, servo_map()) if feedforward else plain(servo_design())


def servo_belief(**changes: dict[str, object]) -> DesignModel:
    return design_model_of(servo(**changes), TABLE, servo_map())


@cache
def rival(kind: str) -> ControllerDesign:
    """The reference actuator's controller of another design."""
    return designed(servo_belief(), ControllerChoice(kind))


def plain(design: ControllerDesign) -> ControllerDesign:
    """A design without its feedforward."""
    parameters = design.parameters._replace(feedforward=False)
    return replace(design, law=replace(design.law, feedforward=False), parameters=parameters)


def delayed(delay: int, *, ideal_drive: bool = False) -> Actuator:
    """The reference actuator with another computation delay, or a drive without lag and voltage limit."""
    drive = {"bandwidth": None, "voltage_limit": None} if ideal_drive else {}
    return servo(controller={"delay_samples": delay}, drive=drive)


@cache
def delayed_design(delay: int, *, ideal_drive: bool = False) -> ControllerDesign:
    actuator = delayed(delay, ideal_drive=ideal_drive)
    return design_controller(actuator, TABLE, servo_map(), bandwidth=30.0)


def believed() -> PlantUnderTest:
    """A plant that is what the controller believes."""
    return PlantUnderTest(servo(), TABLE)


def reference(position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray) -> SimpleNamespace:
    time = np.arange(position.size) / RATE
    return SimpleNamespace(time=time, position=position, velocity=velocity, acceleration=acceleration)


def sine(amplitude: float, frequency: float, duration: float) -> SimpleNamespace:
    t, w = np.arange(round(duration * RATE)) / RATE, 2 * np.pi * frequency
    return reference(amplitude * np.sin(w * t), amplitude * w * np.cos(w * t), -amplitude * w**2 * np.sin(w * t))


def step(size: float, duration: float, delay: float = 0.02) -> SimpleNamespace:
    t = np.arange(round(duration * RATE)) / RATE
    return reference(np.where(t < delay, 0.0, size), np.zeros(t.size), np.zeros(t.size))


def rest(duration: float, position: float = 0.0) -> SimpleNamespace:
    """A smooth way from 0 to a position in the first 0.1 s, where it stays."""
    t = np.arange(round(duration * RATE)) / RATE
    s = np.minimum(t / 0.1, 1.0)
    return reference(
        position * (10 * s**3 - 15 * s**4 + 6 * s**5),
        position * (30 * s**2 - 60 * s**3 + 30 * s**4) / 0.1,
        position * (60 * s - 180 * s**2 + 120 * s**3) / 0.01,
    )
