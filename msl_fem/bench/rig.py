"""The rig on the bench: its plant, its magnets' table, its instruments."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.bench import plant as parts
from msl_fem.bench.plant import CURRENT_DRIVE, FORCE_DRIVE, VOLTAGE_DRIVE, Plant, Surface
from msl_fem.bench.truth import Truth, true_table
from msl_fem.errors import ActuatorError, InputError
from msl_fem.table.magnetic_table import MagneticTable

DRIVES = {"current": CURRENT_DRIVE, "voltage": VOLTAGE_DRIVE, "force": FORCE_DRIVE}


@dataclass(frozen=True)
class Instruments:
    """What is wrong with the readings beside noise; every value at its default is an ideal instrument.

    Attributes
    ----------
    current_gain, current_offset : of the current reading, A
    play : half width of the position reading's play, m
    drift, drift_seed : RMS of the position zero's wander, m, and the seed of its path
    """

    current_gain: float = 1.0
    current_offset: float = 0.0
    play: float = 0.0
    drift: float = 0.0
    drift_seed: int = 0


@dataclass(frozen=True, eq=False)
class Rig:
    """A plant with what stands around it.

    Attributes
    ----------
    plant : its equations' parameters
    table : of one magnet, as it truly is; None without magnets
    delay : between a command and the amplifier, s
    random_force, random_force_seed : RMS of a force that nobody asked for, N, and the seed of its path
    """

    name: str
    plant: Plant
    table: MagneticTable | None
    instruments: Instruments = field(default_factory=Instruments)
    delay: float = 0.0
    random_force: float = 0.0
    random_force_seed: int = 0

    def with_parts(self, **pieces: Any) -> "Rig":
        """The rig with pieces of its plant replaced."""
        return replace(self, plant=self.plant._replace(**pieces))


def true_rig(actuator: Actuator, table: MagneticTable | None, truth: Truth | None = None) -> Rig:
    """The rig with every effect off; at `truth` None its parameters are the believed ones.

    Raises
    ------
    ActuatorError : a section of the actuator is missing
    InputError : a current drive without a bandwidth, no table for magnets
    """
    truth = truth or Truth()
    motion, drive = actuator.motion, actuator.drive
    if motion is None or drive is None:
        missing = "[motion]" if motion is None else "[drive]"
        raise ActuatorError(f"{actuator.name}: section {missing} is missing; the bench needs it")
    magnetic = drive.kind != "force"
    if magnetic and actuator.sides is None:
        raise ActuatorError(f"{actuator.name}: section [sides] is missing; the bench needs count and magnets")
    if magnetic and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    if drive.kind == "current" and drive.bandwidth is None:
        raise InputError(
            f"{actuator.name}: drive.bandwidth is missing; no amplifier makes a current jump, state its bandwidth"
        )
    gap = float(motion.nominal_gap or math.inf) * truth.nominal_gap
    travel = float(motion.range or motion.nominal_gap or math.inf)
    plant = Plant(
        magnets=_magnets(actuator if magnetic else None, gap),
        circuit=parts.Circuit(
            DRIVES[drive.kind], _resistance(actuator) * truth.coil_resistance if magnetic else 0.0,
            _angular(drive.bandwidth), float(drive.voltage_limit or math.inf), float(drive.current_limit or math.inf),
        ),
        amplifier=parts.Amplifier(0.0, 0.7, math.inf, 0.0, 1.0),
        ladder=parts.Ladder(0, 0.0, 1.0),
        hysteresis=parts.Hysteresis(0.0, 1.0, 4.0),
        series_iron=parts.SeriesIron(0.0, np.zeros(parts.IRON_NODES), np.zeros(parts.IRON_NODES)),
        coupling=0.0,
        thermal=parts.Thermal(0.0, 0.0, 1.0, 1.0),
        motion=parts.Motion(
            motion.moving_mass * truth.moving_mass, motion.stiffness * truth.stiffness, motion.damping * truth.damping,
            motion.constant_force, travel,
        ),
        flexure=parts.Flexure(0.0, 1.0, 0, np.zeros(parts.MOST_BRANCHES), np.zeros(parts.MOST_BRANCHES)),
        friction=parts.Friction(0.0, 0.0, 1.0, 0.0, 0.0),
        film=parts.Film(0.0, gap),
        attached=parts.Attached(0.0, 0.0, 0.0),
        support=parts.Support(0.0, 0.0, 0.0),
        disturbance=parts.Disturbance(*9 * (0.0,))._replace(cogging_period=1.0),
        reading=parts.Reading(truth.position_gain, 0.0, np.zeros(2), _angular(actuator.position_sensor.bandwidth)),
        layout=parts.Layout(*8 * (-1,), parts.N_COMMON),
    )  # fmt: skip
    return Rig(actuator.name, plant, None if table is None else true_table(table, truth))


def _magnets(actuator: Actuator | None, gap: float) -> parts.Magnets:
    if actuator is None or actuator.sides is None:
        return parts.Magnets(0, 1, 1.0, gap)
    n = actuator.sides.magnets_per_side
    return parts.Magnets(int(actuator.sides.count), n, 1.0 / n if actuator.sides.connection == "parallel" else 1.0, gap)


def _resistance(actuator: Actuator) -> float:
    """Of a side, ohm: its magnets in series or in parallel."""
    assert actuator.sides is not None
    n = actuator.sides.magnets_per_side
    return actuator.coil_resistance() * (n if actuator.sides.connection == "series" else 1 / n)


def _angular(frequency: float | None) -> float:
    return math.inf if frequency is None else 2 * math.pi * frequency


def surface_of(table: MagneticTable | None) -> Surface:
    """The table's interpolant as compiled functions take it; without a table one that is never evaluated."""
    if table is None:
        return Surface(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((1, 1, 6, 6)))
    s = table.surface
    return Surface(*(np.array(a, dtype=np.float64, order="C") for a in (s.gap, s.current, s.coefficients)))
