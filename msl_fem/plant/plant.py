"""The plant as the compiled kernel takes it: plain numbers of an actuator and plain arrays of a table."""

import math
from typing import NamedTuple

import numpy as np

from msl_fem.actuator import Actuator, Motion
from msl_fem.computing.arrays import Array
from msl_fem.computing.quintic_cell import expanded
from msl_fem.errors import ActuatorError
from msl_fem.table.coenergy_surface import CoenergySurface
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_surface import PairSurface

CURRENT_DRIVE, VOLTAGE_DRIVE, FORCE_DRIVE = 0, 1, 2
WITHOUT_SPRING = 20.0
"""Hz, at which a mover without a spring is thought to swing where something is told over a spring."""
_DRIVE_CODE = {"current": CURRENT_DRIVE, "voltage": VOLTAGE_DRIVE, "force": FORCE_DRIVE}


class MutualSurface(NamedTuple):
    """The arrays of a `PairSurface`: nodes of the position (m) and of both magnets' currents (A), (n,) each.

    `coefficients` (n_cell, N_CELL) are those of `computing.quintic_cell.expanded`.
    """

    position: Array
    current_1: Array
    current_2: Array
    coefficients: Array


class Surface(NamedTuple):
    """The arrays of a `CoenergySurface`: gap (n_gap,) m, current (n_current,) A, coefficients of the cells.

    For lanes, coefficients may have an axis more in front: surfaces over the same nodes. `mutual` is what the armature
    of two sides adds to them, None where they are taken apart.
    """

    gap: Array
    current: Array
    coefficients: Array
    mutual: MutualSurface | None = None


class EndStop(NamedTuple):
    """Where the mover is thrown back, plus and minus (m), and its velocity after over that before."""

    position: float
    restitution: float


class PlantParameters(NamedTuple):
    """What the kernel knows of an actuator, in SI units; `inf` switches a bandwidth or a limit off.

    Magnets of a side, n of them, all carry `current_share` times the side's current (1 in series, 1/n in parallel).
    From equal magnets follow, for either connection: flux linkage of the side n share lambda, its incremental
    inductance n share^2 dlambda/di, its force n F, its resistance n share^2 R.
    """

    mass: float  # kg
    stiffness: float  # N/m
    damping: float  # N s/m
    constant_force: float  # N, along +x
    nominal_gap: float  # m
    travel: float  # m, plus and minus: beyond it the run ends
    sides: int  # 0 (force drive), 1 or 2
    magnets: int  # a side
    current_share: float  # magnet current over side current
    resistance: float  # ohm, of a side
    drive: int  # CURRENT_DRIVE, VOLTAGE_DRIVE or FORCE_DRIVE
    bandwidth: float  # rad/s, of the drive
    voltage_limit: float  # V, of a side
    current_limit: float  # A, of a side
    sensor_bandwidth: float  # rad/s, of the position sensor
    end_stop: EndStop | None  # None: the run ends where the travel does
    leakage_1: float = 0.0  # H, of side 1: flux linkage without force, beside the table's
    leakage_2: float = 0.0
    mutual: float = 0.0  # H, of both sides: flux linkage of each for the other's current, without force
    input_gain_1: float = 1.0  # what drives side 1, over the command or column that states it
    input_gain_2: float = 1.0
    input_zero_1: float = 0.0  # what drives side 1 (A, V, N) where that is 0
    input_zero_2: float = 0.0
    polarity: float = 1.0  # of side 2's currents over those of a pair's table: -1 where positive currents oppose
    inductance: float = 1.0  # H, of a side at the nominal gap without current; leakage and mutual are stated over it


def plant_parameters(actuator: Actuator) -> PlantParameters:
    """The kernel's parameters of an actuator.

    Raises
    ------
    ActuatorError : [motion], [drive], or with a magnet [sides] is missing
    """
    motion, drive = actuator.motion, actuator.drive
    if motion is None:
        raise ActuatorError(f"{actuator.name}: section [motion] is missing; the coupled model needs the moving mass")
    if drive is None:
        raise ActuatorError(
            f"{actuator.name}: section [drive] is missing; the coupled model needs its kind (current, voltage or force)"
        )
    magnetic = drive.kind != "force"
    if magnetic and actuator.sides is None:
        raise ActuatorError(f"{actuator.name}: section [sides] is missing; the coupled model needs count and magnets")
    sides = actuator.sides if magnetic else None
    magnets = sides.magnets_per_side if sides else 1
    share = 1.0 / magnets if sides and sides.connection == "parallel" else 1.0
    return PlantParameters(
        mass=motion.moving_mass,
        stiffness=motion.stiffness,
        damping=motion.damping,
        constant_force=motion.constant_force,
        nominal_gap=float(motion.nominal_gap or math.inf),
        travel=_travel(motion),
        sides=int(sides.count) if sides else 0,
        magnets=magnets,
        current_share=share,
        resistance=magnets * share**2 * actuator.coil_resistance() if magnetic else 0.0,
        drive=_DRIVE_CODE[drive.kind],
        bandwidth=_angular(drive.bandwidth),
        voltage_limit=float(drive.voltage_limit or math.inf),
        current_limit=float(drive.current_limit or math.inf),
        sensor_bandwidth=_angular(actuator.position_sensor.bandwidth),
        polarity=-1.0 if sides and sides.polarity == "opposing" else 1.0,
        end_stop=EndStop(motion.end_stop, motion.end_stop_restitution or 0.0) if motion.end_stop else None,
    )


def surface_of(table: MagneticTable | None) -> Surface:
    """The arrays of the table's interpolant; None (a rig without magnets) gives a surface that is never evaluated."""
    if table is None:
        return Surface(np.zeros(2), np.zeros(2), np.zeros((1, 1, 6, 6)))
    surface = as_surface(table.surface)
    return surface._replace(mutual=_mutual_surface(table.shared.surface)) if table.shared else surface


def as_surface(fitted: CoenergySurface) -> Surface:
    """The arrays of an interpolant, for compiled functions."""
    arrays = fitted.gap, fitted.current, fitted.coefficients
    gap, current, coefficients = (np.array(a, dtype=np.float64, order="C") for a in arrays)
    return Surface(gap, current, coefficients)


def _mutual_surface(surface: PairSurface) -> MutualSurface:
    """The arrays of the surface, for compiled functions."""
    nodes = surface.position, surface.current_1, surface.current_2
    x, i, j = (np.array(a, dtype=np.float64, order="C") for a in nodes)
    return MutualSurface(x, i, j, expanded(x, i, j, surface.hermite))


def _angular(frequency: float | None) -> float:
    return math.inf if frequency is None else 2 * math.pi * frequency


def _travel(motion: Motion) -> float:
    return float(motion.end_stop or motion.range or motion.nominal_gap or math.inf)


def own_stiffness(plant: PlantParameters) -> float:
    """N/m: the spring's, or where there is none that of one on which the mover would swing at `WITHOUT_SPRING`."""
    rate = 2 * math.pi * WITHOUT_SPRING
    return plant.stiffness if plant.stiffness > 0.0 else plant.mass * rate * rate


def drive_lags(plant: PlantParameters) -> bool:
    """Whether the currents cannot jump: not so in an ideal current drive."""
    return plant.drive != CURRENT_DRIVE or math.isfinite(plant.bandwidth)
