"""The plant sample by sample, for loops that run compiled with it: state and command in, readings out.

A loop reads, decides and acts:

    state, history = plant_at_rest(plant)
    for k in range(n):
        read(plant, state, history, k, noise[k], readings)      # (position m, currents of the sides A)
        ...                                                     # readings -> command
        status = act(plant, state, command, disturbance[k], voltage)

Fed the commands of an open-loop run, the readings are those of `simulate`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.plant.effects import PARAMETER_INDEX, EffectValues, neutral_vector
from msl_fem.plant.effects.mechanical import MODE_READING
from msl_fem.plant.effects.mechanisms import position_delay
from msl_fem.plant.effects.sensing import SENSOR_BANDWIDTH
from msl_fem.plant.extended import effect_coefficients
from msl_fem.plant.kernel import advance
from msl_fem.plant.layout import (
    COIL_1,
    COIL_SLOPE_1,
    COIL_START_1,
    MODE,
    MODE_RATE,
    SENSOR,
    V,
    X,
    initial_state,
)
from msl_fem.plant.plant import PlantParameters, Surface, plant_parameters, surface_of
from msl_fem.plant.starting import start_effects
from msl_fem.plant.step_size import (
    STEP_OF_FASTEST,
    fastest_rate,
    fastest_rate_of_effects,
    steps_a_sample,
)
from msl_fem.table.magnetic_table import MagneticTable

Array = NDArray[np.float64]

N_READING = 3
"""Of a sample: position, currents of side 1 and 2."""
# Columns of the history: the channels in the order of the readings, their slopes behind a sample and before it
_AFTER, _BEFORE, _N_HISTORY = N_READING, 2 * N_READING, 3 * N_READING


class Instruments(NamedTuple):
    """What the instruments do, see `readings.py`.

    The channels stand in the order of the readings. A reading is polynomial(y) + drift(t) + hum(t) + noise, with y the
    channel `delay` samples ago.
    """

    rate: float  # samples a second
    delay: Array  # (N_READING,) in samples
    polynomial: Array  # (N_READING, 4): constant, linear, quadratic, cubic
    drift: Array  # (3,) of t, t^2, t^3, on the position
    hum: Array  # (N_READING, 2): cosine, sine
    hum_frequency: float  # rad/s
    resolution: float  # m, of the position; 0: none


class PlantInLoop(NamedTuple):
    """All that `read` and `act` take of a plant."""

    surface: Surface
    parameters: PlantParameters
    effects: Array | None  # (N_COEFFICIENT,) of the kernel
    instruments: Instruments
    step: float  # s
    n_step: int  # a sample


def plant_in_loop(
    actuator: Actuator, table: MagneticTable | None, *, rate: float, effects: EffectValues | None = None,
    largest_step: float = STEP_OF_FASTEST,
) -> PlantInLoop:  # fmt: skip
    """The plant of an actuator, with or without effects, that is sampled at `rate` (Hz).

    `largest_step` is the largest Runge-Kutta step times the fastest rate; the default is that of `simulate`.

    Raises
    ------
    InputError : a section of the actuator is missing, magnets without a table, the plant cannot have one of the effects
    """
    parameters = plant_parameters(actuator)
    if parameters.sides and table is None:
        raise InputError(f"{actuator.name} has magnets and there is no table; make one with 'msl-fem table'")
    surface = surface_of(table if parameters.sides else None)
    fastest = fastest_rate(parameters, table)
    if effects is not None:
        fastest = max(fastest, fastest_rate_of_effects(parameters, effects))
    n_step = steps_a_sample(fastest, rate=rate, largest_step=largest_step)
    step = 1.0 / (rate * n_step)
    coefficients = None
    if effects is not None:
        coefficients = effect_coefficients(parameters, surface, effects, step=step, n_step=n_step)
    vector = neutral_vector() if effects is None else effects.vector()
    instruments = instruments_of(vector, rate=rate, resolution=actuator.position_sensor.resolution)
    return PlantInLoop(surface, parameters, coefficients, instruments, step, n_step)


def plant_at_rest(
    plant: PlantInLoop, *, currents: tuple[float, float] = (0.0, 0.0), position: float | None = None
) -> tuple[Array, Array]:
    """(state, history) of a plant that does not move, memories of its effects fresh.

    `position` is in m; without one it is where the suspension holds the mover without currents (0 where there is none).
    """
    p = plant.parameters
    if position is None:
        position = p.constant_force / p.stiffness if p.stiffness > 0 else 0.0
    state = initial_state(p, float(currents[0]), float(currents[1]), float(position), 0.0)
    if plant.effects is not None:
        start_effects(plant.surface, p, plant.effects, state)
    depth = 2 + int(np.ceil(plant.instruments.delay.max()))
    return state, np.zeros((depth, _N_HISTORY))


def reading_noise(actuator: Actuator, n_sample: int, *, generator: np.random.Generator | None) -> Array:
    """White noise of the readings, (n_sample, N_READING) m and A, drawn in the order of `simulate`; without a generator
    zeros."""
    noise = np.zeros((n_sample, N_READING))
    if generator is None:
        return noise
    sides = actuator.sides.count if actuator.sides else 0
    if actuator.position_sensor.noise > 0:
        noise[:, 0] = actuator.position_sensor.noise * generator.standard_normal(n_sample)
    if actuator.current_sensor.noise > 0 and sides:
        noise[:, 1 : 1 + sides] = actuator.current_sensor.noise * generator.standard_normal((n_sample, sides))
    return noise


@compiled
def read(plant: PlantInLoop, state: Array, history: Array, k: int, noise: Array, readings: Array) -> None:
    """What the instruments read at sample k = 0, 1, 2 ..., before its command acts, into readings (N_READING,).

    `noise` (N_READING,) in m and A is added; `history` remembers what delayed channels need, so call it once a sample.
    """
    it = plant.instruments
    depth = history.shape[0]
    row, before = history[k % depth], history[(k - 1) % depth]
    row[0] = state[SENSOR]
    row[_AFTER] = row[_BEFORE] = _sensor_slope(plant.parameters, plant.effects, state)
    for j in range(2):
        row[1 + j] = state[COIL_1 + j]
        row[_BEFORE + 1 + j] = state[COIL_SLOPE_1 + j]
        if k > 0:
            before[_AFTER + 1 + j] = state[COIL_START_1 + j]
    time = k / it.rate
    cosine, sine = np.cos(it.hum_frequency * time), np.sin(it.hum_frequency * time)
    for n in range(N_READING):
        y, a = _delayed(history, k, n, it.delay[n], it.rate), it.polynomial[n]
        reading = a[0] + y * (a[1] + y * (a[2] + y * a[3]))
        reading += it.hum[n, 0] * cosine + it.hum[n, 1] * sine
        if n == 0:
            reading += time * (it.drift[0] + time * (it.drift[1] + time * it.drift[2]))
        readings[n] = reading + noise[n]
    if it.resolution > 0.0:
        readings[0] = np.round(readings[0] / it.resolution) * it.resolution
    for n in range(1 + plant.parameters.sides, N_READING):
        readings[n] = 0.0


@compiled
def act(plant: PlantInLoop, state: Array, command: Array, disturbance: float, voltage: Array) -> int:
    """`kernel.advance` over one sample: OK with the state moved on, or why not.

    command (2,) A, V or N by the drive's kind and `disturbance` (N on the mass) are held; voltage (2,) receives the
    mean voltages of the sides in V, in force drive the mean force in N.
    """
    status = advance(
        plant.surface, plant.parameters, plant.effects, state, command, disturbance, plant.step, plant.n_step, voltage
    )  # fmt: skip
    return int(status)


@compiled
def _sensor_slope(p: PlantParameters, effects: Array | None, state: Array) -> float:
    """Slope in time of the sensor's answer, m/s."""
    if effects is None:
        x, v, bandwidth = state[X], state[V], p.sensor_bandwidth
    else:
        share, bandwidth = effects[MODE_READING], effects[SENSOR_BANDWIDTH]
        x, v = state[X] + share * state[MODE], state[V] + share * state[MODE_RATE]
    if np.isinf(bandwidth):
        return float(v)
    return float(bandwidth * (x - state[SENSOR]))


