"""What the instruments read: noise and resolution at the sampling instants."""

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator

Array = NDArray[np.float64]


def position_reading(actuator: Actuator, sensed: Array, *, generator: np.random.Generator | None) -> Array:
    """The readings in m of a position that has passed the sensor's bandwidth: white noise, then rounding to its steps.

    `sensed` may have any shape; without a generator there is no noise.
    """
    sensor = actuator.position_sensor
    reading = np.array(sensed, dtype=float)
    if generator is not None and sensor.noise > 0:
        reading = reading + sensor.noise * generator.standard_normal(reading.shape)
    return np.round(reading / sensor.resolution) * sensor.resolution if sensor.resolution > 0 else reading


def current_reading(actuator: Actuator, current: Array, *, generator: np.random.Generator | None) -> Array:
    """The readings in A of the sides' currents, of any shape: white noise; without a generator none."""
    reading = np.array(current, dtype=float)
    if generator is None or actuator.current_sensor.noise == 0:
        return reading
    return reading + actuator.current_sensor.noise * generator.standard_normal(reading.shape)
