"""The linear plant of a controller's design: a mass on a suspension behind the lag and the delay of its drive."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.computing.statespace import StateSpace
from msl_fem.control.current_loop import CurrentLoopDesign
from msl_fem.control.held_input import delayed_hold
from msl_fem.errors import ActuatorError, InputError

_LEAST_LAG = 1e-3  # of a period


@dataclass(frozen=True)
class LinearPlant:
    """A mass on a suspension, moved by a commanded force.

    Attributes
    ----------
    mass, stiffness, damping : kg, N/m, N s/m
    lag : bandwidth of the drive in rad/s; inf where it is ideal
    period : s, of the loop
    delay : samples from a measurement to the command that answers it
    dead_time : s of 1/lag that are a pure delay of the drive; the states of a controller take them for a part of the
        lag, its sensitivity, margins and response are computed with the delay
    """

    mass: float
    stiffness: float
    damping: float
    lag: float
    period: float
    delay: int
    dead_time: float = 0.0

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

    def driven(self, *, magnet_stiffness: float = 0.0) -> StateSpace:
        """`sampled` with the drive's delay as one: a further state is the command before."""
        return _driven(self, magnet_stiffness)

    def prompt_lag(self) -> float:
        """rad/s of the lag without its pure delay."""
        return 1.0 / max(1.0 / self.lag - self.dead_time, _LEAST_LAG * self.period) if self.dead_time else self.lag

    def motion(self, magnet_stiffness: float = 0.0) -> tuple[Array, Array]:
        """A and B of the continuous motion, states (position, velocity[, force])."""
        k = self.stiffness - magnet_stiffness
        c = self.damping
        m = self.mass
        a = np.array([[0.0, 1.0], [-k / m, -c / m]])
        b = np.array([[0.0], [1.0 / m]])
        if math.isinf(self.lag):
            return a, b
        return np.block([[a, b], [np.zeros((1, 2)), -np.eye(1) * self.lag]]), np.array([[0.0], [0.0], [self.lag]])


@lru_cache(maxsize=256)
def _driven(plant: LinearPlant, magnet_stiffness: float) -> StateSpace:
    a, b = replace(plant, lag=plant.prompt_lag()).motion(magnet_stiffness)
    return delayed_hold(a, b, plant.period, plant.dead_time, plant.delay)


@lru_cache(maxsize=256)
def _sampled(plant: LinearPlant, magnet_stiffness: float) -> StateSpace:
    late = _driven(replace(plant, dead_time=0.0), magnet_stiffness)
    moving = ("position", "velocity", "force")[: late.A.shape[0] - plant.delay]
    names = moving + tuple(f"queue_{j + 1}" for j in range(plant.delay))
    return replace(late, states=names, inputs=("force_command",), outputs=("position",))


def linear_plant(actuator: Actuator, current_loop: CurrentLoopDesign | None = None) -> LinearPlant:
    """The linear plant that an actuator file describes; around a voltage drive with its current loop's measured lag.

    Raises
    ------
    ActuatorError : [motion], [drive], [controller] or [sides] is missing, or the drive is neither a current drive nor a
        voltage drive with a current loop
    InputError : the loop is slower than the drive's lag or the suspension, so that no sample would see them
    """
    motion = actuator.motion
    drive = actuator.drive
    controller = actuator.controller
    for name, section in (("motion", motion), ("drive", drive), ("controller", controller), ("sides", actuator.sides)):
        if section is None:
            raise ActuatorError(f"{actuator.name}: section [{name}] is missing; a controller's design needs it")
    assert motion is not None
    assert drive is not None
    assert controller is not None
    if drive.kind != "current" and current_loop is None:
        raise ActuatorError(
            f"{actuator.name}: drive.kind is '{drive.kind}'; feedback linearization commands currents, "
            'use kind = "current", or kind = "voltage" with a table, on which the current loop rests'
        )
    natural = math.sqrt(motion.stiffness / motion.moving_mass) / (2 * math.pi)
    if natural > controller.rate / 4:
        raise InputError(
            f"{actuator.name}: the suspension's {natural:.4g} Hz is too fast for a loop at {controller.rate:g} Hz; "
            "at least four samples a period are needed: raise controller.rate or lower motion.stiffness"
        )
    lag = math.inf if drive.bandwidth is None else 2 * math.pi * drive.bandwidth
    dead_time = 0.0
    if current_loop is not None:
        lag = 1.0 / current_loop.lag
        dead_time = min(current_loop.dead_time, current_loop.lag)
    return LinearPlant(
        mass=motion.moving_mass,
        stiffness=motion.stiffness,
        damping=motion.damping,
        lag=lag,
        period=1.0 / controller.rate,
        delay=controller.delay_samples,
        dead_time=dead_time,
    )
