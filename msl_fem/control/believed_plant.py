"""What the linear design believes: mass, spring and damper behind a lagging force, sampled, with computation delay.

After feedback linearization (Gutierrez and Ro, IEEE Trans. Magnetics 34(5), 1998, eqs. 15 to 18) the plant is
m x'' + c x' + k x = f, where f follows the commanded force u through the drive's lag, f' = w (u - f), and u acts
`delay` samples after the measurement that it answers.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.statespace import StateSpace
from msl_fem.errors import ActuatorError, InputError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BelievedPlant:
    """A mass on a suspension, moved by a commanded force.

    Attributes
    ----------
    mass, stiffness, damping : kg, N/m, N s/m
    lag : bandwidth of the drive in rad/s; inf where it is ideal
    period : s, of the loop
    delay : samples from a measurement to the command that answers it
    """

    mass: float
    stiffness: float
    damping: float
    lag: float
    period: float
    delay: int

    @property
    def lead(self) -> float:
        """Time in s from a measurement to the middle of its command's action: delay, half the hold, and the lag."""
        return (self.delay + 0.5) * self.period + 1.0 / self.lag

    def sampled(self, *, magnet_stiffness: float = 0.0) -> StateSpace:
        """Position over commanded force through a zero-order hold.

        States: position, velocity, force where the drive lags, then the queue of commands, the next to act first.
        `magnet_stiffness` in N/m is the slope dF/dx of a held current's force, which acts against the suspension.
        """
        return _sampled(self, magnet_stiffness)

    def motion(self, magnet_stiffness: float = 0.0) -> tuple[Array, Array]:
        """A and B of the continuous motion, states (position, velocity[, force])."""
        k, c, m = self.stiffness - magnet_stiffness, self.damping, self.mass
        a, b = np.array([[0.0, 1.0], [-k / m, -c / m]]), np.array([[0.0], [1.0 / m]])
        if math.isinf(self.lag):
            return a, b
        return np.block([[a, b], [np.zeros((1, 2)), -np.eye(1) * self.lag]]), np.array([[0.0], [0.0], [self.lag]])


@lru_cache(maxsize=256)
def _sampled(plant: BelievedPlant, magnet_stiffness: float) -> StateSpace:
    a, b = plant.motion(magnet_stiffness)
    moving = StateSpace(a, b, np.eye(1, a.shape[0]), np.zeros((1, 1))).sampled(plant.period)
    n, d = a.shape[0], plant.delay
    big_a, big_b = np.zeros((n + d, n + d)), np.zeros((n + d, 1))
    big_a[:n, :n] = moving.A
    big_a[n : n + d - 1, n + 1 :] = np.eye(max(d - 1, 0))
    if d:
        big_a[:n, n : n + 1] = moving.B
        big_b[-1] = 1.0
    else:
        big_b[:] = moving.B
    names = ("position", "velocity", "force")[:n] + tuple(f"queue_{j + 1}" for j in range(d))
    c, direct = np.eye(1, n + d), np.zeros((1, 1))
    return StateSpace(big_a, big_b, c, direct, plant.period, names, ("force_command",), ("position",))


def believed_plant(actuator: Actuator) -> BelievedPlant:
    """The linear plant that an actuator file describes.

    Raises
    ------
    ActuatorError : [motion], [drive], [controller] or [sides] is missing, or the drive is no current drive
    InputError : the loop is slower than the drive's lag or the suspension, so that no sample would see them
    """
    motion, drive, controller = actuator.motion, actuator.drive, actuator.controller
    for name, section in (
        ("motion", motion), ("drive", drive), ("controller", controller), ("sides", actuator.sides)
    ):  # fmt: skip
        if section is None:
            raise ActuatorError(f"{actuator.name}: section [{name}] is missing; a controller's design needs it")
    assert motion is not None
    assert drive is not None
    assert controller is not None
    if drive.kind != "current":
        raise ActuatorError(
            f"{actuator.name}: drive.kind is '{drive.kind}'; feedback linearization commands currents, "
            'use kind = "current"'
        )
    natural = math.sqrt(motion.stiffness / motion.moving_mass) / (2 * math.pi)
    if natural > controller.rate / 4:
        raise InputError(
            f"{actuator.name}: the suspension's {natural:.4g} Hz is too fast for a loop at {controller.rate:g} Hz; "
            "at least four samples a period are needed: raise controller.rate or lower motion.stiffness"
        )
    return BelievedPlant(
        mass=motion.moving_mass,
        stiffness=motion.stiffness,
        damping=motion.damping,
        lag=math.inf if drive.bandwidth is None else 2 * math.pi * drive.bandwidth,
        period=1.0 / controller.rate,
        delay=controller.delay_samples,
    )