@compiled
def _delayed(history: Array, k: int, n: int, delay: float, rate: float) -> float:
    """Channel n as it was `delay` samples before sample k, by the cubic of `readings.delayed`; before the first one,
    its value there."""
    depth = history.shape[0]
    at = max(k - delay, 0.0)
    low = int(at)
    s = at - low
    begin = history[low % depth]
    if s == 0.0:
        return float(begin[n])
    end = history[(low + 1) % depth]
    hermite = begin[n] * (1 + 2 * s) + begin[_AFTER + n] / rate * s
    return float((1 - s) ** 2 * hermite + s**2 * (end[n] * (3 - 2 * s) - end[_BEFORE + n] / rate * (1 - s)))


def instruments_of(effects: Array, *, rate: float, resolution: float = 0.0) -> Instruments:
    """The instruments of parameters (N_PARAMETER,) of the catalogue, at `rate` samples a second."""
    v = {key: float(effects[n]) for key, n in PARAMETER_INDEX.items()}
    polynomial, hum = np.zeros((N_READING, 4)), np.zeros((N_READING, 2))
    bent = "position_sensor_nonlinearity"
    polynomial[0] = v["sensor_drift", "offset"], 1.0 + v[bent, "gain_error"], v[bent, "quadratic"], v[bent, "cubic"]
    for j in (1, 2):
        polynomial[j, :2] = v["current_sensor_error", f"offset_{j}"], 1.0 + v["current_sensor_error", f"gain_{j}"]
    for n, channel in enumerate(("position", "current", "current")):
        hum[n] = [v["periodic_disturbance", f"{channel}_{part}"] for part in ("cosine", "sine")]
    late = [position_delay(v), v["time_delay", "current"], v["time_delay", "current"]]
    drift = [v["sensor_drift", "rate"], v["sensor_drift", "acceleration"] / 2, v["sensor_drift", "jerk"] / 6]
    return Instruments(
        rate=rate,
        delay=rate * np.array(late),
        polynomial=polynomial,
        drift=np.array(drift),
        hum=hum,
        hum_frequency=2 * np.pi * v["periodic_disturbance", "frequency"],
        resolution=resolution,
    )
