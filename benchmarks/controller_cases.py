"""The reference actuator, its designs, and references, for the benchmarks of the controller."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.control import (
    ClosedLoopRun,
    ControllerChoice,
    ControllerDesign,
    DesignModel,
    PlantUnderTest,
    design_model_of,
    designed,
)
from msl_fem.control.closed_loop import run_closed_loop
from msl_fem.errors import ComputationError, InputError
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.excitation import reference as excitation_reference
from msl_fem.table.magnetic_table import MagneticTable, read_table

Array = NDArray[np.float64]
ROOT = Path(__file__).parent.parent
DOCUMENT = ROOT / "docs" / "control.md"
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
TABLE: MagneticTable = read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")
SEED = 1


@cache
def regions() -> OperatingMap:
    return operating_map(TABLE)


def servo(**changes: dict[str, object]) -> Actuator:
    """The reference actuator with sections changed: servo(controller={"rate": 5000.0})."""
    return SERVO.model_copy(update={k: getattr(SERVO, k).model_copy(update=v) for k, v in changes.items()})


def belief(actuator: Actuator = SERVO) -> DesignModel:
    return design_model_of(actuator, TABLE, regions())


@cache
def design(kind: str = "lqr", *, feedforward: bool = True) -> ControllerDesign:
    return designed(belief(), ControllerChoice(kind, feedforward=feedforward))


@dataclass(frozen=True, eq=False)
class Track:
    """A reference as arrays."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array


def sine(amplitude: float, frequency: float, duration: float, *, rate: float = 2500.0) -> Track:
    t, w = np.arange(round(duration * rate)) / rate, 2 * np.pi * frequency
    return Track(t, amplitude * np.sin(w * t), amplitude * w * np.cos(w * t), -amplitude * w**2 * np.sin(w * t))


def step(size: float, duration: float = 0.3, *, start: float = 0.02, rate: float = 2500.0) -> Track:
    t = np.arange(round(duration * rate)) / rate
    return Track(t, np.where(t < start, 0.0, size), np.zeros(t.size), np.zeros(t.size))


def spec(text: str, *, rate: float = 2500.0) -> Track:
    found = excitation_reference(parse_excitation(text, unit="m"), rate=rate)
    return Track(found.time, found.position, found.velocity, found.acceleration)


def run(
    made: ControllerDesign, track: Track, *, actuator: Actuator = SERVO,
    effects: dict[str, dict[str, float]] | None = None, seed: int | None = SEED,
) -> ClosedLoopRun | None:  # fmt: skip
    """The run, None where the plant is not held."""
    plant = PlantUnderTest(actuator, TABLE, EffectValues(effects) if effects else None)
    generator = None if seed is None else np.random.default_rng(seed)
    try:
        return run_closed_loop(made, track, plant=plant, generator=generator)
    except (ComputationError, InputError):
        return None


def late_rms(found: ClosedLoopRun, *, after: float = 0.5, read: bool = False) -> float:
    """RMS in m of position (or its reading) less reference, from `after` s on."""
    late = found.time >= after
    shown = found.measured if read else found.position
    return float(np.sqrt(np.mean((shown - found.reference)[late] ** 2)))


def step_figures(found: ClosedLoopRun, size: float, *, start: float = 0.02) -> tuple[float, float]:
    """(overshoot over the step, settling time to 2 % in s)."""
    after = found.position[found.time >= start] / size
    outside = np.flatnonzero(np.abs(after - 1) > 0.02)
    return float(after.max() - 1), float((outside[-1] + 1) * (found.time[1] - found.time[0])) if outside.size else 0.0
